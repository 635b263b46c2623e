//! The smoothed output: poses estimated with later evidence.
//!
//! ```text
//!   tracks of a tick -> snapshots of each person, stored for the delay (window)
//!     -> per joint: forward and back through time (line) -> inverse kinematics in the range of motion (solve)
//!     -> the pose set of the tick at the end of the delay
//! ```
//!
//! Identities are those known at the end of the delay. A person confirmed since then has its first
//! ticks that are still inside the delay, with its newest lengths (all of them in two passes; a
//! delay shorter than a confirmation begins later). Evidence that belonged to another person is
//! discarded. A person lost for less than the delay is interpolated from where it was last seen to
//! where it was seen again. The live output does not change: there is no feedback.
//!
//! A delay is a number of ticks. For the *two passes* over a recording it is at least two seconds,
//! far longer than the memory of a joint, so the poses equal those of a smoother over the whole
//! recording, with bounded memory.

mod late;
mod line;
mod solve;
mod window;

use std::collections::VecDeque;

use farfield_proto::id::SessionId;
use farfield_proto::message::{PatchSet, PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;
use rayon::prelude::*;

use self::late::{Late, LateSearch};
use self::window::Window;
use crate::estimate::estimator::TickSnapshot;
use crate::identity::track::Track;
use crate::method::{Method, VenueView};

/// Delay of the two passes over a recording, and the time that is solved at once, seconds.
const TWO_PASSES_S: f64 = 2.0;

/// How long poses wait for later evidence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Delay {
    /// Least ticks that a pose waits.
    lag: usize,
    /// How many ticks are solved together.
    together: usize,
    /// Whether ticks wait until all people in them are decided.
    is_patient: bool,
}

impl Delay {
    /// A delay of `delay_ms` milliseconds at `rate_hz`, rounded to ticks; `None` if that is zero.
    pub fn of_ms(delay_ms: f64, rate_hz: f64) -> Option<Self> {
        let lag = (delay_ms * 1e-3 * rate_hz).round() as usize;
        (lag > 0).then_some(Self {
            lag,
            together: 1,
            is_patient: false,
        })
    }

    /// The two passes over a recording at `rate_hz`.
    pub fn two_passes(rate_hz: f64) -> Self {
        let ticks = (TWO_PASSES_S * rate_hz).round().max(1.0) as usize;
        Self {
            lag: ticks,
            together: ticks,
            is_patient: true,
        }
    }
}

/// All people inside the delay. In steady state a tick allocates only the poses that it returns.
pub struct FixedLagSmoother {
    session: SessionId,
    delay: Delay,
    /// Stepped ticks whose poses are not returned yet.
    ticks: VecDeque<Tick>,
    windows: Vec<Window>,
    /// Snapshots for reuse.
    spare: Vec<TickSnapshot>,
    late: LateSearch,
}

impl FixedLagSmoother {
    /// A smoother without people.
    pub fn new(session: SessionId, delay: Delay, method: &Method) -> Self {
        Self {
            session,
            delay,
            ticks: VecDeque::new(),
            windows: Vec::new(),
            spare: Vec::new(),
            late: LateSearch::new(method),
        }
    }

    /// Adds `tick` with the resulting `tracks`; returns the ticks that are final now, in order.
    /// `undecided` is the first tick of the oldest tentative person.
    pub fn step(
        &mut self,
        tick: Tick,
        tracks: &[Track],
        undecided: Option<Tick>,
        method: &Method,
    ) -> Vec<PoseSet> {
        self.ticks.push_back(tick);
        self.add_tick(tick, tracks, method);
        let Delay {
            lag,
            together,
            is_patient,
        } = self.delay;
        if self.ticks.len() < lag + together {
            return Vec::new();
        }
        let is_decided = |tick: &&Tick| !is_patient || undecided.is_none_or(|first| **tick < first);
        let ready = self.ticks.iter().take(self.ticks.len() - lag);
        let n = ready.take_while(is_decided).count();
        self.release(n, method)
    }

    /// Adds a set that came after its tick was stepped; returns for how many persons' poses it is
    /// useful. It is not if its tick is outside the delay, its person or camera is unknown, or it
    /// cannot be read.
    pub fn add_late(&mut self, set: &PatchSet, cameras: &[VenueView], method: &Method) -> u32 {
        let mut used = 0;
        for patch in &set.persons {
            let camera = cameras.get(usize::from(patch.camera.0));
            let own = camera.filter(|camera| camera.viewpoint == set.viewpoint);
            let window = (self.windows.iter_mut()).find(|window| window.wire_id == patch.person);
            if let (Some(camera), Some(window)) = (own, window) {
                let late = Late {
                    patch,
                    camera,
                    tick: set.tick,
                };
                used += u32::from(window.add_late(&late, &mut self.late, method));
            }
        }
        used
    }

    /// Ends the run: returns the ticks still inside the delay.
    pub fn finish(&mut self, method: &Method) -> Vec<PoseSet> {
        self.release(self.ticks.len(), method)
    }

    fn add_tick(&mut self, tick: Tick, tracks: &[Track], method: &Method) {
        for window in &mut self.windows {
            window.is_here = false;
        }
        for track in tracks {
            let mut moment = self.spare.pop().unwrap_or_default();
            track.write_snapshot(tick, &mut moment);
            let is_own = |window: &Window| window.wire_id == track.wire_id();
            let at = self.windows.iter().position(is_own).unwrap_or_else(|| {
                self.windows.push(Window::new(track, method));
                self.windows.len() - 1
            });
            self.windows[at].add_tick(track, moment);
        }
        self.forget();
    }

    /// Forgets people who left without confirmation, and people who left and are out of the delay.
    fn forget(&mut self) {
        let spare = &mut self.spare;
        self.windows.retain_mut(|window| {
            let stays = window.is_here || window.is_confirmed && !window.moments.is_empty();
            if !stays {
                spare.extend(window.moments.drain(..));
            }
            stays
        });
    }

    /// Solves the first `n` ticks of the delay.
    fn release(&mut self, n: usize, method: &Method) -> Vec<PoseSet> {
        let Some(&last) = n.checked_sub(1).and_then(|last| self.ticks.get(last)) else {
            return Vec::new();
        };
        match self.windows.as_mut_slice() {
            [] => {}
            [only] => only.release(last, method),
            windows => windows
                .par_iter_mut()
                .for_each(|window| window.release(last, method)),
        }
        let mut sets = Vec::with_capacity(n);
        for tick in self.ticks.drain(..n) {
            let mut persons = Vec::with_capacity(self.windows.len());
            for window in &mut self.windows {
                persons.extend(window.take(tick));
            }
            sets.push(PoseSet {
                session: self.session,
                tick,
                persons: one_each(persons),
            });
        }
        for window in &mut self.windows {
            self.spare.append(&mut window.done);
        }
        self.forget();
        sets
    }
}

/// Sorts by id. A person who came back inside the delay may appear twice: with a predicted and a
/// seen pose; the second is correct.
fn one_each(mut persons: Vec<PersonPose>) -> Vec<PersonPose> {
    persons.sort_by_key(|pose| (pose.person, pose.state == PersonState::Coasting));
    persons.dedup_by_key(|pose| pose.person);
    persons
}
