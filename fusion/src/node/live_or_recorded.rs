//! Whether all sources of a venue go by one time: live cameras by the clock, recordings by their own ticks.

use std::path::Path;

use farfield_proto::toml_file::{FileError, Place};
use farfield_proto::venue::Venue;

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

#[cfg(test)]
mod tests {
    use farfield_proto::venue::Source;

    use super::super::live::tests::venue;
    use super::*;

    #[test]
    fn a_recording_beside_a_live_camera_is_refused_by_name() {
        let mut venue = venue();
        let path = Path::new("hall.toml");
        check_live_or_recorded(&venue, path).unwrap();
        let live = Source::V4l {
            device: "/dev/video0".into(),
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
}
