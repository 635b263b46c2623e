//! Which cameras agree, and what would make the others agree, too.
//!
//! Two cameras that agree on the people in both confirm each other. The largest set of cameras that are linked by agreement
//! is taken for right. Every other camera is compared with it: as it is, later, mirrored, turned, with the calibration of
//! another. [`Judge::search`] lists all searches in their order.

mod agreeing;
pub(super) mod before;
pub(super) mod changed;
pub(super) mod exchanged;
mod findings;
mod lateness;
mod permuted;
mod pictures;
mod pictures_of_all;

use std::collections::BTreeMap;

use farfield_proto::camera::CameraModel;
use farfield_proto::message::agreement::{AgreementVerdict, CameraAgreement};
use farfield_proto::order_statistics::upper_median;

pub(super) use self::agreeing::Group;
use self::before::JudgedBefore;
pub(super) use self::findings::Findings;
use super::geometry::SightLines;
use super::lens::LensPoints;
use super::pairs::{CameraRays, PairAgreement, Partners, PictureChange};
use super::report::{AgreementReport, CameraDetails};
use super::samples::{Burst, MAX_COMPARED, PassSample, Samples};
use super::time_shift::by_burst::{Drift, Jump, drifts, jump, shifts_by_burst};
use super::time_shift::curves::ShiftCosts;
use super::time_shift::groups::{LateGroup, late_group};
use super::time_shift::pose_fit::{PoseFit, pose_fits};
use super::time_shift::pose_shift::{PoseShift, against_most};
use super::time_shift::{Shift, shifts};
use super::{AgreementCameras, JudgedCamera};

/// Detection passes that are compared, spread over those that are kept. With many people per camera they are fewer, but
/// never fewer than the second number.
const PASSES: usize = 16;
const MIN_PASSES: usize = 4;
/// Two cameras nearer to each other than this, metres, agree whatever they show: lines of sight from one place meet.
const APART_M: f64 = 0.1;
/// Keypoints that two cameras must have compared for their agreement to count.
const MIN_KEYPOINTS: usize = 40;

/// The cameras of a venue with what they showed lately, and what the searches share.
pub(super) struct Judge<'a> {
    pub(super) cameras: &'a [JudgedCamera],
    models: Vec<&'a CameraModel>,
    pub(super) partners: &'a Partners,
    venue: &'a AgreementCameras,
    pub(super) rate_hz: f64,
    samples: &'a Samples,
    passes: Vec<&'a PassSample>,
    pub(super) lines: Vec<SightLines>,
    pub(super) bursts: Vec<&'a Burst>,
    pub(super) as_it_is: Vec<CameraRays>,
    pairs: BTreeMap<(usize, usize), PairAgreement>,
    pub(super) shifts: Vec<Option<Shift>>,
    /// Several cameras that are late by one time.
    late_group: Option<LateGroup>,
    /// Per camera its drift.
    pub(super) drifts: Vec<Option<Drift>>,
    /// Per camera whether it is late in a part of the time.
    jumps: Vec<Option<Jump>>,
    /// Per camera by how much its sightings are late.
    pub(super) pose_shifts: Vec<Option<PoseShift>>,
    /// Per camera its sightings relative to the poses of all.
    pub(super) fits: Vec<PoseFit>,
    /// Keypoints that three viewpoints show; `None` if they are too few.
    pub(super) points: Option<LensPoints>,
}

impl<'a> Judge<'a> {
    /// Compares all cameras. `before` keeps what does not change from one judgement to the next.
    pub(super) fn new(
        cameras: &'a AgreementCameras,
        samples: &'a Samples,
        before: &mut JudgedBefore,
    ) -> Self {
        let bursts = samples.bursts_if_long_enough();
        let lines = cameras.lines();
        let mut costs = ShiftCosts::new(&bursts, &lines, cameras.rate_hz, &mut before.costs);
        let shifts = shifts(&mut costs);
        let late_group = late_group(&mut costs, &shifts);
        let by_burst = shifts_by_burst(&mut costs, &shifts);
        before.costs = costs.into_cache();
        let bursts: Vec<&Burst> = bursts.into_iter().map(AsRef::as_ref).collect();
        let fits = pose_fits(samples, &lines, cameras.rate_hz);
        let viewpoints = cameras.all.iter().map(|camera| camera.viewpoint).collect();
        let mut judge = Self {
            cameras: &cameras.all,
            models: cameras.models.iter().map(|(_, model)| model).collect(),
            partners: &cameras.partners,
            venue: cameras,
            rate_hz: cameras.rate_hz,
            shifts,
            late_group,
            drifts: drifts(&by_burst, lines.len(), cameras.rate_hz),
            jumps: (0..lines.len()).map(|of| jump(&by_burst, of)).collect(),
            pose_shifts: against_most(fits.iter().map(|fit| fit.shift).collect(), &bursts),
            fits,
            points: LensPoints::from_samples(&bursts, samples, &lines, viewpoints),
            lines,
            samples,
            passes: compared_passes(samples),
            bursts,
            as_it_is: Vec::new(),
            pairs: BTreeMap::new(),
        };
        judge.as_it_is = (0..judge.cameras.len())
            .map(|camera| judge.rays(camera, camera, PictureChange::AsItIs))
            .collect();
        let all: Vec<usize> = (0..judge.cameras.len()).collect();
        for (a, b) in judge.pairs_of(&all) {
            let pair = PairAgreement::of_common(&judge.as_it_is[a], &judge.as_it_is[b]);
            if pair.len() >= MIN_KEYPOINTS {
                judge.pairs.insert((a, b), pair);
            }
        }
        judge
    }

    /// Whether two cameras are of different viewpoints, and stand at different places.
    pub(super) fn are_apart(&self, a: usize, b: usize) -> bool {
        let apart_m = (self.lines[a].center_m - self.lines[b].center_m).norm();
        self.cameras[a].viewpoint != self.cameras[b].viewpoint && apart_m >= APART_M
    }

    fn showing(&self) -> Vec<usize> {
        let shows = |camera: &usize| {
            let mut passes = self.passes.iter();
            passes.any(|pass| !pass.of_camera[*camera].is_empty())
        };
        (0..self.cameras.len()).filter(shows).collect()
    }

    /// The pairs of these cameras that stand apart.
    fn pairs_of(&self, cameras: &[usize]) -> Vec<(usize, usize)> {
        let all = cameras.iter().enumerate();
        let pairs = all.flat_map(|(i, &a)| cameras[i + 1..].iter().map(move |&b| (a, b)));
        pairs.filter(|&(a, b)| self.are_apart(a, b)).collect()
    }

    /// The sightings of `camera` changed so, seen with the calibration of `calibrated`.
    pub(super) fn rays(
        &self,
        camera: usize,
        calibrated: usize,
        change: PictureChange,
    ) -> CameraRays {
        self.rays_through(camera, &self.lines[calibrated], change)
    }

    /// The same with any lines of sight.
    pub(super) fn rays_through(
        &self,
        camera: usize,
        lines: &SightLines,
        change: PictureChange,
    ) -> CameraRays {
        let size_px = self.cameras[camera].size_px;
        let change = (change, self.partners);
        CameraRays::new(&self.passes, (camera, size_px), lines, change)
    }

    /// The findings, and how each camera agrees.
    pub(super) fn report(&self) -> AgreementReport {
        let findings = self.search();
        let mut report = AgreementReport::default();
        let is_compared =
            |camera: usize| self.pairs.keys().any(|&(a, b)| a == camera || b == camera);
        for (index, camera) in self.cameras.iter().enumerate() {
            let mut named = findings.all.iter().map(|it| &it.cameras);
            let is_named = named.any(|all| all.is_empty() || all.contains(&camera.name));
            let verdict = match (findings.is_explained(index), is_compared(index)) {
                (true, _) if is_named => AgreementVerdict::Disagrees,
                (false, true) => AgreementVerdict::Agrees,
                _ => AgreementVerdict::Unknown,
            };
            let name = || camera.name.clone();
            report.cameras.insert(name(), self.numbers(index, verdict));
            report.details.insert(name(), self.details(index));
        }
        report.disagreements = findings.all;
        report
    }

    fn numbers(&self, camera: usize, verdict: AgreementVerdict) -> CameraAgreement {
        let own = self
            .pairs
            .iter()
            .filter(|((a, b), _)| *a == camera || *b == camera);
        let keypoints = own.clone().map(|(_, pair)| pair.len() as u64).sum();
        let medians = own.filter_map(|(&(a, b), pair)| {
            let side = usize::from(b == camera);
            let focal_px = [a, b].map(|of| self.focal_px(of));
            Some((pair.median_m()?, pair.median_px(focal_px)?[side]))
        });
        let best = medians.min_by(|a, b| a.0.total_cmp(&b.0));
        let best =
            best.filter(|(m, px)| ((1000.0 * m) as f32).is_finite() && (*px as f32).is_finite());
        CameraAgreement {
            verdict,
            keypoints,
            distance_mm: best.map(|(m, _)| rounded(m * 1000.0) as f32),
            distance_px: best.map(|(_, px)| rounded(px) as f32),
            late_ticks: self
                .late(camera)
                .or_else(|| self.known_late(camera))
                .map(|late| late as f32)
                .filter(|late| late.is_finite()),
        }
    }

    fn details(&self, camera: usize) -> CameraDetails {
        let passes = || self.fits[camera].seen.iter();
        let sightings: usize = passes().map(|pass| pass.sightings).sum();
        let used: usize = passes().map(|pass| pass.used).sum();
        let drift = self.drifts[camera].map(|drift| rounded(drift.ticks_per_minute));
        CameraDetails {
            share_used: (used > 0)
                .then(|| (100.0 * used as f64 / sightings as f64).round() / 100.0),
            drift_ticks_per_minute: drift,
        }
    }

    /// Keypoints that three viewpoints show, if a person moved far enough for small changes of a camera to be sure.
    pub(super) fn points_of_moving(&self) -> Option<&LensPoints> {
        self.points.as_ref().filter(|points| points.has_moved())
    }

    /// All searches for causes of some cameras, in their order: each leaves out cameras that an earlier one has explained.
    /// Causes of all cameras alike follow in [`super::AgreementSamples`].
    fn search(&self) -> Findings {
        let mut findings = Findings::new(self.cameras.len());
        self.find_low_scores(&mut findings);
        self.find_same_pictures(&mut findings);
        self.find_frozen(&mut findings);
        self.find_silent(&mut findings);
        self.find_jumps(&mut findings);
        self.find_false_fisheyes(&mut findings);
        self.find_permuted(&mut findings);
        self.find_outside_groups(&mut findings);
        self.find_displaced(&mut findings);
        self.find_orders(&mut findings);
        self.find_late(&mut findings);
        self.find_strangers(&mut findings);
        self.find_other_lenses(&mut findings);
        findings
    }

    fn focal_px(&self, camera: usize) -> f64 {
        self.lines[camera].mean_focal_px()
    }

    /// Mean cost of `rays` against these others; `None` if they have too little in common.
    pub(super) fn cost_against(
        &self,
        camera: usize,
        rays: &CameraRays,
        others: &[usize],
    ) -> Option<f64> {
        let others = others
            .iter()
            .filter(|&&other| self.are_apart(camera, other));
        let others = others.map(|&other| &self.as_it_is[other]);
        PairAgreement::mean_cost_of(rays, others, MIN_KEYPOINTS)
    }
}

/// The newest detection pass and earlier ones at equal distances.
fn compared_passes(samples: &Samples) -> Vec<&PassSample> {
    let all = &samples.passes;
    let most_shown = all
        .iter()
        .filter_map(|pass| pass.of_camera.iter().map(Vec::len).max());
    let usual = upper_median(most_shown.map(|n| n as f64).collect()).unwrap_or(0.0);
    let n_passes = PASSES * MAX_COMPARED / (usual as usize).max(MAX_COMPARED);
    let step = all.len().div_ceil(n_passes.max(MIN_PASSES)).max(1);
    all.iter().rev().step_by(step).map(AsRef::as_ref).collect()
}

/// Rounds to a tenth.
pub(super) fn rounded(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}
