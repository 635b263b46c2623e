//! Plans the path of every person through the scene, once, when the scene is loaded.
//!
//! People are planned as units (one person, or a group) in the order of the file, each around the
//! earlier ones. A unit plays its clips ([`timeline`]). It is turned back into the field
//! ([`steer`]) or walks its path ([`path`]), and steps aside ([`aside`]). The plan holds
//! corrections: the turn and shift of the clips' world over time. They are smooth, so positions
//! between ticks are as exact as at ticks.

mod aside;
mod path;
mod steer;
mod timeline;

use std::sync::Arc;

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use nalgebra::{Vector2, Vector3};

pub use self::aside::KEEP_M;
use self::aside::{Neighbours, step_aside};
use self::path::PathWalk;
use self::steer::{Obstacles, SAMPLES_PER_S, UnitWay, steer};
use self::timeline::{Timeline, UnitMember, turned};
use crate::motion::Clip;
use crate::scene::file::{PersonEntry, SceneFile};

/// Distance of pelvises from the edge of the field, metres.
pub const EDGE_M: f64 = 0.4;
/// Averaging window for the own heading of a person on a path, seconds. Slower changes are turns of
/// the clip, which the path replaces. Faster changes are the motion of the pelvis within a step.
const HEADING_WINDOW_S: f64 = 1.2;
/// People who never come closer than this are ignored, metres.
const FAR_M: f64 = 3.0;

/// One person, or a group, with its planned motion.
#[derive(Debug)]
struct Unit {
    timeline: Timeline,
    enter_s: f64,
    way: Locomotion,
    /// Displacement by stepping aside, metres.
    aside: Table<2>,
}

/// How a unit moves through the scene.
#[derive(Debug)]
enum Locomotion {
    /// As in its clips, turned: yaw (radians) and shift (metres) of the clips' world.
    Own(Table<3>),
    /// Along a path: yaw of the clips' world, radians.
    Path(PathWalk, Table<1>),
}

/// The plan of all people.
#[derive(Debug)]
pub(super) struct ScenePlan {
    units: Vec<Unit>,
    /// Unit and member of every person.
    of_person: Vec<(usize, usize)>,
}

/// Positions of all people placed so far, per person and sample of the scene.
type Tracks = Vec<Vec<Option<Vector2<f64>>>>;

impl ScenePlan {
    /// Plans all people of `file`, whose clips are `clips`, per person.
    pub(super) fn new(file: &SceneFile, clips: &[Vec<Arc<Clip>>]) -> Self {
        let mut plan = Self {
            units: Vec::new(),
            of_person: vec![(0, 0); file.people.len()],
        };
        let mut tracks = Tracks::new();
        for people in units_of(file) {
            for (member, person) in people.iter().enumerate() {
                plan.of_person[*person] = (plan.units.len(), member);
            }
            let unit = Unit::plan(file, &people, clips, &tracks);
            for (member, person) in people.iter().enumerate() {
                tracks.push(unit.track(file, member, &file.people[*person]));
            }
            plan.units.push(unit);
        }
        plan
    }

    /// The stature of every person, metres. All people of a group get the scale of its first
    /// person, because their clips share a unit of length.
    pub(super) fn statures_m(file: &SceneFile, clips: &[Vec<Arc<Clip>>]) -> Vec<f64> {
        let mut statures_m = vec![0.0; file.people.len()];
        for people in units_of(file) {
            let first = people[0];
            let metres_per_unit = file.people[first].height_m / clips[first][0].stature_units();
            for person in people {
                statures_m[person] = clips[person][0].stature_units() * metres_per_unit;
            }
        }
        statures_m
    }

    /// The joints of `person` at `time_s` of the scene, world, metres.
    pub(super) fn joints_m(&self, person: usize, time_s: f64) -> Joints {
        let (unit, member) = self.of_person[person];
        self.units[unit].joints_m(member, time_s)
    }
}

/// The people of every unit, in the order of their first person.
fn units_of(file: &SceneFile) -> Vec<Vec<usize>> {
    let mut units: Vec<Vec<usize>> = Vec::new();
    for (index, person) in file.people.iter().enumerate() {
        let same = |unit: &&mut Vec<usize>| {
            person.group.is_some() && file.people[unit[0]].group == person.group
        };
        match units.iter_mut().find(same) {
            Some(unit) => unit.push(index),
            None => units.push(vec![index]),
        }
    }
    units
}

impl Unit {
    fn plan(file: &SceneFile, people: &[usize], clips: &[Vec<Arc<Clip>>], tracks: &Tracks) -> Self {
        let first = &file.people[people[0]];
        let entries = people.iter().map(|&person| &file.people[person]);
        let enter_s = entries.clone().map(|p| p.enter_s).fold(f64::MAX, f64::min);
        let leave_s = entries.map(|p| p.leave_s).fold(0.0, f64::max);
        let length_s = (leave_s.min(file.seconds) - enter_s).max(0.0);
        let frames = &clips[people[0]];
        let member = |&person: &usize| {
            UnitMember::new(clips[person].clone(), frames.clone(), first.height_m)
        };
        let timeline = Timeline::new(
            people.iter().map(member).collect(),
            first.at_m.into(),
            first.heading_rad,
            first.blend_s,
            length_s,
        );
        let n_samples = (length_s * SAMPLES_PER_S).ceil() as usize + 1;
        let times_s: Vec<f64> = (0..n_samples).map(|i| i as f64 / SAMPLES_PER_S).collect();
        let others = neighbours(tracks, enter_s, n_samples);
        let mut unit = Self {
            way: Locomotion::Own(Table::default()),
            aside: Table::default(),
            timeline,
            enter_s,
        };
        let reach_m = Vector2::from(file.size_m) / 2.0 - Vector2::repeat(EDGE_M);
        let reach_m = (first.keep_inside && first.path.is_none())
            .then(|| reach_m.sup(&Vector2::repeat(EDGE_M)));
        unit.way = match &first.path {
            Some(path) => {
                let walk = PathWalk::new(path, first.heading_rad, length_s);
                let yaw = unit.yaw_on_path(&walk, &times_s);
                Locomotion::Path(walk, yaw)
            }
            None => unit.own_way(&times_s, reach_m, &others),
        };
        let at = |&time_s: &f64| unit.pelvises_m(time_s);
        let people_m: Vec<Vec<Vector2<f64>>> = times_s.iter().map(at).collect();
        let others = near_ones(&people_m, others);
        let near = Neighbours {
            reach_m,
            others: &others,
        };
        unit.aside = Table::new(1.0 / SAMPLES_PER_S, step_aside(&people_m, &near));
        unit
    }

    /// The motion of the clips, turned where necessary.
    fn own_way(
        &self,
        times_s: &[f64],
        reach_m: Option<Vector2<f64>>,
        others: &Tracks,
    ) -> Locomotion {
        let pelvises_m: Vec<_> = times_s
            .iter()
            .map(|&t| self.timeline.pelvises_m(t))
            .collect();
        let way = UnitWay::new(&pelvises_m);
        let around = Obstacles {
            reach_m: reach_m.unwrap_or(Vector2::repeat(f64::INFINITY)),
            others,
        };
        let course = steer(&way, &around);
        let correction = |((yaw_rad, at_m), middle_m): (&(f64, Vector2<f64>), &Vector2<f64>)| {
            let shift_m = at_m - turned(*middle_m, *yaw_rad);
            [*yaw_rad, shift_m.x, shift_m.y]
        };
        let corrections = course.iter().zip(&way.middle_m).map(correction);
        Locomotion::Own(Table::new(1.0 / SAMPLES_PER_S, corrections.collect()))
    }

    /// The turn of the clips' world that makes the walker face along its path.
    fn yaw_on_path(&self, walk: &PathWalk, times_s: &[f64]) -> Table<1> {
        let mut facing = Vec::with_capacity(times_s.len());
        let mut last = 0.0;
        for &time_s in times_s {
            let here = self.timeline.facing_rad(0, time_s);
            last += (here - last + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
                - std::f64::consts::PI;
            facing.push(last);
        }
        let half = (HEADING_WINDOW_S / 2.0 * SAMPLES_PER_S) as usize;
        let weight = |offset: usize| {
            let x = offset as f64 / (half + 1) as f64;
            (1.0 - x * x).powi(2)
        };
        let mean = |i: usize| {
            let first = i.saturating_sub(half);
            let window = facing[first..(i + half + 1).min(facing.len())].iter();
            let weighted = window.enumerate().map(|(j, &facing)| {
                let weight = weight(i.abs_diff(first + j));
                (weight * facing, weight)
            });
            let (sum, weights) = weighted.fold((0.0, 0.0), |a, w| (a.0 + w.0, a.1 + w.1));
            sum / weights
        };
        let yaw = |(i, &time_s): (usize, &f64)| [walk.at(time_s).1 - mean(i)];
        let samples = times_s.iter().enumerate().map(yaw).collect();
        Table::new(1.0 / SAMPLES_PER_S, samples)
    }

    /// Turn and shift of the clips' world at `time_s` of the unit.
    fn correction(&self, time_s: f64) -> (f64, Vector2<f64>) {
        let aside = Vector2::from(self.aside.at(time_s));
        match &self.way {
            Locomotion::Own(table) => {
                let [yaw_rad, x, y] = table.at(time_s);
                (yaw_rad, Vector2::new(x, y) + aside)
            }
            Locomotion::Path(walk, yaw) => {
                let [yaw_rad] = yaw.at(time_s);
                let pelvis_m = self.timeline.pelvises_m(time_s)[0];
                let shift_m = walk.at(time_s).0 - turned(pelvis_m, yaw_rad);
                (yaw_rad, shift_m + aside)
            }
        }
    }

    fn pelvises_m(&self, time_s: f64) -> Vec<Vector2<f64>> {
        let (yaw_rad, shift_m) = self.correction(time_s);
        let pelvises = self.timeline.pelvises_m(time_s).into_iter();
        pelvises.map(|p| turned(p, yaw_rad) + shift_m).collect()
    }

    fn joints_m(&self, member: usize, scene_s: f64) -> Joints {
        let time_s = scene_s - self.enter_s;
        let (yaw_rad, shift_m) = self.correction(time_s);
        self.timeline.joints_m(member, time_s).map(|joint| {
            let on_floor = turned(joint.xy(), yaw_rad) + shift_m;
            Vector3::new(on_floor.x, on_floor.y, joint.z)
        })
    }

    /// The position of `member` at every sample of the scene, while it is present.
    fn track(
        &self,
        file: &SceneFile,
        member: usize,
        person: &PersonEntry,
    ) -> Vec<Option<Vector2<f64>>> {
        let n_samples = (file.seconds * SAMPLES_PER_S).ceil() as usize + 1;
        let at = |sample: usize| {
            let scene_s = sample as f64 / SAMPLES_PER_S;
            let there = (person.enter_s..=person.leave_s).contains(&scene_s);
            there.then(|| self.joints_m(member, scene_s)[Joint::Pelvis.index()].xy())
        };
        (0..n_samples).map(at).collect()
    }
}

/// The tracks of all people at the samples of a unit that enters at `enter_s`.
fn neighbours(tracks: &Tracks, enter_s: f64, n_samples: usize) -> Tracks {
    let offset = (enter_s * SAMPLES_PER_S).round() as usize;
    let shifted = |track: &Vec<Option<Vector2<f64>>>| {
        let at = |i: usize| track.get(i + offset).copied().flatten();
        (0..n_samples).map(at).collect()
    };
    tracks.iter().map(shifted).collect()
}

/// The tracks that come near the unit.
fn near_ones(people_m: &[Vec<Vector2<f64>>], mut others: Tracks) -> Tracks {
    others.retain(|other| {
        people_m.iter().zip(other).any(|(people, other)| {
            other.is_some_and(|other| people.iter().any(|p| (p - other).norm() < FAR_M))
        })
    });
    others
}

/// `N` values at evenly spaced times from 0 on, interpolated by Catmull-Rom cubics: once
/// continuously differentiable, and constant before the first and after the last sample.
#[derive(Debug, Clone, Default)]
struct Table<const N: usize> {
    step_s: f64,
    samples: Vec<[f64; N]>,
}

impl<const N: usize> Table<N> {
    /// One sample every `step_s`; without samples the function is zero.
    fn new(step_s: f64, samples: Vec<[f64; N]>) -> Self {
        Self { step_s, samples }
    }

    fn at(&self, time_s: f64) -> [f64; N] {
        let Some(last) = self.samples.len().checked_sub(1) else {
            return [0.0; N];
        };
        let place = (time_s / self.step_s).clamp(0.0, last as f64);
        let index = (place as usize).min(last.saturating_sub(1));
        let u = place - index as f64;
        let sample = |offset: usize| self.samples[(index + offset).saturating_sub(1).min(last)];
        let (a, b, c, d) = (sample(0), sample(1), sample(2), sample(3));
        std::array::from_fn(|i| {
            let (into, out) = ((c[i] - a[i]) / 2.0, (d[i] - b[i]) / 2.0);
            let rise = c[i] - b[i];
            let bend = u * (into + out - 2.0 * rise) + (3.0 * rise - 2.0 * into - out);
            b[i] + u * (into + u * bend)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_interpolates_samples_and_preserves_lines() {
        let table = Table::new(0.5, (0..5).map(|i| [f64::from(i), 2.0]).collect());
        for (time_s, value) in [
            (0.0, 0.0),
            (0.5, 1.0),
            (0.8, 1.6),
            (2.0, 4.0),
            (9.0, 4.0),
            (-1.0, 0.0),
        ] {
            let [a, b] = table.at(time_s);
            assert!(
                (a - value).abs() < 1e-12 && (b - 2.0).abs() < 1e-12,
                "{time_s}: {a}"
            );
        }
    }

    #[test]
    fn an_empty_table_is_zero() {
        assert!(Table::<1>::default().at(1.0)[0].abs() < 1e-12);
    }
}
