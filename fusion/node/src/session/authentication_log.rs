//! Reports refused nodes. Zenoh logs refusals under other names or not at all; a layer on its log reports each kind once, and
//! counts them.

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

/// Log target of Zenoh's access control.
const ACCESS: &str = "zenoh::net::routing::interceptor::access_control";
/// Log targets of Zenoh's links for refused connections.
const LINKS: [&str; 2] = ["zenoh_link_commons", "zenoh_link_tls"];
/// Most nodes whose certificates are remembered; the oldest are forgotten.
const MAX_NAMED: usize = 256;
/// Most kinds of refusals that are reported; further ones are only counted.
const MAX_REPORTED: usize = 64;
/// The last line that Zenoh logs when it computes in advance what a node may do on a key. The node has not tried it yet.
const LAST_IN_ADVANCE: &str = "Declare Liveliness Subscriber (";

static REFUSALS: AtomicU64 = AtomicU64::new(0);
/// The newest generation of each node's certificate, as this node admits them.
static NEWEST: OnceLock<Generations> = OnceLock::new();
static NAMED: Mutex<CertificateNames> = Mutex::new(CertificateNames::new());
static REPORTED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

thread_local! {
    static IS_IN_ADVANCE: AtomicBool = const { AtomicBool::new(false) };
}

/// Prints the number of refusals since the start of this process, if any.
pub(crate) fn sum_up() {
    let times = REFUSALS.load(Ordering::Relaxed);
    if times > 0 {
        say(format_args!("fusion: turned away {times} times in all"));
    }
}

/// Sets the newest generations; from now on older certificates are reported as such.
pub(crate) fn set_generations(newest: &Generations) {
    NEWEST.get_or_init(|| newest.clone());
}

/// The layer, with a filter for its log targets.
pub(crate) fn layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
{
    let links = LINKS.map(|target| (target, LevelFilter::WARN));
    let targets = Targets::new().with_target(ACCESS, LevelFilter::TRACE);
    AuthenticationLog.with_filter(targets.with_targets(links))
}

/// The common names of certificates by Zenoh's id of the node. Each session has a new id, and a refused node reconnects again and
/// again.
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

    /// Stores the name of `node`, and drops the oldest node if there are too many.
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

    fn get(&self, node: &str) -> Option<String> {
        self.by_node.get(node).cloned()
    }
}

struct AuthenticationLog;

impl<S: Subscriber> Layer<S> for AuthenticationLog {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let text = message(event);
        let refusal = if event.metadata().target() == ACCESS {
            denied(&text, NEWEST.get())
        } else if is_from_peer(&text) {
            // Not a refusal here: the other side refused the connection.
            if let Some(words) = rejection(&text) {
                report_once(&words);
            }
            return;
        } else {
            refused_connection(&text)
        };
        let Some(refusal) = refusal else { return };
        REFUSALS.fetch_add(1, Ordering::Relaxed);
        report_once(&refusal);
    }
}

fn report_once(words: &str) {
    let mut reported = lock(&REPORTED);
    if reported.len() < MAX_REPORTED && reported.insert(words.to_owned()) {
        say(format_args!("fusion: {words}"));
    }
}

/// Translates a line of the access control, if a node has tried something that is denied.
fn denied(text: &str, newest: Option<&Generations>) -> Option<String> {
    if text.contains("caching permissions") {
        IS_IN_ADVANCE.with(|it| it.store(true, Ordering::Relaxed));
        return None;
    }
    if text.contains("did not match any configured ACL subject") {
        return Some(format!(
            "refused all messages of a node whose certificate names no node of this venue; if the node was added later, copy the {GENERATIONS_FILE} next to its keys to this machine, and restart fusion"
        ));
    }
    let cached = text.strip_prefix("Using cached result: ");
    if cached.is_none() && IS_IN_ADVANCE.with(|it| it.load(Ordering::Relaxed)) {
        remember_name(text);
        if text.contains(LAST_IN_ADVANCE) {
            IS_IN_ADVANCE.with(|it| it.store(false, Ordering::Relaxed));
        }
        return None;
    }
    let (node, what) = cached.unwrap_or(text).split_once(" is unauthorized to ")?;
    let (what, key) = what.split_once(" (ingress) on ")?;
    let name = match cached {
        // The lines logged in advance contain the certificate.
        Some(_) => lock(&NAMED).get(node),
        None => certificate(node).map(|(_, name)| name.to_owned()),
    };
    let name = name.as_deref();
    if let Some(too_old) = name.and_then(|name| too_old(name, newest?)) {
        return Some(too_old);
    }
    let node = name.map_or_else(
        || "a node".to_owned(),
        |name| format!("the node of certificate {name}"),
    );
    Some(format!("refused {node}: {} on {key}", what.to_lowercase()))
}

/// Zenoh's id of a node, and the common name of its certificate.
fn certificate(text: &str) -> Option<(&str, &str)> {
    let (node, subject) = text.split_once(" on ")?;
    let (_, rest) = subject.split_once("CertCommonName(")?;
    let (name, _) = rest.split_once(')')?;
    Some((node, name))
}

/// Stores the certificate of a node that is denied something in advance.
fn remember_name(text: &str) {
    let denied = text.split_once(" is unauthorized to ");
    let Some((node, name)) = denied.and_then(|(node, _)| certificate(node)) else {
        return;
    };
    lock(&NAMED).remember(node, name);
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // A thread that panicked leaves the sets consistent.
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The refusal of a certificate with this common name, if it is too old.
fn too_old(name: &str, newest: &Generations) -> Option<String> {
    let (node, generation) = generation_of(name)?;
    let newest = newest.of(node);
    (generation < newest).then(|| {
        format!(
            "refused all messages of the node of certificate {name}: {node} has newer keys, of generation {newest}; copy {node}.pem and {node}.key of `farfield certs --renew {node}` to its machine, or find out who has the old ones"
        )
    })
}

/// Whether a link's warning repeats the reason of the other side for closing the connection.
fn is_from_peer(text: &str) -> bool {
    let signs = ["ConnectionClosed", "aborted by peer", "fatal alert"];
    signs.iter().any(|sign| text.contains(sign))
}

/// Why the other side rejected fusion's certificate, if it did.
fn rejection(text: &str) -> Option<String> {
    let other_authority = "its authority is another one; is that node's ca.pem of this venue?";
    let run_out = "it has run out; `farfield certs --renew fusion` makes a new one";
    let other_name = "it is not valid for the address that the node uses; `farfield certs --renew fusion --host` makes one that is";
    let not_yet = "it is not valid yet: is a clock wrong?";
    let not_now = "it has run out, or is not valid yet by that node's clock";
    // TLS has fewer reasons than QUIC, which repeats those of rustls.
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
    Some(format!("a node rejects fusion's certificate: {reason}"))
}

/// Translates a link's warning about a refused connection.
fn refused_connection(text: &str) -> Option<String> {
    let reasons = [
        (
            "UnknownIssuer",
            "its certificate is not of this venue's authority",
        ),
        (
            "BadSignature",
            "its certificate is not of this venue's authority",
        ),
        // rustls uses two forms.
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
    fn a_denied_message_is_reported_with_certificate_and_key() {
        let refusal = denied(
            "4f2a on Interface(lo)+CertCommonName(walk/north-east)+Transport(Quic)+4f2a is unauthorized to Put (ingress) on walk/patch/b",
            None,
        );
        assert_eq!(
            refusal.as_deref(),
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
        // Messages that fusion itself does not send out are no attempt of a node.
        assert_eq!(
            denied("4f2a on x is unauthorized to Put (egress) on k", None),
            None
        );
    }

    #[test]
    fn denials_in_advance_are_not_reported() {
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
    fn a_cached_denial_is_reported_with_the_certificate() {
        // Symptom to prevent: nearly all denials are cached, and were reported for "a node".
        for ahead in [
            "ACL (ingress): caching permissions for `k` ...",
            "5e on Interface(lo)+CertCommonName(walk/south-east/1)+Transport(Quic)+5e is unauthorized to Put (ingress) on k",
            "5e on Interface(lo)+CertCommonName(walk/south-east/1)+Transport(Quic)+5e is unauthorized to Declare Liveliness Subscriber (ingress) on k",
        ] {
            assert_eq!(denied(ahead, None), None);
        }
        let refusal = denied(
            "Using cached result: 5e is unauthorized to Put (ingress) on k",
            None,
        );
        let words = "refused the node of certificate walk/south-east/1: put on k";
        assert_eq!(refusal.as_deref(), Some(words));
    }

    #[test]
    fn the_newest_of_many_denied_sessions_is_named() {
        let mut names = CertificateNames::new();
        for i in 0..2 * MAX_NAMED {
            names.remember(&format!("{i:x}"), "walk/ne/1");
            names.remember(&format!("{i:x}"), "walk/ne/2");
        }
        let newest = format!("{:x}", 2 * MAX_NAMED - 1);
        assert_eq!(names.get(&newest).as_deref(), Some("walk/ne/2"));
        assert_eq!(names.get("0"), None);
        assert_eq!(
            (names.by_node.len(), names.nodes.len()),
            (MAX_NAMED, MAX_NAMED)
        );
    }

    #[test]
    fn an_old_certificate_is_reported_with_the_newest_generation() {
        let mut newest = Generations::default();
        newest.renew("ne");
        newest.renew("ne");
        let text = |name: &str| {
            format!(
                "4f2a on Interface(lo)+CertCommonName({name})+Transport(Quic)+4f2a is unauthorized to Put (ingress) on walk/patch/ne"
            )
        };
        let refusal = denied(&text("walk/ne/1"), Some(&newest)).unwrap();
        assert!(refusal.contains("certificate walk/ne/1: ne has newer keys, of generation 2"));
        let refusal = denied(&text("walk/ne/2"), Some(&newest)).unwrap();
        assert!(refusal.ends_with("put on walk/patch/ne"), "{refusal}");
    }

    #[test]
    fn a_refused_connection_is_reported_with_the_reason() {
        let text = "QUIC acceptor failed: TransportError(Error { reason: \"invalid peer certificate: UnknownIssuer\" }) Hint: increase the system open file limit.";
        let refusal = refused_connection(text).unwrap();
        assert!(refusal.contains("authority"), "{refusal}");
        assert_eq!(refused_connection("something else"), None);
        assert!(!is_from_peer(text));
    }

    #[test]
    fn a_node_that_rejects_fusions_certificate_is_no_refusal() {
        let closed = "QUIC acceptor failed: ConnectionClosed(ConnectionClose { error_code: the cryptographic handshake failed: error 48, frame_type: None, reason: b\"invalid peer certificate: UnknownIssuer\" })";
        let alert =
            "received fatal alert: CertificateExpired. Hint: increase the system open file limit.";
        for (text, words) in [
            (closed, "is that node's ca.pem"),
            (alert, "not valid yet by that node's clock"),
        ] {
            assert!(is_from_peer(text), "{text}");
            let rejection = rejection(text).unwrap();
            assert!(rejection.contains(words), "{rejection}");
        }
        assert_eq!(rejection("ConnectionClosed"), None);
    }
}
