//! `--overlay`: the skeletons of single ticks over the picture of every camera.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::export::unfinished::write_whole;
use farfield_proto::id::PersonId;
use farfield_proto::message::{PersonPose, PersonState};
use farfield_proto::tick::Tick;
use image::{ImageFormat, RgbImage};
use serde::Deserialize;

use super::check::RunPlan;
use crate::overlay::overlay;

/// What of a line of `poses.jsonl` is drawn.
#[derive(Debug, Deserialize)]
struct DrawnPoseLine {
    tick: Tick,
    person: u32,
    state: PersonState,
    joints: BTreeMap<String, [f32; 3]>,
}

/// Writes `overlay_<camera>_<tick>.png` for every camera and every tick that the plan asks for, with
/// the poses that the run has recorded.
pub(super) fn draw(plan: &RunPlan, out: &Path) -> anyhow::Result<()> {
    if plan.overlay.is_empty() {
        return Ok(());
    }
    let recorded = recorded(&out.join("poses.jsonl"), &plan.overlay)?;
    for &tick in &plan.overlay {
        let persons = recorded.get(&tick).map_or(&[][..], Vec::as_slice);
        for camera in &plan.venue.cameras {
            let path = out.join(format!("overlay_{}_{tick}.png", camera.model.name()));
            let image = overlay(&plan.sources, &plan.venue, camera, tick, persons)?;
            let bytes = png(&image).with_context(|| format!("encoding {}", path.display()))?;
            write_whole(path.clone(), &bytes)
                .with_context(|| format!("writing {}", path.display()))?;
        }
    }
    Ok(())
}

fn png(image: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// The poses of `ticks`, of which some may have none.
fn recorded(path: &Path, ticks: &[Tick]) -> anyhow::Result<BTreeMap<Tick, Vec<PersonPose>>> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let mut persons: BTreeMap<Tick, Vec<PersonPose>> = BTreeMap::new();
    for line in BufReader::new(file).lines() {
        let line = line.with_context(|| format!("reading {}", path.display()))?;
        let line: DrawnPoseLine =
            serde_json::from_str(&line).with_context(|| format!("reading {}", path.display()))?;
        // Lines are sorted by tick.
        if ticks.last().is_none_or(|&last| line.tick > last) {
            break;
        }
        if ticks.contains(&line.tick) {
            persons.entry(line.tick).or_default().push(pose(&line));
        }
    }
    Ok(persons)
}

fn pose(line: &DrawnPoseLine) -> PersonPose {
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
        sigma_m: Vec::new(),
        angles: Vec::new(),
        unobserved: 0,
        views: 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_persons_of_the_ticks_are_read_from_the_recording() {
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
        let persons = recorded(&path, &[Tick(3), Tick(4), Tick(5)]).unwrap();
        let ids = |tick| {
            persons[&Tick(tick)]
                .iter()
                .map(|p| p.person.0)
                .collect::<Vec<_>>()
        };
        assert_eq!(persons.len(), 2, "nobody is there at tick 3");
        assert_eq!((ids(4), ids(5)), (vec![1], vec![1, 2]));
        assert_eq!(
            persons[&Tick(5)][0].joints_m[Joint::Pelvis.index()].map(f32::to_bits),
            [1.0f32, 2.0, 0.9].map(f32::to_bits)
        );
    }
}
