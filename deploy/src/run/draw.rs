//! `--overlay`: the skeletons of one tick over the picture of every camera.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::export::unfinished::write_whole;
use farfield_fusion::skeleton::Joint;
use farfield_proto::id::PersonId;
use farfield_proto::message::{PersonPose, PersonState};
use farfield_proto::tick::Tick;
use image::{ImageFormat, RgbImage};
use serde::Deserialize;

use super::check::Plan;
use crate::overlay::overlay;

/// What of a line of `poses.jsonl` is drawn.
#[derive(Debug, Deserialize)]
struct Line {
    tick: Tick,
    person: u32,
    state: PersonState,
    joints: BTreeMap<String, [f32; 3]>,
}

/// Writes `overlay_<camera>_<tick>.png` for every camera, with the poses that the run has recorded.
pub(super) fn draw(plan: &Plan, out: &Path, tick: Tick) -> anyhow::Result<()> {
    let persons = recorded(&out.join("poses.jsonl"), tick)?;
    for camera in &plan.venue.cameras {
        let path = out.join(format!("overlay_{}_{tick}.png", camera.model.name()));
        let image = overlay(&plan.sources, &plan.venue, camera, tick, &persons)?;
        let bytes = png(&image).with_context(|| format!("encoding {}", path.display()))?;
        write_whole(path.clone(), &bytes).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}

fn png(image: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

fn recorded(path: &Path, tick: Tick) -> anyhow::Result<Vec<PersonPose>> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let mut persons = Vec::new();
    for line in BufReader::new(file).lines() {
        let line = line.with_context(|| format!("reading {}", path.display()))?;
        let line: Line =
            serde_json::from_str(&line).with_context(|| format!("reading {}", path.display()))?;
        // Lines are sorted by tick.
        if line.tick > tick {
            break;
        }
        if line.tick == tick {
            persons.push(pose(&line));
        }
    }
    Ok(persons)
}

fn pose(line: &Line) -> PersonPose {
    let joint = |joint: &Joint| {
        line.joints
            .get(joint.name())
            .copied()
            .unwrap_or([f32::NAN; 3])
    };
    PersonPose {
        person: PersonId(line.person),
        state: line.state,
        joints_m: Joint::ALL.iter().map(joint).collect(),
        keypoints_m: Vec::new(),
        angles: Vec::new(),
        unobserved: 0,
        views: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_persons_of_the_tick_are_read_from_the_recording() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses.jsonl");
        let line = |tick: i64, person: u32| {
            format!(
                "{{\"tick\":{tick},\"person\":{person},\"state\":\"tracked\",\"joints\":{{\"pelvis\":[1.0,2.0,0.9]}},\"views\":4}}\n"
            )
        };
        std::fs::write(
            &path,
            [line(4, 1), line(5, 1), line(5, 2), line(6, 1)].concat(),
        )
        .unwrap();
        let persons = recorded(&path, Tick(5)).unwrap();
        assert_eq!(
            persons.iter().map(|p| p.person.0).collect::<Vec<_>>(),
            [1, 2]
        );
        assert_eq!(
            persons[0].joints_m[Joint::Pelvis.index()].map(f32::to_bits),
            [1.0f32, 2.0, 0.9].map(f32::to_bits)
        );
    }
}
