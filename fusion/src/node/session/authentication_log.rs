//! Who was turned away, as the log of a server has it: Zenoh's own log says it under other names or not at all. A listener on that log
//! tells the operator once per kind, and counts.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use farfield_node::log::message;
use farfield_node::process::say;
use farfield_proto::transport::{GENERATIONS_FILE, Generations, generation_of};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::Context;

/// Where Zenoh's access control logs what it denies.
const ACCESS: &str = "zenoh::net::routing::interceptor::access_control";
/// Where Zenoh's links log whom they do not let in.
const LINKS: [&str; 2] = ["zenoh_link_commons", "zenoh_link_tls"];
/// Nodes whose certificates are remembered; of more those that came last.
const MAX_NAMED: usize = 256;
/// Kinds of refusals that are told; more are only counted.
const MAX_TOLD: usize = 64;
/// What Zenoh logs last when it works out ahead what a node may do on a key: nobody has done it yet.
const LAST_OF_AHEAD: &str = "Declare Liveliness Subscriber (";

static TURNED_AWAY: AtomicU64 = AtomicU64::new(0);
/// Which certificates are the newest, by what this node admits others.
static NEWEST: OnceLock<Generations> = OnceLock::new();
static NAMED: Mutex<CertificateNames> = Mutex::new(CertificateNames::new());
static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

thread_local! {
    static IS_AHEAD: AtomicBool = const { AtomicBool::new(false) };
}

/// Tells how often someone was turned away since the start of this process, if ever.
pub(in crate::node) fn sum_up() {
    let times = TURNED_AWAY.load(Ordering::Relaxed);
    if times > 0 {
        say(format_args!("fusion: turned away {times} times in all"));
    }
}

/// From now on it is told of a certificate that it is too old, where `newest` says so.
pub(in crate::node) fn know_generations(newest: &Generations) {
    NEWEST.get_or_init(|| newest.clone());
}

/// The listener, with what it listens to.
pub(in crate::node) fn layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
{
    let links = LINKS.map(|target| (target, LevelFilter::WARN));
    let targets = Targets::new().with_target(ACCESS, LevelFilter::TRACE);
    AuthenticationLog.with_filter(targets.with_targets(links))
}

/// The common names of certificates, by what Zenoh calls their nodes: each session of a node is another one, and one that
/// is denied comes again and again.
struct CertificateNames {
    by_node: BTreeMap<String, String>,
    /// The nodes, the oldest first.
    nodes: VecDeque<String>,
}

impl CertificateNames {
    const fn new() -> Self {
        Self {
            by_node: BTreeMap::new(),
            nodes: VecDeque::new(),
        }
    }

    /// Remembers that of `node`, and forgets the oldest where there are too many.
    fn remember(&mut self, node: &str, name: &str) {
        let known = self.by_node.insert(node.to_owned(), name.to_owned());
        if known.is_some() {
            return;
        }
        self.nodes.push_back(node.to_owned());
        if self.nodes.len() > MAX_NAMED
            && let Some(oldest) = self.nodes.pop_front()
        {
            self.by_node.remove(&oldest);
        }
    }

    fn of(&self, node: &str) -> Option<String> {
        self.by_node.get(node).cloned()
    }
}

struct AuthenticationLog;

impl<S: Subscriber> Layer<S> for AuthenticationLog {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let text = message(event);
        let refusal = if event.metadata().target() == ACCESS {
            denied(&text, NEWEST.get())
        } else if is_of_peer(&text) {
            // Nobody was turned away, but whoever it was stayed away.
            if let Some(words) = not_taken(&text) {
                tell_once(&words);
            }
            return;
        } else {
            not_let_in(&text)
        };
        let Some(refusal) = refusal else { return };
        TURNED_AWAY.fetch_add(1, Ordering::Relaxed);
        tell_once(&refusal);
    }
}

fn tell_once(words: &str) {
    let mut told = lock(&TOLD);
    if told.len() < MAX_TOLD && told.insert(words.to_owned()) {
        say(format_args!("fusion: {words}"));
    }
}

/// What a line of the access control means, if somebody has tried what is denied.
fn denied(text: &str, newest: Option<&Generations>) -> Option<String> {
    if text.contains("caching permissions") {
        IS_AHEAD.with(|ahead| ahead.store(true, Ordering::Relaxed));
        return None;
    }
    if text.contains("did not match any configured ACL subject") {
        return Some(format!(
            "refused all that a node does whose certificate names no node of this venue; one that came later is known by the {GENERATIONS_FILE} that lies beside its keys: copy it here, and start again"
        ));
    }
    let cached = text.strip_prefix("Using cached result: ");
    if cached.is_none() && IS_AHEAD.with(|ahead| ahead.load(Ordering::Relaxed)) {
        remember_name(text);
        if text.contains(LAST_OF_AHEAD) {
            IS_AHEAD.with(|ahead| ahead.store(false, Ordering::Relaxed));
        }
        return None;
    }
    let (who, what) = cached.unwrap_or(text).split_once(" is unauthorized to ")?;
    let (what, key) = what.split_once(" (ingress) on ")?;
    let name = match cached {
        // What was worked out ahead has said by which certificate.
        Some(_) => lock(&NAMED).of(who),
        None => certificate(who).map(|(_, name)| name.to_owned()),
    };
    let name = name.as_deref();
    if let Some(too_old) = name.and_then(|name| too_old(name, newest?)) {
        return Some(too_old);
    }
    let who = name.map_or_else(
        || "a node".to_owned(),
        |name| format!("the node of certificate {name}"),
    );
    Some(format!("refused {who}: {} on {key}", what.to_lowercase()))
}

/// What Zenoh calls a node, and the common name of its certificate.
fn certificate(who: &str) -> Option<(&str, &str)> {
    let (node, subject) = who.split_once(" on ")?;
    let (_, rest) = subject.split_once("CertCommonName(")?;
    let (name, _) = rest.split_once(')')?;
    Some((node, name))
}

/// Remembers whose certificate a node has that is denied something ahead.
fn remember_name(text: &str) {
    let denied = text.split_once(" is unauthorized to ");
    let Some((node, name)) = denied.and_then(|(who, _)| certificate(who)) else {
        return;
    };
    lock(&NAMED).remember(node, name);
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // Whatever a thread that panicked left undone, the sets are whole.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Why nothing is allowed to whoever has the certificate of this common name, if it is too old.
fn too_old(name: &str, newest: &Generations) -> Option<String> {
    let (node, generation) = generation_of(name)?;
    let newest = newest.of(node);
    (generation < newest).then(|| {
        format!(
            "refused all that the node of certificate {name} does: {node} has got new keys since, of generation {newest}; copy {node}.pem and {node}.key of `farfield certs --renew {node}` to its machine, or find out who has the old ones"
        )
    })
}

/// Whether a link's warning repeats what the other side said when it hung up.
fn is_of_peer(text: &str) -> bool {
    let signs = ["ConnectionClosed", "aborted by peer", "fatal alert"];
    signs.iter().any(|sign| text.contains(sign))
}

/// What the other side did not like about fusion's certificate, if that is why it hung up.
fn not_taken(text: &str) -> Option<String> {
    let other_authority = "its authority is another one; is that node's ca.pem of this venue?";
    let run_out = "it has run out; `farfield certs --renew fusion` makes a new one";
    let other_name = "it is not good for the address that the node has; `farfield certs --renew fusion --host` makes one that is";
    let not_yet = "it is not valid yet: is a clock wrong?";
    let not_now = "it has run out, or is not valid yet by that node's clock";
    // TLS has fewer words than QUIC, which repeats those of rustls.
    let reasons = [
        ("fatal alert: CertificateExpired", not_now),
        ("fatal alert: BadCertificate", other_name),
        ("fatal alert: DecryptError", other_authority),
        ("UnknownIssuer", other_authority),
        ("BadSignature", other_authority),
        ("UnknownCA", other_authority),
        ("xpired", run_out),
        ("ot valid for name", other_name),
        ("NotValidForName", other_name),
        ("ot valid yet", not_yet),
        ("NotValidYet", not_yet),
    ];
    let (_, reason) = reasons.iter().find(|(sign, _)| text.contains(sign))?;
    Some(format!(
        "a node does not take fusion's certificate: {reason}"
    ))
}

/// What a link's warning means, if it is about who wants in.
fn not_let_in(text: &str) -> Option<String> {
    let reasons = [
        (
            "UnknownIssuer",
            "its certificate is not of this venue's authority",
        ),
        (
            "BadSignature",
            "its certificate is not of this venue's authority",
        ),
        // rustls says it in two ways.
        (
            "Expired",
            "its certificate has run out; `farfield certs --renew` makes a new one",
        ),
        (
            "certificate expired",
            "its certificate has run out; `farfield certs --renew` makes a new one",
        ),
        (
            "NotValidYet",
            "its certificate is not valid yet: is a clock wrong?",
        ),
        (
            "certificate not valid yet",
            "its certificate is not valid yet: is a clock wrong?",
        ),
        ("sent no certificates", "it has no certificate"),
        ("CertificateRequired", "it has no certificate"),
    ];
    let (_, reason) = reasons.iter().find(|(sign, _)| text.contains(sign))?;
    Some(format!("refused a node: {reason}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_denied_message_is_told_with_who_and_where() {
        let told = denied(
            "4f2a on Interface(lo)+CertCommonName(walk/north-east)+Transport(Quic)+4f2a is unauthorized to Put (ingress) on walk/patch/b",
            None,
        );
        assert_eq!(
            told.as_deref(),
            Some("refused the node of certificate walk/north-east: put on walk/patch/b")
        );
        let cached = denied(
            "Using cached result: 4f2a is unauthorized to Put (ingress) on walk/patch/b",
            None,
        );
        assert_eq!(
            cached.as_deref(),
            Some("refused a node: put on walk/patch/b")
        );
        assert_eq!(
            denied("4f2a on x is authorized to Put (ingress) on k", None),
            None
        );
        // What fusion does not send out is nobody's attempt.
        assert_eq!(
            denied("4f2a on x is unauthorized to Put (egress) on k", None),
            None
        );
    }

    #[test]
    fn what_nobody_has_tried_yet_is_not_told() {
        assert_eq!(
            denied("ACL (ingress): caching permissions for `k` ...", None),
            None
        );
        assert_eq!(
            denied("z on s is unauthorized to Put (ingress) on k", None),
            None
        );
        assert_eq!(
            denied(
                "z on s is unauthorized to Declare Liveliness Subscriber (ingress) on k",
                None
            ),
            None
        );
        assert!(denied("z on s is unauthorized to Put (ingress) on k", None).is_some());
    }

    #[test]
    fn what_is_denied_by_a_cached_result_is_told_with_whose_certificate_it_is() {
        // Symptom to prevent: nearly all that is denied is, and was told of "a node".
        for ahead in [
            "ACL (ingress): caching permissions for `k` ...",
            "5e on Interface(lo)+CertCommonName(walk/south-east/1)+Transport(Quic)+5e is unauthorized to Put (ingress) on k",
            "5e on Interface(lo)+CertCommonName(walk/south-east/1)+Transport(Quic)+5e is unauthorized to Declare Liveliness Subscriber (ingress) on k",
        ] {
            assert_eq!(denied(ahead, None), None);
        }
        let told = denied(
            "Using cached result: 5e is unauthorized to Put (ingress) on k",
            None,
        );
        let words = "refused the node of certificate walk/south-east/1: put on k";
        assert_eq!(told.as_deref(), Some(words));
    }

    #[test]
    fn after_hundreds_of_denied_sessions_the_next_is_named_all_the_same() {
        let mut names = CertificateNames::new();
        for i in 0..2 * MAX_NAMED {
            names.remember(&format!("{i:x}"), "walk/ne/1");
            names.remember(&format!("{i:x}"), "walk/ne/2");
        }
        let newest = format!("{:x}", 2 * MAX_NAMED - 1);
        assert_eq!(names.of(&newest).as_deref(), Some("walk/ne/2"));
        assert_eq!(names.of("0"), None);
        assert_eq!(
            (names.by_node.len(), names.nodes.len()),
            (MAX_NAMED, MAX_NAMED)
        );
    }

    #[test]
    fn a_certificate_that_is_too_old_is_named_with_the_newest() {
        let mut newest = Generations::default();
        newest.renew("ne");
        newest.renew("ne");
        let text = |name: &str| {
            format!(
                "4f2a on Interface(lo)+CertCommonName({name})+Transport(Quic)+4f2a is unauthorized to Put (ingress) on walk/patch/ne"
            )
        };
        let told = denied(&text("walk/ne/1"), Some(&newest)).unwrap();
        assert!(
            told.contains("walk/ne/1") && told.contains("generation 2"),
            "{told}"
        );
        let told = denied(&text("walk/ne/2"), Some(&newest)).unwrap();
        assert!(told.ends_with("put on walk/patch/ne"), "{told}");
    }

    #[test]
    fn whoever_is_not_let_in_is_told_with_the_reason() {
        let text = "QUIC acceptor failed: TransportError(Error { reason: \"invalid peer certificate: UnknownIssuer\" }) Hint: increase the system open file limit.";
        let told = not_let_in(text).unwrap();
        assert!(told.contains("not of this venue's authority"), "{told}");
        assert_eq!(not_let_in("something else"), None);
        assert!(!is_of_peer(text));
    }

    #[test]
    fn a_node_that_does_not_take_fusions_certificate_is_not_one_that_was_refused() {
        let closed = "QUIC acceptor failed: ConnectionClosed(ConnectionClose { error_code: the cryptographic handshake failed: error 48, frame_type: None, reason: b\"invalid peer certificate: UnknownIssuer\" })";
        let alert =
            "received fatal alert: CertificateExpired. Hint: increase the system open file limit.";
        for (text, words) in [
            (closed, "is that node's ca.pem"),
            (alert, "not valid yet by that node's clock"),
        ] {
            assert!(is_of_peer(text), "{text}");
            let told = not_taken(text).unwrap();
            assert!(told.contains(words), "{told}");
        }
        assert_eq!(not_taken("ConnectionClosed"), None);
    }
}
