//! The system's clock: whether something keeps it right.

use farfield_proto::message::health::SystemClock;
use farfield_proto::venue::{Parameters, Venue};

use crate::report_lines::ReportLines;

const CLOCK: &str = "clock";
/// 2025-01-01, Unix time in seconds: this program is younger.
const YOUNGEST_S: i64 = 1_735_689_600;
const KEEP: &str = "timedatectl set-ntp true (or chrony, or PTP: docs/live.md)";

/// Adds what the system says of its clock, at `now_s` by it (Unix time in seconds).
pub(super) fn look_at_clock(
    clock: &SystemClock,
    now_s: i64,
    venue: Option<&Venue>,
    report: &mut ReportLines,
) {
    if now_s < YOUNGEST_S {
        report.fail(
            CLOCK,
            "the clock shows a time before this program was made",
            KEEP,
        );
        return;
    }
    let parameters = venue.map_or_else(Parameters::default, |venue| venue.parameters.clone());
    let bound_ms = parameters.link.clock_bound_ms;
    let max_error_ms = clock.max_error_us.map(|us| f64::from(us) / 1000.0);
    match (clock.synchronised, max_error_ms) {
        (false, _) => report.warn(
            CLOCK,
            "nothing keeps the clock right, as far as the system says (in a container it may not know)",
            KEEP,
        ),
        (true, Some(error_ms)) if error_ms > bound_ms => report.warn(
            CLOCK,
            format!("the clock may be off by {error_ms:.0} ms; live, an edge that is surely off by {bound_ms:.0} ms is refused"),
            "chronyc makestep (or a nearer time server)",
        ),
        (true, Some(error_ms)) => {
            report.ok(CLOCK, format!("the clock is kept right, to {error_ms:.1} ms at worst"));
        }
        (true, None) => report.ok(CLOCK, "the clock is kept right"),
    }
}
