//! What events do to tracks, and to what is remembered: the one door to who is who.
//!
//! Every event passes [`Registry::begin_track`], who begins a track, or [`Registry::apply`]. Both change the
//! phase, and publish the event.
//!
//! What no event holds is done beside it by who applies it, in `sighted`: a body that was fitted to sightings
//! or to keypoints given by hand comes with the track that begins, and moves a track that is initiated anew
//! right after its event. The pose of somebody revived is found before: where the known body cannot take one,
//! nobody is revived, and there is no event.

use farfield_proto::id::PersonId;
use farfield_proto::message::MAX_PERSONS;
use farfield_proto::message::identity_event::{DropReason, MAX_EVENTS};
use farfield_proto::tick::Tick;

use super::Registry;
use crate::body::fit::Fitted;
use crate::identity::event::{Event, EventKind};
use crate::identity::memory::Departed;
use crate::identity::phase::{Coverage, Phase};
use crate::identity::track::Track;
use crate::method::Method;

impl Registry {
    /// Begins the track of somebody who was not here, with the event `kind`, and publishes it; `None` where that
    /// event begins nothing.
    pub(super) fn begin_track(
        &mut self,
        kind: EventKind,
        body: Fitted,
        tick: Tick,
        method: &Method,
    ) -> Option<&mut Track> {
        let phase = Phase::after(None, &kind, tick)?;
        let wire_id = self.new_id();
        self.publish(wire_id, &Event { wire_id, kind });
        let body = (body.skeleton, body.pose);
        let mut track = Track::new(wire_id, phase, body, method);
        if let EventKind::Initiate { awaited_ticks, .. } = kind {
            track.identity.coverage = Coverage::sighted(awaited_ticks);
        }
        self.tracks.push(track);
        self.tracks.last_mut()
    }

    /// Applies events of tracks, in order, and publishes them.
    pub(super) fn apply(&mut self, events: &[Event], tick: Tick, method: &Method) {
        for event in events {
            let Some(index) = self.position(event.wire_id) else {
                continue;
            };
            self.publish(self.tracks[index].id(), event);
            let identity = &mut self.tracks[index].identity;
            if let Some(phase) = Phase::after(Some(identity.phase), &event.kind, tick) {
                identity.phase = phase;
            }
            match event.kind {
                EventKind::Drop { reason } => self.drop_track(index, reason, tick),
                EventKind::Reinitiate { awaited_ticks, .. } => {
                    identity.coverage = Coverage::sighted(awaited_ticks);
                }
                EventKind::Revive { .. } => identity.coverage.revive(),
                EventKind::Recognise { old, .. } => self.recognise(index, old, tick),
                EventKind::StepBack { ticks, .. } => self.tracks[index].step_back(ticks, method),
                _ => {}
            }
        }
    }

    /// Publishes an event of `person`, with the tick; past [`MAX_EVENTS`] of one tick it is left out, because
    /// everybody would refuse the message.
    ///
    /// Only a venue file comes near that, which gives more than a thousand persons by hand at one tick: a track
    /// begins, lives on, is recognised, steps back, is sighted and is let go at most once a tick.
    pub(super) fn publish(&mut self, person: PersonId, event: &Event) {
        const { assert!(6 * MAX_PERSONS < MAX_EVENTS) }
        if self.events.len() == MAX_EVENTS {
            return;
        }
        let dt_s = self.rules.dt_s();
        self.events
            .extend(event.kind.as_message(person, event.wire_id, dt_s));
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
            && let Some(mut departed) = track.departed(tick, self.rules.rate_hz)
        {
            departed.is_missed = matches!(reason, DropReason::Unseen { .. });
            self.memory.remember(departed);
        }
        if matches!(reason, DropReason::Poster { .. }) {
            self.posters.add(track.estimator.keypoints_m(), tick);
        }
    }

    /// Gives the track at `index` its older self's id and body.
    fn recognise(&mut self, index: usize, old: PersonId, tick: Tick) {
        if let Some(known) = self.take_known(old, tick) {
            self.tracks[index].becomes(known, self.rules.rate_hz);
        }
    }

    /// What is known of `id`, who is gone or lost. The memory forgets it.
    fn take_known(&mut self, id: PersonId, tick: Tick) -> Option<Departed> {
        let gone = self.memory.take(id);
        gone.or_else(|| {
            let mut tracks = self.tracks.iter();
            let is_it = |track: &&Track| self.may_be_elsewhere(track) && track.id() == id;
            tracks.find(is_it)?.departed(tick, self.rules.rate_hz)
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
