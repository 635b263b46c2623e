//! A file of maps as a camera of a venue.

use std::fs;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use farfield_edge::source::{
    Frame, FrameContent, FrameSource, MapPainter, SourceError, SourceOrigin,
};
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};

use super::read::MAX_FILE_BYTES;
use super::{CameraFailure, FailureKind, MapsFile};
use crate::faults::MapObservation;

/// Relative difference below which two rates are equal: a file may store fewer digits.
const RATE_TOLERANCE: f64 = 1e-6;

/// Ticks of a recording that repeats: at 1000 per second it lasts 35 years.
const ENDLESS: i64 = 1 << 40;

/// The frames of one camera, tick by tick.
#[derive(Debug)]
pub struct MapsSource {
    file: Arc<MapsFile>,
    at: SourceOrigin,
    camera: Arc<CameraModel>,
    /// The next tick of the recording.
    next: u64,
    /// The venue's tick of the first tick of the recording.
    first: Tick,
    /// The repeated picture of a frozen camera.
    frozen: Option<Arc<MapObservation>>,
}

/// Reads and checks the file at `path` for `camera` of `venue`.
///
/// # Errors
/// [`SourceError`] when the file is absent, is damaged, or belongs to another camera or venue.
pub(crate) fn load(
    path: &Path,
    camera: &VenueCamera,
    venue: &Venue,
) -> Result<MapsFile, SourceError> {
    let at = || SourceOrigin {
        camera: camera.model.name().to_owned(),
        place: path.display().to_string(),
    };
    let unreadable = |problem: String| SourceError::Unreadable { at: at(), problem };
    let not_there = |error: std::io::Error| SourceError::NotThere {
        at: at(),
        problem: error.to_string(),
    };
    let bytes = fs::metadata(path).map_err(not_there)?.len();
    if bytes > MAX_FILE_BYTES {
        let problem = format!("has {bytes} bytes, at most {MAX_FILE_BYTES} are read");
        return Err(unreadable(problem));
    }
    let bytes = fs::read(path).map_err(not_there)?;
    let file = MapsFile::parse(bytes).map_err(|error| unreadable(error.to_string()))?;
    let header = file.header();
    if header.camera != camera.model.name() {
        return Err(unreadable(format!(
            "holds the maps of camera `{}`",
            header.camera
        )));
    }
    if header.size_px != camera.model.size_px() {
        return Err(SourceError::PixelSize {
            at: at(),
            found_px: header.size_px,
            expected_px: camera.model.size_px(),
        });
    }
    if !same_rate(header.rate_hz, venue.rate_hz) {
        return Err(SourceError::Rate {
            at: at(),
            found_hz: header.rate_hz,
            expected_hz: venue.rate_hz,
        });
    }
    Ok(file)
}

/// The venue's ticks of a file that starts at `first`.
pub(crate) fn ticks_of(file: &MapsFile, first: Tick) -> Range<Tick> {
    let header = file.header();
    let n = if header.repeats {
        ENDLESS
    } else {
        i64::from(header.ticks)
    };
    first..first + n
}

impl MapsSource {
    /// The frames of `file` from tick `from` of the venue on.
    ///
    /// # Errors
    /// [`SourceError::OutsideClip`] when the file has no such tick.
    pub fn new(
        file: Arc<MapsFile>,
        path: &Path,
        camera: &VenueCamera,
        (first, from): (Tick, Tick),
    ) -> Result<Self, SourceError> {
        let name = camera.model.name().to_owned();
        let has = ticks_of(&file, first);
        if !has.contains(&from) {
            return Err(SourceError::OutsideClip {
                camera: name,
                asked: from..from + 1,
                has,
            });
        }
        Ok(Self {
            file,
            at: SourceOrigin {
                camera: name,
                place: path.display().to_string(),
            },
            camera: Arc::new(camera.model.clone()),
            next: (from - first).unsigned_abs(),
            first,
            frozen: None,
        })
    }

    fn unreadable(&self, problem: String) -> SourceError {
        SourceError::Unreadable {
            at: self.at.clone(),
            problem,
        }
    }

    fn seen(&self, tick: u64) -> Result<Option<Arc<MapObservation>>, SourceError> {
        let seen = self.file.observation(tick, &self.camera);
        let seen = seen.map_err(|error| self.unreadable(error.to_string()))?;
        Ok(seen.map(Arc::new))
    }

    /// The output of a camera that has failed.
    fn failed(&mut self, failure: CameraFailure) -> Result<Arc<dyn MapPainter>, SourceError> {
        match failure.kind {
            FailureKind::TurnsBlack => Ok(Arc::new(MapObservation::black(&self.camera))),
            FailureKind::Freezes => {
                let last = u64::from(failure.from.saturating_sub(1));
                if self.frozen.is_none() {
                    self.frozen = self.seen(last)?;
                }
                let frozen = self.frozen.clone();
                frozen.map_or_else(
                    || Err(self.unreadable("a camera that never began freezes".to_owned())),
                    |frozen| Ok(frozen as Arc<dyn MapPainter>),
                )
            }
            FailureKind::Dies => Err(SourceError::Ended {
                at: self.at.clone(),
                read: self.next,
                expected: None,
                tool_output: String::new(),
            }),
        }
    }
}

impl FrameSource for MapsSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let tick = self.next;
        let header = self.file.header();
        let capture_offset_us = header.capture_offset_us;
        let failure = header.failure.filter(|f| tick >= u64::from(f.from));
        let Some(seen) = self.seen(tick)? else {
            return Ok(None);
        };
        let painter = match failure {
            Some(failure) => self.failed(failure)?,
            None => seen,
        };
        self.next += 1;
        Ok(Some(Frame {
            tick: self.first + i64::try_from(tick).unwrap_or(i64::MAX),
            capture_offset_us,
            content: FrameContent::Painted(painter),
        }))
    }
}

pub(crate) fn same_rate(found_hz: f64, expected_hz: f64) -> bool {
    (found_hz - expected_hz).abs() <= RATE_TOLERANCE * expected_hz
}
