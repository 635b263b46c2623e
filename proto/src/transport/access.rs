//! Which node may publish, subscribe, query and answer on which keys, as Zenoh's access control: everything else is
//! denied.
//!
//! A node is known by the common name of its certificate, which stands for exactly one node, or for
//! all readers. Directions are those of the node that the rules are for: `ingress` comes in.

use super::ZenohSetting;
use super::json::{list, quoted};
use crate::key::Keys;

/// Fusion's name among the nodes.
pub const FUSION: &str = "fusion";
/// The common name of all readers: they may subscribe to poses, events and statuses, and publish nothing.
pub const READER: &str = "reader";

/// The recorder node's name: it may subscribe to everything, and publishes nothing.
pub const RECORDER: &str = "recorder";

/// The common name in the certificate of `node`: its name under the venue's, so that an authority
/// that serves two venues lets no node into the other one.
pub fn common_name(venue: &str, node: &str) -> String {
    format!("{venue}/{node}")
}

/// All kinds of messages that Zenoh's access control knows.
const ALL_MESSAGES: [&str; 9] = [
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
];
const SUBSCRIBE: [&str; 1] = ["declare_subscriber"];
const PUBLISH: [&str; 1] = ["put"];
const DECLARE_TOKEN: [&str; 1] = ["liveliness_token"];
const WATCH_TOKENS: [&str; 2] = ["declare_liveliness_subscriber", "liveliness_query"];
const QUERY: [&str; 1] = ["query"];
const ANSWER: [&str; 2] = ["reply", "declare_queryable"];

/// One allowance.
struct Rule<'a> {
    flow: &'static str,
    messages: &'a [&'static str],
    keys: Vec<String>,
}

/// Rules that come in and rules that go out.
fn rules<const N: usize, const M: usize>(
    ingress: [(&'static [&'static str], Vec<String>); N],
    egress: [(&'static [&'static str], Vec<String>); M],
) -> Vec<Rule<'static>> {
    let of = |flow| {
        move |(messages, keys)| Rule {
            flow,
            messages,
            keys,
        }
    };
    let ingress = ingress.into_iter().map(of("ingress"));
    ingress
        .chain(egress.into_iter().map(of("egress")))
        .collect()
}

/// What a viewpoint may do at fusion.
fn of_edge(keys: &Keys, viewpoint: &str) -> Vec<Rule<'static>> {
    let published = vec![
        keys.patch(viewpoint),
        keys.sighting(viewpoint),
        keys.status(viewpoint),
    ];
    let received = vec![keys.boxes(viewpoint), keys.status(FUSION)];
    rules(
        [
            (&PUBLISH, published),
            (&SUBSCRIBE, received.clone()),
            (&DECLARE_TOKEN, vec![keys.alive(viewpoint)]),
            (&WATCH_TOKENS, vec![keys.alive(FUSION)]),
            (&QUERY, vec![keys.config()]),
            (&ANSWER, vec![keys.fill(viewpoint)]),
        ],
        [
            (&PUBLISH, received),
            (
                &SUBSCRIBE,
                vec![keys.patches(), keys.sightings(), keys.statuses()],
            ),
            (&DECLARE_TOKEN, vec![keys.alive(FUSION)]),
            (&WATCH_TOKENS, vec![keys.all_alive()]),
            (&QUERY, vec![keys.fill(viewpoint)]),
            (&ANSWER, vec![keys.config()]),
        ],
    )
}

/// What a reader may do at fusion.
fn of_reader(keys: &Keys) -> Vec<Rule<'static>> {
    let received = vec![keys.pose(), keys.smooth(), keys.event(), keys.statuses()];
    rules(
        [
            (&SUBSCRIBE, received.clone()),
            (&WATCH_TOKENS, vec![keys.all_alive()]),
        ],
        [
            (&PUBLISH, received),
            (&DECLARE_TOKEN, vec![keys.all_alive()]),
        ],
    )
}

/// What the recorder may do at fusion.
fn of_recorder(keys: &Keys) -> Vec<Rule<'static>> {
    rules(
        [
            (&SUBSCRIBE, vec![keys.all()]),
            (&WATCH_TOKENS, vec![keys.all_alive()]),
        ],
        [
            (&PUBLISH, vec![keys.all()]),
            (&DECLARE_TOKEN, vec![keys.all_alive()]),
        ],
    )
}

/// Fusion's access control for edges at `viewpoints`, and for readers.
pub(super) fn at_fusion(venue: &str, viewpoints: &[&str]) -> ZenohSetting {
    let keys = Keys::new(venue);
    let mut subjects: Vec<(&str, Vec<Rule<'_>>)> = viewpoints
        .iter()
        .map(|viewpoint| (*viewpoint, of_edge(&keys, viewpoint)))
        .collect();
    subjects.push((READER, of_reader(&keys)));
    subjects.push((RECORDER, of_recorder(&keys)));
    setting(venue, &subjects)
}

/// An edge's access control: everything under the venue's name for fusion, nothing for others.
pub(super) fn at_edge(venue: &str) -> ZenohSetting {
    let all = vec![Keys::new(venue).all()];
    let rules = rules([(&ALL_MESSAGES, all.clone())], [(&ALL_MESSAGES, all)]);
    setting(venue, &[(FUSION, rules)])
}

fn setting(venue: &str, subjects: &[(&str, Vec<Rule<'_>>)]) -> ZenohSetting {
    let (mut rules, mut names, mut policies) = (Vec::new(), Vec::new(), Vec::new());
    for (node, allowed) in subjects {
        let mut ids = Vec::new();
        for rule in allowed {
            let id = format!("{node} {}", ids.len());
            rules.push(format!(
                "{{id:{},permission:\"allow\",flows:[{}],messages:{},key_exprs:{}}}",
                quoted(&id),
                quoted(rule.flow),
                list(rule.messages),
                list(&rule.keys),
            ));
            ids.push(id);
        }
        names.push(format!(
            "{{id:{},cert_common_names:{}}}",
            quoted(node),
            list(&[common_name(venue, node)]),
        ));
        policies.push(format!(
            "{{rules:{},subjects:{}}}",
            list(&ids),
            list(&[*node])
        ));
    }
    let value = format!(
        "{{enabled:true,default_permission:\"deny\",rules:[{}],subjects:[{}],policies:[{}]}}",
        rules.join(","),
        names.join(","),
        policies.join(","),
    );
    ("access_control".to_owned(), value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edge_publishes_under_its_own_name_only() {
        let keys = Keys::new("hall");
        for rule in of_edge(&keys, "ne") {
            if rule.flow == "ingress" && rule.messages == PUBLISH {
                assert_eq!(
                    rule.keys,
                    ["hall/patch/ne", "hall/sighting/ne", "hall/status/ne"]
                );
            }
            let deletes = rule.flow == "ingress" && rule.messages.contains(&"delete");
            assert!(!deletes);
        }
    }

    #[test]
    fn a_reader_and_the_recorder_publish_nothing() {
        let publishes = |rule: &Rule<'_>| {
            rule.flow == "ingress"
                && !rule
                    .messages
                    .iter()
                    .all(|m| SUBSCRIBE.contains(m) || WATCH_TOKENS.contains(m))
        };
        let keys = Keys::new("hall");
        assert!(!of_reader(&keys).iter().any(publishes));
        assert!(!of_recorder(&keys).iter().any(publishes));
    }

    #[test]
    fn fusion_sends_events_to_readers_and_not_to_edges() {
        let keys = Keys::new("hall");
        let publishes = |rules: Vec<Rule<'_>>| {
            let mut published = rules
                .iter()
                .filter(|rule| rule.flow == "egress" && rule.messages == PUBLISH);
            published.any(|rule| rule.keys.contains(&keys.event()))
        };
        assert!(publishes(of_reader(&keys)));
        assert!(!publishes(of_edge(&keys, "ne")));
    }

    #[test]
    fn names_of_one_venue_are_none_of_another() {
        let (_, access) = at_fusion("hall", &["ne"]);
        assert!(access.contains(r#"["hall/ne"]"#), "{access}");
        assert!(access.contains(r#"["hall/reader"]"#), "{access}");
    }
}
