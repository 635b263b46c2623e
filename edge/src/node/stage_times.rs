//! Durations of the pipeline's stages, with their names in statuses and summaries.

use farfield_proto::message::DETECTION_STAGE;

use crate::pipeline::EdgeStage;

/// The durations by name. The `share` of the inference for sightings counts as detection, which
/// separates the cost of detection from that of tracking.
pub(super) fn split_detection(laps: &[(EdgeStage, u32)], share: f64) -> [(&'static str, u32); 4] {
    let of = |wanted: EdgeStage| {
        let laps = laps.iter().filter(|(stage, _)| *stage == wanted);
        laps.map(|(_, us)| us).sum::<u32>()
    };
    let keypoints_us = (f64::from(of(EdgeStage::Infer)) * share).round() as u32;
    [
        (name(EdgeStage::Crop), of(EdgeStage::Crop)),
        (DETECTION_STAGE, of(EdgeStage::Detect) + keypoints_us),
        (name(EdgeStage::Infer), of(EdgeStage::Infer) - keypoints_us),
        (name(EdgeStage::Encode), of(EdgeStage::Encode)),
    ]
}

fn name(stage: EdgeStage) -> &'static str {
    match stage {
        EdgeStage::Crop => "crop",
        EdgeStage::Detect => DETECTION_STAGE,
        EdgeStage::Infer => "infer",
        EdgeStage::Encode => "encode",
    }
}
