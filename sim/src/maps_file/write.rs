//! Writes a camera of a scene as a file of maps.

use std::io::{self, Write};
use std::sync::Arc;

use farfield_proto::tick::Tick;
use serde::Serialize;

use super::{CameraFailure, Course, Header, MAGIC};
use crate::faults::{MapFaults, SceneCrowd, StoredMapObservation};

/// Writes `ticks` ticks of the maps of camera `camera` over `course`. Returns false, with the file
/// unfinished, as soon as `goes_on` returns false.
///
/// Slow errors of the simulated network restart with each repetition of a course.
///
/// # Errors
/// An error of `out`.
///
/// # Panics
/// When the scene has no such camera.
pub fn write_maps(
    crowd: &Arc<SceneCrowd>,
    camera: usize,
    (course, ticks): (Course, u32),
    failure: Option<CameraFailure>,
    out: &mut impl Write,
    goes_on: &dyn Fn() -> bool,
) -> io::Result<bool> {
    let scene = crowd.scene();
    let model = &scene.cameras()[camera];
    let mut maps = MapFaults::with_crowd(Arc::clone(crowd), camera);
    let header = Header {
        camera: model.name().to_owned(),
        size_px: model.size_px(),
        rate_hz: scene.rate_hz(),
        ticks,
        repeats: matches!(course, Course::ThereAndBack { .. }),
        capture_offset_us: maps.capture_offset_us(),
        failure,
    };
    let mut out = Hashed {
        out,
        hasher: blake3::Hasher::new(),
    };
    out.write(&MAGIC)?;
    out.record(&header)?;
    let offset_s = f64::from(header.capture_offset_us) * 1e-6;
    for tick in (0..i64::from(ticks)).map(Tick) {
        if !goes_on() {
            return Ok(false);
        }
        let time_s = course.time_s(tick.seconds(scene.rate_hz()) + offset_s);
        out.record(&StoredMapObservation::new(&maps.observe_at(tick, time_s)))?;
    }
    let checksum = *out.hasher.finalize().as_bytes();
    out.write(&checksum)?;
    Ok(true)
}

/// A writer that also computes the checksum.
struct Hashed<'a, W> {
    out: &'a mut W,
    hasher: blake3::Hasher,
}

impl<W: Write> Hashed<'_, W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.hasher.update(bytes);
        self.out.write_all(bytes)
    }

    fn record(&mut self, record: &impl Serialize) -> io::Result<()> {
        let bytes = postcard::to_stdvec(record).map_err(io::Error::other)?;
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        self.write(&length.to_le_bytes())?;
        self.write(&bytes)
    }
}
