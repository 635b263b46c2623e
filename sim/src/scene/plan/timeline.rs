//! The motion of a unit: its clips in sequence, before any steering.
//!
//! A unit is one person, or a group whose clips share a coordinate frame. Each clip continues at
//! the place and heading where the previous one ended, with a blend. The end of one clip and the
//! start of the next are chosen within [`TRIM_S`] so that both are most similar in the middle of
//! the blend. Otherwise legs would cross in every step that is cut short. A closed clip is repeated
//! whole.
//!
//! Bones are those of the person's first clip: people do not grow when the rig changes.

use std::collections::BTreeMap;
use std::sync::Arc;

use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use nalgebra::{Vector2, Vector3};

use crate::motion::{Clip, Posture};

/// How much of a clip's start or end may be cut for a better blend, seconds.
const TRIM_S: f64 = 0.5;
/// Step of the search for the best cut, seconds.
const TRIM_STEP_S: f64 = 1.0 / 30.0;
/// Part of a clip that a blend, or the cut at one end, may take.
const SHARE: f64 = 0.25;
/// Time over which the pace of two clips is compared, seconds.
const PACE_S: f64 = 0.05;
/// Cost of cutting one second, in metres of mean joint distance, so that cuts need a benefit.
const TRIM_COST_M_S: f64 = 0.04;
/// Largest mean joint speed that a blend may cause, metres per second. A longer blend is taken
/// where the file's would exceed it.
const MAX_BLEND_M_S: f64 = 2.0;
/// Largest slope of the smooth step.
pub(super) const STEEPEST: f64 = 1.875;
/// Longest time that may be missing between the last and the first posture of a closed clip,
/// seconds.
const LONGEST_GAP_S: f64 = 0.05;
/// How much the last clip may be slowed down to reach the end, instead of a short restart.
const SLOWER: f64 = 0.03;
/// Softness of the minimum over joint heights, statures.
const LOWEST_SOFTNESS: f64 = 0.01;
/// Length of the arrow that makes headings comparable with positions, metres.
const ARROW_M: f64 = 0.3;

/// One person of a unit.
#[derive(Debug)]
pub(super) struct UnitMember {
    /// Its clips; all members have the same number.
    clips: Vec<Arc<Clip>>,
    /// The clips of the unit's first member; their statures and floors apply to all members.
    frames: Vec<Arc<Clip>>,
    /// Stature of the unit's first member, metres.
    stature_m: f64,
    /// The bone lengths of each of its clips, statures.
    lengths: Vec<[f64; N_JOINTS]>,
}

impl UnitMember {
    /// A member that plays `clips` in the coordinate frames of `frames`, the clips of the unit's
    /// first member, whose stature is `stature_m`.
    pub(super) fn new(clips: Vec<Arc<Clip>>, frames: Vec<Arc<Clip>>, stature_m: f64) -> Self {
        let lengths = clips.iter().map(|clip| clip.mean_lengths()).collect();
        Self {
            clips,
            frames,
            stature_m,
            lengths,
        }
    }

    /// The posture at `time_s` in clip `clip`, with the bones of the first clip, in statures of the
    /// unit's first member.
    fn posture(&self, clip: usize, time_s: f64) -> Posture {
        let posture = self.clips[clip].posture_relative_to(time_s, &self.frames[clip]);
        if Arc::ptr_eq(&self.clips[clip], &self.clips[0]) {
            posture
        } else {
            posture.with_mean_lengths(&self.lengths[clip], &self.lengths[0])
        }
    }

    /// Position of the pelvis on the floor, metres, and heading, radians.
    fn stand(&self, posture: &Posture) -> (Vector2<f64>, f64) {
        let pelvis = posture.joints[Joint::Pelvis.index()].xy() * self.stature_m;
        (pelvis, posture.facing_rad())
    }

    fn moved(&self, posture: &Posture, motion: &FloorMotion) -> Posture {
        let shift = Vector3::new(motion.shift_m.x, motion.shift_m.y, 0.0) / self.stature_m;
        posture.moved(motion.yaw_rad, shift)
    }
}

/// A motion on the floor: first a turn about the origin, then a shift.
#[derive(Debug, Clone, Copy)]
struct FloorMotion {
    yaw_rad: f64,
    shift_m: Vector2<f64>,
}

/// One clip in its place.
#[derive(Debug, Clone, Copy)]
struct ClipPart {
    clip: usize,
    /// Start, seconds of the unit.
    start_s: f64,
    /// The played interval of the clip.
    in_s: f64,
    out_s: f64,
    /// Seconds of the clip per second.
    pace: f64,
    /// Duration of the blend out of the previous part, after `start_s`. A negative value is the
    /// missing time between the two parts.
    blend_s: f64,
    place: FloorMotion,
}

impl ClipPart {
    fn end_s(&self) -> f64 {
        self.start_s + (self.out_s - self.in_s) / self.pace
    }
}

/// How a clip follows another.
#[derive(Debug, Clone, Copy)]
enum Join {
    Blend { out_s: f64, in_s: f64, blend_s: f64 },
    Close { gap_s: f64 },
}

/// The motion of a unit's people as pure functions of time; times count from the unit's start.
#[derive(Debug)]
pub(super) struct Timeline {
    members: Vec<UnitMember>,
    parts: Vec<ClipPart>,
}

impl Timeline {
    /// Plays the members' clips in order, repeatedly, for `length_s`. At the start the pelvis of
    /// the first member is at `at_m` and faces `heading_rad`.
    pub(super) fn new(
        members: Vec<UnitMember>,
        at_m: Vector2<f64>,
        heading_rad: f64,
        blend_s: f64,
        length_s: f64,
    ) -> Self {
        let mut timeline = Self {
            members,
            parts: Vec::new(),
        };
        let (pelvis_m, facing) = timeline.members[0].stand(&timeline.members[0].posture(0, 0.0));
        let yaw_rad = heading_rad - facing;
        timeline.parts.push(ClipPart {
            clip: 0,
            start_s: 0.0,
            in_s: 0.0,
            out_s: timeline.length_s(0),
            pace: 1.0,
            blend_s: 0.0,
            place: FloorMotion {
                yaw_rad,
                shift_m: at_m - turned(pelvis_m, yaw_rad),
            },
        });
        let n_clips = timeline.members[0].clips.len();
        let mut joins = BTreeMap::new();
        while let Some(last) = timeline.parts.last_mut()
            && last.end_s() < length_s
        {
            let share = (last.end_s() - last.start_s) / (length_s - last.start_s);
            if share > 1.0 - SLOWER {
                last.pace = share;
                break;
            }
            let last = *last;
            let next = (last.clip + 1) % n_clips;
            let join = *joins
                .entry((last.clip, next))
                .or_insert_with(|| timeline.join(last.clip, next, blend_s));
            timeline.follow(next, join);
        }
        timeline
    }

    /// The joints of `member` at `time_s`, metres.
    pub(super) fn joints_m(&self, member: usize, time_s: f64) -> Joints {
        let played = &self.members[member];
        self.posture(member, time_s).scaled(played.stature_m)
    }

    /// Heading of `member` at `time_s`, radians.
    pub(super) fn facing_rad(&self, member: usize, time_s: f64) -> f64 {
        self.posture(member, time_s).facing_rad()
    }

    /// Positions of the members' pelvises on the floor at `time_s`, metres.
    pub(super) fn pelvises_m(&self, time_s: f64) -> Vec<Vector2<f64>> {
        let pelvis = |(i, m): (usize, &UnitMember)| m.stand(&self.posture(i, time_s)).0;
        self.members.iter().enumerate().map(pelvis).collect()
    }

    /// Shortest duration of clip `clip` among the members.
    fn length_s(&self, clip: usize) -> f64 {
        let lengths = self.members.iter().map(|m| m.clips[clip].duration_s());
        // A clip of one frame is a still posture; it needs some length to be repeated.
        lengths.fold(f64::MAX, f64::min).max(TRIM_STEP_S)
    }

    fn posture(&self, member: usize, time_s: f64) -> Posture {
        let next = self.parts.partition_point(|part| part.start_s <= time_s);
        let index = next.saturating_sub(1);
        let part = &self.parts[index];
        let posture = self.placed(member, part, time_s);
        let into_s = time_s - part.start_s;
        if into_s < part.blend_s && index > 0 {
            let before = self.placed(member, &self.parts[index - 1], time_s);
            return blended(&before, &posture, smooth_step(into_s / part.blend_s));
        }
        match self.parts.get(next) {
            // Between the end of a closed clip and its start: the step that the file omits.
            Some(after) if time_s > part.end_s() => {
                let share = (time_s - part.end_s()) / (after.start_s - part.end_s());
                posture.blend(&self.placed(member, after, after.start_s), share)
            }
            _ => posture,
        }
    }

    fn placed(&self, member: usize, part: &ClipPart, time_s: f64) -> Posture {
        let played = &self.members[member];
        let local_s =
            (part.in_s + (time_s - part.start_s) * part.pace).clamp(part.in_s, part.out_s);
        played.moved(&played.posture(part.clip, local_s), &part.place)
    }

    fn follow(&mut self, next: usize, join: Join) {
        let Some(last) = self.parts.last_mut() else {
            return;
        };
        let (blend_s, in_s, meet_s) = match join {
            Join::Blend {
                out_s,
                in_s,
                blend_s,
            } => {
                last.out_s = out_s;
                (blend_s, in_s, last.end_s() - blend_s / 2.0)
            }
            Join::Close { gap_s } => (-gap_s, 0.0, last.end_s()),
        };
        let (last, lead_s) = (*last, blend_s.max(0.0) / 2.0);
        let start_s = last.end_s() - blend_s;
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for (index, played) in self.members.iter().enumerate() {
            let (mut pelvis_m, facing) = played.stand(&self.placed(index, &last, meet_s));
            if let Join::Close { gap_s } = join {
                let before = played.stand(&self.placed(index, &last, meet_s - PACE_S)).0;
                pelvis_m += (pelvis_m - before) * (gap_s / PACE_S);
            }
            from.push((pelvis_m, facing));
            to.push(played.stand(&played.posture(next, in_s + lead_s)));
        }
        self.parts.push(ClipPart {
            clip: next,
            start_s,
            in_s,
            out_s: self.length_s(next),
            pace: 1.0,
            blend_s,
            place: align(&to, &from),
        });
    }

    /// The best transition from clip `a` to clip `b`.
    fn join(&self, a: usize, b: usize, blend_s: f64) -> Join {
        if let Some(gap_s) = self.gap_s(a, b) {
            return Join::Close { gap_s };
        }
        let most_s = (SHARE * self.length_s(a).min(self.length_s(b))).max(1e-3);
        let blend_s = blend_s.clamp(1e-3, most_s);
        let (out_s, in_s, apart_m) = self.best_cut(a, b, blend_s);
        let calm_s = (STEEPEST * apart_m / MAX_BLEND_M_S).min(most_s);
        if calm_s <= blend_s {
            return Join::Blend {
                out_s,
                in_s,
                blend_s,
            };
        }
        let (out_s, in_s, _) = self.best_cut(a, b, calm_s);
        Join::Blend {
            out_s,
            in_s,
            blend_s: calm_s,
        }
    }

    /// Where to leave clip `a` and enter `b` for a blend of `blend_s`, seconds, and the joint
    /// distance in the middle of the blend, metres.
    fn best_cut(&self, a: usize, b: usize, blend_s: f64) -> (f64, f64, f64) {
        let (a_s, b_s) = (self.length_s(a), self.length_s(b));
        let trims = |length_s: f64| {
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a few steps"
            )]
            let n = ((SHARE * length_s).min(TRIM_S) / TRIM_STEP_S) as u32;
            (0..=n).map(|i| f64::from(i) * TRIM_STEP_S)
        };
        let half_s = blend_s / 2.0;
        let mut best = (f64::MAX, 0.0, 0.0);
        for trim_a in trims(a_s) {
            for trim_b in trims(b_s) {
                let (out, into) = ((a, a_s - trim_a - half_s), (b, trim_b + half_s));
                let cost_m = self.difference_m(out, into) + TRIM_COST_M_S * (trim_a + trim_b);
                if cost_m < best.0 {
                    best = (cost_m, trim_a, trim_b);
                }
            }
        }
        let (_, trim_a, trim_b) = best;
        let apart_m = self.place_difference_m((a, a_s - trim_a - half_s), (b, trim_b + half_s));
        (a_s - trim_a, trim_b, apart_m)
    }

    /// The time between the last and the first posture of the same clip, if it is closed.
    fn gap_s(&self, a: usize, b: usize) -> Option<f64> {
        let same = |m: &UnitMember| Arc::ptr_eq(&m.clips[a], &m.clips[b]);
        let length_s = self.length_s(a);
        if !self.members.iter().all(same) || length_s < 4.0 * PACE_S {
            return None;
        }
        let apart_m = self.place_difference_m((a, length_s), (a, 0.0));
        let pace_m = self.place_difference_m((a, 0.0), (a, PACE_S))
            + self.place_difference_m((a, length_s - PACE_S), (a, length_s));
        let gap_s = apart_m / (pace_m / (2.0 * PACE_S)).max(1e-3);
        (gap_s <= LONGEST_GAP_S).then_some(gap_s)
    }

    /// The difference of two moments (clip, seconds) in posture and pace: mean joint distance,
    /// metres.
    fn difference_m(&self, a: (usize, f64), b: (usize, f64)) -> f64 {
        let half_s = PACE_S / 2.0;
        let at =
            |offset_s: f64| self.place_difference_m((a.0, a.1 + offset_s), (b.0, b.1 + offset_s));
        // Compares both ends of a short interval: equal postures with opposite paces differ there.
        at(-2.0 * half_s) + at(2.0 * half_s)
    }

    fn place_difference_m(&self, a: (usize, f64), b: (usize, f64)) -> f64 {
        let postures = |(clip, time_s): (usize, f64)| -> Vec<Posture> {
            self.members
                .iter()
                .map(|m| m.posture(clip, time_s))
                .collect()
        };
        let (of_a, of_b) = (postures(a), postures(b));
        let stands = |postures: &[Posture]| -> Vec<_> {
            let pairs = self.members.iter().zip(postures);
            pairs.map(|(m, posture)| m.stand(posture)).collect()
        };
        let place = align(&stands(&of_b), &stands(&of_a));
        let mut sum_m = 0.0;
        for ((played, a), b) in self.members.iter().zip(&of_a).zip(&of_b) {
            let b = played.moved(b, &place);
            let apart = a.joints.iter().zip(&b.joints).map(|(a, b)| (a - b).norm());
            sum_m += played.stature_m * apart.sum::<f64>() / N_JOINTS as f64;
        }
        sum_m / self.members.len() as f64
    }
}

/// `a` blended into `b`, neither sunk into the floor nor lifted off it. Without the correction,
/// legs that unfold between standing and crawling would pass through the floor.
fn blended(a: &Posture, b: &Posture, share: f64) -> Posture {
    let between = a.blend(b, share);
    let wanted = (1.0 - share) * lowest(a) + share * lowest(b);
    let lift = wanted - lowest(&between);
    between.moved(0.0, Vector3::new(0.0, 0.0, lift))
}

/// Height of the lowest joints, statures: a smooth minimum.
fn lowest(posture: &Posture) -> f64 {
    let heights = posture.joints.iter().map(|joint| joint.z);
    let least = heights.clone().fold(f64::MAX, f64::min);
    let sum: f64 = heights.map(|z| ((least - z) / LOWEST_SOFTNESS).exp()).sum();
    least - LOWEST_SOFTNESS * sum.ln()
}

/// The motion that maps places and headings `from` closest to `to` (least squares).
fn align(from: &[(Vector2<f64>, f64)], to: &[(Vector2<f64>, f64)]) -> FloorMotion {
    let points = |stands: &[(Vector2<f64>, f64)]| -> Vec<Vector2<f64>> {
        let arrow = |(at, facing): &(Vector2<f64>, f64)| {
            [*at, at + ARROW_M * Vector2::new(facing.cos(), facing.sin())]
        };
        stands.iter().flat_map(arrow).collect()
    };
    let (a, b) = (points(from), points(to));
    let mean = |stands: &[(Vector2<f64>, f64)]| {
        stands.iter().map(|s| s.0).sum::<Vector2<f64>>() / stands.len() as f64
    };
    // The arrows only affect the turn; positions are matched without them.
    let (mean_a, mean_b) = (mean(from), mean(to));
    let (mut cos, mut sin) = (0.0, 0.0);
    for (p, q) in a.iter().zip(&b) {
        let (p, q) = (p - mean_a, q - mean_b);
        cos += p.dot(&q);
        sin += p.perp(&q);
    }
    let yaw_rad = sin.atan2(cos);
    FloorMotion {
        yaw_rad,
        shift_m: mean_b - turned(mean_a, yaw_rad),
    }
}

/// `v` turned by `yaw_rad`.
pub(super) fn turned(v: Vector2<f64>, yaw_rad: f64) -> Vector2<f64> {
    let (sin, cos) = yaw_rad.sin_cos();
    Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
}

/// From 0 to 1 with zero slope and curvature at both ends.
pub(super) fn smooth_step(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (x * (6.0 * x - 15.0) + 10.0)
}
