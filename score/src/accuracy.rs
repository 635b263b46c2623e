//! Distances of one actor's points and limbs from the truth.

use super::ActorScore;
use super::motion::Smoothness;
use super::points::{PointSet, ScoredBody, ScoredLimb};

/// Mean error up to which a pose counts as a success, metres (Ohashi 2020, section 4.2).
const SUCCESS_M: f64 = 0.150;
/// Error up to which a point counts as correct, metres.
const PCK_M: [f64; 2] = [0.050, 0.100];

/// The pose of one actor at one tick.
#[derive(Debug, Clone, Copy)]
pub enum FramePose<'a> {
    /// A pose within the gate.
    Near(&'a ScoredBody),
    /// The actor's last pose, now beyond the gate.
    Outlier(&'a ScoredBody),
    /// No pose.
    Missing,
}

impl<'a> FramePose<'a> {
    /// The pose, near or outlier.
    pub fn body(self) -> Option<&'a ScoredBody> {
        match self {
            Self::Near(body) | Self::Outlier(body) => Some(body),
            Self::Missing => None,
        }
    }
}

/// Sums over the frames of one actor.
#[derive(Debug, Clone, Default)]
pub struct ActorTally {
    frames: u64,
    gaps: u64,
    outliers: u64,
    successes: u64,
    points: u64,
    compared_points: u64,
    missing_points: u64,
    error_sum_m: f64,
    site_error_sum_m: f64,
    compared_sites: u64,
    within: [u64; 2],
    limbs: u64,
    correct_limbs: [u64; 3],
}

impl ActorTally {
    /// Adds one frame: the true body, and the pose that it is compared with.
    pub fn add(&mut self, truth: &ScoredBody, pose: FramePose<'_>, points: PointSet) {
        self.frames += 1;
        self.gaps += u64::from(!matches!(pose, FramePose::Near(_)));
        self.outliers += u64::from(matches!(pose, FramePose::Outlier(_)));
        let pose = pose.body();
        let mut frame_sum_m = 0.0;
        let mut frame_points = 0u64;
        for (slot, true_point) in truth.points_m.iter().enumerate() {
            let Some(true_point) = true_point else {
                continue;
            };
            self.points += 1;
            let Some(pose) = pose else { continue };
            if let Some(point) = pose.points_m[slot] {
                let error_m = (point - true_point).norm();
                frame_sum_m += error_m;
                frame_points += 1;
                for (count, bound_m) in self.within.iter_mut().zip(PCK_M) {
                    *count += u64::from(error_m <= bound_m);
                }
            } else {
                self.missing_points += 1;
            }
        }
        self.error_sum_m += frame_sum_m;
        self.compared_points += frame_points;
        if frame_points > 0 && frame_sum_m / frame_points as f64 <= SUCCESS_M {
            self.successes += 1;
        }
        for limb in points.limbs() {
            self.add_limb(limb, truth, pose);
        }
        let sites = |body: &ScoredBody| body.sites_m;
        for (a, b) in pose
            .iter()
            .flat_map(|pose| sites(truth).into_iter().zip(sites(pose)))
        {
            if let (Some(a), Some(b)) = (a, b) {
                self.site_error_sum_m += (a - b).norm();
                self.compared_sites += 1;
            }
        }
    }

    /// Percentage of correct parts, in its three definitions (see [`ActorScore`]).
    fn add_limb(&mut self, limb: ScoredLimb, truth: &ScoredBody, pose: Option<&ScoredBody>) {
        let Some(true_ends) = limb.on(truth) else {
            return;
        };
        self.limbs += 1;
        let Some(ends) = pose.and_then(|body| limb.on(body)) else {
            return;
        };
        let half_length_m = (true_ends[1] - true_ends[0]).norm() / 2.0;
        let [a, b] = [0, 1].map(|end| (ends[end] - true_ends[end]).norm());
        let middle = ((ends[0] + ends[1]) / 2.0 - (true_ends[0] + true_ends[1]) / 2.0).norm();
        let correct = [
            a.max(b) <= half_length_m,
            f64::midpoint(a, b) <= half_length_m,
            middle <= half_length_m,
        ];
        for (count, correct) in self.correct_limbs.iter_mut().zip(correct) {
            *count += u64::from(correct);
        }
    }

    /// The figures. `motion` is that of the poses matched to the same actor, `id_switches` the number of id changes.
    pub fn finish(
        &self,
        motion: &Smoothness,
        id_switches: u64,
        rate_hz: Option<f64>,
    ) -> ActorScore {
        let [pcp_both_ends, pcp_mean_end, pcp_midpoint] = self
            .correct_limbs
            .map(|n| (self.limbs > 0).then(|| percent(n, self.limbs)));
        let of_points = |part, whole| (self.points > 0).then(|| percent(part, whole));
        let [pck_50, pck_100] = self.within.map(|n| of_points(n, self.points));
        ActorScore {
            frames: self.frames,
            success_150: of_points(self.successes, self.frames),
            mpjpe_mm: (self.compared_points > 0)
                .then(|| 1000.0 * self.error_sum_m / self.compared_points as f64),
            mpjpe_sites_mm: (self.compared_sites > 0)
                .then(|| 1000.0 * self.site_error_sum_m / self.compared_sites as f64),
            pcp_both_ends,
            pcp_mean_end,
            pcp_midpoint,
            pck_50,
            pck_100,
            gaps: self.gaps,
            outliers: self.outliers,
            id_switches,
            missing_points: self.missing_points,
            jitter_m_s3: rate_hz.and_then(|rate| motion.jitter_m_s3(rate)),
            foot_slide_mm_s: rate_hz.and_then(|rate| motion.foot_slide_mm_s(rate)),
            ankle_slide_mm_s: rate_hz.and_then(|rate| motion.ankle_slide_mm_s(rate)),
        }
    }
}

/// 0 if the whole is 0.
pub(super) fn percent(part: u64, whole: u64) -> f64 {
    if whole == 0 {
        0.0
    } else {
        100.0 * part as f64 / whole as f64
    }
}
