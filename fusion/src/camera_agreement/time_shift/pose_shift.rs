//! By how many ticks each camera is late, from its sightings and the poses of people. This finds
//! shifts longer than a burst, and shifts of people who move too little in one.
//!
//! ```text
//!   e(s) = mean over the sightings of a camera of  min over people of
//!          mean over keypoints of  cost(|project(X(t - s)) - u| z / f)
//! ```
//!
//! u is a keypoint of a sighting at tick t, X(t - s) a pose s ticks earlier. A camera that is late
//! by seconds does not show people in their crops, because boxes are where people are now.
//! Sightings need no boxes. Poses follow all cameras, so a camera that is a little late draws them
//! towards itself. So a small shift is underestimated here, a large one is not.

use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;
use nalgebra::{Vector2, Vector3};

use super::super::geometry::SightLines;
use super::super::pairs::HALF_COST_M;
use super::super::samples::{Burst, MAX_POSED, PassSample, PosedTick, SeenBody};
use super::{KeypointHalf, vertex};

/// Longest shift of the search, seconds.
const MAX_SHIFT_S: f64 = 10.0;
/// Least number of compared keypoints at a shift.
const MIN_COMPARED: usize = 120;
/// Least ratio of the median cost of all shifts to the least cost.
const MIN_MEDIAN_RATIO: f64 = 1.25;
/// Least ratio of the cost of any shift farther away than `SECOND_MINIMUM_S` to the least cost.
const MIN_SECOND_RATIO: f64 = 1.12;
const SECOND_MINIMUM_S: f64 = 0.5;
/// The coarse search takes every third shift. The fine search takes the neighbours of its best
/// ones: at most `MAX_CANDIDATES`, whose costs are at most `MAX_CANDIDATE_RATIO` times the least.
const COARSE_STEP: usize = 3;
const MAX_CANDIDATES: usize = 12;
const MAX_CANDIDATE_RATIO: f64 = 1.5;
/// Range around the least cost in which the halves of the keypoints are searched, poses.
const HALF_REACH_POSES: isize = 3;
/// Largest difference between the halves, in ticks and as a share of the shift.
const MAX_DIFFERENCE_TICKS: f64 = 0.6;
const MAX_DIFFERENCE_RATIO: f64 = 0.03;

/// Conditions that both halves of the time must meet, because a chance fit does not occur twice:
/// the least number of keypoints, the largest ratio of the costs with and without the shift, and
/// the largest cost. If a camera is late on the Shelf, ratio and cost are at most 0.66 and 0.31.
const MIN_COMPARED_IN_HALF: usize = 50;
const MAX_COST_RATIO_IN_HALF: f64 = 0.85;
const MAX_COST_IN_HALF: f64 = 0.45;

/// Least number of moments with passes, and least time between two moments, kept poses (0.4 s at
/// 30 Hz).
const MIN_MOMENTS: usize = 3;
const MOMENT_POSES: i64 = 12;

/// Least number of keypoints of a sighting.
const MIN_KEYPOINTS: usize = 5;
/// Largest distance between the middles of two bodies of one person, metres.
const MAX_MIDDLES_APART_M: f64 = 1.5;

/// The time shift of a camera against poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct PoseShift {
    /// By how many ticks its pictures are late against the poses.
    pub(in crate::camera_agreement) late_ticks: f64,
    /// Cost with the shift over the cost without.
    pub(in crate::camera_agreement) ratio: f64,
    /// Whether both halves of the time confirm it.
    pub(in crate::camera_agreement) is_steady: bool,
}

/// The sightings of a camera, and the poses of all people projected into it.
pub(super) struct PoseSearch<'a> {
    pub(super) camera: usize,
    pub(super) focal_px: f64,
    pub(super) size_px: Vector2<f64>,
    pub(super) passes: &'a [&'a PassSample],
    every: i64,
    /// Number of the first kept pose: its tick over `every`.
    first: i64,
    /// By number, from the first on.
    people: Vec<PosedPeople>,
}

/// The people at a kept tick.
#[derive(Default)]
struct PosedPeople {
    seen: Vec<Projected>,
    /// Whether there may have been more people than are kept.
    is_cut: bool,
}

impl<'a> PoseSearch<'a> {
    /// `every` is the number of ticks from one kept pose to the next.
    pub(super) fn new(
        camera: usize,
        lines: &SightLines,
        poses: &[&PosedTick],
        passes: &'a [&'a PassSample],
        every: i64,
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
                    .filter_map(|(person, body)| Projected::new(*person, body, lines))
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
        let reach = (MAX_SHIFT_S / per_pose_s).round() as isize;
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
            .skip(reach.cast_unsigned() % COARSE_STEP)
            .step_by(COARSE_STEP);
        let middle = upper_median(coarse.copied().filter(|c| c.is_finite()).collect())?;
        let separate = (SECOND_MINIMUM_S / per_pose_s).ceil() as usize;
        let next = known().filter(|(other, _)| other.abs_diff(at) > separate);
        let next = next.map(|(_, c)| c).fold(f64::INFINITY, f64::min);
        if middle < MIN_MEDIAN_RATIO * least || next < MIN_SECOND_RATIO * least {
            return None;
        }
        let own = at.cast_signed() - reach;
        let halves =
            [KeypointHalf::OddPairs, KeypointHalf::EvenPairs].map(|half| self.near(own, half));
        let [odd, even] = [self.ticks(halves[0]?), self.ticks(halves[1]?)];
        let most_apart = MAX_DIFFERENCE_TICKS
            .max(MAX_DIFFERENCE_RATIO * odd.abs())
            .max(0.3 * self.every as f64);
        let late_ticks = self.ticks(self.near(own, KeypointHalf::All)?);
        // Without a known cost at no shift, no people were followed at the time of the sightings.
        let before = Some(costs[reach.cast_unsigned()]).filter(|c| c.is_finite());
        let is_sure = (odd - even).abs() <= most_apart;
        is_sure.then(|| PoseShift {
            late_ticks,
            ratio: least / before.unwrap_or(middle).max(least),
            is_steady: self.is_steady(own),
        })
    }

    /// The mean cost by shift, from `-reach` on; NaN if too little is known, or if the search skips
    /// the shift.
    fn costs(&self, reach: isize) -> Option<Vec<f64>> {
        let seen = self.sightings(KeypointHalf::All, self.passes);
        let at = |shift: isize| self.cost_at(&seen, shift);
        let mut costs = vec![f64::NAN; 2 * reach.cast_unsigned() + 1];
        // The coarse shifts include a shift of 0.
        let first = reach.cast_unsigned() % COARSE_STEP;
        let coarse = (first..costs.len()).step_by(COARSE_STEP);
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
            .take_while(|(_, cost)| *cost <= MAX_CANDIDATE_RATIO * least)
            .take(MAX_CANDIDATES)
        {
            for near in
                index.saturating_sub(COARSE_STEP - 1)..(index + COARSE_STEP).min(costs.len())
            {
                if costs[near].is_nan() {
                    costs[near] = mean(at(near.cast_signed() - reach));
                }
            }
        }
        Some(costs)
    }

    /// The sightings of passes with enough keypoints of that half.
    fn sightings(
        &self,
        half: KeypointHalf,
        passes: &[&'a PassSample],
    ) -> Vec<(&'a PassSample, Sighted)> {
        let in_pass = |pass: &&'a PassSample| {
            let pass = *pass;
            let seen = pass.surest(self.camera).iter();
            seen.filter_map(move |body| Some((pass, Sighted::new(body, half)?)))
        };
        passes.iter().flat_map(in_pass).collect()
    }

    /// The summed cost at a shift, and the number of keypoints.
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

    /// The people `shift` kept poses before a pass.
    pub(super) fn people_at(&self, pass: &PassSample, shift: isize) -> Option<&[Projected]> {
        self.posed_at(pass, shift).map(|people| &people.seen[..])
    }

    /// Whether the poses at a pass are of all tracked people.
    pub(super) fn has_all_people_at(&self, pass: &PassSample) -> bool {
        self.posed_at(pass, 0).is_some_and(|people| !people.is_cut)
    }

    fn posed_at(&self, pass: &PassSample, shift: isize) -> Option<&PosedPeople> {
        let now = pass.tick.0.div_euclid(self.every) - self.first;
        let at = usize::try_from(now - shift as i64).ok()?;
        self.people.get(at)
    }

    /// Whether the shift explains the sightings in both halves of the time. Passes in quick
    /// succession count as one: before people are followed, they fit the first poses best.
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
            let seen = self.sightings(KeypointHalf::All, half);
            let at = |shift: isize| self.cost_at(&seen, shift);
            let ((there, n), (here, n_here)) = (at(own), at(0));
            let (there, here) = (there / n.max(1) as f64, here / n_here.max(1) as f64);
            // The cost without a shift is unknown before people were followed.
            let is_better = n_here == 0 || there < MAX_COST_RATIO_IN_HALF * here;
            n >= MIN_COMPARED_IN_HALF && there < MAX_COST_IN_HALF && is_better
        };
        explains(first) && explains(second)
    }

    /// Number of these ticks that are at least `MOMENT_POSES` apart.
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

    /// The shift near `own` with the least cost of a half, with the fraction of a parabola, poses.
    fn near(&self, own: isize, half: KeypointHalf) -> Option<f64> {
        let seen = self.sightings(half, self.passes);
        let range = own - HALF_REACH_POSES..=own + HALF_REACH_POSES;
        let curve = range.map(|shift| self.cost_at(&seen, shift));
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
        Some((own - HALF_REACH_POSES + at.cast_signed()) as f64 + fraction)
    }

    /// A shift in ticks. Adds the mean offset of detection passes from the kept pose before them.
    fn ticks(&self, poses: f64) -> f64 {
        let off = self
            .passes
            .iter()
            .map(|pass| pass.tick.0.rem_euclid(self.every) as f64);
        poses * self.every as f64 + off.sum::<f64>() / self.passes.len().max(1) as f64
    }
}

/// The shift of each camera against most cameras, because poses are a little early or late for all.
/// Of two cameras, the one nearer to the poses is the reference. Capture times that edges report
/// are already known, so they do not count as lateness.
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

/// The keypoints of a person at a kept tick, projected into a camera.
pub(super) struct Projected {
    pub(super) person: u32,
    pub(super) middle_px: Vector2<f64>,
    /// Pixel and depth (metres) per keypoint; `None` behind the camera.
    pub(super) keypoints: Vec<Option<(Vector2<f64>, f64)>>,
    /// Depth over focal length of the first keypoint, metres per pixel.
    pub(super) pixel_m: f64,
}

impl Projected {
    fn new(person: u32, body: &[[f32; 3]], lines: &SightLines) -> Option<Self> {
        let project = |m: &[f32; 3]| lines.project(&Vector3::from(m.map(f64::from)));
        let keypoints: Vec<Option<(Vector2<f64>, f64)>> = body.iter().map(project).collect();
        let seen = || keypoints.iter().flatten();
        let n = seen().count();
        let middle_px = seen().map(|(px, _)| px).sum::<Vector2<f64>>() / n.max(1) as f64;
        let (_, depth_m) = seen().next()?;
        let pixel_m = depth_m / lines.mean_focal_px();
        (n >= MIN_KEYPOINTS).then_some(Self {
            person,
            middle_px,
            keypoints,
            pixel_m,
        })
    }
}

/// The visible keypoints of a sighting.
pub(super) struct Sighted {
    middle_px: Vector2<f64>,
    keypoints: Vec<(usize, Vector2<f64>)>,
}

impl Sighted {
    pub(super) fn new(body: &SeenBody, half: KeypointHalf) -> Option<Self> {
        let all = body.iter().enumerate().filter_map(|(k, seen)| {
            let pixel = seen.as_ref()?.pixel.map(f64::from);
            Some((k, Vector2::from(pixel)))
        });
        let all: Vec<(usize, Vector2<f64>)> = all.collect();
        if all.len() < MIN_KEYPOINTS {
            return None;
        }
        let middle_px = all.iter().map(|(_, px)| px).sum::<Vector2<f64>>() / all.len() as f64;
        let keypoints: Vec<_> = all.into_iter().filter(|(k, _)| half.has(*k)).collect();
        (keypoints.len() * 3 >= MIN_KEYPOINTS).then_some(Self {
            middle_px,
            keypoints,
        })
    }

    fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// The mean cost with the person that it fits best; 1 if no person is near.
    pub(super) fn cost(&self, people: &[Projected], focal_px: f64) -> f64 {
        self.cost_near(people, focal_px).unwrap_or(1.0)
    }

    /// The same; `None` if no person is near.
    fn cost_near(&self, people: &[Projected], focal_px: f64) -> Option<f64> {
        let mut least = None;
        for person in people {
            let apart_m = (person.middle_px - self.middle_px).norm() * person.pixel_m;
            if apart_m <= MAX_MIDDLES_APART_M {
                let most = least.unwrap_or(f64::INFINITY);
                least = Some(self.sum_up_to(most, person, focal_px));
            }
        }
        Some(least? / self.len() as f64)
    }

    /// The summed cost with a person, at most `most`. Stops early: most people are elsewhere.
    ///
    /// The cost of [`crate::camera_agreement::pairs::cost`], without a root.
    fn sum_up_to(&self, most: f64, person: &Projected, focal_px: f64) -> f64 {
        let half2 = HALF_COST_M * HALF_COST_M * focal_px * focal_px;
        let mut sum = 0.0;
        for (k, seen) in &self.keypoints {
            sum += match person.keypoints.get(*k) {
                Some(Some((px, depth_m))) => {
                    let off2 = (px - seen).norm_squared() * depth_m * depth_m;
                    off2 / (off2 + half2)
                }
                _ => 1.0,
            };
            if sum >= most {
                return most;
            }
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::samples::SeenKeypoint;
    use super::*;
    use crate::sightings::fixture::hall;

    /// The 17 keypoints at a tick of a person who walks through the hall, metres.
    fn walking(tick: i64) -> Vec<[f32; 3]> {
        let x = 0.03 * tick as f32 - 2.0;
        let place = |k: u8| [x + 0.02 * f32::from(k), 0.5, 0.1 * f32::from(k)];
        (0..17).map(place).collect()
    }

    /// Whether a camera that shows at these passes the pose of four ticks later is steadily early.
    fn is_steady(passes: impl Iterator<Item = i64>) -> bool {
        let lines = SightLines::from_camera(&hall().cameras[0].1);
        let posed: Vec<PosedTick> = (0..120)
            .map(|tick| PosedTick {
                tick: Tick(tick),
                people: vec![(1, walking(tick))],
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
                of_camera: vec![vec![walking(tick + 4).into_iter().map(seen).collect()]],
                unsure: vec![Vec::new()],
            })
            .collect();
        let (posed, shown): (Vec<_>, Vec<_>) = (posed.iter().collect(), shown.iter().collect());
        PoseSearch::new(0, &lines, &posed, &shown, 1).is_steady(-4)
    }

    #[test]
    fn passes_in_a_row_confirm_no_steady_shift() {
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
        against_most(shifts, &[])
            .iter()
            .map(|shift| Some(shift.as_ref()?.late_ticks))
            .collect()
    }

    #[test]
    fn shifts_are_against_most_or_against_the_camera_nearer_to_the_poses() {
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
