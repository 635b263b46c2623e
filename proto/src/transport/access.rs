//! Zenoh's access control: which node may publish, subscribe, query and answer on which keys.
//! Everything else is denied.
//!
//! A node is identified by the common name of its certificate. The name belongs to exactly one node
//! and contains a generation; older generations are denied everything. Directions are those of the
//! node with the rules: `ingress` is incoming.

use super::generations::{AHEAD, BEHIND, Generations};
use super::{ZenohSetting, list, quoted};
use crate::key::Keys;

/// Fusion's name among the nodes.
pub const FUSION: &str = "fusion";
/// Prefix of all readers' common names: they may subscribe to poses, events and statuses, and
/// publish nothing.
pub const READER: &str = "reader";

/// The recorder node's name: it may subscribe to everything but thumbnails, and publishes nothing.
pub const RECORDER: &str = "recorder";

/// The common name in the certificate of `node` of this generation. It contains the venue's name,
/// so that an authority for two venues admits no node to the other one. Generation 0 is for
/// certificates made before generations were counted.
pub fn common_name(venue: &str, node: &str, generation: u32) -> String {
    match generation {
        0 => format!("{venue}/{node}"),
        generation => format!("{venue}/{node}/{generation}"),
    }
}

/// Node and generation of a common name.
pub fn generation_of(common_name: &str) -> Option<(&str, u32)> {
    let (_, node) = common_name.split_once('/')?;
    match node.rsplit_once('/') {
        Some((node, number)) => {
            let node = node
                .strip_prefix(READER)
                .and_then(|name| name.strip_prefix('/'))
                .unwrap_or(node);
            Some((node, number.parse().ok()?))
        }
        None => Some((node, 0)),
    }
}

/// The node name of the reader `name`, for [`common_name`].
pub fn reader(name: &str) -> String {
    format!("{READER}/{name}")
}

/// The admitted common names of `node`, if `newest` is the newest known generation.
fn admitted(venue: &str, node: &str, newest: u32) -> impl Iterator<Item = String> {
    (newest..=newest + AHEAD).map(move |generation| common_name(venue, node, generation))
}

/// The outdated common names.
fn outdated(venue: &str, node: &str, newest: u32) -> impl Iterator<Item = String> {
    (newest.saturating_sub(BEHIND)..newest)
        .map(move |generation| common_name(venue, node, generation))
}

/// All message kinds of Zenoh's access control.
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

/// A permission, or a denial, which has priority.
struct Rule<'a> {
    permission: &'static str,
    flow: &'static str,
    messages: &'a [&'static str],
    keys: Vec<String>,
}

/// Incoming and outgoing rules.
fn rules<const N: usize, const M: usize>(
    ingress: [(&'static [&'static str], Vec<String>); N],
    egress: [(&'static [&'static str], Vec<String>); M],
) -> Vec<Rule<'static>> {
    let of = |flow| {
        move |(messages, keys)| Rule {
            permission: "allow",
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

/// Permissions of a viewpoint at fusion.
fn edge_rules(keys: &Keys, viewpoint: &str) -> Vec<Rule<'static>> {
    let published = vec![
        keys.patch(viewpoint),
        keys.sighting(viewpoint),
        keys.thumbnail(viewpoint),
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
                vec![
                    keys.patches(),
                    keys.sightings(),
                    keys.thumbnails(),
                    keys.statuses(),
                ],
            ),
            (&DECLARE_TOKEN, vec![keys.alive(FUSION)]),
            (&WATCH_TOKENS, vec![keys.all_alive()]),
            (&QUERY, vec![keys.fill(viewpoint)]),
            (&ANSWER, vec![keys.config()]),
        ],
    )
}

/// Permissions of a reader at fusion.
fn reader_rules(keys: &Keys) -> Vec<Rule<'static>> {
    let received = vec![
        keys.pose(),
        keys.smooth(),
        keys.event(),
        keys.naming(),
        keys.statuses(),
    ];
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

/// Permissions of the recorder at fusion: everything but pictures.
fn recorder_rules(keys: &Keys) -> Vec<Rule<'static>> {
    let mut rules = rules(
        [
            (&SUBSCRIBE, vec![keys.all()]),
            (&WATCH_TOKENS, vec![keys.all_alive()]),
        ],
        [
            (&PUBLISH, vec![keys.all()]),
            (&DECLARE_TOKEN, vec![keys.all_alive()]),
        ],
    );
    rules.push(Rule {
        permission: "deny",
        flow: "egress",
        messages: &PUBLISH,
        keys: vec![keys.thumbnails()],
    });
    rules
}

/// Permissions of another fusion of the venue at fusion: only to detect that there is one, and
/// which.
fn other_fusion_rules(keys: &Keys) -> Vec<Rule<'static>> {
    let (status, alive) = (vec![keys.status(FUSION)], vec![keys.alive(FUSION)]);
    rules(
        [(&SUBSCRIBE, status.clone()), (&WATCH_TOKENS, alive.clone())],
        [(&PUBLISH, status), (&DECLARE_TOKEN, alive)],
    )
}

/// A group of common names and its permissions.
struct Subject {
    /// Its id in the settings.
    id: String,
    /// Common names of its certificates.
    names: Vec<String>,
    rules: Vec<Rule<'static>>,
}

/// The admitted certificates of `node` with their permissions, and the outdated ones.
fn subject(
    venue: &str,
    node: &str,
    generations: &Generations,
    rules: Vec<Rule<'static>>,
    old: &mut Vec<String>,
) -> Subject {
    let newest = generations.of(node);
    old.extend(outdated(venue, node, newest));
    Subject {
        id: node.to_owned(),
        names: admitted(venue, node, newest).collect(),
        rules,
    }
}

/// As [`subject`], for all readers: each has its own name, except for those made before generations
/// were counted.
fn readers(
    venue: &str,
    viewpoints: &[&str],
    generations: &Generations,
    rules: Vec<Rule<'static>>,
    old: &mut Vec<String>,
) -> Subject {
    let mut names = Vec::new();
    let is_other =
        |name: &&str| [FUSION, RECORDER, READER].contains(name) || viewpoints.contains(name);
    for name in generations.nodes().filter(|name| !is_other(name)) {
        let newest = generations.of(name);
        names.extend(admitted(venue, &reader(name), newest));
        old.extend(outdated(venue, &reader(name), newest).skip(1));
    }
    let shared = common_name(venue, READER, 0);
    let place = if names.is_empty() { &mut names } else { old };
    place.push(shared);
    Subject {
        id: READER.to_owned(),
        names,
        rules,
    }
}

/// Fusion's access control for edges at `viewpoints`, and for readers.
pub(super) fn at_fusion(
    venue: &str,
    viewpoints: &[&str],
    generations: &Generations,
) -> ZenohSetting {
    let keys = Keys::new(venue);
    let mut old = Vec::new();
    let mut of = |node: &str, rules| subject(venue, node, generations, rules, &mut old);
    let mut subjects: Vec<Subject> = viewpoints
        .iter()
        .map(|viewpoint| of(viewpoint, edge_rules(&keys, viewpoint)))
        .collect();
    subjects.push(of(FUSION, other_fusion_rules(&keys)));
    subjects.push(of(RECORDER, recorder_rules(&keys)));
    subjects.push(readers(
        venue,
        viewpoints,
        generations,
        reader_rules(&keys),
        &mut old,
    ));
    setting(venue, &subjects, &old)
}

/// The access control of a fusion without keys: every node may do everything, but pictures of
/// cameras are not sent beyond fusion.
pub(super) fn pictures_end_here(venue: &str) -> ZenohSetting {
    let value = format!(
        "{{enabled:true,default_permission:\"allow\",rules:[{{id:\"pictures\",permission:\"deny\",flows:[\"egress\"],\
         messages:{},key_exprs:{}}}],subjects:[{{id:\"all\"}}],policies:[{{rules:[\"pictures\"],subjects:[\"all\"]}}]}}",
        list(&PUBLISH),
        list(&[Keys::new(venue).thumbnails()]),
    );
    ("access_control".to_owned(), value)
}

/// An edge's access control: everything under the venue's name for fusion, nothing for others.
pub(super) fn at_edge(venue: &str, generations: &Generations) -> ZenohSetting {
    let all = vec![Keys::new(venue).all()];
    let rules = rules([(&ALL_MESSAGES, all.clone())], [(&ALL_MESSAGES, all)]);
    let mut old = Vec::new();
    let fusion = subject(venue, FUSION, generations, rules, &mut old);
    setting(venue, &[fusion], &old)
}

/// `old` names may do nothing. Without a subject of their own, Zenoh does not report which name it
/// denies.
fn setting(venue: &str, subjects: &[Subject], old: &[String]) -> ZenohSetting {
    let (mut rules, mut names, mut policies) = (Vec::new(), Vec::new(), Vec::new());
    let mut add = |id: &str, of: &[String], own: &[Rule<'_>]| {
        let mut ids = Vec::new();
        for rule in own {
            let name = format!("{id} {}", ids.len());
            rules.push(format!(
                "{{id:{},permission:{},flows:[{}],messages:{},key_exprs:{}}}",
                quoted(&name),
                quoted(rule.permission),
                quoted(rule.flow),
                list(rule.messages),
                list(&rule.keys),
            ));
            ids.push(name);
        }
        names.push(format!(
            "{{id:{},cert_common_names:{}}}",
            quoted(id),
            list(of)
        ));
        policies.push(format!("{{rules:{},subjects:{}}}", list(&ids), list(&[id])));
    };
    for Subject { id, names, rules } in subjects {
        add(id, names, rules);
    }
    if !old.is_empty() {
        let denied = ["ingress", "egress"].map(|flow| Rule {
            permission: "deny",
            flow,
            messages: &ALL_MESSAGES,
            keys: vec![Keys::new(venue).all()],
        });
        // No node has a blank in its name.
        add("too old", old, &denied);
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
        for rule in edge_rules(&keys, "ne") {
            if rule.flow == "ingress" && rule.messages == PUBLISH {
                assert_eq!(
                    rule.keys,
                    [
                        "hall/patch/ne",
                        "hall/sighting/ne",
                        "hall/thumbnail/ne",
                        "hall/status/ne"
                    ]
                );
            }
            let deletes = rule.flow == "ingress" && rule.messages.contains(&"delete");
            assert!(!deletes);
        }
    }

    #[test]
    fn a_reader_the_recorder_and_another_fusion_publish_nothing() {
        let publishes = |rule: &Rule<'_>| {
            rule.flow == "ingress"
                && !rule
                    .messages
                    .iter()
                    .all(|m| SUBSCRIBE.contains(m) || WATCH_TOKENS.contains(m))
        };
        let keys = Keys::new("hall");
        assert!(!reader_rules(&keys).iter().any(publishes));
        assert!(!recorder_rules(&keys).iter().any(publishes));
        assert!(!other_fusion_rules(&keys).iter().any(publishes));
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
        assert!(publishes(reader_rules(&keys)));
        assert!(!publishes(edge_rules(&keys, "ne")));
    }

    #[test]
    fn only_fusion_receives_thumbnails() {
        let keys = Keys::new("hall");
        let sent = |rules: Vec<Rule<'_>>| -> Vec<(&str, Vec<String>)> {
            let out = |rule: &Rule<'_>| rule.flow == "egress" && rule.messages == PUBLISH;
            let out = rules.into_iter().filter(out);
            out.map(|rule| (rule.permission, rule.keys)).collect()
        };
        let others = [
            edge_rules(&keys, "ne"),
            reader_rules(&keys),
            other_fusion_rules(&keys),
        ];
        for (_, keys) in others.into_iter().flat_map(sent) {
            assert!(
                keys.iter()
                    .all(|key| !key.contains("thumbnail") && !key.contains("**"))
            );
        }
        // The recorder gets everything else; a denial has priority.
        let recorder = sent(recorder_rules(&keys));
        assert!(recorder.contains(&("deny", vec!["hall/thumbnail/*".to_owned()])));
    }

    #[test]
    fn names_of_one_venue_are_not_valid_in_another() {
        let (_, access) = at_fusion("hall", &["ne"], &Generations::default());
        assert!(access.contains(r#"["hall/ne","hall/ne/1","#), "{access}");
        assert!(access.contains(r#"["hall/reader"]"#), "{access}");
        assert!(!access.contains("too old"), "{access}");
    }

    /// The common names of the subject `id` in a setting.
    fn names(access: &str, id: &str) -> String {
        let from = format!("{{id:\"{id}\",cert_common_names:[");
        let rest = access.split(&from).nth(1).unwrap_or_default();
        rest.split(']').next().unwrap_or_default().to_owned()
    }

    #[test]
    fn only_the_newest_and_later_generations_are_admitted() {
        let mut generations = Generations::default();
        for node in ["fusion", "ne", "ne", "screen", "screen"] {
            generations.renew(node);
        }
        let (_, access) = at_fusion("hall", &["ne", "nw"], &generations);
        assert!(names(&access, "ne").starts_with("\"hall/ne/2\",\"hall/ne/3\""));
        assert!(names(&access, "nw").starts_with("\"hall/nw\",\"hall/nw/1\""));
        assert!(names(&access, "reader").starts_with("\"hall/reader/screen/2\""));
        let old =
            "\"hall/ne\",\"hall/ne/1\",\"hall/fusion\",\"hall/reader/screen/1\",\"hall/reader\"";
        assert_eq!(names(&access, "too old"), old);
        let (_, access) = at_edge("hall", &generations);
        assert!(names(&access, "fusion").starts_with("\"hall/fusion/1\""));
        assert_eq!(names(&access, "too old"), "\"hall/fusion\"");
    }

    #[test]
    fn a_common_name_contains_its_generation() {
        for (node, generation) in [("ne", 0), ("ne", 7), ("fusion", 1)] {
            let name = common_name("hall", node, generation);
            assert_eq!(generation_of(&name), Some((node, generation)));
        }
        let screen = common_name("hall", &reader("screen"), 3);
        assert_eq!(generation_of(&screen), Some(("screen", 3)));
        assert_eq!(generation_of("hall/ne/x"), None);
    }
}
