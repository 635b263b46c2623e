//! The log of a node, and how a node listens in on Zenoh's.

use std::fmt;
use std::io::{IsTerminal as _, stderr};

use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, debug};
use tracing_subscriber::layer::{Identity, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer, Registry};

use crate::process::say;

/// What is logged unless `RUST_LOG` says otherwise. Zenoh warns about every peer that leaves: the nodes
/// say that themselves, by name. So they do with the backend.
const LOGGED: &str = "warn,zenoh=error,ort=error,farfield_edge::network::backend=error";

/// Libraries whose own log is only of use to who asks for it by name.
const LIBRARIES: [&str; 6] = ["zenoh", "quinn", "rustls", "ort", "tract", "mio"];

/// What is logged when `RUST_LOG` is `asked`: of libraries that it does not name, warnings and worse, or less where it asks
/// for less of all.
fn filter_of(asked: &str) -> String {
    let directives = || asked.split(',').map(str::trim).filter(|it| !it.is_empty());
    let of_all: Option<LevelFilter> = directives().rev().find_map(|it| it.parse().ok());
    let level = of_all.map_or(LevelFilter::WARN, |level| level.min(LevelFilter::WARN));
    let is_unnamed = |library: &&&str| !directives().any(|it| is_about(it, library));
    let quiet = LIBRARIES.iter().filter(is_unnamed);
    let quiet = quiet.map(|library| format!("{library}={level}"));
    quiet
        .chain([asked.to_owned()])
        .collect::<Vec<_>>()
        .join(",")
}

/// Whether the target of `directive` (`TARGET[SPAN]=LEVEL`) is `library`, a part of it or a crate of its family.
fn is_about(directive: &str, library: &str) -> bool {
    let target = directive.split(['=', '[']).next().unwrap_or_default();
    let rest = target.strip_prefix(library);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['_', ':']))
}

/// The filter of the log; what `RUST_LOG` says is told of where it says nothing that can be understood.
fn filter() -> EnvFilter {
    let asked = std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default();
    if asked.trim().is_empty() {
        return EnvFilter::new(LOGGED);
    }
    EnvFilter::try_new(filter_of(&asked)).unwrap_or_else(|error| {
        say(format_args!(
            "RUST_LOG: found `{asked}`, expected a level or TARGET=LEVEL, with commas between: {error}"
        ));
        EnvFilter::new(LOGGED)
    })
}

/// Sends the log to standard error: warnings and worse, unless `RUST_LOG` says otherwise.
pub fn start_log() {
    start_log_with(Identity::new());
}

/// The same, with `listener` beside it: what a node makes of the log of a library.
pub fn start_log_with(listener: impl Layer<Registry> + Send + Sync) {
    let filter = filter();
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
    let arguments: Vec<_> = std::env::args_os().skip(1).collect();
    debug!(version = env!("CARGO_PKG_VERSION"), ?arguments, "started");
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn libraries_are_quiet_unless_they_are_named() {
        assert_eq!(
            filter_of("debug"),
            "zenoh=warn,quinn=warn,rustls=warn,ort=warn,tract=warn,mio=warn,debug"
        );
        let named = filter_of("info,zenoh_transport=debug");
        assert!(
            !named.contains("zenoh=warn") && named.contains("quinn=warn"),
            "{named}"
        );
        for asked in [
            "debug",
            "off",
            "farfield_edge=trace",
            "zenoh=info,debug",
            "ort::session[run]=info",
        ] {
            EnvFilter::try_new(filter_of(asked)).unwrap();
        }
    }

    #[test]
    fn who_asks_for_less_of_all_gets_less_of_libraries_too() {
        for (asked, level) in [
            ("error", "error"),
            ("off", "off"),
            ("debug, OFF", "off"),
            ("info", "warn"),
        ] {
            let filter = filter_of(asked);
            for library in LIBRARIES {
                let quiet = format!("{library}={level},");
                assert!(filter.contains(&quiet), "{asked}: {filter}");
            }
        }
    }

    #[test]
    fn a_library_is_named_by_a_target_and_not_by_letters_within_another() {
        let filter = filter_of("farfield_fusion::export=debug,farfield_proto::transport=trace");
        assert!(filter.contains("ort=warn,"), "{filter}");
        for named in ["ort", "ort=info", "ort::session=info", "ort[run]=info"] {
            let filter = filter_of(named);
            assert!(!filter.contains("ort=warn"), "{named}: {filter}");
        }
        assert!(filter_of("orthography=debug").contains("ort=warn,"));
    }
}
