//! Cameras of a scene as sources of a venue.

use std::path::Path;
use std::sync::Arc;

use farfield_edge::source::{FrameContent, FrameSource as _, Sources as _};
use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{SimulatedContent, Venue};

use super::*;
use crate::embedded;
use crate::faults::{MapFaults, SceneCrowd};
use crate::scene::write::calibration_text;

const FIRST: Tick = Tick(100);

fn venue_of(scene: &Scene, path: &Path, content: &str) -> Venue {
    let source = |_: &CameraModel| {
        let path = quoted(&path.display().to_string());
        format!("{{ kind = \"simulated\", path = {path}, content = \"{content}\" }}")
    };
    let text = VenueText {
        scene,
        name: "court",
        head: "two lines\nof comment",
        calibration: "calibration.toml",
        network: Some("models/net.toml"),
        detector: None,
        source: &source,
        first_tick: FIRST,
        given: Some(Tick(3)..Tick(9)),
    };
    let calibration = calibration_text(scene.cameras());
    let calibration = Calibration::parse(&calibration, Path::new("calibration.toml")).unwrap();
    Venue::parse(&text.to_toml(), Path::new("venue.toml"), calibration).unwrap()
}

#[test]
fn the_venue_of_a_scene_is_valid() {
    let scene = embedded::scene("court").unwrap();
    let venue = venue_of(&scene, Path::new("scene.toml"), "pixels");
    assert_eq!(venue.cameras.len(), scene.cameras().len());
    assert_eq!(venue.viewpoints.len(), scene.viewpoints().len());
    assert_eq!(venue.first_tick, FIRST);
    // All people are present from the start, and are given at their true positions.
    assert_eq!(venue.given_persons.len(), scene.people().len());
    let nose_m = venue.given_persons[0].keypoints_m["nose"];
    let truth = scene.person_at(0, scene.time_s(Tick(3))).unwrap();
    assert_eq!(venue.given_persons[0].tick, Tick(3));
    assert!((nose_m[0] - truth.sites_m[0].x).abs() < 1e-3, "{nose_m:?}");
}

#[test]
fn a_scenes_ticks_start_at_the_venues_first_tick() {
    let folder = tempfile::tempdir().unwrap();
    let path = embedded::write_scene("court", folder.path()).unwrap();
    let scene = Scene::load(&path).unwrap();
    let venue = venue_of(&scene, &path, "maps");
    let sources = VenueSources::default();
    let info = sources.probe(&venue.cameras[0], &venue).unwrap();
    let ticks = info.ticks.unwrap();
    assert_eq!(ticks.start, FIRST);
    assert_eq!(ticks.end - ticks.start, scene.ticks().end.0);
    let mut source = sources.open(&venue.cameras[0], &venue, Tick(105)).unwrap();
    let frame = source.next_frame().unwrap().unwrap();
    assert_eq!((frame.tick, frame.capture_offset_us), (Tick(105), 0));
    let FrameContent::Painted(seen) = frame.content else {
        panic!("maps are painted");
    };
    let crowd = Arc::new(SceneCrowd::new(Arc::new(scene)));
    let expected = MapFaults::with_crowd(crowd, 0).observe(Tick(5));
    let expected: &dyn farfield_edge::source::MapPainter = &expected;
    assert_eq!(seen.persons(), expected.persons());
    for outside in [Tick(99), ticks.end] {
        let refused = sources.open(&venue.cameras[0], &venue, outside);
        assert!(refused.is_err(), "{outside} is outside");
    }
}

#[test]
fn pictures_come_one_by_one_and_end_with_the_scene() {
    let scene = Arc::new(embedded::scene("court").unwrap());
    let crowd = Arc::new(SceneCrowd::new(Arc::clone(&scene)));
    let ticks = Tick(7)..Tick(9);
    let pixels = SimulatedContent::Pixels;
    let mut source = SimulatedSource::new(&crowd, 1, pixels, ticks, Tick(0)).unwrap();
    for tick in [7, 8] {
        let frame = source.next_frame().unwrap().unwrap();
        assert_eq!(frame.tick, Tick(tick));
        let FrameContent::Image(picture) = frame.content else {
            panic!("pixels are pictures");
        };
        assert_eq!(picture.size_px(), scene.cameras()[1].size_px());
    }
    assert!(source.next_frame().unwrap().is_none());
    let none = SimulatedSource::new(&crowd, 99, pixels, Tick(0)..Tick(1), Tick(0));
    assert!(none.is_err(), "the scene has 8 cameras");
}

#[test]
fn a_mismatch_with_the_venue_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = embedded::write_scene("court", folder.path()).unwrap();
    let scene = Scene::load(&path).unwrap();
    let sources = VenueSources::default();
    let refusal = |venue: &Venue| {
        sources
            .probe(&venue.cameras[0], venue)
            .unwrap_err()
            .to_string()
    };
    let mut venue = venue_of(&scene, &path, "maps");
    venue.rate_hz = 25.0;
    let refused = refusal(&venue);
    assert!(refused.contains("30.000 frames per second"), "{refused}");
    let venue = venue_of(&scene, Path::new("no/scene.toml"), "maps");
    let refused = refusal(&venue);
    assert!(refused.contains("no/scene.toml"), "{refused}");
}

#[test]
fn pictures_have_only_the_fault_of_their_time() {
    let mut faults = FaultProfile::standard();
    faults.free_running = true;
    let scene = embedded::scene("court").unwrap().with_faults(faults);
    let bare = without_map_faults(scene);
    assert_eq!(
        *bare.faults(),
        FaultProfile {
            free_running: true,
            ..FaultProfile::none()
        }
    );
}
