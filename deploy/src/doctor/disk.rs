//! The disk that results go to: whether it can be written, how fast, and how long it lasts.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use farfield_node::clock;
use farfield_proto::venue::Venue;

use crate::report_lines::ReportLines;

const DISK: &str = "disk";
/// What is written to measure, in pieces that are synced each.
const PIECES: usize = 16;
const PIECE_BYTES: usize = 1 << 20;
/// Measuring ends after this.
const PATIENCE: Duration = Duration::from_millis(800);
/// People of whom a recording is reckoned with.
const PEOPLE: f64 = 10.0;
/// What a person is in a recording per tick, bytes: poses as messages and as JSON, and the patches of a viewpoint.
const POSE_BYTES: f64 = 4000.0;
const PATCH_BYTES: f64 = 1500.0;
/// A recording shall last so long, and must, seconds.
const USUAL_S: f64 = 3600.0;
const LEAST_S: f64 = 60.0;

/// What a recording asks of the disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DiskNeed {
    /// Bytes per second.
    pub(super) bytes_per_s: f64,
}

impl DiskNeed {
    /// That of a recording of ten people in `venue`; without one, of four viewpoints at 60 ticks per second.
    pub(super) fn of(venue: Option<&Venue>) -> Self {
        let (rate_hz, viewpoints) =
            venue.map_or((60.0, 4), |venue| (venue.rate_hz, venue.viewpoints.len()));
        let per_tick = PEOPLE * (POSE_BYTES + PATCH_BYTES * viewpoints as f64);
        Self {
            bytes_per_s: rate_hz * per_tick,
        }
    }
}

/// Writes into `folder`, or into the nearest folder above it that is there, and takes it away again.
pub(super) fn look_at_disk(folder: &Path, need: DiskNeed, report: &mut ReportLines) {
    let mut there = folder;
    while !there.as_os_str().is_empty() && !there.exists() {
        there = there.parent().unwrap_or(Path::new(""));
    }
    let there = if there.as_os_str().is_empty() {
        Path::new(".")
    } else {
        there
    };
    let shown = if there == Path::new(".") {
        "this folder".to_owned()
    } else {
        there.display().to_string()
    };
    match free_bytes(there) {
        Err(error) => {
            report.fail(
                DISK,
                format!("{shown}: {error}"),
                "name a folder that can be written: `--out DIR`",
            );
            return;
        }
        Ok(free) => judge_room(&shown, free, need, report),
    }
    match measure(there) {
        Ok(bytes_per_s) => judge_rate(&shown, bytes_per_s, need, report),
        Err(error) => report.fail(
            DISK,
            format!("{shown} cannot be written: {error}"),
            "make room, or name another folder for the results: `farfield run VENUE --out DIR`",
        ),
    }
}

fn free_bytes(folder: &Path) -> std::io::Result<u64> {
    let about = rustix::fs::statvfs(folder)?;
    Ok(about.f_bavail.saturating_mul(about.f_frsize))
}

/// Adds what `free` bytes are worth.
pub(super) fn judge_room(shown: &str, free: u64, need: DiskNeed, report: &mut ReportLines) {
    let lasts_s = free as f64 / need.bytes_per_s;
    let text = format!(
        "{shown}: {:.1} GB are free, for about {:.1} hours of ten people recorded at {:.1} MB/s",
        free as f64 / 1e9,
        lasts_s / 3600.0,
        need.bytes_per_s / 1e6
    );
    let remedy = "delete recordings, or name another disk: `--out DIR`; `[recording] json_poses = false` takes half of it";
    if lasts_s < LEAST_S {
        report.fail(DISK, text, remedy);
    } else if lasts_s < USUAL_S {
        report.warn(DISK, text, remedy);
    } else {
        report.ok(DISK, text);
    }
}

/// Adds what a write rate is worth.
pub(super) fn judge_rate(shown: &str, bytes_per_s: f64, need: DiskNeed, report: &mut ReportLines) {
    let text = format!(
        "{shown}: {:.0} MB/s are written and synced, a recording takes {:.1} MB/s",
        bytes_per_s / 1e6,
        need.bytes_per_s / 1e6
    );
    if bytes_per_s < need.bytes_per_s {
        report.warn(DISK, text, "name a faster disk: `--out DIR`");
    } else {
        report.ok(DISK, text);
    }
}

/// Bytes per second that reach the disk.
fn measure(folder: &Path) -> std::io::Result<f64> {
    let mut file = tempfile::Builder::new()
        .prefix(".farfield-doctor-")
        .tempfile_in(folder)?;
    // Zeros would be nothing to a disk that compresses.
    let mut state = 1_u32;
    let piece: Vec<u8> = (0..PIECE_BYTES)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    let start = clock::now();
    let mut written = 0;
    for _ in 0..PIECES {
        file.write_all(&piece)?;
        file.as_file().sync_data()?;
        written += piece.len();
        if clock::now().duration_since(start) > PATIENCE {
            break;
        }
    }
    let took_s = clock::now().duration_since(start).as_secs_f64().max(1e-6);
    file.close()?;
    Ok(written as f64 / took_s)
}
