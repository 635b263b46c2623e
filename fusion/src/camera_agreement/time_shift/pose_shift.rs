//! By how many ticks each camera is off, from its sightings and where people were: beyond what a burst is long, and of people
//! who move too little in one.
//!
//! ```text
//!   e(s) = mean over the sightings of a camera of  min over people of  mean over keypoints of  cost(|project(X(t - s)) - u| z / f)
//! ```
//!
//! u is what a detection pass at tick t shows, X(t - s) where a person was at that tick or another. Who is late by seconds is
//! not in his crops, as boxes are where people are now; sightings are made without boxes. Poses follow all cameras, so that
//! one that is a little late draws them to itself: of few ticks some are missing here, of many none.

mod sighted;

use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;
use nalgebra::Vector2;

pub(super) use self::sighted::{Projected, Sighted};

use super::super::geometry::SightLines;
use super::super::samples::{Burst, MAX_POSED, PassSample, PosedTick};
use super::{KeypointHalf, vertex};

/// Longest shift that is looked for, seconds.
const LONGEST_S: f64 = 10.0;
/// Keypoints that must have been compared at a shift.
const MIN_COMPARED: usize = 120;
/// By which factor most shifts cost more than the least.
const STANDS_OUT: f64 = 1.25;
/// By which factor any shift costs more that is so far from the least, seconds.
const ALONE: f64 = 1.12;
const ALONE_S: f64 = 0.5;
/// Of the shifts every so many are looked at at first; then those beside the least of these, as many as may be the least of all:
/// so many, of which none costs more than the least by this factor.
const COARSE: usize = 3;
const TRIED: usize = 12;
const MAY_BE_LEAST: f64 = 1.5;
/// How far the halves of the keypoints look from the least cost of all, poses.
const BESIDE: isize = 3;
/// By how much they may differ: ticks, and a share of the shift.
const DIFFERENCE_TICKS: f64 = 0.6;
const DIFFERENCE: f64 = 0.03;

/// Fewest keypoints of either half of the time that tell, what the shift must leave of the cost in each, and the cost up to
/// which it fits at all: what fits by chance does not do so twice. Shelf: 0.66 and 0.31 at the most, where a camera is late.
const MIN_COMPARED_IN_HALF: usize = 50;
const EXPLAINS_IN_HALF: f64 = 0.85;
const FITS_IN_HALF: f64 = 0.45;

/// Fewest moments at which passes must tell of a shift, and from one to the next so many kept poses: half a second.
const MIN_MOMENTS: usize = 3;
const MOMENT_POSES: i64 = 12;

/// What is known of a camera's time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct PoseShift {
    /// By how many ticks its pictures are late against the poses.
    pub(in crate::camera_agreement) late_ticks: f64,
    /// What it leaves of the cost.
    pub(in crate::camera_agreement) ratio: f64,
    /// Whether both halves of the time say so.
    pub(in crate::camera_agreement) is_steady: bool,
}

/// The sightings of a camera, and everybody as it would see them.
pub(super) struct Search<'a> {
    pub(super) camera: usize,
    pub(super) focal_px: f64,
    pub(super) size_px: Vector2<f64>,
    pub(super) passes: &'a [&'a PassSample],
    every: i64,
    /// Number of the first kept pose: its tick over `every`.
    first: i64,
    /// Per number from the first on.
    people: Vec<PosedPeople>,
}

/// Those at a kept tick.
#[derive(Default)]
struct PosedPeople {
    seen: Vec<Projected>,
    /// Whether there may have been more.
    is_cut: bool,
}

impl<'a> Search<'a> {
    pub(super) fn of(
        (camera, lines): (usize, &SightLines),
        poses: &[&PosedTick],
        (passes, every): (&'a [&'a PassSample], i64),
    ) -> Self {
        let number = |posed: &PosedTick| posed.tick.0.div_euclid(every);
        let first = poses.first().map_or(0, |posed| number(posed));
        let mut people: Vec<PosedPeople> = Vec::new();
        for posed in poses {
            let at = (number(posed) - first).unsigned_abs() as usize;
            people.resize_with(at, PosedPeople::default);
            let seen = posed.people.iter();
            people.push(PosedPeople {
                seen: seen
                    .filter_map(|(person, body)| Projected::of(*person, body, lines))
                    .collect(),
                is_cut: posed.people.len() >= MAX_POSED,
            });
        }
        Self {
            camera,
            focal_px: lines.mean_focal_px(),
            size_px: lines.size_px(),
            passes,
            every,
            first,
            people,
        }
    }

    pub(super) fn shift(&self, rate_hz: f64) -> Option<PoseShift> {
        let per_pose_s = self.every as f64 / rate_hz;
        let reach = (LONGEST_S / per_pose_s).round() as isize;
        let costs = self.costs(reach)?;
        let known = || {
            costs
                .iter()
                .copied()
                .enumerate()
                .filter(|(_, c)| c.is_finite())
        };
        let (at, least) = known().min_by(|a, b| a.1.total_cmp(&b.1))?;
        let coarse = costs
            .iter()
            .skip(reach.cast_unsigned() % COARSE)
            .step_by(COARSE);
        let middle = upper_median(coarse.copied().filter(|c| c.is_finite()).collect())?;
        let alone = (ALONE_S / per_pose_s).ceil() as usize;
        let next = known().filter(|(other, _)| other.abs_diff(at) > alone);
        let next = next.map(|(_, c)| c).fold(f64::INFINITY, f64::min);
        if middle < STANDS_OUT * least || next < ALONE * least {
            return None;
        }
        let own = at.cast_signed() - reach;
        let halves =
            [KeypointHalf::OddPairs, KeypointHalf::EvenPairs].map(|half| self.near(own, half));
        let [odd, even] = [self.ticks(halves[0]?), self.ticks(halves[1]?)];
        let most_apart = DIFFERENCE_TICKS
            .max(DIFFERENCE * odd.abs())
            .max(0.3 * self.every as f64);
        let late_ticks = self.ticks(self.near(own, KeypointHalf::All)?);
        // Where a shift of nothing is not known, nobody was sighted then where people are now.
        let before = Some(costs[reach.cast_unsigned()]).filter(|c| c.is_finite());
        let is_sure = (odd - even).abs() <= most_apart;
        is_sure.then(|| PoseShift {
            late_ticks,
            ratio: least / before.unwrap_or(middle).max(least),
            is_steady: self.is_steady(own),
        })
    }

    /// The mean cost by shift, from `-reach` on; not a number where too little is known, or where it is not the least.
    fn costs(&self, reach: isize) -> Option<Vec<f64>> {
        let seen = self.sighted(KeypointHalf::All, self.passes);
        let at = |shift: isize| self.cost_at(&seen, shift);
        let mut costs = vec![f64::NAN; 2 * reach.cast_unsigned() + 1];
        // With no shift among them.
        let first = reach.cast_unsigned() % COARSE;
        let coarse = (first..costs.len()).step_by(COARSE);
        let coarse: Vec<(usize, (f64, usize))> = coarse
            .map(|index| (index, at(index.cast_signed() - reach)))
            .collect();
        let most = coarse.iter().map(|(_, (_, n))| *n).max()?;
        let mean = |(sum, n): (f64, usize)| {
            let is_known = n >= MIN_COMPARED && 3 * n >= most;
            if is_known { sum / n as f64 } else { f64::NAN }
        };
        for (index, compared) in coarse {
            costs[index] = mean(compared);
        }
        let known = costs.iter().copied().enumerate();
        let mut best: Vec<(usize, f64)> = known.filter(|(_, cost)| cost.is_finite()).collect();
        best.sort_by(|a, b| a.1.total_cmp(&b.1));
        let least = best.first()?.1;
        for (index, _) in best
            .into_iter()
            .take_while(|(_, cost)| *cost <= MAY_BE_LEAST * least)
            .take(TRIED)
        {
            for beside in index.saturating_sub(COARSE - 1)..(index + COARSE).min(costs.len()) {
                if costs[beside].is_nan() {
                    costs[beside] = mean(at(beside.cast_signed() - reach));
                }
            }
        }
        Some(costs)
    }

    /// The sightings of passes that show enough of those keypoints.
    fn sighted(
        &self,
        half: KeypointHalf,
        passes: &[&'a PassSample],
    ) -> Vec<(&'a PassSample, Sighted)> {
        let of = |pass: &&'a PassSample| {
            let pass = *pass;
            let seen = pass.surest(self.camera).iter();
            seen.filter_map(move |body| Some((pass, Sighted::of(body, half)?)))
        };
        passes.iter().flat_map(of).collect()
    }

    /// The summed cost at a shift, and of how many keypoints.
    fn cost_at(&self, seen: &[(&PassSample, Sighted)], shift: isize) -> (f64, usize) {
        let (mut sum, mut n) = (0.0, 0);
        for (pass, seen) in seen {
            let people = self.people_at(pass, shift);
            if let Some(people) = people.filter(|people| !people.is_empty()) {
                sum += seen.cost(people, self.focal_px) * seen.len() as f64;
                n += seen.len();
            }
        }
        (sum, n)
    }

    /// Where people were so many kept poses before a pass.
    pub(super) fn people_at(&self, pass: &PassSample, shift: isize) -> Option<&[Projected]> {
        self.posed_at(pass, shift).map(|people| &people.seen[..])
    }

    /// Whether everybody is among those who were there at a pass, so far as is known.
    pub(super) fn knows_everybody_at(&self, pass: &PassSample) -> bool {
        self.posed_at(pass, 0).is_some_and(|people| !people.is_cut)
    }

    fn posed_at(&self, pass: &PassSample, shift: isize) -> Option<&PosedPeople> {
        let now = pass.tick.0.div_euclid(self.every) - self.first;
        let at = usize::try_from(now - shift as i64).ok()?;
        self.people.get(at)
    }

    /// Whether the shift explains what is shown in the first half of the time, and in the second. Passes in a row tell as much as one:
    /// before anybody is followed they fit the first poses best.
    fn is_steady(&self, own: isize) -> bool {
        let is_compared = |pass: &&&PassSample| {
            let people = self.people_at(pass, own);
            people.is_some_and(|p| !p.is_empty()) && !pass.surest(self.camera).is_empty()
        };
        let passes: Vec<&'a PassSample> = self.passes.iter().filter(is_compared).copied().collect();
        if self.moments(passes.iter().map(|pass| &pass.tick)) < MIN_MOMENTS {
            return false;
        }
        let bodies = |pass: &&PassSample| pass.surest(self.camera).len();
        let all: usize = passes.iter().map(bodies).sum();
        let mut shown = 0;
        let middle = passes.iter().position(|pass| {
            shown += bodies(pass);
            2 * shown > all
        });
        let (first, second) = passes.split_at(middle.unwrap_or(0));
        let explains = |half: &[&'a PassSample]| {
            let seen = self.sighted(KeypointHalf::All, half);
            let at = |shift: isize| self.cost_at(&seen, shift);
            let ((there, n), (here, n_here)) = (at(own), at(0));
            let (there, here) = (there / n.max(1) as f64, here / n_here.max(1) as f64);
            // Before anybody was followed nothing is known of how it is.
            let is_better = n_here == 0 || there < EXPLAINS_IN_HALF * here;
            n >= MIN_COMPARED_IN_HALF && there < FITS_IN_HALF && is_better
        };
        explains(first) && explains(second)
    }

    /// How many of these ticks are so far from each other that poses between them tell more than one of them.
    fn moments<'t>(&self, ticks: impl Iterator<Item = &'t Tick>) -> usize {
        let mut moments: Vec<Tick> = Vec::new();
        for &tick in ticks {
            let last = moments.last();
            if last.is_none_or(|last| tick - *last >= MOMENT_POSES * self.every) {
                moments.push(tick);
            }
        }
        moments.len()
    }

    /// The least cost of some keypoints beside a shift, with the fraction of the parabola through it, poses.
    fn near(&self, own: isize, half: KeypointHalf) -> Option<f64> {
        let seen = self.sighted(half, self.passes);
        let curve = (own - BESIDE..=own + BESIDE).map(|shift| self.cost_at(&seen, shift));
        let costs: Vec<f64> = curve
            .map(|(sum, n)| {
                if n == 0 {
                    f64::INFINITY
                } else {
                    sum / n as f64
                }
            })
            .collect();
        let inside = 1..costs.len().saturating_sub(1);
        let at = inside.min_by(|&a, &b| costs[a].total_cmp(&costs[b]))?;
        let fraction = vertex(costs[at - 1], costs[at], costs[at + 1]);
        Some((own - BESIDE + at.cast_signed()) as f64 + fraction)
    }

    /// Poses are kept now and then, and detection passes come in between.
    fn ticks(&self, poses: f64) -> f64 {
        let off = self
            .passes
            .iter()
            .map(|pass| pass.tick.0.rem_euclid(self.every) as f64);
        poses * self.every as f64 + off.sum::<f64>() / self.passes.len().max(1) as f64
    }
}

/// By how many ticks the sightings of each camera are late against poses, more than those of most: poses are where people
/// are a little before or after what all show. Of two that are known that one is taken for right which is nearer to the poses.
/// What the edges themselves say of when pictures were taken is known.
pub(in crate::camera_agreement) fn against_most(
    mut shifts: Vec<Option<PoseShift>>,
    bursts: &[&Burst],
) -> Vec<Option<PoseShift>> {
    for (camera, shift) in shifts.iter_mut().enumerate() {
        let trails = bursts.iter().flat_map(|burst| &burst.trails);
        let own = trails.filter(|trail| trail.camera == camera);
        let taken =
            own.flat_map(|trail| (0..trail.len()).filter_map(|tick| Some(trail.at(tick)?.0)));
        let taken = upper_median(taken.collect()).unwrap_or(0.0);
        if let Some(shift) = shift {
            shift.late_ticks += taken;
        }
    }
    let all: Vec<f64> = shifts.iter().flatten().map(|it| it.late_ticks).collect();
    let most = match all[..] {
        [a, b] if a.abs() < b.abs() => a,
        [_, b] => b,
        _ => upper_median(all).unwrap_or(0.0),
    };
    for shift in shifts.iter_mut().flatten() {
        shift.late_ticks -= most;
    }
    shifts
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::super::super::samples::SeenKeypoint;
    use super::*;
    use crate::sightings::fixture::hall;

    /// Somebody who walks through the hall, at a tick: 17 keypoints, metres.
    fn walking(tick: i64) -> Vec<[f32; 3]> {
        let x = 0.03 * tick as f32 - 2.0;
        let place = |k: u8| [x + 0.02 * f32::from(k), 0.5, 0.1 * f32::from(k)];
        (0..17).map(place).collect()
    }

    /// What a camera tells that shows at these passes where somebody is, so many ticks later, among 120 ticks of poses.
    fn told<T>(
        at: impl Fn(i64) -> Vec<[f32; 3]>,
        (passes, later): (impl Iterator<Item = i64>, i64),
        of: impl Fn(&Search<'_>) -> T,
    ) -> T {
        let lines = SightLines::of(&hall().cameras[0].1);
        let posed: Vec<PosedTick> = (0..120)
            .map(|tick| PosedTick {
                tick: Tick(tick),
                people: vec![(1, at(tick))],
            })
            .collect();
        let seen = |m: [f32; 3]| {
            let (px, _) = lines.project(&Vector3::from(m.map(f64::from)))?;
            let pixel = [px.x as f32, px.y as f32];
            Some(SeenKeypoint { pixel, score: 0.9 })
        };
        let shown: Vec<PassSample> = passes
            .map(|tick| PassSample {
                tick: Tick(tick),
                of_camera: vec![vec![at(tick + later).into_iter().map(seen).collect()]],
                unsure: vec![Vec::new()],
            })
            .collect();
        let (posed, shown): (Vec<_>, Vec<_>) = (posed.iter().collect(), shown.iter().collect());
        of(&Search::of((0, &lines), &posed, (&shown, 1)))
    }

    /// Whether a camera that shows at these passes what others show four ticks later is steadily so.
    fn is_steady(passes: impl Iterator<Item = i64>) -> bool {
        told(walking, (passes, 4), |search| search.is_steady(-4))
    }

    #[test]
    fn passes_in_a_row_tell_of_no_shift_that_lasts() {
        assert!(is_steady((0..8).map(|pass| 12 * pass)));
        assert!(!is_steady(0..8));
    }

    fn late(known: &[Option<f64>]) -> Vec<Option<f64>> {
        let shift = |late_ticks: f64| PoseShift {
            late_ticks,
            ratio: 0.5,
            is_steady: true,
        };
        let shifts = known.iter().map(|ticks| ticks.map(shift)).collect();
        let found = against_most(shifts, &[]);
        found
            .iter()
            .map(|shift| Some(shift.as_ref()?.late_ticks))
            .collect()
    }

    #[test]
    fn whoever_is_late_is_late_against_most_and_of_two_against_the_one_nearer_to_the_poses() {
        assert_eq!(
            late(&[Some(1.0), Some(1.0), Some(31.0)]),
            [Some(0.0), Some(0.0), Some(30.0)]
        );
        assert_eq!(
            late(&[Some(30.0), None, Some(0.5)]),
            [Some(29.5), None, Some(0.0)]
        );
        assert_eq!(late(&[Some(0.5), Some(30.0)]), [Some(0.0), Some(29.5)]);
        assert_eq!(late(&[None, Some(30.0)]), [None, Some(0.0)]);
    }
}
