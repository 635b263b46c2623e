//! Applies events to tracks and to the memory: the only place that changes identities.
//!
//! Every event passes [`Registry::begin_track`], which begins a track, or [`Registry::apply`]. Both
//! change the phase, and publish the event.
//!
//! An event carries no body. The caller in `sighted` handles bodies: a body that was fitted to
//! sightings or to given keypoints comes with a new track. It moves a reinitiated track right after
//! the event. The pose of a revived person is solved before: if the known body cannot take one,
//! there is no event.

use farfield_proto::id::PersonId;
use farfield_proto::message::MAX_PERSONS;
use farfield_proto::message::identity_event::{DropReason, MAX_EVENTS};
use farfield_proto::tick::Tick;

use super::Registry;
use crate::body::fit::Fitted;
use crate::identity::event::{Event, EventKind};
use crate::identity::known::Departed;
use crate::identity::phase::{Coverage, Phase};
use crate::identity::track::Track;
use crate::method::Method;

impl Registry {
    /// Begins a new track with the event `kind`, and publishes it; `None` if that event begins no
    /// track.
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

    /// Publishes an event of `person` with the tick. It is left out past [`MAX_EVENTS`] of one
    /// tick, because all receivers would refuse the message.
    ///
    /// Only a venue file that gives more than a thousand persons by hand at one tick comes near
    /// that. A track begins, changes phase, is recognised, steps back, is sighted and is dropped at
    /// most once a tick.
    pub(super) fn publish(&mut self, person: PersonId, event: &Event) {
        const { assert!(6 * MAX_PERSONS < MAX_EVENTS) }
        if self.events.len() == MAX_EVENTS {
            return;
        }
        let dt_s = self.rules.dt_s();
        self.events
            .extend(event.kind.as_message(person, event.wire_id, dt_s));
    }

    /// Index of the track of `wire_id`.
    pub(super) fn position(&self, wire_id: PersonId) -> Option<usize> {
        let mut tracks = self.tracks.iter();
        tracks.position(|track| track.wire_id() == wire_id)
    }

    /// Drops the track at `index`. Remembers the person if it was published, and the place of a
    /// poster.
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

    /// Gives the track at `index` the id and the body of its earlier life.
    fn recognise(&mut self, index: usize, old: PersonId, tick: Tick) {
        if let Some(known) = self.take_known(old, tick) {
            self.tracks[index].take_identity_of(known, self.rules.rate_hz);
        }
    }

    /// Takes the data of `id`, a person who left or is lost, out of the memory.
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
    /// Discards the evidence of the last `ticks`, which belonged to another person. The person goes
    /// back to where it last stood alone, as uncertain as if it had not been seen since.
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
