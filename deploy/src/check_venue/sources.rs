//! Checks that every source exists, has the calibration's image size, and is not used twice.

use std::collections::BTreeMap;

use farfield_edge::source::{SourceError, SourceOrigin};
use farfield_proto::plausibility;
use farfield_proto::venue::{Source, Venue, VenueCamera};

use super::opened::OpenedSource;
use crate::recording_checks::{camera_name, format_remarks, to_one_rate};
use crate::report_lines::ReportLines;

const SOURCES: &str = "sources";

/// Images without a value above this are black: noise of a sensor in the dark stays below it, 0 to 255.
const BLACK: u8 = 24;

/// Checks the opened sources, one line per camera, and reports sources that two cameras share.
pub(super) fn check_sources(venue: &Venue, opened: &[OpenedSource], report: &mut ReportLines) {
    for (camera, source) in venue.cameras.iter().zip(opened) {
        check_source(camera, source, report);
    }
    check_duplicates(venue, opened, report);
}

fn check_source(camera: &VenueCamera, source: &OpenedSource, report: &mut ReportLines) {
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
                "check `source` of camera `{name}`: {}",
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
    if let Some(warning) = info.contents.and_then(|contents| contents.doubt()) {
        let named = format!("camera `{name}`: {}:", place(&camera.source));
        report.advise(SOURCES, warning.of(&named));
        return;
    }
    if source.brightest.is_some_and(|value| value < BLACK) {
        report.warn(
            SOURCES,
            format!("{words}: its first images are black"),
            "check for a lens cap, missing light or a missing signal; if the recording begins with black, cut all \
             recordings alike",
        );
        return;
    }
    report.ok(SOURCES, words);
    for remark in format_remarks(&camera_name(name), info) {
        report.advise(SOURCES, remark);
    }
}

/// The remedy for a source that cannot be used.
fn remedy(error: &SourceError, camera: &VenueCamera) -> String {
    let name = camera.model.name();
    match error {
        SourceError::ToolMissing { .. } => "apt install ffmpeg".to_owned(),
        SourceError::NotThere { .. } | SourceError::Pattern { .. } => {
            format!(
                "correct `source` of camera `{name}`, relative to the venue file, or copy the file there"
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
                "its offset would be {off_s:.0} s after an hour; if all cameras have this rate, set `rate_hz = {found_hz:.6}`, \
                 else {}",
                to_one_rate(*found_hz, *expected_hz)
            )
        }
        SourceError::Fields { found_hz, .. } => format!(
            "run the given command for all cameras, and set its OUT in `source`; or set `rate_hz = {found_hz:.6}`, \
             which ignores half of the fields",
        ),
        SourceError::Cut { .. } | SourceError::Ended { .. } => {
            "copy the recording again: it is incomplete".to_owned()
        }
        SourceError::NotBuilt { needs, .. } => format!("run this viewpoint with {needs}"),
        SourceError::Line { .. } => {
            "write the file again: docs/venue.md describes its lines".to_owned()
        }
        SourceError::VariableRate { .. } | SourceError::UnevenRate { .. } => {
            "run the given command, and set its OUT in `source`: it uses the times of the frames, and repeats frames \
             where some were lost"
                .to_owned()
        }
        SourceError::Unreadable { at, .. } => unreadable_remedy(at, camera),
        _ => format!("check `source` of camera `{name}`"),
    }
}

/// The remedy for a source that exists but is invalid.
fn unreadable_remedy(at: &SourceOrigin, camera: &VenueCamera) -> String {
    match &camera.source {
        Source::Video { .. } => format!(
            "check that it plays (`ffplay {}`); if not, copy it from the camera again, or correct `source` of camera `{}`",
            at.place,
            camera.model.name()
        ),
        Source::Keypoints { .. } => {
            "write the file again: docs/venue.md describes its lines".to_owned()
        }
        Source::V4l { .. } => format!(
            "close other programs that use it (`fuser {}`), and request a mode that it offers: `size` in the calibration, \
             `rate_hz` of the venue, `format` and `controls` of its `source`",
            at.place
        ),
        _ => format!("check `source` of camera `{}`", camera.model.name()),
    }
}

/// The place of a source for display.
fn place(source: &Source) -> String {
    match source {
        Source::Video { path }
        | Source::Images { path }
        | Source::Keypoints { path, .. }
        | Source::Simulated { path, .. }
        | Source::Maps { path, .. }
        | Source::V4l { device: path, .. } => path.display().to_string(),
        // Addresses can contain passwords.
        Source::Ffmpeg { .. } => "a live stream".to_owned(),
    }
}

/// The file of a source that belongs to one camera; a scene is shared by all.
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

fn check_duplicates(venue: &Venue, opened: &[OpenedSource], report: &mut ReportLines) {
    let mut files: BTreeMap<String, &str> = BTreeMap::new();
    let mut contents: BTreeMap<u64, &str> = BTreeMap::new();
    for (camera, source) in venue.cameras.iter().zip(opened) {
        let name = camera.model.name();
        let earlier = own_file(&camera.source).and_then(|file| files.insert(file, name));
        let alike = source
            .content
            .and_then(|content| contents.insert(content, name));
        let (other, what) = match (earlier, alike) {
            (Some(other), _) => (other, "have the same source"),
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
            format!("set the recording of `{name}` in its `source`"),
        );
    }
}
