//! How long the stages of the pipeline take, by the names that statuses and summaries have for them.

use farfield_proto::message::LOOK_STAGE;

use crate::pipeline::Stage;

/// The stages' times by name, with the keypoints of sightings, `share` of the inference, counted as
/// looking: what looks cost is told apart from what following people costs.
pub(super) fn split_looks(laps: &[(Stage, u32)], share: f64) -> [(&'static str, u32); 4] {
    let of = |wanted: Stage| {
        let laps = laps.iter().filter(|(stage, _)| *stage == wanted);
        laps.map(|(_, us)| us).sum::<u32>()
    };
    let keypoints_us = (f64::from(of(Stage::Infer)) * share).round() as u32;
    [
        (name(Stage::Crop), of(Stage::Crop)),
        (LOOK_STAGE, of(Stage::Look) + keypoints_us),
        (name(Stage::Infer), of(Stage::Infer) - keypoints_us),
        (name(Stage::Encode), of(Stage::Encode)),
    ]
}

fn name(stage: Stage) -> &'static str {
    match stage {
        Stage::Crop => "crop",
        Stage::Look => LOOK_STAGE,
        Stage::Infer => "infer",
        Stage::Encode => "encode",
    }
}
