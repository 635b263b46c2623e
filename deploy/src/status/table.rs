//! The state of a venue as a table: one row per node, columns two blanks apart, the longest text last. A narrow
//! terminal gets fewer columns, with long texts below.

use super::state::{CameraState, ClockState, Mark, NodeState, PatchState, VenueState};
use farfield_proto::message::agreement::CameraAgreement;
use farfield_proto::message::live::CameraHealth;
use farfield_proto::plain_text::one_line;
use farfield_proto::printed::signed;

/// The columns from the left; faults and warnings follow.
const HEAD: [&str; 11] = [
    "node", "", "state", "version", "ticks/s", "delay ms", "patches", "kB/s", "clock ms",
    "cameras", "key ends",
];
/// Head of faults and warnings.
const NOTICES: &str = "notices";
/// Columns that a narrow terminal can lack; the first is removed first.
const LESS_IMPORTANT: [&str; 8] = [
    "version", "key ends", "patches", "clock ms", "kB/s", "cameras", "delay ms", "ticks/s",
];
/// Shown where nothing is known.
const NOTHING: &str = "-";
/// Longest state in the table, characters; a longer one is repeated in full among the notices.
const MAX_STATE: usize = 28;
/// Indent of continuation lines.
const INDENT: &str = "    ";

struct Row {
    cells: [String; HEAD.len()],
    /// Faults and warnings.
    notices: String,
}

/// The table, with a line for every node.
pub(super) fn text(state: &VenueState) -> String {
    let rows: Vec<Row> = state.nodes.iter().map(row).collect();
    whole(&rows) + &agreement(state)
}

/// The same for a terminal with this number of columns.
pub(super) fn text_within(state: &VenueState, columns: usize) -> String {
    let rows: Vec<Row> = state.nodes.iter().map(row).collect();
    let whole = whole(&rows);
    let table = if fits(&whole, columns) {
        whole
    } else {
        narrow(&rows, columns)
    };
    let below: String = agreement(state)
        .lines()
        .map(|line| wrapped(line, columns))
        .collect();
    table + &below
}

fn whole(rows: &[Row]) -> String {
    let notices = rows.iter().map(|row| row.notices.as_str());
    let notices: Vec<&str> = std::iter::once(NOTICES).chain(notices).collect();
    let columns: Vec<usize> = (0..HEAD.len()).collect();
    table(rows, &columns, &notices)
}

/// With as many columns as fit; missing columns, faults and warnings follow.
fn narrow(rows: &[Row], width: usize) -> String {
    let has_content = |column: &usize| {
        let mut cells = rows.iter().map(|row| row.cells[*column].as_str());
        cells.any(|cell| !cell.is_empty() && cell != NOTHING)
    };
    let mut shown: Vec<usize> = (0..HEAD.len()).filter(has_content).collect();
    let mut removed = Vec::new();
    let mut text = table(rows, &shown, &[]);
    for name in LESS_IMPORTANT {
        if fits(&text, width) {
            break;
        }
        let before = shown.len();
        shown.retain(|column| HEAD[*column] != name);
        if shown.len() < before {
            removed.push(name);
            text = table(rows, &shown, &[]);
        }
    }
    for row in rows.iter().filter(|row| !row.notices.is_empty()) {
        let line = format!("{}: {}", row.cells[0], row.notices);
        text.push_str(&wrapped(&line, width));
    }
    if !removed.is_empty() {
        let line = format!("hidden columns: {}", removed.join(", "));
        text.push_str(&wrapped(&line, width));
    }
    text
}

/// Head and rows of these columns; `last` is an optional last column with its head.
fn table(rows: &[Row], columns: &[usize], last: &[&str]) -> String {
    let heads = HEAD.map(str::to_owned);
    let cells = rows.iter().map(|row| &row.cells);
    let lines: Vec<&[String; HEAD.len()]> = std::iter::once(&heads).chain(cells).collect();
    let widths = columns.iter().map(|column| {
        let widths = lines.iter().map(|cells| cells[*column].chars().count());
        widths.max().unwrap_or(0)
    });
    let widths: Vec<usize> = widths.collect();
    let mut text = String::new();
    for (i, cells) in lines.iter().enumerate() {
        let mut line = String::new();
        for (column, width) in columns.iter().zip(&widths) {
            let cell = &cells[*column];
            let gap = width - cell.chars().count() + 2;
            line.push_str(cell);
            line.extend(std::iter::repeat_n(' ', gap));
        }
        line.push_str(last.get(i).copied().unwrap_or_default());
        text.push_str(line.trim_end());
        text.push('\n');
    }
    text
}

/// Whether no line is longer than `width` characters.
fn fits(text: &str, width: usize) -> bool {
    text.lines().all(|line| line.chars().count() <= width)
}

/// Wraps `line` at `width` characters; a longer word has a line of its own.
fn wrapped(line: &str, width: usize) -> String {
    if fits(line, width) {
        return format!("{line}\n");
    }
    let mut text = String::new();
    let mut used = 0;
    for word in line.split_whitespace() {
        let length = word.chars().count();
        if used > 0 && used + 1 + length > width {
            text.push('\n');
            text.push_str(INDENT);
            used = INDENT.len();
        } else if used > 0 {
            text.push(' ');
            used += 1;
        }
        text.push_str(word);
        used += length;
    }
    text.push('\n');
    text
}

/// An empty line, and a line for every camera whose agreement with the others is known.
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

fn row(node: &NodeState) -> Row {
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
    let cells = [
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
    ];
    Row {
        cells: cells.map(|text| one_line(&text)),
        notices: one_line(&notices.join("; ")),
    }
}

/// Fusion: delay of its poses; edge: round trip.
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
    let offset = clock.offset_ms.map(|ms| signed(ms, 1));
    let bound = clock.uncertainty_ms.map(|ms| format!("±{ms:.1}"));
    let synchronised = match clock.synchronised {
        Some(true) => Some("synced".to_owned()),
        Some(false) => Some("free".to_owned()),
        None => None,
    };
    let parts: Vec<String> = [offset, bound, synchronised]
        .into_iter()
        .flatten()
        .collect();
    if parts.is_empty() {
        NOTHING.to_owned()
    } else {
        parts.join(" ")
    }
}

fn cameras(cameras: &[CameraState]) -> Option<String> {
    let works = |camera: &&CameraState| camera.health == CameraHealth::Works;
    let n = cameras.iter().filter(works).count();
    let waiting = cameras.iter().filter(|camera| camera.is_not_begun).count();
    match cameras.len() {
        0 => None,
        all if all == n => Some(format!("{n} work")),
        all if all == n + waiting => Some(format!("{waiting} wait")),
        all => Some(format!("{n} of {all} work")),
    }
}

/// Cameras that do not work, with their states.
fn cameras_in_words(cameras: &[CameraState]) -> impl Iterator<Item = String> {
    let broken = cameras
        .iter()
        .filter(|camera| camera.health != CameraHealth::Works && !camera.is_not_begun);
    broken.map(|camera| format!("camera {} {}", camera.name, camera.words))
}
