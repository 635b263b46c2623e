//! The state of a venue as a table: one row a node, columns two blanks apart, whatever is long last.

use super::state::{CameraState, ClockState, Mark, NodeState, PatchState, VenueState};
use farfield_proto::message::agreement::CameraAgreement;
use farfield_proto::message::live::CameraHealth;

/// The columns, from the left; the last has what is not as it should be.
const HEAD: [&str; 12] = [
    "node", "", "state", "version", "ticks/s", "delay ms", "patches", "kB/s", "clock ms",
    "cameras", "key ends", "notices",
];
/// What stands where nothing is known.
const NOTHING: &str = "-";
/// Longest state in the table, characters; all of it stands among the notices then.
const MAX_STATE: usize = 28;

/// The table, with a line for every node.
pub(super) fn text(state: &VenueState) -> String {
    let mut rows = vec![HEAD.map(str::to_owned)];
    rows.extend(state.nodes.iter().map(row));
    let mut widths = [0; HEAD.len()];
    for row in &rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let mut text = String::new();
    for row in rows {
        let mut line = String::new();
        for (width, cell) in widths.iter().zip(&row) {
            let gap = width - cell.chars().count() + 2;
            line.push_str(cell);
            line.extend(std::iter::repeat_n(' ', gap));
        }
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text.push_str(&agreement(state));
    text
}

/// A line for every camera of which it is known how it agrees with the others, after an empty one.
fn agreement(state: &VenueState) -> String {
    let cameras = state.nodes.iter().flat_map(|node| &node.cameras);
    let known = cameras.filter_map(|camera| Some((&camera.name, camera.agreement?)));
    let known: Vec<_> = known.filter(|(_, it)| it.is_known()).collect();
    let width = known.iter().map(|(name, _)| name.chars().count()).max();
    let width = width.unwrap_or(0);
    let line = |(name, agreement): (&String, CameraAgreement)| {
        format!("camera {name:width$}  {}\n", agreement.words())
    };
    let lines: String = known.into_iter().map(line).collect();
    if lines.is_empty() {
        lines
    } else {
        format!("\n{lines}")
    }
}

fn row(node: &NodeState) -> [String; HEAD.len()] {
    let mark = match node.mark {
        Mark::Ok => "ok",
        Mark::Warning => "!",
        Mark::Red => "RED",
    };
    let mut notices = node.notices.clone();
    let mut state = node.state.clone();
    if state.chars().count() > MAX_STATE {
        notices.insert(0, state.clone());
        state = state
            .split(':')
            .next()
            .unwrap_or_default()
            .chars()
            .take(MAX_STATE)
            .collect();
    }
    notices.extend(cameras_in_words(&node.cameras));
    let known = |text: Option<String>| text.unwrap_or_else(|| NOTHING.to_owned());
    [
        node.node.clone(),
        mark.to_owned(),
        state,
        known(Some(node.version.clone()).filter(|version| !version.is_empty())),
        known(node.ticks_per_s.map(|rate| format!("{rate:.1}"))),
        known(delay(node)),
        known(node.patches.as_ref().map(patches)),
        known(
            node.bytes_per_s
                .map(|bytes| format!("{:.1}", bytes as f64 / 1e3)),
        ),
        known(node.clock.as_ref().map(clock)),
        known(cameras(&node.cameras)),
        known(node.certificate_days.map(|days| format!("{days} days"))),
        notices.join("; "),
    ]
    // One line that commands no terminal, whatever a node has said.
    .map(|cell| cell.replace(char::is_control, " "))
}

/// Of fusion its poses', of an edge its round trip.
fn delay(node: &NodeState) -> Option<String> {
    let poses = node
        .delay_ms
        .map(|[p50, p99]| format!("{p50:.0} ({p99:.0})"));
    poses.or_else(|| node.round_trip_ms.map(|ms| format!("{ms:.1} rtt")))
}

fn patches(patches: &PatchState) -> String {
    let mut parts = vec![match patches.compression_level {
        0 => "lossless".to_owned(),
        level => format!("level {level}"),
    }];
    parts.extend(patches.persons_per_tick.map(|n| format!("{n} people")));
    if patches.every_nth_tick > 1 {
        parts.push(format!("1 in {} ticks", patches.every_nth_tick));
    }
    if patches.late + patches.missing > 0 {
        parts.push(format!(
            "{} late, {} missing",
            patches.late, patches.missing
        ));
    }
    parts.join(", ")
}

fn clock(clock: &ClockState) -> String {
    let offset = clock.offset_ms.map(|ms| format!("{ms:+.1}"));
    let bound = clock.uncertainty_ms.map(|ms| format!("±{ms:.1}"));
    let kept = match clock.synchronised {
        Some(true) => Some("kept".to_owned()),
        Some(false) => Some("free".to_owned()),
        None => None,
    };
    let parts: Vec<String> = [offset, bound, kept].into_iter().flatten().collect();
    if parts.is_empty() {
        NOTHING.to_owned()
    } else {
        parts.join(" ")
    }
}

fn cameras(cameras: &[CameraState]) -> Option<String> {
    let works = |camera: &&CameraState| camera.health == CameraHealth::Works;
    let n = cameras.iter().filter(works).count();
    match cameras.len() {
        0 => None,
        all if all == n => Some(format!("{n} work")),
        all => Some(format!("{n} of {all} work")),
    }
}

/// Those that do not work, each with how it is.
fn cameras_in_words(cameras: &[CameraState]) -> impl Iterator<Item = String> {
    let broken = cameras
        .iter()
        .filter(|camera| camera.health != CameraHealth::Works);
    broken.map(|camera| format!("camera {} {}", camera.name, camera.words))
}
