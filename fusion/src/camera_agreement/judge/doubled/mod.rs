//! Whether people are followed twice, some cameras showing everybody at one place and the others at another: calibrations with
//! two origins, a direction that was measured too short, two recorders that began at different instants.
//!
//! Cameras of either kind agree with each other, so that nothing seems wrong. But two people who make the same movements at
//! one distance, and of whom each camera shows only the one or the other, are one.

#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::message::agreement::AgreementVerdict;
use farfield_proto::order_statistics::upper_median;
use farfield_proto::tick::Tick;
use nalgebra::{Vector2, Vector3};

use super::super::geometry::SightLines;
use super::super::report::{AgreementReport, Disagreement, DisagreementCause};
use super::super::samples::{PosedTick, SeenBody, middle_m};
use super::Judge;

/// How far keypoints of the same movement may be from each other once the one body is laid on the other, metres, the mean of
/// them; how far apart the bodies are.
const ALIKE_M: f64 = 0.08;
const APART_M: [f64; 2] = [0.08, 2.0];
/// Kept poses that two must have together, and which share of them must be alike: who is followed by half of the cameras is
/// followed badly.
const MIN_POSES: usize = 24;
const ALIKE: f64 = 0.5;
/// Which share of what a camera shows must be the one, for it to be of his side; and of what all show, which must be of cameras
/// of a side.
const MOSTLY: f64 = 0.8;
/// How far they must have gone together, metres: people who stand in a row are as alike.
const GONE_M: f32 = 1.0;
/// One in so many of those who are followed must be one of two.
const MANY: usize = 3;
/// How far apart two must be before a camera for it to tell which of them it shows, metres; how near the sighting must be
/// to him, and as a share of how far it is from the other.
const TOLD_APART_M: f64 = 0.12;
const NEAR_M: f64 = 0.15;
const NEARER: f64 = 0.6;
/// Sightings that must tell, how many cameras may show both or neither for each, and viewpoints that each of the two must be
/// seen from.
const MIN_TELLING: usize = 12;
const BOTH: f64 = 0.1;
const NEITHER: f64 = 0.4;
const MIN_VIEWPOINTS: usize = 2;

/// Two who are followed.
type Pair = (u32, u32);

/// Whom cameras show of pairs that move alike.
#[derive(Debug, Default)]
struct Telling {
    /// Per camera, how often it shows the one, and the other.
    shown: BTreeMap<usize, [usize; 2]>,
    both: usize,
    neither: usize,
}

impl Judge<'_> {
    /// Says that people are followed twice, in the place of what that looks like for single cameras.
    pub(in crate::camera_agreement) fn tell_of_doubled(&self, report: &mut AgreementReport) {
        let Some((sides, apart_m)) = self.doubled() else {
            return;
        };
        let name = |camera: &usize| &self.cameras[*camera].name;
        let is_late = |camera: &usize| {
            let mut told = report.disagreements.iter();
            told.any(|d| {
                matches!(d.cause, DisagreementCause::Late { .. })
                    && d.cameras.contains(name(camera))
            })
        };
        // Then it is told by how much.
        if sides.iter().any(|side| side.iter().all(is_late)) {
            return;
        }
        let is_kept = |told: &Disagreement| {
            let mut of_sides = sides.iter().flatten().map(name);
            let is_elsewhere =
                !told.cameras.is_empty() && of_sides.all(|camera| !told.cameras.contains(camera));
            told.cause.is_of_pictures() || is_elsewhere
        };
        report.disagreements.retain(is_kept);
        let fewer = sides
            .iter()
            .min_by_key(|side| (side.len(), (*side).clone()));
        let cameras = fewer.cloned().unwrap_or_default();
        let told = self.disagreement(&cameras, DisagreementCause::Doubled { apart_m });
        report.disagreements.insert(0, told);
        Self::set_verdicts(report);
    }

    /// Those agree of whom nothing is told any more.
    pub(super) fn set_verdicts(report: &mut AgreementReport) {
        for (name, camera) in &mut report.cameras {
            let is_told = report
                .disagreements
                .iter()
                .any(|told| told.cameras.contains(name));
            if is_told {
                camera.verdict = AgreementVerdict::Disagrees;
            } else if camera.verdict == AgreementVerdict::Disagrees {
                camera.verdict = AgreementVerdict::Agrees;
            }
        }
    }

    /// The cameras that show people at the one place, and those that do at the other, and how far apart these are, metres.
    fn doubled(&self) -> Option<([Vec<usize>; 2], f64)> {
        let poses: Vec<&PosedTick> = self.samples.poses.iter().map(AsRef::as_ref).collect();
        let mut all = Telling::default();
        let (mut apart_m, mut twice) = (Vec::new(), BTreeSet::new());
        for (pair, of_pair_m) in alike(&poses) {
            let telling = self.telling(pair, &poses);
            if telling.is_one_person(self) {
                all.add(&telling);
                apart_m.push(of_pair_m);
                twice.extend([pair.0, pair.1]);
            }
        }
        // A few who are so are people; all pairs together tell of the same cameras.
        let is_common = MANY * twice.len() >= followed(&poses);
        let apart_m = upper_median(apart_m).filter(|_| is_common && all.is_one_person(self))?;
        Some((all.sides(), (100.0 * apart_m).round() / 100.0))
    }

    /// Whom of a pair the cameras show in detection passes.
    fn telling(&self, (one, other): Pair, poses: &[&PosedTick]) -> Telling {
        let mut telling = Telling::default();
        let every = self.samples.pose_every_ticks();
        for pass in &self.samples.passes {
            let posed = at(poses, pass.tick, every);
            let body = |id: u32| posed?.people.iter().find(|(of, _)| *of == id);
            let Some(((_, one), (_, other))) = body(one).zip(body(other)) else {
                continue;
            };
            for (camera, lines) in self.lines.iter().enumerate() {
                let seen = [one, other].map(|body| ShownBody::of(body, lines));
                let [Some(one), Some(other)] = seen else {
                    continue;
                };
                if one.middle_apart_m(&other) < TOLD_APART_M {
                    continue;
                }
                let mut shows = [false; 2];
                for sighting in &pass.of_camera[camera] {
                    let off_m = [&one, &other].map(|body| body.off_m(sighting));
                    for who in 0..2 {
                        let (own, others) = (off_m[who], off_m[1 - who]);
                        shows[who] |= own < NEAR_M && own < NEARER * others;
                    }
                }
                let of_camera = telling.shown.entry(camera).or_default();
                match shows {
                    [true, true] => telling.both += 1,
                    [false, false] => telling.neither += 1,
                    [is_one, _] => of_camera[usize::from(!is_one)] += 1,
                }
            }
        }
        telling
    }
}

impl Telling {
    /// Whether the two are one, whom each of some viewpoints shows at one of two places.
    fn is_one_person(&self, judge: &Judge<'_>) -> bool {
        let singles: usize = self.shown.values().flatten().sum();
        let few = |n: usize, share: f64| n as f64 <= share * singles as f64;
        let of_sides = self.sides().into_iter().flatten();
        let of_sides = of_sides.filter_map(|camera| self.shown.get(&camera));
        let of_sides: usize = of_sides.flatten().sum();
        let viewpoints = self.sides().map(|cameras| {
            let of = cameras
                .iter()
                .map(|&camera| judge.cameras[camera].viewpoint);
            let mut of: Vec<_> = of.collect();
            of.sort_unstable();
            of.dedup();
            of.len()
        });
        singles >= MIN_TELLING
            && few(self.both, BOTH)
            && few(self.neither, NEITHER)
            && of_sides as f64 >= MOSTLY * singles as f64
            && viewpoints.iter().all(|n| *n >= MIN_VIEWPOINTS)
    }

    /// The cameras that mostly show the one, and those that mostly show the other.
    fn sides(&self) -> [Vec<usize>; 2] {
        [0, 1].map(|side| {
            let mostly =
                |shown: &[usize; 2]| shown[side] as f64 > MOSTLY * (shown[0] + shown[1]) as f64;
            let own = self.shown.iter().filter(|(_, shown)| mostly(shown));
            own.map(|(camera, _)| *camera).collect()
        })
    }

    /// Adds what is told of another pair, of which either may be called the one.
    fn add(&mut self, other: &Self) {
        let lean = |[one, other]: [usize; 2]| one as f64 - other as f64;
        let sum: f64 = (other.shown.iter())
            .filter_map(|(camera, shown)| Some(lean(*shown) * lean(*self.shown.get(camera)?)))
            .sum();
        for (camera, &[one, two]) in &other.shown {
            let own = self.shown.entry(*camera).or_default();
            let [to_one, to_two] = if sum < 0.0 { [two, one] } else { [one, two] };
            own[0] += to_one;
            own[1] += to_two;
        }
        self.both += other.both;
        self.neither += other.neither;
    }
}

/// How many people were followed for long enough to be told of.
fn followed(poses: &[&PosedTick]) -> usize {
    let mut n_poses: BTreeMap<u32, usize> = BTreeMap::new();
    for (id, _) in poses.iter().flat_map(|posed| &posed.people) {
        *n_poses.entry(*id).or_default() += 1;
    }
    n_poses.values().filter(|n| **n >= MIN_POSES).count()
}

/// What is known of two who are followed at the same time.
#[derive(Default)]
struct Together {
    n_poses: usize,
    /// How far apart they were in one posture, metres.
    alike_m: Vec<f64>,
    /// Where the one was then: the lowest and the highest x and y, world, metres.
    reach_m: Option<[[f32; 2]; 2]>,
}

impl Together {
    fn note(&mut self, one: &[[f32; 3]], other: &[[f32; 3]]) {
        self.n_poses += 1;
        let Some(apart_m) = apart_if_alike_m(one, other) else {
            return;
        };
        self.alike_m.push(apart_m);
        let middle_m = middle_m(one);
        let [low, high] = self.reach_m.get_or_insert([[middle_m.x, middle_m.y]; 2]);
        for axis in 0..2 {
            low[axis] = low[axis].min(middle_m[axis]);
            high[axis] = high[axis].max(middle_m[axis]);
        }
    }

    /// How far apart they are, metres, where they make the same movements.
    fn apart_m(self) -> Option<f64> {
        let [low, high] = self.reach_m?;
        let gone_m = (0..2).map(|axis| high[axis] - low[axis]);
        let is_alike = self.n_poses >= MIN_POSES
            && self.alike_m.len() as f64 >= ALIKE * self.n_poses as f64
            && gone_m.fold(0.0, f32::max) >= GONE_M;
        upper_median(self.alike_m).filter(|_| is_alike)
    }
}

/// Pairs of people who make the same movements at one distance, and that distance, metres.
fn alike(poses: &[&PosedTick]) -> Vec<(Pair, f64)> {
    let mut of_pairs: BTreeMap<Pair, Together> = BTreeMap::new();
    for posed in poses {
        for (index, (one, own)) in posed.people.iter().enumerate() {
            for (other, theirs) in &posed.people[index + 1..] {
                of_pairs
                    .entry((*one, *other))
                    .or_default()
                    .note(own, theirs);
            }
        }
    }
    let alike = of_pairs.into_iter();
    alike
        .filter_map(|(pair, together)| Some((pair, together.apart_m()?)))
        .collect()
}

/// How far apart two bodies are that are in one posture, metres.
fn apart_if_alike_m(one: &[[f32; 3]], other: &[[f32; 3]]) -> Option<f64> {
    let n = one.len().min(other.len());
    let between = || {
        let both = one.iter().zip(other);
        both.map(|(a, b)| Vector3::from(*b) - Vector3::from(*a))
    };
    let mean = between().sum::<Vector3<f32>>() / n.max(1) as f32;
    let apart_m = f64::from(mean.norm());
    let is_apart = (APART_M[0]..=APART_M[1]).contains(&apart_m);
    if n == 0 || !is_apart {
        return None;
    }
    let off_m = between().map(|way| f64::from((way - mean).norm()));
    (off_m.sum::<f64>() / n as f64 <= ALIKE_M).then_some(apart_m)
}

/// The poses that were kept at a tick, or just before it.
fn at<'a>(poses: &[&'a PosedTick], tick: Tick, every: i64) -> Option<&'a PosedTick> {
    let next = poses.partition_point(|posed| posed.tick <= tick);
    let posed = poses.get(next.checked_sub(1)?)?;
    (tick - posed.tick < every).then_some(posed)
}

/// Somebody as a camera would show him: pixels, and what a pixel is there, metres.
struct ShownBody {
    keypoints: Vec<Vector2<f64>>,
    middle_px: Vector2<f64>,
    pixel_m: f64,
}

impl ShownBody {
    /// `None` where he is not all in the picture.
    fn of(body: &[[f32; 3]], lines: &SightLines) -> Option<Self> {
        let size_px = lines.size_px();
        let (mut keypoints, mut depth_m) = (Vec::with_capacity(body.len()), 0.0);
        for point_m in body {
            let (px, depth) = lines.project(&Vector3::from(point_m.map(f64::from)))?;
            let is_inside = px.x >= 0.0 && px.y >= 0.0 && px.x < size_px.x && px.y < size_px.y;
            if !is_inside {
                return None;
            }
            keypoints.push(px);
            depth_m += depth;
        }
        let n = keypoints.len().max(1) as f64;
        Some(Self {
            middle_px: keypoints.iter().sum::<Vector2<f64>>() / n,
            pixel_m: depth_m / n / lines.mean_focal_px(),
            keypoints,
        })
    }

    fn middle_apart_m(&self, other: &Self) -> f64 {
        (self.middle_px - other.middle_px).norm() * self.pixel_m
    }

    /// How far a sighting is from him, metres, the median of its keypoints.
    fn off_m(&self, sighting: &SeenBody) -> f64 {
        let off = sighting
            .iter()
            .zip(&self.keypoints)
            .filter_map(|(seen, px)| {
                let pixel = Vector2::from(seen.as_ref()?.pixel.map(f64::from));
                Some((pixel - px).norm() * self.pixel_m)
            });
        upper_median(off.collect()).unwrap_or(f64::INFINITY)
    }
}
