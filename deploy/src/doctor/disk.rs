//! The disk for the results: whether it can be written, its speed, and how long its space lasts.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use farfield_node::clock;
use farfield_proto::venue::Venue;

use crate::report_lines::ReportLines;

const DISK: &str = "disk";
/// Data written for the measurement, in pieces that are synced one by one.
const PIECES: usize = 16;
const PIECE_BYTES: usize = 1 << 20;
/// The measurement ends after this time.
const PATIENCE: Duration = Duration::from_millis(800);
/// Number of people of the assumed recording.
const PEOPLE: f64 = 10.0;
/// Bytes per person and tick of a recording: poses as messages and as JSON, and patches per viewpoint.
const POSE_BYTES: f64 = 4000.0;
const PATCH_BYTES: f64 = 1500.0;
/// Seconds of recording that the free space must have room for: below the first a warning, below the second a failure.
const USUAL_S: f64 = 3600.0;
const LEAST_S: f64 = 60.0;

/// What a recording needs of the disk.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DiskNeed {
    pub(super) bytes_per_s: f64,
}

impl DiskNeed {
    /// For a recording of ten people in `venue`; without one, of four viewpoints at 60 ticks per second.
    pub(super) fn for_venue(venue: Option<&Venue>) -> Self {
        let (rate_hz, viewpoints) =
            venue.map_or((60.0, 4), |venue| (venue.rate_hz, venue.viewpoints.len()));
        let per_tick = PEOPLE * (POSE_BYTES + PATCH_BYTES * viewpoints as f64);
        Self {
            bytes_per_s: rate_hz * per_tick,
        }
    }
}

/// Writes into `folder`, or into its nearest existing parent, and deletes the file again.
pub(super) fn check_disk(folder: &Path, need: DiskNeed, report: &mut ReportLines) {
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
                "choose a writable folder: `--out DIR`",
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
            "free some space, or choose another folder for the results: `farfield run VENUE --out DIR`",
        ),
    }
}

fn free_bytes(folder: &Path) -> std::io::Result<u64> {
    let about = rustix::fs::statvfs(folder)?;
    Ok(about.f_bavail.saturating_mul(about.f_frsize))
}

/// Reports whether `free` bytes are enough.
pub(super) fn judge_room(shown: &str, free: u64, need: DiskNeed, report: &mut ReportLines) {
    let lasts_s = free as f64 / need.bytes_per_s;
    let text = format!(
        "{shown}: {:.1} GB are free, enough for about {:.1} hours of recording ten people at {:.1} MB/s",
        free as f64 / 1e9,
        lasts_s / 3600.0,
        need.bytes_per_s / 1e6
    );
    let remedy = "delete recordings, or choose another disk: `--out DIR`; `[recording] json_poses = false` halves the size";
    if lasts_s < LEAST_S {
        report.fail(DISK, text, remedy);
    } else if lasts_s < USUAL_S {
        report.warn(DISK, text, remedy);
    } else {
        report.ok(DISK, text);
    }
}

/// Reports whether the write rate is high enough.
pub(super) fn judge_rate(shown: &str, bytes_per_s: f64, need: DiskNeed, report: &mut ReportLines) {
    let text = format!(
        "{shown}: {:.0} MB/s written and synced, a recording needs {:.1} MB/s",
        bytes_per_s / 1e6,
        need.bytes_per_s / 1e6
    );
    if bytes_per_s < need.bytes_per_s {
        report.warn(DISK, text, "choose a faster disk: `--out DIR`");
    } else {
        report.ok(DISK, text);
    }
}

/// The write rate of the disk, bytes per second.
fn measure(folder: &Path) -> std::io::Result<f64> {
    let mut file = tempfile::Builder::new()
        .prefix(".farfield-doctor-")
        .tempfile_in(folder)?;
    // Random data, as a disk that compresses would store zeros too fast.
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
