//! Whether all sources of a venue go by one time: live cameras by the clock, recordings by their own ticks; and whether the
//! ticks of a run are still to come.

use std::ops::Range;
use std::path::Path;

use anyhow::ensure;
use farfield_proto::tick::{Micros, Tick};
use farfield_proto::toml_file::{FileError, Place};
use farfield_proto::venue::Venue;

use crate::live::tick_time::TickTime;

/// Whether all pictures are recorded, or simulated: then they are played from a tick that fusion sets.
pub(super) fn is_recorded(venue: &Venue) -> bool {
    !venue.cameras.iter().any(|camera| camera.source.is_live())
}

/// Refuses a venue for a live run in which some cameras are live and others recordings: tick 0 of the live ones was in
/// 1970, and the recordings were over then.
///
/// # Errors
/// Names the venue file, which is at `path`, and the first recording beside a live camera.
pub fn check_live_or_recorded(venue: &Venue, path: &Path) -> Result<(), FileError> {
    let of = |is_live: bool| {
        let mut cameras = venue.cameras.iter();
        cameras.find(move |camera| camera.source.is_live() == is_live)
    };
    let (Some(live), Some(recorded)) = (of(true), of(false)) else {
        return Ok(());
    };
    let viewpoint = usize::from(recorded.viewpoint.0);
    let own = venue.viewpoints[viewpoint].cameras.iter();
    let mut own = own.filter_map(|&index| venue.camera(index));
    let at = own.position(|camera| camera.model.name() == recorded.model.name());
    let place = Place::field("viewpoint").index(viewpoint);
    let place = place.key("camera").index(at.unwrap_or(0)).key("source");
    let problem = format!(
        "found a recording (camera {}) beside the live camera {}: live cameras go by the clock, recordings by their own ticks, and they never meet; run the recordings alone, or replace them",
        recorded.model.name(),
        live.model.name()
    );
    Err(FileError::new(path, problem).at_field(place.to_string()))
}

/// Refuses `ticks` of live cameras that are over at `now_us`.
///
/// # Errors
/// Says which tick it is.
pub(super) fn check_ticks_to_come(
    venue: &Venue,
    ticks: &Range<Tick>,
    now_us: Micros,
) -> anyhow::Result<()> {
    let now = TickTime::new(0, venue.rate_hz).first_from(now_us);
    ensure!(
        is_recorded(venue) || now < ticks.end,
        "`--ticks {}..{}`: these are over, as ticks of live cameras count from 1970: expected an end after {now}; or leave `--ticks` out, and stop with Ctrl-C",
        ticks.start,
        ticks.end
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use farfield_proto::tick::SECOND_US;
    use farfield_proto::venue::{DeviceSettings, Source};

    use super::super::live::tests::venue;
    use super::*;

    #[test]
    fn a_recording_beside_a_live_camera_is_refused_by_name() {
        let mut venue = venue();
        let path = Path::new("hall.toml");
        check_live_or_recorded(&venue, path).unwrap();
        let live = Source::V4l {
            device: "/dev/video0".into(),
            settings: DeviceSettings::default(),
        };
        for i in [2, 0, 1] {
            venue.cameras[i].source = live.clone();
        }
        let refused = check_live_or_recorded(&venue, path)
            .unwrap_err()
            .to_string();
        assert!(
            refused.starts_with("hall.toml: `viewpoint[3].camera[0].source`: found a recording (camera d) beside the live camera a"),
            "{refused}"
        );
        venue.cameras[3].source = live;
        check_live_or_recorded(&venue, path).unwrap();
    }

    #[test]
    fn ticks_of_live_cameras_that_are_over_are_refused() {
        let recorded = venue();
        let mut live = venue();
        live.rate_hz = 60.0;
        live.cameras[0].source = Source::V4l {
            device: "/dev/video0".into(),
            settings: DeviceSettings::default(),
        };
        let now_us = 1_000 * SECOND_US;
        let ticks = |end| Tick(0)..Tick(end);
        assert!(check_ticks_to_come(&recorded, &ticks(1_200), now_us).is_ok());
        assert!(check_ticks_to_come(&live, &ticks(60_001), now_us).is_ok());
        let refused = check_ticks_to_come(&live, &ticks(60_000), now_us).unwrap_err();
        assert!(refused.to_string().contains("after 60000"), "{refused}");
    }
}
