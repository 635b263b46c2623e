//! Keypoints in space -> the lengths of a person's skeleton.

use super::observed::ObservedJoints;
use farfield_proto::order_statistics::weighted_median;

use super::prior::{BodyPrior, measured_sigma_m};
use super::segment::{Segment, stature_m};
use crate::body::skeleton::Proportions;

/// Initial error of a triangulated length, metres: one sigma.
const LENGTH_SIGMA_M: f64 = 0.03;

/// Weight of [`LENGTH_SIGMA_M`] relative to the spread of the samples, in samples.
const SIGMA_SAMPLES: f64 = 1.0;

/// A network's hip and knee are not at the joints' centres. This is the resulting error of the
/// distance of two hips, and of the distance of hip and knee or knee and ankle, metres. More
/// samples do not reduce it.
const HIPS_APART_SIGMA_M: f64 = 0.024;
const LEG_SIGMA_M: f64 = 0.010;

/// Limits of a length relative to that of the stature; outside, it was measured wrongly.
const FACTORS: [f64; 2] = [0.75, 1.3];

/// Samples farther from their median than this many robust sigmas do not take part in the mean.
const OUTLIER_SIGMAS: f64 = 2.5;

/// Sigma of a normal distribution over its median absolute deviation.
const SIGMA_OVER_MAD: f64 = 1.4826;

/// Least samples for a spread.
const MIN_SPREAD_SAMPLES: usize = 5;

/// Limits of the stature of a skeleton, metres.
const STATURES_M: [f64; 2] = [0.9, 2.4];

/// A body that is known before its keypoints are seen.
#[derive(Debug, Clone, Copy)]
pub struct KnownBody<'a> {
    /// The prior.
    pub prior: &'a BodyPrior,
    /// How long keypoints have shown it, seconds.
    pub seen_s: f64,
}

/// A length and its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
struct MeasuredLengths {
    length_m: f64,
    variance_m2: f64,
}

/// Lengths from `ticks` of one person: each segment's measured length and the length that the
/// stature gives, weighted by their variances. Left and right are combined.
///
/// The chain pelvis - spine - scapula - shoulder is as long and as wide as the measured trunk, with
/// the spine unbent and the scapulas level (paper, appendix B).
///
/// For a `known` body its lengths replace those of the stature, and the variance of a measured
/// length is limited by the time for which it was seen.
///
/// `None` if no segment of the body is known.
pub(crate) fn proportions(
    ticks: &[ObservedJoints],
    known: Option<KnownBody<'_>>,
) -> Option<Proportions> {
    let stature = stature_m(ticks)?.clamp(STATURES_M[0], STATURES_M[1]);
    let expected = |segment: Segment| {
        if let Some(known) = known {
            known.prior.segment_m(segment)
        } else {
            let length_m = segment.ratio() * stature;
            (length_m, segment.spread() * length_m)
        }
    };
    let lasting_m = known.map_or(0.0, |known| measured_sigma_m(known.seen_s));
    let length = |segment| blended_m(segment, ticks, expected(segment), lasting_m);
    let factor = |segment: Segment| length(segment) / expected(segment).0;
    let average = match known {
        Some(known) => *known.prior.body(),
        None => Proportions::from_stature(stature),
    };
    let (tall, wide, eyes) = (
        factor(Segment::Trunk),
        factor(Segment::ShoulderWidth),
        factor(Segment::EyeForward),
    );
    let neck_above_shoulders_m = tall * (average.trunk_m - average.scapula_up_m);
    let head_m = length(Segment::HeadHeight) - neck_above_shoulders_m;
    let (thigh_m, shank_m) = (length(Segment::Thigh), length(Segment::Shank));
    Some(Proportions {
        pelvis_height_m: average.pelvis_height_m - average.thigh_m - average.shank_m
            + thigh_m
            + shank_m,
        lumbar_m: tall * average.lumbar_m,
        trunk_m: tall * average.trunk_m,
        scapula_up_m: tall * average.scapula_up_m,
        scapula_side_m: wide * average.scapula_side_m,
        clavicle_m: wide * average.clavicle_m,
        head_m: head_m.clamp(FACTORS[0] * average.head_m, FACTORS[1] * average.head_m),
        nose_forward_m: length(Segment::NoseForward),
        eye_forward_m: eyes * average.eye_forward_m,
        eye_up_m: eyes * average.eye_up_m,
        eye_side_m: 0.5 * length(Segment::EyeWidth),
        ear_side_m: 0.5 * length(Segment::EarWidth),
        upper_arm_m: length(Segment::UpperArm),
        forearm_m: length(Segment::Forearm),
        hip_side_m: 0.5 * length(Segment::HipWidth),
        thigh_m,
        shank_m,
        ..average
    })
}

/// The length of `segment`, metres, from `prior` with its sigma and from `ticks`, with a lasting
/// error of `lasting_m`.
///
/// ```text
///   l = (m / v + p / u) / (1 / v + 1 / u),   m, v: measured and its variance,   p, u: prior and its variance
/// ```
fn blended_m(
    segment: Segment,
    ticks: &[ObservedJoints],
    (prior, prior_sigma): (f64, f64),
    lasting_m: f64,
) -> f64 {
    let prior_variance = prior_sigma.powi(2);
    let samples: Vec<(f64, f64)> = ticks
        .iter()
        .flat_map(|body| segment.lengths_m(body))
        .collect();
    let Some(measured) = measured(&samples) else {
        return prior;
    };
    let m = measured
        .length_m
        .clamp(FACTORS[0] * prior, FACTORS[1] * prior);
    let joint_error_m: f64 = match segment {
        Segment::HipWidth => HIPS_APART_SIGMA_M,
        Segment::Thigh | Segment::Shank => LEG_SIGMA_M,
        _ => 0.0,
    };
    let lasting_m2 = lasting_m.max(joint_error_m).powi(2);
    let variance_m2 = measured.variance_m2 + lasting_m2;
    let (w_measured, w_prior) = (variance_m2.recip(), prior_variance.recip());
    (m * w_measured + prior * w_prior) / (w_measured + w_prior)
}

/// The robust mean of `samples` (length, weight), corrected for the effect of noise on a distance.
///
/// Noise across a segment makes it longer: with variance s^2 per length, E|a - b|^2 exceeds the
/// true square by 3 s^2, of which s^2 are the length's own.
fn measured(samples: &[(f64, f64)]) -> Option<MeasuredLengths> {
    let middle = weighted_median(samples.to_vec())?;
    let deviations = samples
        .iter()
        .map(|&(l, w)| ((l - middle).abs(), w))
        .collect();
    let sigma = SIGMA_OVER_MAD * weighted_median(deviations)?;
    let gate = OUTLIER_SIGMAS * sigma.max(1e-6);
    let kept: Vec<(f64, f64)> = samples
        .iter()
        .copied()
        .filter(|&(l, _)| (l - middle).abs() <= gate)
        .collect();
    let weight: f64 = kept.iter().map(|s| s.1).sum();
    let mean = if weight > 0.0 {
        kept.iter().map(|s| s.0 * s.1).sum::<f64>() / weight
    } else {
        middle
    };
    let n = samples.len() as f64;
    let noise = if samples.len() >= MIN_SPREAD_SAMPLES {
        sigma * sigma
    } else {
        0.0
    };
    let length_m = (mean * mean - 2.0 * noise).max(0.25 * mean * mean).sqrt();
    let variance =
        (SIGMA_SAMPLES * LENGTH_SIGMA_M.powi(2) + n * sigma * sigma) / (SIGMA_SAMPLES + n);
    Some(MeasuredLengths {
        length_m,
        variance_m2: variance / n,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::body::fixture::{Noise, coco_only, joints, postures};
    use crate::body::skeleton::Skeleton;

    /// Error of a length from noise-free keypoints: the pull of the stature, which knees with
    /// possible offsets do not quite overrule.
    const EXACT_SHARE: f64 = 0.02;

    /// Root mean square error of links, as a share, if keypoints are off by [`NOISE_M`].
    const NOISY_SHARE: f64 = 0.03;

    const NOISE_M: f64 = 0.02;

    /// The links between keypoints, the only ones that can be measured. For hips, the stature
    /// determines part of their distance.
    fn measured_links(body: &Proportions) -> [(&'static str, f64); 6] {
        [
            ("upper arm", body.upper_arm_m),
            ("forearm", body.forearm_m),
            ("thigh", body.thigh_m),
            ("shank", body.shank_m),
            (
                "shoulder width",
                2.0 * (body.scapula_side_m + body.clavicle_m),
            ),
            ("trunk", body.lumbar_m + body.scapula_up_m),
        ]
    }

    fn ticks(body: &Proportions, seed: u64, sigma_m: f64) -> Vec<ObservedJoints> {
        let skeleton = Skeleton::new(body);
        let mut noise = Noise(seed);
        postures(15, &mut noise)
            .iter()
            .map(|pose| coco_only(&joints(&skeleton, pose), |p| p + noise.vector(sigma_m)))
            .collect()
    }

    fn check(truth: &Proportions, seen: &[ObservedJoints]) -> Result<(), TestCaseError> {
        let found = proportions(seen, None).expect("whole bodies have segments");
        for ((name, was), (_, is)) in measured_links(truth)
            .into_iter()
            .zip(measured_links(&found))
        {
            prop_assert!(
                (is - was).abs() <= EXACT_SHARE * was,
                "{name}: {is:.4} m, was {was:.4} m"
            );
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn exact_keypoints_give_the_links_of_an_unusual_person(
            stature in 1.2f64..2.1,
            arms in 0.92f64..1.08,
            legs in 0.92f64..1.08,
            trunk in 0.92f64..1.08,
            seed in any::<u64>(),
        ) {
            let average = Proportions::from_stature(stature);
            let body = Proportions {
                upper_arm_m: arms * average.upper_arm_m,
                forearm_m: arms * average.forearm_m,
                thigh_m: legs * average.thigh_m,
                shank_m: legs * average.shank_m,
                lumbar_m: trunk * average.lumbar_m,
                trunk_m: trunk * average.trunk_m,
                scapula_up_m: trunk * average.scapula_up_m,
                ..average
            };
            check(&body, &ticks(&body, seed, 0.0))?;
        }
    }

    #[test]
    fn noisy_keypoints_of_fifteen_ticks_give_the_links_too() {
        // Per axis, so that a keypoint is off by NOISE_M in total.
        let sigma_m = NOISE_M / f64::sqrt(3.0);
        let body = Proportions::from_stature(1.78);
        let runs: Vec<Proportions> = (0..40)
            .map(|seed| proportions(&ticks(&body, seed, sigma_m), None).unwrap())
            .collect();
        for (i, (name, was)) in measured_links(&body).into_iter().enumerate() {
            let squares = runs
                .iter()
                .map(|found| (measured_links(found)[i].1 / was - 1.0).powi(2));
            let rms = (squares.sum::<f64>() / runs.len() as f64).sqrt();
            assert!(rms < NOISY_SHARE, "{name}: off by {:.1} %", 100.0 * rms);
        }
    }

    #[test]
    fn hips_are_half_way_between_keypoints_and_stature() {
        let average = Proportions::from_stature(1.75);
        let body = Proportions {
            hip_side_m: 1.2 * average.hip_side_m,
            ..average
        };
        let found = proportions(&ticks(&body, 3, 0.0), None).unwrap();
        let share = (found.hip_side_m / average.hip_side_m - 1.0) / 0.2;
        assert!((0.1..0.6).contains(&share), "{share}");
    }

    #[test]
    fn one_outlier_tick_of_fifteen_has_no_effect() {
        let body = Proportions::from_stature(1.7);
        let mut seen = ticks(&body, 5, 0.0);
        let wild: Vec<_> = seen[3]
            .iter()
            .map(|(joint, p)| (joint, p.position_m * 3.0))
            .collect();
        for (joint, position_m) in wild {
            seen[3].set(joint, position_m, 1.0);
        }
        check(&body, &seen).unwrap();
    }

    #[test]
    fn a_prior_weighs_less_the_longer_a_body_is_seen() {
        let (truth, prior) = (Proportions::from_stature(1.8), BodyPrior::from_stature(1.7));
        let seen = ticks(&truth, 3, 0.0);
        let upper_arm_m = |seen_s| {
            let prior = &prior;
            let found = proportions(&seen, Some(KnownBody { prior, seen_s }));
            found.unwrap().upper_arm_m
        };
        let [at_once, later] = [0.2, 16.0].map(upper_arm_m);
        let [known, is] = [prior.body().upper_arm_m, truth.upper_arm_m];
        assert!(known < at_once && at_once < later && later < is);
        assert!(later > 0.5 * (known + is), "16 s weigh more than a stature");
    }

    #[test]
    fn a_face_alone_gives_no_proportions() {
        let mut face = ObservedJoints::default();
        face.set(
            crate::body::skeleton::Joint::Nose,
            nalgebra::Vector3::new(0.0, 0.0, 1.7),
            1.0,
        );
        assert!(proportions(&[face], None).is_none());
        assert!(proportions(&[], None).is_none());
    }
}
