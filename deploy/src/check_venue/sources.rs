//! Whether every source is there, of the calibration's size, and another than all others.

use std::collections::BTreeMap;

use farfield_edge::source::{SourceError, SourceOrigin};
use farfield_proto::plausibility;
use farfield_proto::venue::{Source, Venue, VenueCamera};

use super::opened::OpenedSource;
use crate::recorded_formats::{format_remarks, of_camera};
use crate::recorded_rates::to_one_rate;
use crate::report_lines::ReportLines;

/// The group of these lines.
const SOURCES: &str = "sources";

/// Pictures of which no value reaches this are black: a sensor's noise in the dark does not, 0 to 255.
const BLACK: u8 = 24;

/// Looks at what was opened, one line per camera, and for sources that two cameras share.
pub(super) fn look_at_sources(venue: &Venue, opened: &[OpenedSource], report: &mut ReportLines) {
    for (camera, source) in venue.cameras.iter().zip(opened) {
        look_at(camera, source, report);
    }
    look_for_doubles(venue, opened, report);
}

fn look_at(camera: &VenueCamera, source: &OpenedSource, report: &mut ReportLines) {
    let name = camera.model.name();
    let info = match &source.info {
        Ok(info) => info,
        Err(error) => {
            report.fail(SOURCES, error.to_string(), remedy(error, camera));
            return;
        }
    };
    if let Some(Err(problem)) = &source.first {
        report.fail(
            SOURCES,
            problem.as_str(),
            format!(
                "look at `source` of camera `{name}`: {}",
                place(&camera.source)
            ),
        );
        return;
    }
    let mut words = vec![format!("camera `{name}`: {}", place(&camera.source))];
    if let Some([width, height]) = info.size_px {
        words.push(format!("{width}x{height}"));
    }
    if let Some(rate_hz) = info.rate_hz {
        words.push(format!(
            "{} frames per second",
            (rate_hz * 1000.0).round() / 1000.0
        ));
    }
    if let Some(ticks) = &info.ticks {
        words.push(format!("{} frames", ticks.end - ticks.start));
    }
    let words = words.join(", ");
    if let Some(doubt) = info.contents.and_then(|contents| contents.doubt()) {
        let named = format!("camera `{name}`: {}:", place(&camera.source));
        report.advise(SOURCES, doubt.of(&named));
        return;
    }
    if source.brightest.is_some_and(|value| value < BLACK) {
        report.warn(
            SOURCES,
            format!("{words}: its first pictures are black"),
            "see whether a cap is on the lens, light is on and a signal comes; a recording that begins with black: cut all \
             recordings alike",
        );
        return;
    }
    report.ok(SOURCES, words);
    for remark in format_remarks(&of_camera(name), info) {
        report.advise(SOURCES, remark);
    }
}

/// What mends a source that cannot be used.
fn remedy(error: &SourceError, camera: &VenueCamera) -> String {
    let name = camera.model.name();
    match error {
        SourceError::ToolMissing { .. } => "apt install ffmpeg".to_owned(),
        SourceError::NotThere { .. } | SourceError::Pattern { .. } => {
            format!(
                "correct `source` of camera `{name}`, relative to the venue file, or bring the file there"
            )
        }
        SourceError::PixelSize { found_px, .. } => {
            let finding = plausibility::of_picture_size(&camera.model, *found_px);
            finding.map_or_else(String::new, |finding| finding.remedy)
        }
        SourceError::Rate {
            found_hz,
            expected_hz,
            ..
        } => {
            let off_s = 3600.0 * (found_hz / expected_hz - 1.0).abs();
            format!(
                "it would be off by {off_s:.0} s after an hour; if all cameras have this rate, write `rate_hz = {found_hz:.6}`, \
                 else {}",
                to_one_rate(*found_hz, *expected_hz)
            )
        }
        SourceError::Fields { found_hz, .. } => format!(
            "run the command that stands there for all cameras, and name its OUT in `source`; or write `rate_hz = {found_hz:.6}`, \
             and half of the fields are left out"
        ),
        SourceError::Cut { .. } | SourceError::Ended { .. } => {
            "copy the recording again: it was cut".to_owned()
        }
        SourceError::NotBuilt { needs, .. } => format!("run this viewpoint with {needs}"),
        SourceError::Line { .. } => {
            "write the file again: docs/venue.md says what a line holds".to_owned()
        }
        SourceError::VariableRate { .. } | SourceError::UnevenRate { .. } => {
            "run the command that stands there, and name its OUT in `source`: it goes by the times of the frames, and what was \
             lost is shown twice"
                .to_owned()
        }
        SourceError::Unreadable { at, .. } => unreadable_remedy(at, camera),
        _ => format!("look at `source` of camera `{name}`"),
    }
}

/// What may mend a source that is there and is not what it should be.
fn unreadable_remedy(at: &SourceOrigin, camera: &VenueCamera) -> String {
    match &camera.source {
        Source::Video { .. } => format!(
            "see whether it plays (`ffplay {}`); if not, copy it from the camera again, or correct `source` of camera `{}`",
            at.place,
            camera.model.name()
        ),
        Source::Keypoints { .. } => {
            "write the file again: docs/venue.md says what a line holds".to_owned()
        }
        Source::V4l { .. } => format!(
            "close what else uses it (`fuser {}`), and ask it for what it offers: `size` in the calibration, `rate_hz` of the \
             venue, `format` and `controls` of its `source`",
            at.place
        ),
        _ => format!("look at `source` of camera `{}`", camera.model.name()),
    }
}

/// Where a source is, as it may be shown.
fn place(source: &Source) -> String {
    match source {
        Source::Video { path }
        | Source::Images { path }
        | Source::Keypoints { path, .. }
        | Source::Simulated { path, .. }
        | Source::Maps { path, .. }
        | Source::V4l { device: path, .. } => path.display().to_string(),
        // Passwords stand in addresses.
        Source::Ffmpeg { .. } => "a live stream".to_owned(),
    }
}

/// The file that a source alone is; scenes are shared by all cameras.
fn own_file(source: &Source) -> Option<String> {
    match source {
        Source::Video { path } | Source::Images { path } | Source::Keypoints { path, .. } => {
            let full = path.canonicalize().unwrap_or_else(|_| path.clone());
            Some(full.display().to_string())
        }
        Source::V4l { device, .. } => Some(device.display().to_string()),
        Source::Ffmpeg { url, .. } => Some(url.clone()),
        Source::Maps { .. } | Source::Simulated { .. } => None,
    }
}

fn look_for_doubles(venue: &Venue, opened: &[OpenedSource], report: &mut ReportLines) {
    let mut files: BTreeMap<String, &str> = BTreeMap::new();
    let mut contents: BTreeMap<u64, &str> = BTreeMap::new();
    for (camera, source) in venue.cameras.iter().zip(opened) {
        let name = camera.model.name();
        let earlier = own_file(&camera.source).and_then(|file| files.insert(file, name));
        let alike = source
            .content
            .and_then(|content| contents.insert(content, name));
        let (other, what) = match (earlier, alike) {
            (Some(other), _) => (other, "have one source"),
            (None, Some(other)) => (
                other,
                "show the same: their first frames are equal, byte for byte",
            ),
            (None, None) => continue,
        };
        report.fail(
            SOURCES,
            format!(
                "cameras `{other}` and `{name}` {what}: {}",
                place(&camera.source)
            ),
            format!("name the recording of `{name}` in its `source`"),
        );
    }
}
