//! Which node may publish, subscribe, query and answer on which keys, as Zenoh's access control: everything else is
//! denied.
//!
//! A node is known by the common name of its certificate, which stands for exactly one node, and says of which generation
//! it is: an older one is denied everything. Directions are those of the node that the rules are for: `ingress` comes in.

use super::ZenohSetting;
use super::generations::{AHEAD, BEHIND, Generations};
use super::json::{list, quoted};
use crate::key::Keys;

/// Fusion's name among the nodes.
pub const FUSION: &str = "fusion";
/// What the common names of all readers begin with: they may subscribe to poses, events and statuses, and publish nothing.
pub const READER: &str = "reader";

/// The recorder node's name: it may subscribe to everything but thumbnails, and publishes nothing.
pub const RECORDER: &str = "recorder";

/// The common name in the certificate of `node`, of this generation: under the venue's name, so that an authority that
/// serves two venues lets no node into the other one. Of generation 0 are those that were made before they were counted.
pub fn common_name(venue: &str, node: &str, generation: u32) -> String {
    match generation {
        0 => format!("{venue}/{node}"),
        generation => format!("{venue}/{node}/{generation}"),
    }
}

/// Of which node and generation a certificate of this common name is.
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

/// The reader `name` among the nodes, for [`common_name`].
pub fn reader(name: &str) -> String {
    format!("{READER}/{name}")
}

/// The common names of `node` that are admitted where `newest` is the newest generation that is known.
fn admitted(venue: &str, node: &str, newest: u32) -> impl Iterator<Item = String> {
    (newest..=newest + AHEAD).map(move |generation| common_name(venue, node, generation))
}

/// Those that are too old.
fn outdated(venue: &str, node: &str, newest: u32) -> impl Iterator<Item = String> {
    (newest.saturating_sub(BEHIND)..newest)
        .map(move |generation| common_name(venue, node, generation))
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

/// One allowance, or a refusal, which counts more.
struct Rule<'a> {
    permission: &'static str,
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

/// What a viewpoint may do at fusion.
fn of_edge(keys: &Keys, viewpoint: &str) -> Vec<Rule<'static>> {
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

/// What a reader may do at fusion.
fn of_reader(keys: &Keys) -> Vec<Rule<'static>> {
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

/// What the recorder may do at fusion: it gets everything but pictures.
fn of_recorder(keys: &Keys) -> Vec<Rule<'static>> {
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

/// What another fusion of the venue may do at fusion: find out that there is one, and which.
fn of_other_fusion(keys: &Keys) -> Vec<Rule<'static>> {
    let (status, alive) = (vec![keys.status(FUSION)], vec![keys.alive(FUSION)]);
    rules(
        [(&SUBSCRIBE, status.clone()), (&WATCH_TOKENS, alive.clone())],
        [(&PUBLISH, status), (&DECLARE_TOKEN, alive)],
    )
}

/// Who certain common names stand for, and what they may do.
struct Subject {
    /// How it is called among the settings.
    id: String,
    /// Of these certificates.
    names: Vec<String>,
    rules: Vec<Rule<'static>>,
}

/// The certificates of `node` that are admitted, with what they may do; and those that are too old.
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

/// The same for all readers: each has a name of its own, but for those that were made before generations were counted.
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
        .map(|viewpoint| of(viewpoint, of_edge(&keys, viewpoint)))
        .collect();
    subjects.push(of(FUSION, of_other_fusion(&keys)));
    subjects.push(of(RECORDER, of_recorder(&keys)));
    subjects.push(readers(
        venue,
        viewpoints,
        generations,
        of_reader(&keys),
        &mut old,
    ));
    setting(venue, &subjects, &old)
}

/// The access control of a fusion without keys: everybody may do all, but pictures of cameras go no farther than fusion
/// itself, whoever asks for them.
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

/// `old` are names that may do nothing: without a subject of their own Zenoh does not say whom it denies something.
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
        for rule in of_edge(&keys, "ne") {
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
        assert!(!of_reader(&keys).iter().any(publishes));
        assert!(!of_recorder(&keys).iter().any(publishes));
        assert!(!of_other_fusion(&keys).iter().any(publishes));
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
    fn thumbnails_go_to_nobody_but_fusion_itself() {
        let keys = Keys::new("hall");
        let sent = |rules: Vec<Rule<'_>>| -> Vec<(&str, Vec<String>)> {
            let out = |rule: &Rule<'_>| rule.flow == "egress" && rule.messages == PUBLISH;
            let out = rules.into_iter().filter(out);
            out.map(|rule| (rule.permission, rule.keys)).collect()
        };
        let others = [
            of_edge(&keys, "ne"),
            of_reader(&keys),
            of_other_fusion(&keys),
        ];
        for (_, keys) in others.into_iter().flat_map(sent) {
            assert!(
                keys.iter()
                    .all(|key| !key.contains("thumbnail") && !key.contains("**"))
            );
        }
        // What the recorder gets is all but them: what is denied counts more.
        let recorder = sent(of_recorder(&keys));
        assert!(recorder.contains(&("deny", vec!["hall/thumbnail/*".to_owned()])));
    }

    #[test]
    fn names_of_one_venue_are_none_of_another() {
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
    fn only_the_newest_generation_of_a_node_is_admitted_and_what_the_authority_makes_after_it() {
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
    fn a_common_name_says_of_which_generation_it_is() {
        for (node, generation) in [("ne", 0), ("ne", 7), ("fusion", 1)] {
            let name = common_name("hall", node, generation);
            assert_eq!(generation_of(&name), Some((node, generation)));
        }
        let screen = common_name("hall", &reader("screen"), 3);
        assert_eq!(generation_of(&screen), Some(("screen", 3)));
        assert_eq!(generation_of("hall/ne/x"), None);
    }
}
