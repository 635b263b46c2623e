//! Cameras of which a clock or a focal length is not as given.

use super::found::Found;
use crate::points::{Bars, ClockUnit, Timing, suspects};
use crate::report::Finding;

/// How late a camera is that is doubtful, and wrong, seconds: people walk 1.5 m a second.
const LATE_S: [f64; 2] = [0.012, 0.06];
/// Share by which a focal length is off that is doubtful, and wrong: people tell one to a hundredth or two.
const FOCAL: [f64; 2] = [0.03, 0.045];

/// What is said of cameras that fit better with another clock or focal length.
pub(super) fn of_suspects(found: &Found<'_>) -> Vec<Finding> {
    let bars = Bars {
        late: LATE_S.map(|late_s| late_s * found.ticks_hz),
        focal: FOCAL,
    };
    let unit = ClockUnit {
        hz: Some(found.ticks_hz),
        is_frame: found.request.timing == Timing::Synchronised,
    };
    let suspects = suspects(&found.adjusted.problem, bars);
    let each = suspects.iter().map(|it| {
        let asked = found.adjusted.posed.get(it.camera);
        let name = found.name(*asked.unwrap_or(&it.camera));
        it.finding(name, bars, unit)
    });
    each.collect()
}
