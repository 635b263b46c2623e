//! Which cameras agree, and what would make the others agree, too.
//!
//! Two cameras that agree on the people whom both show are right as far as the other knows. The largest set of cameras
//! that are linked so is taken for right, and every other one is held to it: as it is, later, mirrored, turned, with the
//! calibration of another.

use std::collections::BTreeMap;

use super::geometry::SightLines;
use super::pairs::{CameraRays, PairAgreement, Partners, PictureChange};
use super::refit::refit;
use super::report::{
    AgreementReport, AgreementVerdict, CameraAgreement, Disagreement, DisagreementCause,
};
use super::samples::{Burst, PassSample, Samples, SeenBody};
use super::time_shift::{KeypointHalf, Shift, shifts};
use super::words;
use super::{AgreementCameras, JudgedCamera};

/// Detection passes that are compared, spread over those that are kept.
const PASSES: usize = 16;
/// Keypoints that two cameras must have compared for their agreement to count.
const MIN_KEYPOINTS: usize = 40;
/// Median distance of lines of sight up to which two cameras agree in any case, metres, and pixels of the camera in
/// which people are smaller.
const AGREES_M: f64 = 0.042;
const AGREES_PX: f64 = 1.5;
/// The same as a factor of that of the two cameras that agree best: networks differ.
const AGREES_FACTOR: f64 = 2.5;
/// No cameras agree whose lines pass farther from each other than this, metres.
const NEVER_AGREES_M: f64 = 0.11;
/// What a cause leaves of the cost that it explains.
const EXPLAINS: f64 = 0.6;
/// What it may leave when no other leaves nearly as little: networks err on heads that hang down.
const EXPLAINS_IN_PART: f64 = 0.8;
/// From which change of the focal length on it is called that, as a share.
const OTHER_FOCAL_LENGTH: f64 = 0.03;
/// A fit of four numbers explains a little of anything.
const REFIT_HANDICAP: f64 = 1.3;
/// How much less than what any other leaves.
const STANDS_OUT: f64 = 0.9;
/// Shift in time that is told of, ticks.
const LATE_TICKS: f64 = 0.6;
/// What it must leave of the cost.
const LATE_EXPLAINS: f64 = 0.96;
/// By how much the halves of the keypoints may differ in it, ticks.
const LATE_DIFFERENCE_TICKS: f64 = 0.5;
/// The same as a share of the shift.
const LATE_DIFFERENCE: f64 = 0.05;
/// Least time between the first and the last burst that tells a rate, minutes.
const LEAST_DRIFT_MINUTES: f64 = 0.08;
/// Pixels by which the keypoints of two cameras differ at most that show the same picture: their crops are not the same.
const SAME_PX: f32 = 6.0;

pub(super) struct Judge<'a> {
    cameras: &'a [JudgedCamera],
    partners: &'a Partners,
    rate_hz: f64,
    passes: Vec<&'a PassSample>,
    bursts: Vec<&'a Burst>,
    as_it_is: Vec<CameraRays>,
    pairs: BTreeMap<(usize, usize), PairAgreement>,
    shifts: Vec<Option<Shift>>,
}

impl<'a> Judge<'a> {
    pub(super) fn new(cameras: &'a AgreementCameras, samples: &'a Samples) -> Self {
        let all = &samples.passes;
        let step = all.len().div_ceil(PASSES).max(1);
        let passes: Vec<&PassSample> = all.iter().rev().step_by(step).map(AsRef::as_ref).collect();
        let bursts: Vec<&Burst> = samples.bursts.iter().map(AsRef::as_ref).collect();
        let mut judge = Self {
            cameras: &cameras.all,
            partners: &cameras.partners,
            rate_hz: cameras.rate_hz,
            shifts: shifts(
                &bursts,
                &cameras.lines(),
                (cameras.rate_hz, KeypointHalf::All),
            ),
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
                let pair = PairAgreement::of(&judge.as_it_is[a], &judge.as_it_is[b]);
                if judge.cameras[a].viewpoint != judge.cameras[b].viewpoint
                    && pair.len() >= MIN_KEYPOINTS
                {
                    judge.pairs.insert((a, b), pair);
                }
            }
        }
        judge
    }

    /// The sightings of `camera` changed so, seen with the calibration of `calibrated`.
    fn rays(&self, camera: usize, calibrated: usize, change: PictureChange) -> CameraRays {
        let size_px = self.cameras[camera].size_px;
        let lines = &self.cameras[calibrated].lines;
        CameraRays::of(
            &self.passes,
            (camera, size_px),
            lines,
            (change, self.partners),
        )
    }

    pub(super) fn report(&self) -> AgreementReport {
        let right = self.taken_for_right();
        let mut report = AgreementReport::default();
        let mut told = vec![false; self.cameras.len()];
        self.find_same_pictures(&mut report, &mut told);
        let is_compared =
            |camera: usize| self.pairs.keys().any(|&(a, b)| a == camera || b == camera);
        let outside: Vec<usize> = (0..self.cameras.len())
            .filter(|camera| is_compared(*camera) && !right.contains(camera))
            .collect();
        for &camera in &outside {
            if !told[camera] {
                let disagreement = self.explain(camera, (&right, &outside), &mut told);
                report.disagreements.push(disagreement);
            }
            told[camera] = true;
        }
        let drifts = self.drifts();
        for camera in 0..self.cameras.len() {
            let late = || {
                self.late(camera)
                    .map(|ticks| DisagreementCause::Late { ticks })
            };
            let cause = drifts[camera]
                .map(|ticks_per_minute| DisagreementCause::Drifts { ticks_per_minute });
            if !told[camera]
                && let Some(cause) = cause.or_else(late)
            {
                told[camera] = true;
                report
                    .disagreements
                    .push(self.disagreement(&[camera], cause));
            }
        }
        if right.is_empty() {
            merge_swaps(&mut report.disagreements, self.rate_hz);
        }
        for (index, camera) in self.cameras.iter().enumerate() {
            let verdict = match (told[index], is_compared(index)) {
                (true, _) => AgreementVerdict::Disagrees,
                (false, true) => AgreementVerdict::Agrees,
                (false, false) => AgreementVerdict::Unknown,
            };
            report
                .cameras
                .insert(camera.name.clone(), self.numbers(index, verdict));
        }
        report
    }

    /// The largest set of cameras that are linked by agreement; none where no two agree, or two sets are as large.
    fn taken_for_right(&self) -> Vec<usize> {
        let medians = self
            .pairs
            .iter()
            .map(|(pair, agreement)| (*pair, agreement.median_m()));
        let medians: Vec<_> = medians.filter_map(|(pair, m)| Some((pair, m?))).collect();
        let least_m = medians
            .iter()
            .map(|(_, m)| *m)
            .fold(f64::INFINITY, f64::min);
        let limit_m = (AGREES_FACTOR * least_m).min(NEVER_AGREES_M);
        let mut set_of: Vec<usize> = (0..self.cameras.len()).collect();
        let is_near = |(a, b): (usize, usize), median_m: f64| {
            let pixel_m = self.pairs[&(a, b)].pixel_m([a, b].map(|c| self.focal_px(c)));
            median_m <= limit_m.max(AGREES_M + AGREES_PX * pixel_m)
        };
        for ((a, b), _) in medians.iter().filter(|(pair, m)| is_near(*pair, *m)) {
            let (into, from) = (set_of[*a], set_of[*b]);
            for set in set_of.iter_mut().filter(|set| **set == from) {
                *set = into;
            }
        }
        let members = |set: usize| set_of.iter().filter(|of| **of == set).count();
        let sets: std::collections::BTreeSet<usize> = set_of.iter().copied().collect();
        let most = sets.iter().map(|&set| members(set)).max().unwrap_or(0);
        let mut largest = sets.into_iter().filter(|&set| members(set) == most);
        match (largest.next(), largest.next()) {
            (Some(set), None) if most >= 2 => {
                let cameras = 0..self.cameras.len();
                cameras.filter(|&camera| set_of[camera] == set).collect()
            }
            _ => Vec::new(),
        }
    }

    fn focal_px(&self, camera: usize) -> f64 {
        self.cameras[camera].lines.mean_focal_px()
    }

    /// Two cameras whose keypoints stand in the same pixels at every pass.
    fn find_same_pictures(&self, report: &mut AgreementReport, told: &mut [bool]) {
        for a in 0..self.cameras.len() {
            for b in a + 1..self.cameras.len() {
                // Two cameras on one pole may look the same way.
                let is_elsewhere = self.cameras[a].viewpoint != self.cameras[b].viewpoint;
                if is_elsewhere && self.show_the_same(a, b) {
                    told[a] = true;
                    told[b] = true;
                    report
                        .disagreements
                        .push(self.disagreement(&[a, b], DisagreementCause::SamePictures));
                }
            }
        }
    }

    fn show_the_same(&self, a: usize, b: usize) -> bool {
        let (mut n, mut same) = (0, 0);
        for pass in &self.passes {
            for one in &pass.of_camera[a] {
                let others = pass.of_camera[b]
                    .iter()
                    .map(|other| same_pixels(one, other));
                let (own, common) = others.max().unwrap_or_default();
                same += own;
                n += common;
            }
        }
        n >= MIN_KEYPOINTS && same * 10 >= n * 7
    }

    /// What makes `camera`, which is outside of those that are `right`, agree best.
    fn explain(
        &self,
        camera: usize,
        (right, outside): (&[usize], &[usize]),
        told: &mut [bool],
    ) -> Disagreement {
        let others: Vec<usize> = if right.is_empty() {
            (0..self.cameras.len())
                .filter(|&other| other != camera)
                .collect()
        } else {
            right.to_vec()
        };
        let Some(as_it_is) = self.cost_against(camera, &self.as_it_is[camera], &others) else {
            return self.disagreement(&[camera], DisagreementCause::Unexplained);
        };
        let mut causes: Vec<(f64, Vec<usize>, DisagreementCause)> = Vec::new();
        for (change, cause) in [
            (PictureChange::Mirrored, DisagreementCause::Mirrored),
            (PictureChange::HalfTurned, DisagreementCause::HalfTurned),
        ] {
            let rays = self.rays(camera, camera, change);
            if let Some(cost) = self.cost_against(camera, &rays, &others) {
                causes.push((cost / as_it_is, vec![camera], cause));
            }
        }
        for other in (0..self.cameras.len()).filter(|&other| other != camera) {
            let apart: Vec<usize> = others.iter().copied().filter(|&o| o != other).collect();
            let is_outside = outside.contains(&other) && !told[other];
            let rays = self.rays(camera, other, PictureChange::AsItIs);
            let Some(before) = self.cost_against(camera, &self.as_it_is[camera], &apart) else {
                continue;
            };
            let Some(cost) = self.cost_against(camera, &rays, &apart) else {
                continue;
            };
            let exchanged = self.rays(other, camera, PictureChange::AsItIs);
            let swap = self
                .cost_against(other, &exchanged, &apart)
                .filter(|_| is_outside);
            let other_before = self.cost_against(other, &self.as_it_is[other], &apart);
            match (swap, other_before) {
                (Some(of_other), Some(other_before)) if of_other < EXPLAINS * other_before => {
                    let ratio = (cost + of_other) / (before + other_before);
                    causes.push((ratio, vec![camera, other], DisagreementCause::Swapped));
                }
                _ => {
                    let cause = if right.contains(&other) {
                        DisagreementCause::SamePictures
                    } else {
                        DisagreementCause::OtherCalibration
                    };
                    causes.push((cost / before, vec![camera, other], cause));
                }
            }
        }
        if let (Some(shift), Some(ticks)) = (self.shifts[camera], self.late(camera)) {
            let ratio = shift.cost_after / shift.cost_before;
            causes.push((ratio, vec![camera], DisagreementCause::Late { ticks }));
        }
        let lines: Vec<SightLines> = self.cameras.iter().map(|c| c.lines.clone()).collect();
        if let Some(refit) = refit(&self.bursts, &lines, (camera, right)) {
            let cause = if (refit.focal_factor - 1.0).abs() > OTHER_FOCAL_LENGTH {
                DisagreementCause::FocalLength {
                    factor: (1000.0 * refit.focal_factor).round() / 1000.0,
                }
            } else {
                DisagreementCause::Turned {
                    degrees: rounded(refit.turned_rad.to_degrees()),
                }
            };
            causes.push((REFIT_HANDICAP * refit.ratio, vec![camera], cause));
        }
        causes.sort_by(|a, b| a.0.total_cmp(&b.0));
        let second = causes.get(1).map_or(1.0, |(ratio, ..)| *ratio);
        let is_cause = |ratio: f64| {
            ratio < EXPLAINS || ratio < EXPLAINS_IN_PART && ratio < STANDS_OUT * second
        };
        match causes
            .into_iter()
            .next()
            .filter(|(ratio, ..)| is_cause(*ratio))
        {
            Some((_, cameras, cause)) => {
                if cause == DisagreementCause::Swapped {
                    cameras.iter().for_each(|&camera| told[camera] = true);
                }
                self.disagreement(&cameras, cause)
            }
            None => self.disagreement(&[camera], DisagreementCause::Unexplained),
        }
    }

    /// Mean cost of `rays` against these others; `None` where they have too little in common.
    fn cost_against(&self, camera: usize, rays: &CameraRays, others: &[usize]) -> Option<f64> {
        let own = self.cameras[camera].viewpoint;
        let others = others
            .iter()
            .filter(|&&other| other != camera && self.cameras[other].viewpoint != own);
        let pairs = others.map(|&other| PairAgreement::of(rays, &self.as_it_is[other]));
        let costs: Vec<f64> = pairs
            .filter(|pair| pair.len() >= MIN_KEYPOINTS)
            .map(|pair| pair.mean_cost())
            .collect();
        (!costs.is_empty()).then(|| costs.iter().sum::<f64>() / costs.len() as f64)
    }

    /// By how many ticks `camera` is late, when that is sure.
    fn late(&self, camera: usize) -> Option<f64> {
        let shift = self.shifts[camera]?;
        let is_told = shift.late_ticks.abs() >= LATE_TICKS
            && shift.cost_after < LATE_EXPLAINS * shift.cost_before;
        if !is_told {
            return None;
        }
        let lines: Vec<SightLines> = self.cameras.iter().map(|c| c.lines.clone()).collect();
        let of = |half: KeypointHalf| {
            let shift = shifts(&self.bursts, &lines, (self.rate_hz, half))[camera];
            shift.map(|shift| shift.late_ticks)
        };
        let (first, second) = (of(KeypointHalf::Odd)?, of(KeypointHalf::Even)?);
        let differ = (first - second).abs();
        let is_same = differ <= LATE_DIFFERENCE_TICKS.max(LATE_DIFFERENCE * shift.late_ticks.abs());
        (is_same && first * second > 0.0).then_some(shift.late_ticks)
    }

    /// Per camera by how many ticks more it is late every minute, where that is sure.
    fn drifts(&self) -> Vec<Option<f64>> {
        let none = vec![None; self.cameras.len()];
        let (Some(first), Some(last)) = (self.bursts.first(), self.bursts.last()) else {
            return none;
        };
        let minutes = (last.first - first.first) as f64 / self.rate_hz / 60.0;
        if minutes < LEAST_DRIFT_MINUTES {
            return none;
        }
        let lines: Vec<SightLines> = self.cameras.iter().map(|c| c.lines.clone()).collect();
        let of = |burst: &Burst, half| shifts(&[burst], &lines, (self.rate_hz, half));
        let gains = [KeypointHalf::Odd, KeypointHalf::Even].map(|half| {
            let (before, after) = (of(first, half), of(last, half));
            let gain = |(before, after): (&Option<Shift>, &Option<Shift>)| {
                Some((*after)?.late_ticks - (*before)?.late_ticks)
            };
            before
                .iter()
                .zip(&after)
                .map(gain)
                .collect::<Vec<Option<f64>>>()
        });
        let [odd, even] = &gains;
        odd.iter()
            .zip(even)
            .map(|(odd, even)| {
                let (odd, even) = ((*odd)?, (*even)?);
                let differ = (odd - even).abs();
                let is_sure = odd.abs().min(even.abs()) >= LATE_TICKS
                    && odd * even > 0.0
                    && differ <= LATE_DIFFERENCE_TICKS.max(LATE_DIFFERENCE * odd.abs());
                is_sure.then_some(0.5 * (odd + even) / minutes)
            })
            .collect()
    }

    /// By how many ticks `camera` is late, as far as that is known, to a hundredth.
    fn known_late(&self, camera: usize) -> Option<f64> {
        let late_ticks = self.shifts[camera]?.late_ticks;
        let is_known = late_ticks.abs() < LATE_TICKS || self.late(camera).is_some();
        is_known.then_some((100.0 * late_ticks).round() / 100.0)
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
        let best = best.filter(|(m, px)| m.is_finite() && px.is_finite());
        CameraAgreement {
            verdict,
            keypoints,
            distance_mm: best.map(|(m, _)| rounded(m * 1000.0)),
            distance_px: best.map(|(_, px)| rounded(px)),
            late_ticks: self.known_late(camera),
        }
    }

    fn disagreement(&self, cameras: &[usize], cause: DisagreementCause) -> Disagreement {
        let names = cameras
            .iter()
            .map(|&camera| self.cameras[camera].name.clone());
        let names: Vec<String> = names.collect();
        let (found, remedy) = words::of(&names, cause, self.rate_hz);
        Disagreement {
            cameras: names,
            cause,
            found,
            remedy,
        }
    }
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
                found,
                remedy,
            },
        );
    }
    *all = others;
}

/// How many keypoints of two sightings are in the same pixels, and how many both have.
fn same_pixels(one: &SeenBody, other: &SeenBody) -> (usize, usize) {
    let pairs = one
        .iter()
        .zip(other)
        .filter_map(|(p, q)| Some((p.as_ref()?, q.as_ref()?)));
    let near = |p: f32, q: f32| (p - q).abs() <= SAME_PX;
    pairs.fold((0, 0), |(same, n), (p, q)| {
        let is_same = near(p.pixel[0], q.pixel[0]) && near(p.pixel[1], q.pixel[1]);
        (same + usize::from(is_same), n + 1)
    })
}

/// To a tenth.
fn rounded(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}
