//! Texts that people and programs write: venues, calibrations, clips, scenes, cards, keypoints, poses.

use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use farfield_edge::source::{open, probe};
use farfield_proto::calibration::Calibration;
use farfield_proto::frames::Pixel;
use farfield_proto::model_card::ModelCard;
use farfield_proto::venue::Venue;
use farfield_score::lines::{LinesRole, PoseLines};
use farfield_score::points::PointSet;
use farfield_sim::embedded::CLIPS;
use farfield_sim::motion::Clip;
use farfield_sim::scene::Scene;

use super::{read_or_refused, refused, size, text};

/// Motion clips (BVH) of any content: read or refused.
pub(super) fn clip_text(bytes: &[u8]) -> String {
    read_or_refused(&Clip::parse(text(bytes), Path::new("clip.bvh")))
}

/// Scenes of any content: read or refused, in bounded time.
pub(super) fn scene_text(bytes: &[u8]) -> String {
    static CLIP: LazyLock<Arc<Clip>> = LazyLock::new(|| {
        let (name, text) = CLIPS[0];
        Arc::new(Clip::parse(text, Path::new(name)).expect("an embedded clip can be read"))
    });
    let mut clips = |_: &Path| Ok(Arc::clone(&CLIP));
    let scene = Scene::parse(text(bytes), Path::new("scene.toml"), &mut clips);
    if let Ok(scene) = &scene {
        std::hint::black_box(scene.person_at(0, scene.seconds() / 2.0));
    }
    read_or_refused(&scene)
}

/// Model cards of any content: read or refused.
pub(super) fn model_card_text(bytes: &[u8]) -> String {
    read_or_refused(&ModelCard::parse(text(bytes), Path::new("card.toml")))
}

/// Files of 2D keypoints of any content: read to their end or refused.
pub(super) fn keypoints_text(bytes: &[u8]) -> String {
    static VENUE: LazyLock<Venue> = LazyLock::new(|| {
        let file = format!("farfield-hostile-{}.jsonl", std::process::id());
        keypoint_venue(&std::env::temp_dir(), &file)
    });
    let path = std::env::temp_dir().join(format!("farfield-hostile-{}.jsonl", std::process::id()));
    std::fs::write(&path, bytes).expect("a temporary file can be written");
    let behaviour = read_keypoints(&VENUE);
    std::fs::remove_file(&path).expect("what was written can be removed");
    behaviour
}

fn read_keypoints(venue: &Venue) -> String {
    let info = match probe(&venue.cameras[0], venue) {
        Ok(info) => info,
        Err(error) => return refused(&error),
    };
    let ticks = info.ticks.expect("a file has an end");
    let mut source = match open(&venue.cameras[0], venue, ticks.start) {
        Ok(source) => source,
        Err(error) => return refused(&error),
    };
    let mut frames = 0;
    loop {
        match source.next_frame() {
            Ok(Some(_)) => frames += 1,
            Ok(None) => return format!("read, {} frames", size(frames)),
            Err(error) => return refused(&error),
        }
    }
}

/// Files of poses or truth of any content: read or refused.
pub(super) fn poses_text(bytes: &[u8]) -> String {
    let path = Path::new("poses.jsonl");
    let mut behaviour = String::new();
    for points in [PointSet::Joints, PointSet::Shelf14] {
        for role in [LinesRole::Poses, LinesRole::Truth] {
            let recording = PoseLines::read(bytes, path, role, points, None);
            behaviour += &read_or_refused(&recording);
        }
    }
    behaviour
}

const CALIBRATION: &str = r"
[a]
size = [64, 48]
matrix = [[50.0, 0.0, 32.0], [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]
distortions = [0.0, 0.0, 0.0, 0.0]
rotation = [0.0, 0.0, 0.0]
translation = [0.0, 0.0, 0.0]
";
const VENUE: &str = r#"
name = "v"
rate_hz = 60.0
calibration = "calibration.toml"
[[viewpoint]]
name = "n"
[[viewpoint.camera]]
name = "a"
source = { kind = "keypoints", path = "PATH" }
"#;

/// Calibration files of any content: read or refused.
pub(super) fn calibration_text(bytes: &[u8]) -> String {
    let calibration = Calibration::parse(text(bytes), Path::new("calibration.toml"));
    for camera in calibration.iter().flat_map(|it| it.cameras.values()) {
        let corner = camera.undistort(Pixel::new(0.0, 0.0));
        if camera.lens().is_fisheye() {
            assert!(
                corner.is_none_or(|ideal| ideal.vector_px().iter().all(|v| v.is_finite())),
                "what is used of a fisheye has a place among the pinhole's pixels"
            );
        } else {
            assert!(
                corner.is_some(),
                "a camera that was accepted sees its corner"
            );
        }
    }
    read_or_refused(&calibration)
}

/// Venue files of any content: read or refused.
pub(super) fn venue_text(bytes: &[u8]) -> String {
    let venue = Venue::parse(text(bytes), Path::new("venue.toml"), one_camera());
    read_or_refused(&venue)
}

/// A venue of one camera, `a`, with its keypoints in this file of this folder.
pub(super) fn keypoint_venue(folder: &Path, file: &str) -> Venue {
    let path: PathBuf = folder.join("venue.toml");
    let venue = Venue::parse(&VENUE.replace("PATH", file), &path, one_camera());
    venue.expect("the text above is a venue")
}

fn one_camera() -> Calibration {
    let calibration = Calibration::parse(CALIBRATION, Path::new("calibration.toml"));
    calibration.expect("the text above is a calibration")
}
