//! Who was turned away, as the log of a server has it: Zenoh's own log says it under other names or not at all. A listener on that log
//! tells the operator once per kind, and counts.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use farfield_node::log::message;
use farfield_node::process::say;
use tracing::level_filters::LevelFilter;
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::Context;

/// Where Zenoh's access control logs what it denies.
const ACCESS: &str = "zenoh::net::routing::interceptor::access_control";
/// Where Zenoh's links log whom they do not let in.
const LINKS: [&str; 2] = ["zenoh_link_commons", "zenoh_link_tls"];
/// Kinds of refusals that are told; more are only counted.
const MAX_TOLD: usize = 64;
/// What Zenoh logs last when it works out ahead what a node may do on a key: nobody has done it yet.
const LAST_OF_AHEAD: &str = "Declare Liveliness Subscriber (";

static TURNED_AWAY: AtomicU64 = AtomicU64::new(0);
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

/// The listener, with what it listens to.
pub(in crate::node) fn layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
{
    let links = LINKS.map(|target| (target, LevelFilter::WARN));
    let targets = Targets::new().with_target(ACCESS, LevelFilter::TRACE);
    AuthenticationLog.with_filter(targets.with_targets(links))
}

struct AuthenticationLog;

impl<S: Subscriber> Layer<S> for AuthenticationLog {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let text = message(event);
        let refusal = if event.metadata().target() == ACCESS {
            denied(&text)
        } else {
            not_let_in(&text)
        };
        let Some(refusal) = refusal else { return };
        TURNED_AWAY.fetch_add(1, Ordering::Relaxed);
        let mut told = TOLD.lock().unwrap_or_else(PoisonError::into_inner);
        if told.len() < MAX_TOLD && told.insert(refusal.clone()) {
            say(format_args!("fusion: {refusal}"));
        }
    }
}

/// What a line of the access control means, if somebody has tried what is denied.
fn denied(text: &str) -> Option<String> {
    if text.contains("caching permissions") {
        IS_AHEAD.with(|ahead| ahead.store(true, Ordering::Relaxed));
        return None;
    }
    if text.contains("did not match any configured ACL subject") {
        return Some(
            "refused all that a node does whose certificate names no node of this venue".to_owned(),
        );
    }
    let cached = text.strip_prefix("Using cached result: ");
    if cached.is_none() && IS_AHEAD.with(|ahead| ahead.load(Ordering::Relaxed)) {
        if text.contains(LAST_OF_AHEAD) {
            IS_AHEAD.with(|ahead| ahead.store(false, Ordering::Relaxed));
        }
        return None;
    }
    let (who, what) = text.split_once(" is unauthorized to ")?;
    let (what, key) = what.split_once(" (ingress) on ")?;
    // Without the cache Zenoh says by which certificate, too: interface, then name.
    let name = who.split_once(" on ").map(|(_, subject)| subject);
    let name = name.and_then(|subject| subject.split('+').find(|part| part.contains('/')));
    let who = name.map_or_else(
        || "a node".to_owned(),
        |name| format!("the node of certificate {name}"),
    );
    Some(format!("refused {who}: {} on {key}", what.to_lowercase()))
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
        (
            "Expired",
            "its certificate has run out; `farfield certs --renew` makes a new one",
        ),
        (
            "NotValidYet",
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
            "4f2a on lo+walk/north-east+quic+4f2a is unauthorized to Put (ingress) on walk/patch/b",
        );
        assert_eq!(
            told.as_deref(),
            Some("refused the node of certificate walk/north-east: put on walk/patch/b")
        );
        let cached =
            denied("Using cached result: 4f2a is unauthorized to Put (ingress) on walk/patch/b");
        assert_eq!(
            cached.as_deref(),
            Some("refused a node: put on walk/patch/b")
        );
        assert_eq!(
            denied("4f2a on x is authorized to Put (ingress) on k"),
            None
        );
        // What fusion does not send out is nobody's attempt.
        assert_eq!(
            denied("4f2a on x is unauthorized to Put (egress) on k"),
            None
        );
    }

    #[test]
    fn what_nobody_has_tried_yet_is_not_told() {
        assert_eq!(
            denied("ACL (ingress): caching permissions for `k` ..."),
            None
        );
        assert_eq!(denied("z on s is unauthorized to Put (ingress) on k"), None);
        assert_eq!(
            denied("z on s is unauthorized to Declare Liveliness Subscriber (ingress) on k"),
            None
        );
        assert!(denied("z on s is unauthorized to Put (ingress) on k").is_some());
    }

    #[test]
    fn whoever_is_not_let_in_is_told_with_the_reason() {
        let text = "QUIC acceptor failed: TransportError(Error { reason: \"invalid peer certificate: UnknownIssuer\" }) Hint: increase the system open file limit.";
        let told = not_let_in(text).unwrap();
        assert!(told.contains("not of this venue's authority"), "{told}");
        assert_eq!(not_let_in("something else"), None);
    }
}
