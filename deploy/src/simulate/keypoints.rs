//! Simulated cameras as files of 2D keypoints, as a detector would find them, or of maps; with the faults of the scene.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, bail};
use farfield_edge::source::{FrameContent, FrameSource as _, KeypointCandidate};
use farfield_fusion::export::unfinished::Unfinished;
use farfield_node::process::Ending;
use farfield_proto::venue::SimulatedContent;
use farfield_sim::maps_file::write_maps;
use serde_json::{Value, json};

use super::RecordingPlan;
use super::kind::RecordingKind;
use super::work::{Interrupt, each_camera};

/// Writes one file of keypoints per camera into `folder`.
pub(super) fn write(
    plan: &RecordingPlan,
    folder: &Path,
    interrupt: &Interrupt,
) -> anyhow::Result<Ending> {
    let cameras = plan.scene.cameras();
    each_camera(cameras.len(), interrupt, |camera| {
        let path = folder.join(RecordingKind::Keypoints.path(cameras[camera].name()));
        let mut frames = plan.frames(camera, SimulatedContent::Maps)?;
        let mut write = || -> anyhow::Result<Ending> {
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent)?;
            }
            let mut file = Unfinished::create(&path)?;
            while let Some(frame) = frames.next_frame()? {
                if interrupt.is_requested() {
                    return Ok(Ending::Interrupted);
                }
                let FrameContent::Painted(maps) = frame.content else {
                    bail!("a simulated camera did not give maps");
                };
                writeln!(file, "{}", line(frame.tick.0, &maps.persons()))?;
            }
            file.finish()?;
            Ok(Ending::Done)
        };
        write().with_context(|| format!("writing {}", path.display()))
    })
}

/// One line of the file: the candidates of every person, in pixels of the raw image.
fn line(tick: i64, persons: &[Vec<Option<KeypointCandidate>>]) -> Value {
    let candidate = |candidate: &Option<KeypointCandidate>| {
        candidate.map(|KeypointCandidate { position, score }| {
            let px = position.vector_px();
            [
                rounded(px.x, 1e2),
                rounded(px.y, 1e2),
                rounded(f64::from(score), 1e3),
            ]
        })
    };
    let persons: Vec<Value> = persons
        .iter()
        .map(|person| json!({ "keypoints": person.iter().map(candidate).collect::<Vec<_>>() }))
        .collect();
    json!({ "tick": tick, "persons": persons })
}

fn rounded(value: f64, per_unit: f64) -> f64 {
    (value * per_unit).round() / per_unit
}

/// Writes one file of maps per camera into `folder`.
pub(super) fn write_as_maps(
    plan: &RecordingPlan,
    folder: &Path,
    interrupt: &Interrupt,
) -> anyhow::Result<Ending> {
    let cameras = plan.scene.cameras();
    each_camera(cameras.len(), interrupt, |camera| {
        let path = folder.join(RecordingKind::Maps.path(cameras[camera].name()));
        let may_continue = || !interrupt.is_requested();
        let write = || -> anyhow::Result<Ending> {
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent)?;
            }
            let mut file = Unfinished::create(&path)?;
            if !write_maps(
                &plan.crowd,
                camera,
                plan.course,
                None,
                &mut file,
                &may_continue,
            )? {
                return Ok(Ending::Interrupted);
            }
            file.flush()?;
            file.finish()?;
            Ok(Ending::Done)
        };
        write().with_context(|| format!("writing {}", path.display()))
    })
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;

    use super::*;

    #[test]
    fn a_line_has_null_for_missing_keypoints() {
        let seen = KeypointCandidate {
            position: Pixel::new(10.123, 20.0),
            score: 0.5,
        };
        let text = line(7, &[vec![Some(seen), None]]).to_string();
        assert_eq!(
            text,
            r#"{"persons":[{"keypoints":[[10.12,20.0,0.5],null]}],"tick":7}"#
        );
    }
}
