//! Smoothness of one actor's poses: jitter, and feet that slide while they stand.
//!
//! Foot slide is that of heel and toe. Poses without them (triangulated keypoints) are compared by the ankle: its horizontal
//! speed while the true foot is still.

use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::points::{LIMB_POINTS, N_POINTS, ScoredBody};

/// The scored limb points; the last two are the ankles, left and right.
const N_LIMB_POINTS: usize = LIMB_POINTS.len();
/// Speed of heel and toe below which the true foot is still, metres per second.
const STILL_M_S: f64 = 0.05;

/// Change of a foot over one tick, metres per tick: of the truth in 3D, the faster of heel and toe; of the pose horizontally,
/// the mean of heel and toe, and the ankle.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "the unit is in every name")]
struct FootStep {
    true_m: f64,
    foot_m: Option<f64>,
    ankle_m: Option<f64>,
}

/// Sums over the ticks of one actor. Differences are taken over consecutive ticks that all have a pose. An id change in between
/// adds to the actor's jitter.
#[derive(Debug, Clone, Default)]
pub struct Smoothness {
    /// Up to three ticks in a row, newest last.
    recent: Vec<(Tick, ScoredBody, ScoredBody)>,
    third_difference_sum_m: f64,
    third_differences: u64,
    foot_steps: Vec<FootStep>,
}

impl Smoothness {
    /// Adds the next tick: the true body and the pose that it is compared with, possibly an outlier.
    pub fn add(&mut self, tick: Tick, truth: &ScoredBody, pose: Option<&ScoredBody>) {
        let Some(pose) = pose else {
            self.recent.clear();
            return;
        };
        if self
            .recent
            .last()
            .is_some_and(|(last, ..)| tick - *last != 1)
        {
            self.recent.clear();
        }
        if let [(_, _, p0), (_, _, p1), (_, _, p2)] = self.recent.as_slice() {
            for slot in 0..N_POINTS {
                let at = |body: &ScoredBody| body.points_m[slot];
                if let (Some(a), Some(b), Some(c), Some(d)) = (at(p0), at(p1), at(p2), at(pose)) {
                    self.third_difference_sum_m += (d - 3.0 * c + 3.0 * b - a).norm();
                    self.third_differences += 1;
                }
            }
        }
        if let Some((_, last_truth, last_pose)) = self.recent.last() {
            let steps = [0, 1].map(|side| {
                let true_change = foot_change(truth, last_truth, side)?;
                let true_m = true_change
                    .map(|v| v.norm())
                    .into_iter()
                    .fold(0.0, f64::max);
                let foot_m = foot_change(pose, last_pose, side).map(|change| {
                    let [heel, toe] = change.map(|v| v.xy().norm());
                    f64::midpoint(heel, toe)
                });
                let ankle = N_LIMB_POINTS - 2 + side;
                let ankle_m = pose.points_m[ankle]
                    .zip(last_pose.points_m[ankle])
                    .map(|(now, before)| (now - before).xy().norm());
                Some(FootStep {
                    true_m,
                    foot_m,
                    ankle_m,
                })
            });
            self.foot_steps.extend(steps.into_iter().flatten());
        }
        if self.recent.len() == 3 {
            self.recent.remove(0);
        }
        self.recent.push((tick, truth.clone(), pose.clone()));
    }

    /// Mean norm of the third difference of the scored points over dt^3, m/s^3.
    pub fn jitter_m_s3(&self, rate_hz: f64) -> Option<f64> {
        let mean_m = self.third_difference_sum_m / self.third_differences as f64;
        (self.third_differences > 0).then(|| mean_m * rate_hz.powi(3))
    }

    /// Mean horizontal speed of heel and toe while the true foot (its heel and its toe) is slower
    /// than 0.05 m/s, mm/s.
    pub fn foot_slide_mm_s(&self, rate_hz: f64) -> Option<f64> {
        self.slide_mm_s(rate_hz, |step| step.foot_m)
    }

    /// The same of the ankle.
    pub fn ankle_slide_mm_s(&self, rate_hz: f64) -> Option<f64> {
        self.slide_mm_s(rate_hz, |step| step.ankle_m)
    }

    fn slide_mm_s(&self, rate_hz: f64, of: fn(&FootStep) -> Option<f64>) -> Option<f64> {
        let still: Vec<f64> = self
            .foot_steps
            .iter()
            .filter(|step| step.true_m * rate_hz < STILL_M_S)
            .filter_map(of)
            .map(|moved_m| 1000.0 * moved_m * rate_hz)
            .collect();
        (!still.is_empty()).then(|| still.iter().sum::<f64>() / still.len() as f64)
    }
}

fn foot_change(now: &ScoredBody, before: &ScoredBody, side: usize) -> Option<[Vector3<f64>; 2]> {
    let change = |part: usize| Some(now.feet_m[side][part]? - before.feet_m[side][part]?);
    Some([change(0)?, change(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn body(x: f64, foot_x: f64) -> ScoredBody {
        let mut body = ScoredBody::default();
        body.points_m[0] = Some(Vector3::new(x, 0.0, 0.0));
        body.feet_m[0] = [
            Some(Vector3::new(foot_x, 0.0, 0.0)),
            Some(Vector3::new(foot_x, 0.1, 0.0)),
        ];
        body
    }

    #[test]
    fn jitter_of_a_cubic_is_its_third_derivative() {
        let mut motion = Smoothness::default();
        for t in 0..6 {
            let time_s = f64::from(t) / 10.0;
            motion.add(
                Tick(t.into()),
                &body(0.0, 0.0),
                Some(&body(2.0 * time_s.powi(3), 0.0)),
            );
        }
        assert!((motion.jitter_m_s3(10.0).unwrap() - 12.0).abs() < 1e-9);
    }

    #[test]
    fn a_gap_is_not_differentiated_across() {
        let mut motion = Smoothness::default();
        for t in [0, 1, 2, 4, 5, 6] {
            motion.add(Tick(t), &body(0.0, 0.0), Some(&body(t as f64, 0.0)));
        }
        assert_eq!(motion.jitter_m_s3(10.0), None);
    }

    #[test]
    fn only_feet_that_truly_stand_can_slide() {
        let mut motion = Smoothness::default();
        // The true foot stands for two steps, then moves at 1 m/s. The pose slides by 2 mm a tick, then by 90 mm.
        for (t, true_x, x) in [
            (0, 0.0, 0.0),
            (1, 0.0, 0.002),
            (2, 0.0, 0.004),
            (3, 0.1, 0.094),
        ] {
            motion.add(Tick(t), &body(0.0, true_x), Some(&body(0.0, x)));
        }
        assert!((motion.foot_slide_mm_s(10.0).unwrap() - 20.0).abs() < 1e-9);
        assert_eq!(motion.ankle_slide_mm_s(10.0), None);
    }

    #[test]
    fn a_pose_without_feet_slides_by_its_ankle() {
        let mut motion = Smoothness::default();
        for t in 0..4 {
            let mut pose = ScoredBody::default();
            pose.points_m[10] = Some(Vector3::new(0.003 * t as f64, 0.0, 0.01 * t as f64));
            motion.add(Tick(t), &body(0.0, 0.0), Some(&pose));
        }
        assert!((motion.ankle_slide_mm_s(10.0).unwrap() - 30.0).abs() < 1e-9);
        assert_eq!(motion.foot_slide_mm_s(10.0), None);
    }
}
