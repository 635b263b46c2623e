//! Relative accuracy of a network's keypoints: an eye is a point, a hip is somewhere inside a body.

use farfield_proto::keypoints::KeypointSet;

/// Standard deviations of human annotators, as shares of the object's scale: the constants
/// `sigma_k` of COCO's object keypoint similarity (cocoeval.py), by the end of the keypoint's name.
const OKS_SIGMAS: [(&str, f64); 9] = [
    ("nose", 0.026),
    ("eye", 0.025),
    ("ear", 0.035),
    ("shoulder", 0.079),
    ("elbow", 0.072),
    ("wrist", 0.062),
    ("hip", 0.107),
    ("knee", 0.087),
    ("ankle", 0.089),
];

/// Root mean square of the twelve limb keypoints' constants: the reference of
/// `ik.keypoint_sigma_m`.
const LIMB_SIGMA: f64 = 0.084;

/// Bounds of the ratio: a model's face is not a person's face, whatever a network sees.
const RATIOS: [f64; 2] = [0.5, 1.5];

/// Per keypoint of the network: its expected error over that of the average limb keypoint. Names
/// that COCO does not have count as average.
pub fn relative_sigmas(keypoints: &KeypointSet) -> Vec<f64> {
    let of = |name: &String| {
        let known = OKS_SIGMAS.iter().find(|(part, _)| name.ends_with(part));
        known.map_or(1.0, |(_, sigma)| {
            (sigma / LIMB_SIGMA).clamp(RATIOS[0], RATIOS[1])
        })
    };
    keypoints.names().iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eyes_are_better_than_hips_and_unknown_names_average() {
        let names = ["left_eye", "left_wrist", "left_hip", "mid_spine"];
        let sigmas = relative_sigmas(&KeypointSet::new(names.map(str::to_owned).to_vec()));
        assert!(sigmas[..3].is_sorted_by(|a, b| a < b), "{sigmas:?}");
        assert!((sigmas[3] - 1.0).abs() < 1e-12, "{sigmas:?}");
    }
}
