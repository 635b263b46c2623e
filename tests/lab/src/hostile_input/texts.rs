//! Texts that people and programs write: venues, calibrations, clips, scenes, cards, keypoints, poses.

use std::path::Path;
use std::sync::{Arc, LazyLock};

use farfield_edge::source::{open, probe};
use farfield_proto::model_card::ModelCard;
use farfield_proto::venue::Venue;
use farfield_score::lines::{LinesRole, PoseLines};
use farfield_score::points::PointSet;
use farfield_sim::embedded::CLIPS;
use farfield_sim::motion::Clip;
use farfield_sim::scene::Scene;

use super::venue_texts::keypoint_venue;
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
