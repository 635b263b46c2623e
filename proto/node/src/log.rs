//! The log of a node, and how a node listens in on Zenoh's.

use std::fmt;
use std::io::{IsTerminal as _, stderr};

use tracing::Event;
use tracing::field::{Field, Visit};
use tracing_subscriber::layer::{Identity, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer, Registry};

/// What is logged unless `RUST_LOG` says otherwise. Zenoh warns about every peer that leaves: the nodes
/// say that themselves, by name. So they do with the backend.
const LOGGED: &str = "warn,zenoh=error,ort=error,farfield_edge::network::backend=error";

/// Sends the log to standard error: warnings and worse, unless `RUST_LOG` says otherwise.
pub fn start_log() {
    start_log_with(Identity::new());
}

/// The same, with `listener` beside it: what a node makes of the log of a library.
pub fn start_log_with(listener: impl Layer<Registry> + Send + Sync) {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(LOGGED));
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(stderr)
        .with_ansi(stderr().is_terminal())
        .with_filter(filter);
    // A second call in one process (tests) finds the first log in place.
    let already_started = tracing_subscriber::registry()
        .with(listener)
        .with(lines)
        .try_init();
    drop(already_started);
}

/// The message of an event, without its fields.
pub fn message(event: &Event<'_>) -> String {
    let mut text = Text::default();
    event.record(&mut text);
    text.0
}

#[derive(Default)]
struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}
