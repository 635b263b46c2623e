//! Cameras as files of 2D keypoints: what a detector would have found, with the scene's faults.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, bail};
use farfield_edge::source::{FrameContent, FrameSource as _, KeypointCandidate};
use farfield_fusion::export::unfinished::Unfinished;
use farfield_node::process::Ending;
use farfield_proto::venue::SimulatedContent;
use serde_json::{Value, json};

use super::RecordingPlan;
use super::kind::RecordingKind;
use super::work::{Interrupt, each_camera};

/// Writes one file per camera into `folder`.
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
                if interrupt.is_asked() {
                    return Ok(Ending::Interrupted);
                }
                let FrameContent::Painted(maps) = frame.content else {
                    bail!("a camera of maps has given something else");
                };
                writeln!(file, "{}", line(frame.tick.0, &maps.persons()))?;
            }
            file.finish()?;
            Ok(Ending::Done)
        };
        write().with_context(|| format!("writing {}", path.display()))
    })
}

/// One line of the file: the candidates of every person, in pixels of the raw picture.
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

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;

    use super::*;

    #[test]
    fn a_line_holds_what_was_seen_and_null_for_what_was_not() {
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
