//! The log of a node, and a listener to Zenoh's log.

use std::fmt;
use std::io::{IsTerminal as _, stderr};

use tracing::field::{Field, Visit};
use tracing::level_filters::LevelFilter;
use tracing::{Event, debug};
use tracing_subscriber::layer::{Identity, SubscriberExt as _};
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer, Registry};

use crate::process::say;

/// The default filter without `RUST_LOG`. Zenoh warns about every peer that leaves, but the nodes
/// report that themselves, by name. The same holds for the inference backend.
const LOGGED: &str = "warn,zenoh=error,ort=error,farfield_edge::network::backend=error";

/// Libraries whose log is only useful on request.
const LIBRARIES: [&str; 6] = ["zenoh", "quinn", "rustls", "ort", "tract", "mio"];

/// The filter for the value `requested` of `RUST_LOG`. Libraries without a directive log warnings
/// and worse, or less if `requested` lowers the level of everything.
fn filter_of(requested: &str) -> String {
    let directives = || {
        requested
            .split(',')
            .map(str::trim)
            .filter(|it| !it.is_empty())
    };
    let of_all: Option<LevelFilter> = directives().rev().find_map(|it| it.parse().ok());
    let level = of_all.map_or(LevelFilter::WARN, |level| level.min(LevelFilter::WARN));
    let is_unnamed = |library: &&&str| !directives().any(|it| is_about(it, library));
    let quiet = LIBRARIES.iter().filter(is_unnamed);
    let quiet = quiet.map(|library| format!("{library}={level}"));
    quiet
        .chain([requested.to_owned()])
        .collect::<Vec<_>>()
        .join(",")
}

/// Whether the target of `directive` (`TARGET[SPAN]=LEVEL`) is `library`, a part of it or a crate
/// of its family.
fn is_about(directive: &str, library: &str) -> bool {
    let target = directive.split(['=', '[']).next().unwrap_or_default();
    let rest = target.strip_prefix(library);
    rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['_', ':']))
}

/// The filter of the log; warns about an invalid `RUST_LOG`.
fn filter() -> EnvFilter {
    let requested = std::env::var(EnvFilter::DEFAULT_ENV).unwrap_or_default();
    if requested.trim().is_empty() {
        return EnvFilter::new(LOGGED);
    }
    EnvFilter::try_new(filter_of(&requested)).unwrap_or_else(|error| {
        say(format_args!(
            "RUST_LOG: found `{requested}`, expected a level or TARGET=LEVEL, with commas between: {error}"
        ));
        EnvFilter::new(LOGGED)
    })
}

/// Sends the log to standard error: warnings and worse, unless `RUST_LOG` sets another filter.
pub fn start_log() {
    start_log_with(Identity::new());
}

/// As [`start_log`], with an additional layer `listener` for the log of a library.
pub fn start_log_with(listener: impl Layer<Registry> + Send + Sync) {
    let filter = filter();
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(stderr)
        .with_ansi(stderr().is_terminal())
        .with_filter(filter);
    // A second call in one process (tests) keeps the first log.
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
    fn libraries_are_quiet_unless_named() {
        assert_eq!(
            filter_of("debug"),
            "zenoh=warn,quinn=warn,rustls=warn,ort=warn,tract=warn,mio=warn,debug"
        );
        let named = filter_of("info,zenoh_transport=debug");
        assert!(
            !named.contains("zenoh=warn") && named.contains("quinn=warn"),
            "{named}"
        );
        for requested in [
            "debug",
            "off",
            "farfield_edge=trace",
            "zenoh=info,debug",
            "ort::session[run]=info",
        ] {
            EnvFilter::try_new(filter_of(requested)).unwrap();
        }
    }

    #[test]
    fn a_lower_global_level_also_applies_to_libraries() {
        for (requested, level) in [
            ("error", "error"),
            ("off", "off"),
            ("debug, OFF", "off"),
            ("info", "warn"),
        ] {
            let filter = filter_of(requested);
            for library in LIBRARIES {
                let quiet = format!("{library}={level},");
                assert!(filter.contains(&quiet), "{requested}: {filter}");
            }
        }
    }

    #[test]
    fn a_library_is_named_by_its_target_not_by_a_substring() {
        let filter = filter_of("farfield_fusion::export=debug,farfield_proto::transport=trace");
        assert!(filter.contains("ort=warn,"), "{filter}");
        for named in ["ort", "ort=info", "ort::session=info", "ort[run]=info"] {
            let filter = filter_of(named);
            assert!(!filter.contains("ort=warn"), "{named}: {filter}");
        }
        assert!(filter_of("orthography=debug").contains("ort=warn,"));
    }
}
