//! Waiting for fusion: messages for the operator, and the reason why the last attempt failed. Zenoh
//! reports that reason only in its log, in technical terms.

use std::convert::Infallible;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use farfield_node::log::message;
use farfield_node::process::say;
use farfield_node::service_manager;
use tokio::time::{MissedTickBehavior, interval};
use tracing::level_filters::LevelFilter;
use tracing::{Event, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::Context;

/// The log target of Zenoh's attempts.
const TRIES: &str = "zenoh::net::runtime::orchestrator";
/// The start of the line of a failed attempt.
const FAILED: &str = "Unable to connect to";

static LAST: Mutex<Option<&'static str>> = Mutex::new(None);

/// Reason of the last failure; `None` before the first one, or if the reason is unknown.
pub(super) fn last_failure() -> Option<&'static str> {
    *LAST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A log layer for Zenoh's attempts, with its filter.
pub(super) fn layer<S>() -> impl Layer<S>
where
    S: Subscriber + for<'a> tracing_subscriber::registry::LookupSpan<'a>,
{
    Attempts.with_filter(Targets::new().with_target(TRIES, LevelFilter::DEBUG))
}

struct Attempts;

impl<S: Subscriber> Layer<S> for Attempts {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let text = message(event);
        if text.starts_with(FAILED) {
            *LAST.lock().unwrap_or_else(PoisonError::into_inner) = reason(&text);
        }
    }
}

/// The meaning of Zenoh's message.
fn reason(text: &str) -> Option<&'static str> {
    let other_name = "fusion's certificate is not valid for that address: make a new one with `farfield certs --renew fusion --host`";
    let other_venue = "the node there has a certificate of another venue";
    let expired = "fusion's certificate has expired";
    let not_yet = "fusion's certificate is not valid yet: is this machine's clock right?";
    let hung_up = "fusion closed the connection: it rejects this edge's certificate";
    let no_answer = "no answer from there";
    // The first match decides.
    let reasons = [
        // Rejections by the other side, about this edge's certificate. The entries below would
        // misread them as problems of fusion's certificate.
        ("aborted by peer", hung_up),
        ("fatal alert", hung_up),
        // rustls has two wordings for these.
        ("certificate not valid for name", other_name),
        ("NotValidForName", other_name),
        ("certificate expired", expired),
        ("Expired", expired),
        ("certificate not valid yet", not_yet),
        ("NotValidYet", not_yet),
        ("UnknownIssuer", other_venue),
        ("BadSignature", other_venue),
        ("refused", "no node listens there"),
        ("imed out", no_answer),
        ("elapsed", no_answer),
        ("imeout", no_answer),
        ("lost", hung_up),
        ("losed", hung_up),
    ];
    let found = reasons.iter().find(|(sign, _)| text.contains(sign));
    found.map(|(_, reason)| *reason)
}

/// Time until the first report that the edge waits for fusion.
const SILENCE: Duration = Duration::from_millis(500);
/// Interval of further reports.
const REMIND_EVERY: Duration = Duration::from_secs(10);

/// Prints the result of `waiting` at intervals, if there is one.
pub(super) async fn remind(waiting: impl Fn() -> Option<String>) -> Infallible {
    tokio::time::sleep(SILENCE).await;
    let mut reminders = interval(REMIND_EVERY);
    reminders.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        reminders.tick().await;
        if let Some(line) = waiting() {
            service_manager::report(&line);
            say(format_args!("{line}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rejections_by_fusion_concern_the_certificate_of_this_edge() {
        // QUIC reports either text for the same rejection, depending on when the answer arrives.
        for text in [
            "Cannot initialize QUIC streams 127.0.0.1: aborted by peer: the cryptographic handshake failed: error 48: invalid peer certificate: UnknownIssuer",
            "Read error on QUIC link 127.0.0.1:4 => 127.0.0.1:5: connection lost",
            "Can not create a new TLS link bound to \"127.0.0.1\": received fatal alert: CertificateExpired",
        ] {
            let message = reason(text).unwrap();
            assert!(
                message.contains("this edge's certificate"),
                "{text}: {message}"
            );
        }
    }

    #[test]
    fn rejections_by_this_edge_concern_the_certificate_of_fusion() {
        let text = "Can not create a new QUIC link bound to 127.0.0.1: the cryptographic handshake failed: error 48: invalid peer certificate: UnknownIssuer";
        assert!(reason(text).unwrap().contains("another venue"));
        assert_eq!(reason("something else"), None);
        // Another program on that port, or a middlebox.
        assert_eq!(
            reason("alert-pc.lan: Connection reset by peer (os error 104)"),
            None
        );
    }
}
