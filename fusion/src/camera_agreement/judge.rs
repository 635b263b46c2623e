//! Which cameras agree, and what would make the others agree, too.
//!
//! Two cameras that agree on the people whom both show are right as far as the other knows. The largest set of cameras
//! that are linked so is taken for right, and every other one is held to it: as it is, later, mirrored, turned, with the
//! calibration of another.

pub(super) mod before;
pub(super) mod changed;
pub(super) mod exchanged;
mod far_off;
mod held;
mod kind_of_lens;
mod lateness;
mod numbers;
mod permuted;
mod pictures;
mod pictures_of_all;
pub(super) mod sides;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use farfield_proto::camera::CameraModel;
use farfield_proto::message::agreement::AgreementVerdict;
use farfield_proto::order_statistics::upper_median;

use self::before::JudgedBefore;
use super::geometry::SightLines;
use super::lens::LensPoints;
use super::pairs::{CameraRays, PairAgreement, Partners, PictureChange};
use super::report::{AgreementReport, Disagreement, DisagreementCause};
use super::samples::{Burst, COMPARED, PassSample, Samples};
use super::time_shift::by_burst::{Drift, drifts, shifts_by_burst};
use super::time_shift::curves::ShiftCosts;
use super::time_shift::groups::{LateGroup, late_group};
use super::time_shift::jumps::{Jump, jumps};
use super::time_shift::met::{PoseFit, pose_fits};
use super::time_shift::pose_shift::{PoseShift, against_most};
use super::time_shift::{Shift, shifts_by_half};
use super::words;
use super::{AgreementCameras, JudgedCamera};

/// Detection passes that are compared, spread over those that are kept: the fewer the more people cameras show, and so many at
/// the least.
const PASSES: usize = 16;
const LEAST_PASSES: usize = 4;
/// Passes of so little time, seconds, show one moment: in as much poses count as one, too.
const MOMENT_S: f64 = 0.4;
/// Two cameras that are nearer to each other than this, metres, agree whatever they show: all lines of sight from one place
/// meet.
const APART_M: f64 = 0.1;
/// Keypoints that two cameras must have compared for their agreement to count.
const MIN_KEYPOINTS: usize = 40;
/// Median distance of lines of sight up to which two cameras agree in any case, metres, and pixels of the camera in
/// which people are smaller.
const AGREES_M: f64 = 0.042;
const AGREES_PX: f64 = 1.5;
/// The same as a factor of that of the two cameras that agree best: networks differ.
const AGREES_FACTOR: f64 = 2.5;
/// No cameras agree whose lines pass farther from each other than this, metres, unless their pixels are as wide.
const NEVER_AGREES_M: f64 = 0.11;

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
    /// The same from the odd and from the even keypoints alone.
    pub(super) halves: [Vec<Option<Shift>>; 2],
    /// Those that are late by the same time, where they are several.
    late_group: Option<LateGroup>,
    /// Per camera how it drifts.
    pub(super) drifts: Vec<Option<Drift>>,
    /// Per camera whether it is late in a part of the time.
    jumps: Vec<Option<Jump>>,
    /// The same beside some others.
    apart: Vec<Option<Jump>>,
    /// Per camera by how much its sightings are late.
    pub(super) pose_shifts: Vec<Option<PoseShift>>,
    /// Per camera what its sightings are beside where people are.
    pub(super) fits: Vec<PoseFit>,
}

impl<'a> Judge<'a> {
    /// What was found `before` is not looked at again.
    pub(super) fn new(
        cameras: &'a AgreementCameras,
        samples: &'a Samples,
        before: &mut JudgedBefore,
    ) -> Self {
        let all = &samples.passes;
        let most_shown = all
            .iter()
            .filter_map(|pass| pass.of_camera.iter().map(Vec::len).max());
        let usual = upper_median(most_shown.map(|n| n as f64).collect()).unwrap_or(0.0);
        let n_passes = PASSES * COMPARED / (usual as usize).max(COMPARED);
        let n_passes = n_passes.max(LEAST_PASSES);
        let step = all.len().div_ceil(n_passes).max(1);
        let passes: Vec<&PassSample> = all.iter().rev().step_by(step).map(AsRef::as_ref).collect();
        let bursts = samples.telling_bursts();
        let lines = cameras.lines();
        let mut costs = ShiftCosts::of(&bursts, &lines, cameras.rate_hz, &mut before.costs);
        let [shifts, odd, even] = shifts_by_half(&mut costs);
        let late_group = late_group(&mut costs, &shifts);
        let by_burst = shifts_by_burst(&mut costs, &shifts);
        before.costs = costs.into_found();
        let bursts: Vec<&Burst> = bursts.into_iter().map(AsRef::as_ref).collect();
        let fits = pose_fits(samples, (&lines, &shifts), cameras.rate_hz);
        let by_pose = |of: fn(&PoseFit) -> _| jumps(&by_burst, &fits, of, cameras.rate_hz);
        let (jumps, apart) = (by_pose(|fit| fit.jump), by_pose(|fit| fit.apart));
        let mut judge = Self {
            cameras: &cameras.all,
            models: cameras.models.iter().map(|(_, model)| model).collect(),
            partners: &cameras.partners,
            venue: cameras,
            rate_hz: cameras.rate_hz,
            shifts,
            halves: [odd, even],
            late_group,
            drifts: drifts(&by_burst, lines.len(), cameras.rate_hz),
            jumps,
            apart,
            pose_shifts: against_most(fits.iter().map(|fit| fit.shift).collect(), &bursts),
            fits,
            lines,
            samples,
            passes,
            bursts,
            as_it_is: Vec::new(),
            pairs: BTreeMap::new(),
        };
        judge.as_it_is = (0..judge.cameras.len())
            .map(|camera| judge.rays(camera, camera, PictureChange::AsItIs))
            .collect();
        for a in 0..judge.cameras.len() {
            for b in a + 1..judge.cameras.len() {
                if judge.are_apart(a, b) {
                    let pair = PairAgreement::of_common(&judge.as_it_is[a], &judge.as_it_is[b]);
                    if pair.len() >= MIN_KEYPOINTS {
                        judge.pairs.insert((a, b), pair);
                    }
                }
            }
        }
        judge
    }

    /// Whether two cameras are of different viewpoints, and do not stand at one place all the same.
    pub(super) fn are_apart(&self, a: usize, b: usize) -> bool {
        let apart_m = (self.lines[a].center_m - self.lines[b].center_m).norm();
        self.cameras[a].viewpoint != self.cameras[b].viewpoint && apart_m >= APART_M
    }

    /// The cameras that show anybody.
    fn showing(&self) -> Vec<usize> {
        let shows = |camera: &usize| {
            let mut passes = self.passes.iter();
            passes.any(|pass| !pass.of_camera[*camera].is_empty())
        };
        (0..self.cameras.len()).filter(shows).collect()
    }

    /// Pairs of them that stand apart.
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

    /// The same through any lines of sight.
    pub(super) fn rays_through(
        &self,
        camera: usize,
        lines: &SightLines,
        change: PictureChange,
    ) -> CameraRays {
        let size_px = self.cameras[camera].size_px;
        let change = (change, self.partners);
        CameraRays::of(&self.passes, (camera, size_px), lines, change)
    }

    pub(super) fn report(&self) -> AgreementReport {
        let mut report = AgreementReport::default();
        let mut told = vec![false; self.cameras.len()];
        self.find_disagreements(&mut report, &mut told);
        let is_compared =
            |camera: usize| self.pairs.keys().any(|&(a, b)| a == camera || b == camera);
        let disagreements = report.disagreements.iter();
        let named: Vec<Vec<String>> = disagreements.map(|told| told.cameras.clone()).collect();
        for (index, camera) in self.cameras.iter().enumerate() {
            let mut named = named.iter();
            let is_named = named.any(|all| all.is_empty() || all.contains(&camera.name));
            let verdict = match (told[index], is_compared(index)) {
                (true, _) if is_named => AgreementVerdict::Disagrees,
                (false, true) => AgreementVerdict::Agrees,
                _ => AgreementVerdict::Unknown,
            };
            report
                .cameras
                .insert(camera.name.clone(), self.numbers(index, verdict));
            report
                .details
                .insert(camera.name.clone(), self.details(index));
        }
        report
    }

    /// What does not fit, and of which cameras.
    fn find_disagreements(&self, report: &mut AgreementReport, told: &mut [bool]) {
        self.find_low_scores(&mut report.disagreements, told);
        self.find_same_pictures(report, told);
        self.find_frozen(&mut report.disagreements, told);
        self.find_silent(&mut report.disagreements, told);
        self.find_jumps(&self.jumps, &mut report.disagreements, told);
        self.find_no_fisheyes(&mut report.disagreements, told);
        let (samples, bursts) = self.without(&self.doubtful_witnesses());
        let bursts: Vec<&Burst> = bursts.iter().map(AsRef::as_ref).collect();
        let points = self.lens_points(&bursts, &samples);
        let points = points.as_ref();
        self.find_permuted(&mut report.disagreements, told);
        for group in self.groups(told) {
            self.judge_group(&group, points, &mut report.disagreements, told);
        }
        if let Some(points) = points {
            self.find_displaced(points, &mut report.disagreements, told);
        }
        self.find_what_agrees_by_chance(points, &mut report.disagreements, told);
        // Those who are held to a camera that is wrong seem a little late: they are told of once it is mended.
        let all_right = !told.contains(&true);
        for (camera, told) in told.iter_mut().enumerate() {
            let drift = || {
                let told = self.drifts[camera].filter(|drift| drift.is_told);
                told.map(|drift| DisagreementCause::Drifts {
                    ticks_per_minute: drift.ticks_per_minute,
                })
            };
            let late = || {
                let late = self
                    .late(camera)
                    .filter(|_| all_right || self.is_clearly_late(camera));
                late.map(|ticks| DisagreementCause::Late { ticks })
            };
            if !*told && let Some(cause) = drift().or_else(late) {
                *told = true;
                let disagreement = self.disagreement(&[camera], cause);
                report.disagreements.push(disagreement);
            }
        }
        self.find_apart(&mut report.disagreements, told);
        self.find_far_off(&mut report.disagreements, told);
        if let Some(points) = points {
            self.find_other_lenses(points, &mut report.disagreements, told);
        }
    }

    /// What tells of lenses, where somebody moved.
    fn lens_points(&self, bursts: &[&Burst], samples: &Samples) -> Option<LensPoints<'_>> {
        let viewpoints = self.cameras.iter().map(|camera| camera.viewpoint);
        LensPoints::of(bursts, samples, (&self.lines, viewpoints.collect()))
    }

    /// The cameras that were compared, by groups that have nobody in common. Those of which is told what is wrong with them are
    /// left out: nobody else is held to them.
    fn groups(&self, told: &[bool]) -> Vec<Vec<usize>> {
        let compared = self.pairs.keys().copied();
        let compared = compared.filter(|&(a, b)| !told[a] && !told[b]);
        let sets = linked(self.cameras.len(), compared);
        sets.into_iter().filter(|set| set.len() > 1).collect()
    }

    /// Explains every camera of a group that is not among those which are taken for right.
    fn judge_group(
        &self,
        group: &[usize],
        points: Option<&LensPoints<'_>>,
        all: &mut Vec<Disagreement>,
        told: &mut [bool],
    ) {
        let right = self.taken_for_right(group);
        let outside = group
            .iter()
            .copied()
            .filter(|camera| !right.contains(camera));
        let outside: Vec<usize> = outside.collect();
        // What hides somebody from some cameras at one moment is no disagreement; nor are others held to these cameras.
        let is_of_a_moment = self.samples.passes_last_s() < MOMENT_S;
        let (mut found, mut unexplained) = (Vec::new(), Vec::new());
        for &camera in &outside {
            if !told[camera] {
                match self.explain(camera, (&right, group, &outside), points, told) {
                    Some((cameras, cause)) => found.push(self.disagreement(&cameras, cause)),
                    None if is_of_a_moment => {}
                    None => unexplained.push(camera),
                }
            }
            told[camera] = true;
        }
        if right.is_empty() {
            merge_swaps(&mut found, self.rate_hz);
            if !unexplained.is_empty() {
                found.push(self.disagreement(&unexplained, DisagreementCause::Unexplained));
            }
        } else {
            for camera in unexplained {
                found.push(self.disagreement(&[camera], DisagreementCause::Unexplained));
            }
        }
        all.extend(found);
    }

    /// The largest set of cameras of a group that are linked by agreement; none where no two agree, or two sets are as
    /// large.
    fn taken_for_right(&self, group: &[usize]) -> Vec<usize> {
        let near = self.agreeing(&self.pairs, |camera| group.contains(&camera));
        let sets = linked(self.cameras.len(), near.into_iter());
        let most = sets.iter().map(Vec::len).max().unwrap_or(0);
        let mut largest = sets.into_iter().filter(|set| set.len() == most);
        match (largest.next(), largest.next()) {
            (Some(set), None) if most >= 2 => set,
            _ => Vec::new(),
        }
    }

    /// Those of `pairs` of cameras in a group whose lines of sight pass each other about as near as they do anywhere in it.
    fn agreeing(
        &self,
        pairs: &BTreeMap<(usize, usize), PairAgreement>,
        is_in_group: impl Fn(usize) -> bool,
    ) -> Vec<(usize, usize)> {
        let own = |(a, b): &(usize, usize)| is_in_group(*a) && is_in_group(*b);
        let own = pairs.iter().filter(|(pair, _)| own(pair));
        let medians = own.filter_map(|(pair, agreement)| Some((*pair, agreement.median_m()?)));
        let medians: Vec<((usize, usize), f64)> = medians.collect();
        let least_m = medians.iter().map(|(_, m)| *m);
        let least_m = least_m.fold(f64::INFINITY, f64::min);
        let limit_m = (AGREES_FACTOR * least_m).min(NEVER_AGREES_M);
        let is_near = |(a, b): (usize, usize), median_m: f64| {
            let pixel_m = pairs[&(a, b)].pixel_m([a, b].map(|c| self.focal_px(c)));
            median_m <= limit_m.max(AGREES_M + AGREES_PX * pixel_m)
        };
        let near = medians.iter().filter(|(pair, m)| is_near(*pair, *m));
        near.map(|(pair, _)| *pair).collect()
    }

    fn focal_px(&self, camera: usize) -> f64 {
        self.lines[camera].mean_focal_px()
    }

    /// Mean cost of `rays` against these others; `None` where they have too little in common.
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

    pub(super) fn disagreement(&self, cameras: &[usize], cause: DisagreementCause) -> Disagreement {
        let names = cameras
            .iter()
            .map(|&camera| self.cameras[camera].name.clone());
        let names: Vec<String> = names.collect();
        let (found, remedy) = words::of(&names, cause, self.rate_hz);
        Disagreement {
            cameras: names,
            cause,
            part_ticks: None,
            found,
            remedy,
        }
    }
}

/// Sets of `n` cameras that are linked by these pairs.
fn linked(n: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Vec<Vec<usize>> {
    let mut set_of: Vec<usize> = (0..n).collect();
    for (a, b) in pairs {
        let (into, from) = (set_of[a], set_of[b]);
        for set in set_of.iter_mut().filter(|set| **set == from) {
            *set = into;
        }
    }
    let members = |set: usize| (0..n).filter(|&camera| set_of[camera] == set).collect();
    let sets = (0..n).map(members);
    sets.filter(|set: &Vec<usize>| !set.is_empty()).collect()
}

/// Where cameras stand opposite each other, two swaps may explain the same: then it is one or the other.
fn merge_swaps(all: &mut Vec<Disagreement>, rate_hz: f64) {
    let (swaps, mut others): (Vec<Disagreement>, Vec<Disagreement>) = std::mem::take(all)
        .into_iter()
        .partition(|d| d.cause == DisagreementCause::Swapped);
    let cameras: Vec<String> = swaps.into_iter().flat_map(|swap| swap.cameras).collect();
    if !cameras.is_empty() {
        let cause = DisagreementCause::Swapped;
        let (found, remedy) = words::of(&cameras, cause, rate_hz);
        others.insert(
            0,
            Disagreement {
                cameras,
                cause,
                part_ticks: None,
                found,
                remedy,
            },
        );
    }
    *all = others;
}

/// To a tenth.
pub(super) fn rounded(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}
