//! Which cameras agree, and what would make the others agree, too.
//!
//! Two cameras that agree on the people whom both show are right as far as the other knows. The largest set of cameras
//! that are linked so is taken for right, and every other one is held to it: as it is, later, mirrored, turned, with the
//! calibration of another.

use std::collections::BTreeMap;

use farfield_proto::message::agreement::{AgreementVerdict, CameraAgreement};

use super::geometry::SightLines;
use super::pairs::{CameraRays, PairAgreement, Partners, PictureChange};
use super::report::{AgreementReport, Disagreement, DisagreementCause};
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
/// No cameras agree whose lines pass farther from each other than this, metres, unless their pixels are as wide.
const NEVER_AGREES_M: f64 = 0.11;
/// Shift in time that is told of, ticks.
const LATE_TICKS: f64 = 0.6;
/// What it must leave of the cost.
const LATE_EXPLAINS: f64 = 0.96;
/// Shifts from so many ticks on are looked for among so many that one of them explains something by chance.
const FAR_TICKS: f64 = 8.0;
/// What they must leave.
const FAR_EXPLAINS: f64 = 0.7;
/// By how much the halves of the keypoints may differ in it, ticks.
const LATE_DIFFERENCE_TICKS: f64 = 0.5;
/// The same as a share of the shift.
const LATE_DIFFERENCE: f64 = 0.05;
/// Least time between the first and the last burst that tells a rate, minutes.
const LEAST_DRIFT_MINUTES: f64 = 0.08;
/// Pixels by which the keypoints of two cameras differ at most that show the same picture: their crops are not the same.
const SAME_PX: f32 = 6.0;

pub(super) struct Judge<'a> {
    pub(super) cameras: &'a [JudgedCamera],
    pub(super) partners: &'a Partners,
    rate_hz: f64,
    passes: Vec<&'a PassSample>,
    pub(super) lines: Vec<SightLines>,
    pub(super) bursts: Vec<&'a Burst>,
    pub(super) as_it_is: Vec<CameraRays>,
    pairs: BTreeMap<(usize, usize), PairAgreement>,
    pub(super) shifts: Vec<Option<Shift>>,
    /// The same from the odd and from the even keypoints alone.
    halves: [Vec<Option<Shift>>; 2],
    /// Per camera by how many ticks more it is late every minute, where that is sure.
    drifts: Vec<Option<f64>>,
}

impl<'a> Judge<'a> {
    pub(super) fn new(cameras: &'a AgreementCameras, samples: &'a Samples) -> Self {
        let all = &samples.passes;
        let step = all.len().div_ceil(PASSES).max(1);
        let passes: Vec<&PassSample> = all.iter().rev().step_by(step).map(AsRef::as_ref).collect();
        let bursts: Vec<&Burst> = samples.bursts.iter().map(AsRef::as_ref).collect();
        let lines = cameras.lines();
        let of = |half: KeypointHalf| shifts(&bursts, &lines, (cameras.rate_hz, half));
        let mut judge = Self {
            cameras: &cameras.all,
            partners: &cameras.partners,
            rate_hz: cameras.rate_hz,
            shifts: of(KeypointHalf::All),
            halves: [of(KeypointHalf::Odd), of(KeypointHalf::Even)],
            drifts: drifts(&bursts, &lines, cameras.rate_hz),
            lines,
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
                let pair = PairAgreement::of_common(&judge.as_it_is[a], &judge.as_it_is[b]);
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
    pub(super) fn rays(
        &self,
        camera: usize,
        calibrated: usize,
        change: PictureChange,
    ) -> CameraRays {
        let size_px = self.cameras[camera].size_px;
        let lines = &self.lines[calibrated];
        CameraRays::of(
            &self.passes,
            (camera, size_px),
            lines,
            (change, self.partners),
        )
    }

    pub(super) fn report(&self) -> AgreementReport {
        let mut report = AgreementReport::default();
        let mut told = vec![false; self.cameras.len()];
        self.find_same_pictures(&mut report, &mut told);
        for group in self.groups() {
            self.judge_group(&group, &mut report.disagreements, &mut told);
        }
        self.find_what_agrees_by_chance(&mut report.disagreements, &mut told);
        // Those who are held to a camera that is wrong seem a little late: they are told of once it is mended.
        let all_right = !told.contains(&true);
        for (camera, told) in told.iter_mut().enumerate() {
            let drift = || {
                self.drifts[camera]
                    .map(|ticks_per_minute| DisagreementCause::Drifts { ticks_per_minute })
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
        let is_compared =
            |camera: usize| self.pairs.keys().any(|&(a, b)| a == camera || b == camera);
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

    /// The cameras that were compared, by groups that have nobody in common.
    fn groups(&self) -> Vec<Vec<usize>> {
        let compared = || self.pairs.keys().copied();
        let sets = linked(self.cameras.len(), compared());
        sets.into_iter().filter(|set| set.len() > 1).collect()
    }

    /// Explains every camera of a group that is not among those which are taken for right.
    fn judge_group(&self, group: &[usize], all: &mut Vec<Disagreement>, told: &mut [bool]) {
        let right = self.taken_for_right(group);
        let outside = group
            .iter()
            .copied()
            .filter(|camera| !right.contains(camera));
        let outside: Vec<usize> = outside.collect();
        let (mut found, mut unexplained) = (Vec::new(), Vec::new());
        for &camera in &outside {
            if !told[camera] {
                match self.explain(camera, (&right, group, &outside), told) {
                    Some((cameras, cause)) => found.push(self.disagreement(&cameras, cause)),
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
        let own = self.pairs.iter().filter(|((a, _), _)| group.contains(a));
        let medians = own.filter_map(|(pair, agreement)| Some((*pair, agreement.median_m()?)));
        let medians: Vec<((usize, usize), f64)> = medians.collect();
        let least_m = medians
            .iter()
            .map(|(_, m)| *m)
            .fold(f64::INFINITY, f64::min);
        let limit_m = (AGREES_FACTOR * least_m).min(NEVER_AGREES_M);
        let is_near = |(a, b): (usize, usize), median_m: f64| {
            let pixel_m = self.pairs[&(a, b)].pixel_m([a, b].map(|c| self.focal_px(c)));
            median_m <= limit_m.max(AGREES_M + AGREES_PX * pixel_m)
        };
        let near = medians.iter().filter(|(pair, m)| is_near(*pair, *m));
        let sets = linked(self.cameras.len(), near.map(|(pair, _)| *pair));
        let most = sets.iter().map(Vec::len).max().unwrap_or(0);
        let mut largest = sets.into_iter().filter(|set| set.len() == most);
        match (largest.next(), largest.next()) {
            (Some(set), None) if most >= 2 => set,
            _ => Vec::new(),
        }
    }

    fn focal_px(&self, camera: usize) -> f64 {
        self.lines[camera].mean_focal_px()
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

    /// Mean cost of `rays` against these others; `None` where they have too little in common.
    pub(super) fn cost_against(
        &self,
        camera: usize,
        rays: &CameraRays,
        others: &[usize],
    ) -> Option<f64> {
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

    /// By how many ticks `camera` is late, when that is sure and worth a word.
    pub(super) fn late(&self, camera: usize) -> Option<f64> {
        let shift = self.shifts[camera]?;
        let explains = if shift.late_ticks.abs() < FAR_TICKS {
            LATE_EXPLAINS
        } else {
            FAR_EXPLAINS
        };
        let is_told =
            shift.late_ticks.abs() >= LATE_TICKS && shift.cost_after < explains * shift.cost_before;
        self.known_late(camera).filter(|_| is_told)
    }

    /// Whether `camera` is late, and that explains most of what it is off.
    pub(super) fn is_clearly_late(&self, camera: usize) -> bool {
        let shift = self.shifts[camera];
        let explains =
            shift.is_some_and(|shift| shift.cost_after < FAR_EXPLAINS * shift.cost_before);
        explains && self.late(camera).is_some()
    }

    /// By how many ticks `camera` is late, to a hundredth; `None` where nothing moved enough to tell, or the halves of the
    /// keypoints tell otherwise.
    fn known_late(&self, camera: usize) -> Option<f64> {
        let shift = self.shifts[camera].filter(|shift| shift.is_sharp)?;
        let halves = [&self.halves[0], &self.halves[1]].map(|half| half[camera]);
        let [first, second] = [halves[0]?.late_ticks, halves[1]?.late_ticks];
        is_same(first, second).then_some((100.0 * shift.late_ticks).round() / 100.0)
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
                .known_late(camera)
                .map(|late| late as f32)
                .filter(|late| late.is_finite()),
        }
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
            found,
            remedy,
        }
    }
}

/// Whether the halves of the keypoints tell the same shift.
fn is_same(first: f64, second: f64) -> bool {
    let most = LATE_DIFFERENCE_TICKS.max(LATE_DIFFERENCE * first.abs());
    (first - second).abs() <= most
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

/// Per camera by how many ticks more it is late every minute, where the bursts lie on a line and that is steep enough.
fn drifts(bursts: &[&Burst], lines: &[SightLines], rate_hz: f64) -> Vec<Option<f64>> {
    let none = vec![None; lines.len()];
    let (Some(first), Some(last)) = (bursts.first(), bursts.last()) else {
        return none;
    };
    let minutes_at = |burst: &Burst| (burst.first - first.first) as f64 / rate_hz / 60.0;
    let minutes = minutes_at(last);
    if minutes < LEAST_DRIFT_MINUTES {
        return none;
    }
    let of = |burst: &&Burst| {
        let half = |half| shifts(&[burst], lines, (rate_hz, half));
        (
            minutes_at(burst),
            half(KeypointHalf::Odd),
            half(KeypointHalf::Even),
        )
    };
    let all: Vec<_> = bursts.iter().map(of).collect();
    let drift = |camera: usize| {
        let told = all.iter().filter_map(|(at, odd, even)| {
            let (odd, even) = (odd[camera]?, even[camera]?);
            let is_told = odd.is_sharp && even.is_sharp && is_same(odd.late_ticks, even.late_ticks);
            is_told.then_some((*at, 0.5 * (odd.late_ticks + even.late_ticks)))
        });
        let told: Vec<(f64, f64)> = told.collect();
        let (&(from, before), &(to, after)) = (told.first()?, told.last()?);
        let rate = (after - before) / (to - from);
        let is_on_line = |&(at, late): &(f64, f64)| {
            let expected = before + rate * (at - from);
            (late - expected).abs() <= LATE_DIFFERENCE_TICKS
        };
        let is_drift = told.len() >= 3
            && (after - before).abs() >= 2.0 * LATE_TICKS
            && told.iter().all(is_on_line);
        is_drift.then_some(rate)
    };
    (0..lines.len()).map(drift).collect()
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
pub(super) fn rounded(value: f64) -> f64 {
    (10.0 * value).round() / 10.0
}
