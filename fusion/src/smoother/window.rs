//! One person inside the delay: the measurements of each tick, and its joints through time.
//!
//! A measurement is the pose of the first inverse kinematics, with each joint's variance from the
//! views of its tick. A tick without evidence is no measurement if a later one has evidence: the
//! joints then move smoothly from here to there. Without later evidence inside the delay, the pose
//! of the track is used.

use std::collections::VecDeque;

use farfield_proto::id::PersonId;
use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;

use super::late::{Late, LateBody, LateSearch};
use super::line::{JointLine, KnownPoint, Measure, PointState};
use super::solve::{Aims, Solver};
use crate::body::skeleton::{Joint, N_JOINTS};
use crate::estimate::estimator::TickSnapshot;
use crate::identity::track::Track;
use crate::method::Method;

/// Spectral density of the jerk of a joint at rest, m²/s⁵: of the trunk and head, and of limbs.
/// Like the next one, chosen on the project's scenes at a delay of 100 ms: the error is flat over a
/// factor of ten.
const TRUNK_JERK: f64 = 3e3;
const LIMB_JERK: f64 = 1e4;
/// Speed at which the density is twice that at rest, metres per second; it grows with the square.
const JERK_SPEED_M_S: f64 = 1.0;
/// Initial standard deviations of a joint's place (m), velocity (m/s) and acceleration (m/s²).
const AT_FIRST: [f64; 3] = [0.3, 5.0, 30.0];
/// Standard deviation per axis below which a joint counts as seen, metres.
const SEEN_M: f64 = 0.06;

/// One person inside the delay.
pub(super) struct Window {
    /// The track's id on the edges, which never changes.
    pub(super) wire_id: PersonId,
    pub(super) is_confirmed: bool,
    /// Whether its track exists.
    pub(super) is_here: bool,
    /// In order, one per tick.
    pub(super) moments: VecDeque<TickSnapshot>,
    /// Snapshots whose poses are done.
    pub(super) done: Vec<TickSnapshot>,
    poses: VecDeque<(Tick, PersonPose)>,
    /// Per joint, the state at the tick before the first snapshot; empty before the first tick of a
    /// life.
    before: Vec<PointState>,
    /// The tick before the first snapshot.
    last: Option<Tick>,
    /// Per joint, the variance when it was last seen, per axis, m².
    seen_m2: [Option<f64>; N_JOINTS],
    solver: Solver,
    line: JointLine,
    measures: Vec<Measure>,
    known: Vec<KnownPoint>,
    aims: Vec<Aims>,
}

impl Window {
    pub(super) fn new(track: &Track, method: &Method) -> Self {
        Self {
            wire_id: track.wire_id(),
            is_confirmed: false,
            is_here: true,
            moments: VecDeque::new(),
            done: Vec::new(),
            poses: VecDeque::new(),
            before: Vec::with_capacity(N_JOINTS),
            last: None,
            seen_m2: [None; N_JOINTS],
            solver: Solver::new(track, method),
            line: JointLine::default(),
            measures: Vec::new(),
            known: Vec::new(),
            aims: Vec::new(),
        }
    }

    /// Adds the newest tick, and its changes to earlier ticks.
    pub(super) fn add_tick(&mut self, track: &Track, moment: TickSnapshot) {
        self.is_here = true;
        self.is_confirmed = !track.is_tentative();
        self.solver.set_body(track);
        let tick = moment.tick;
        self.moments.push_back(moment);
        for solved in track
            .solved_again()
            .iter()
            .filter(|snapshot| snapshot.tick < tick)
        {
            let at = (self.moments).binary_search_by_key(&solved.tick, |moment| moment.tick);
            if let Ok(at) = at {
                self.moments[at].clone_from(solved);
            }
        }
        if let Some(apart) = track.mistaken_since() {
            self.discard_after(apart);
        }
    }

    /// Discards the evidence after `tick`, which belonged to another person: the person is assumed
    /// to have waited where the newest snapshot has it.
    fn discard_after(&mut self, tick: Tick) {
        let Some(back) = self.moments.back().cloned() else {
            return;
        };
        let mistaken = self.moments.iter_mut().filter(|moment| moment.tick > tick);
        mistaken.for_each(|moment| moment.withdraw(&back));
        if self.last.is_some_and(|last| last > tick) {
            self.before.clear();
        }
    }

    /// Adds a late patch to the snapshot of its tick; returns whether it was useful.
    pub(super) fn add_late(
        &mut self,
        late: &Late<'_>,
        search: &mut LateSearch,
        method: &Method,
    ) -> bool {
        let at = (self.moments).binary_search_by_key(&late.tick, |moment| moment.tick);
        let Ok(at) = at else { return false };
        let before = at.checked_sub(1).unwrap_or(at);
        let (skeleton, sites) = self.solver.body();
        let body = LateBody {
            skeleton,
            sites,
            before: self.moments[before].pose,
        };
        search.add(late, &body, &mut self.moments[at], method)
    }

    /// Solves all snapshots up to `tick`.
    pub(super) fn release(&mut self, tick: Tick, method: &Method) {
        let n = self.moments.partition_point(|moment| moment.tick <= tick);
        if n == 0 {
            return;
        }
        self.smooth(n, method);
        for aims in &self.aims {
            let Some(moment) = self.moments.pop_front() else {
                break;
            };
            self.last = Some(moment.tick);
            if self.is_confirmed {
                let pose = self.solver.solve(&moment, aims, method);
                self.poses.push_back((moment.tick, pose));
            }
            self.done.push(moment);
        }
    }

    /// The pose of `tick`, the oldest that was not returned.
    pub(super) fn take(&mut self, tick: Tick) -> Option<PersonPose> {
        let is_due = self.poses.front().is_some_and(|(at, _)| *at == tick);
        let due = if is_due { self.poses.pop_front() } else { None };
        due.map(|(_, pose)| pose)
    }

    /// Fills `aims` for the first `n` snapshots.
    fn smooth(&mut self, n: usize, method: &Method) {
        if self.before.is_empty() {
            let places_m = self.moments[0].joints_m.iter();
            self.before
                .extend(places_m.map(|place_m| PointState::near(*place_m, AT_FIRST)));
        }
        self.aims.clear();
        self.aims.resize(n, Aims::default());
        for joint in Joint::ALL {
            let i = joint.index();
            self.measure(joint, method.dt_s);
            self.line
                .smooth(&self.before[i], &self.measures, &mut self.known);
            for k in 0..n.min(self.known.len()) {
                let known = self.known[k];
                let variance_m2 = self.variance_m2(k, i, known.variance_m2);
                self.aims[k].place_m[i] = known.place_m;
                self.aims[k].velocity_m_s[i] = known.velocity_m_s;
                self.aims[k].variance_m2[i] = variance_m2;
            }
            if let Some(after) = self.line.after(n - 1) {
                self.before[i] = after;
            }
        }
    }

    /// Fills `measures` with the measurements of `joint`.
    fn measure(&mut self, joint: Joint, dt_s: f64) {
        let i = joint.index();
        let jerk = if is_of_limb(joint) {
            LIMB_JERK
        } else {
            TRUNK_JERK
        };
        let is_measured = |moment: &TickSnapshot| moment.variance_m2[i].is_finite();
        let n_closed = self.moments.iter().rposition(is_measured);
        let mut last = self.last;
        self.measures.clear();
        for (k, moment) in self.moments.iter().enumerate() {
            let ticks = last.map_or(1, |last| moment.tick - last);
            last = Some(moment.tick);
            let is_open = n_closed.is_none_or(|closed| k > closed);
            let (place_m, variance_m2) = if is_open {
                let published_m2 = moment.published_m2.map(|m2| m2[i]);
                (moment.joints_m[i], published_m2.unwrap_or(f64::INFINITY))
            } else {
                (moment.measured_m[i], moment.variance_m2[i])
            };
            let haste = moment.velocity_m_s[i].norm() / JERK_SPEED_M_S;
            self.measures.push(Measure {
                place_m,
                variance_m2,
                since_s: ticks as f64 * dt_s,
                jerk: jerk * (1.0 + haste * haste),
            });
        }
    }

    /// Variance of joint `i` at snapshot `k`, per axis, m²: that of the track; in a closed gap, at
    /// most that of the last view plus that of the way across (`across_m2`).
    fn variance_m2(&mut self, k: usize, i: usize, across_m2: f64) -> Option<f64> {
        let published_m2 = self.moments[k].published_m2?[i];
        let is_seen = |moment: &TickSnapshot| moment.variance_m2[i] < SEEN_M * SEEN_M;
        if is_seen(&self.moments[k]) {
            self.seen_m2[i] = Some(published_m2);
            return Some(published_m2);
        }
        let is_closed = self.moments.iter().skip(k + 1).any(is_seen);
        let held_m2 = self.seen_m2[i].filter(|_| is_closed);
        Some(held_m2.map_or(published_m2, |held_m2| {
            published_m2.min(held_m2 + across_m2)
        }))
    }
}

/// Whether `joint` is at or beyond an elbow or a knee.
fn is_of_limb(joint: Joint) -> bool {
    std::iter::successors(Some(joint), |joint| joint.parent()).any(|joint| {
        matches!(
            joint,
            Joint::LeftElbow | Joint::RightElbow | Joint::LeftKnee | Joint::RightKnee
        )
    })
}
