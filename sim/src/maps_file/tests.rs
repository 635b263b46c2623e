//! A file is read back as it was written, and every damage is refused.

use std::sync::{Arc, LazyLock};

use farfield_edge::source::{MapCrop, MapPainter};
use farfield_proto::bounding_box::{BoundingBox, BoxRate};
use farfield_proto::grid::CellGrid;
use farfield_proto::id::CameraIndex;
use farfield_proto::message::CameraBox;
use farfield_proto::patch::Maps;
use farfield_proto::tick::Tick;
use proptest::prelude::*;

use super::*;
use crate::embedded;
use crate::faults::{MapFaults, MapObservation, SceneCrowd};
use crate::scene::Scene;

const TICKS: u32 = 4;

fn court() -> Arc<Scene> {
    Arc::new(embedded::scene("court").unwrap())
}

fn written(scene: &Arc<Scene>, course: (Course, u32)) -> Vec<u8> {
    let crowd = Arc::new(SceneCrowd::new(Arc::clone(scene)));
    let mut bytes = Vec::new();
    let whole = write_maps(&crowd, 0, course, None, &mut bytes, &|| true).unwrap();
    assert!(whole);
    bytes
}

fn once(scene: &Arc<Scene>) -> Vec<u8> {
    written(scene, (Course::Once { start_s: 0.0 }, TICKS))
}

/// The maps of a crop around the first person that a detector finds.
fn painted(observation: &MapObservation, scene: &Scene) -> Maps {
    let camera = &scene.cameras()[0];
    let persons = observation.persons();
    let nose = persons[0].iter().flatten().next().unwrap();
    let at = camera.undistort(nose.position).unwrap().vector_px();
    let center_px = [at.x as f32, at.y as f32];
    let region = CameraBox {
        camera: CameraIndex(0),
        bounding_box: BoundingBox {
            center_px,
            size_px: [300.0, 400.0],
            rotation_rad: 0.0,
        },
        rate: BoxRate::default(),
        torso_px: center_px,
        neck_px: center_px,
    };
    let grid = CellGrid {
        origin_px: [center_px[0] - 144.0, center_px[1] - 192.0],
        step_px: [6.0, 0.0],
        width: 48,
        height: 64,
    };
    let crop = MapCrop {
        region: &region,
        grid: &grid,
        sigma_cells: 2.0,
        camera,
        floor: 15,
    };
    let mut maps = Maps::new(48, 64, 17);
    observation.paint(&crop, &mut maps);
    maps
}

#[test]
fn precomputed_maps_equal_directly_painted_ones() {
    let scene = court();
    let file = MapsFile::parse(once(&scene)).unwrap();
    let camera = Arc::new(scene.cameras()[0].clone());
    assert_eq!(file.header().camera, camera.name());
    let mut made = MapFaults::new(Arc::clone(&scene), 0);
    for tick in 0..u64::from(TICKS) {
        let stored = file.observation(tick, &camera).unwrap().unwrap();
        let made = made.observe(Tick(tick.cast_signed()));
        let (stored, made) = (painted(&stored, &scene), painted(&made, &scene));
        let mut sum = 0;
        for k in 0..17 {
            for (a, b) in stored.cells(k).iter().zip(made.cells(k)) {
                // Positions are stored as f32.
                assert!(a.abs_diff(*b) <= 1);
                sum += u32::from(*a);
            }
        }
        assert!(sum > 1000, "an empty crop proves nothing");
    }
    assert!(
        file.observation(u64::from(TICKS), &camera)
            .unwrap()
            .is_none()
    );
}

#[test]
fn every_observation_with_faults_is_read_back() {
    // Every fault of the standard profile occurs many times, also mirrored peaks higher than 1.
    let scene = Arc::new(embedded::scene("futsal").unwrap());
    let file = MapsFile::parse(written(&scene, (Course::Once { start_s: 0.0 }, 120)));
    assert_eq!(file.map(|file| file.header().ticks), Ok(120));
}

#[test]
fn a_recording_that_returns_to_its_start_repeats() {
    let scene = court();
    let course = Course::new(&scene, &(Tick(0)..Tick(1)), true);
    let file = MapsFile::parse(written(&scene, course)).unwrap();
    assert!(file.header().repeats);
    let camera = Arc::new(scene.cameras()[0].clone());
    let at = |tick| file.observation(tick, &camera).unwrap().unwrap();
    let n = u64::from(course.1);
    assert_eq!(at(3).persons(), at(3 + 5 * n).persons());
    // The last tick is next to the first: every person moves at most one slow step.
    let (last, first) = (at(n - 1).persons(), at(n).persons());
    let px = |persons: &[Vec<Option<farfield_edge::source::KeypointCandidate>>]| {
        persons[0][5].unwrap().position.vector_px()
    };
    assert!((px(&last) - px(&first)).norm() < 5.0, "{last:?} {first:?}");
}

#[test]
fn a_cut_file_is_refused_at_every_length() {
    let bytes = once(&court());
    for end in (0..bytes.len()).step_by(7) {
        let refused = MapsFile::parse(bytes[..end].to_vec()).unwrap_err();
        let message = refused.to_string();
        let expected = if end < MAGIC.len() {
            "does not begin as one"
        } else {
            "was cut: it ends in"
        };
        assert!(message.contains(expected), "{end}: {message}");
    }
    let more = [&bytes[..], b"x"].concat();
    assert_eq!(
        MapsFile::parse(more).unwrap_err(),
        MapsFileError::LeftOver(1)
    );
    let mut other = bytes;
    other[MAGIC.len() - 1] = 9;
    assert_eq!(
        MapsFile::parse(other).unwrap_err(),
        MapsFileError::Version { got: 9 }
    );
}

proptest! {
    #[test]
    fn every_changed_byte_is_detected(at in any::<prop::sample::Index>(), change in 1u8..) {
        static WRITTEN: LazyLock<Vec<u8>> = LazyLock::new(|| once(&court()));
        let mut bytes = WRITTEN.clone();
        let at = at.index(bytes.len());
        bytes[at] ^= change;
        prop_assert!(MapsFile::parse(bytes).is_err());
    }

    #[test]
    fn arbitrary_bytes_are_read_or_refused(rest in prop::collection::vec(any::<u8>(), 0..400)) {
        let bytes = [&MAGIC[..], &rest].concat();
        prop_assert!(MapsFile::parse(bytes).is_err());
    }
}
