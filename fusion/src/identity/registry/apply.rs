//! What events do to tracks, and to what is remembered.

use farfield_proto::id::PersonId;
use farfield_proto::message::PersonPose;
use farfield_proto::message::identity_event::DropReason;
use farfield_proto::tick::Tick;

use super::Registry;
use crate::identity::event::{Event, EventKind};
use crate::identity::memory::Departed;
use crate::identity::track::Track;
use crate::method::Method;

impl Registry {
    /// Applies events of tracks, in order, and says them.
    pub(super) fn apply(&mut self, events: &[Event], tick: Tick, method: &Method) {
        for event in events {
            let Some(index) = self.position(event.wire_id) else {
                continue;
            };
            self.say(self.tracks[index].id(), event);
            let track = &mut self.tracks[index];
            track.identity.phase = track.identity.phase.after(&event.kind, tick);
            match event.kind {
                EventKind::Drop { reason } => self.drop_track(index, reason, tick),
                EventKind::StepBack { ticks, .. } => track.step_back(ticks, method),
                _ => {}
            }
        }
    }

    /// Says an event of `person`.
    pub(super) fn say(&mut self, person: PersonId, event: &Event) {
        let dt_s = self.rules.dt_s();
        self.events
            .extend(event.kind.told(person, event.wire_id, dt_s));
    }

    /// Where the track of `wire_id` stands.
    pub(super) fn position(&self, wire_id: PersonId) -> Option<usize> {
        let mut tracks = self.tracks.iter();
        tracks.position(|track| track.wire_id() == wire_id)
    }

    /// Lets the track at `index` go, and remembers who was published; and where a poster hangs.
    fn drop_track(&mut self, index: usize, reason: DropReason, tick: Tick) {
        let track = self.tracks.remove(index);
        let is_replaced = matches!(reason, DropReason::FoundElsewhere | DropReason::GivenByHand);
        if !track.is_tentative()
            && !is_replaced
            && let Some(departed) = track.departed(self.rules.rate_hz)
        {
            self.memory.remember(departed);
        }
        if matches!(reason, DropReason::Poster { .. }) {
            self.posters.add(track.estimator.keypoints_m(), tick);
        }
    }

    /// Gives who has just been confirmed its body, its older self's where it was `recognised`; returns the
    /// poses of its tentative ticks.
    pub(super) fn confirm(
        &mut self,
        wire_id: PersonId,
        recognised: Option<&Event>,
        method: &Method,
    ) -> Vec<(Tick, PersonPose)> {
        let known = recognised.and_then(|event| match event.kind {
            EventKind::Recognise { old, .. } => Some((event, self.take_known(old)?)),
            _ => None,
        });
        let Some(index) = self.position(wire_id) else {
            return Vec::new();
        };
        if let Some((event, known)) = &known {
            self.say(self.tracks[index].id(), event);
            self.tracks[index].becomes(known, self.rules.rate_hz);
        }
        let known = known.as_ref().map(|(_, known)| known);
        self.tracks[index].solve_again(known, method)
    }

    /// What is known of `id`, who is gone or lost. The memory forgets it.
    fn take_known(&mut self, id: PersonId) -> Option<Departed> {
        let gone = self.memory.take(id);
        gone.or_else(|| {
            let mut tracks = self.tracks.iter();
            let is_it = |track: &&Track| track.identity.phase.is_lost() && track.id() == id;
            tracks.find(is_it)?.departed(self.rules.rate_hz)
        })
    }
}

impl Track {
    /// Gives back what was seen of somebody else in the last `ticks`: goes back to where it was when nobody
    /// else was near, and waits there, as unsure as if it had not been seen since.
    pub(crate) fn step_back(&mut self, ticks: u32, method: &Method) {
        let identity = &mut self.identity;
        let Some(alone) = identity.alone else {
            return;
        };
        identity.coverage.withdraw(ticks);
        identity.changed.mistaken_since = Some(alone.tick);
        let ago_s = f64::from(ticks) * method.dt_s;
        self.estimator
            .go_back_to(&alone.restart_point, ago_s, method);
    }
}
