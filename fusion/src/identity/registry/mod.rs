//! All people in the venue: applies decisions, and publishes them.

mod apply;
mod naming;
mod reception;
mod sighted;
#[cfg(test)]
pub(super) mod tests;

use farfield_proto::id::{CameraIndex, PersonId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PersonPose;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::naming::Naming;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{GivenPerson, Venue};
use rayon::prelude::*;

use self::reception::Reception;
use super::decide::places::SharedPlaces;
use super::decide::recognition::Newcomer;
use super::decide::{lives, places, recognition};
use super::detection_scheduler::DetectionScheduler;
use super::event::{Event, EventKind};
use super::facts::{Rules, TrackFacts};
use super::known::{Candidate, KnownPeople, KnownPerson, Memory};
use super::poster::Posters;
use super::recognise::{Appearance, Lengths};
use super::shown::ShownPeople;
use super::subjects::Subjects;
use super::track::{Track, velocity_m_s};
use super::whereabouts::Whereabouts;
use crate::align::TickGroup;
use crate::body::fit::fit;
use crate::body::observed::ObservedJoints;
use crate::method::Method;
use crate::sightings::finder::PersonFinder;

/// Uncertainty per axis above which an unseen, carried person has no published pose, metres: half a
/// metre on the floor. Beyond that the next person may stand.
const CARRIED_OFF_M: f64 = 0.35;

/// Changes after a tick.
pub struct Outcome {
    /// The earlier ticks of the people who were confirmed at this tick.
    pub confirmed: Vec<(Tick, PersonPose)>,
    /// Identity events, in order.
    pub events: Vec<IdentityEvent>,
    /// Results of the comparison with the venue's subjects, by id.
    pub namings: Vec<Naming>,
    /// Sightings that were not used: wrong camera, or wrong number of keypoints.
    pub unusable_sightings: u32,
}

/// All persons, also tentative ones, in the order of their initiation.
pub struct Registry {
    tracks: Vec<Track>,
    next_id: u32,
    rules: Rules,
    finder: PersonFinder,
    given: Vec<GivenPerson>,
    scheduler: DetectionScheduler,
    shared_places: SharedPlaces,
    posters: Posters,
    memory: Memory,
    shown: ShownPeople,
    subjects: Subjects,
    viewpoint_of_camera: Vec<ViewpointIndex>,
    /// Which viewpoints send messages.
    reception: Reception,
    /// Whether any detection pass has shown a person yet.
    finds_people: bool,
    /// Events since the last result.
    events: Vec<IdentityEvent>,
    /// Namings since the last result.
    namings: Vec<Naming>,
    /// Buffer: facts of all tracks.
    facts: Vec<TrackFacts>,
}

impl Registry {
    /// An empty registry.
    pub fn new(venue: &Venue, keypoints: KeypointSet) -> Self {
        let births = venue.parameters.births.clone();
        let cameras: Vec<_> = venue
            .cameras
            .iter()
            .map(|camera| (camera.viewpoint, camera.model.clone()))
            .collect();
        Self {
            tracks: Vec::new(),
            next_id: 1,
            viewpoint_of_camera: cameras.iter().map(|camera| camera.0).collect(),
            scheduler: DetectionScheduler::new(
                cameras.clone(),
                venue.field,
                &births,
                venue.rate_hz,
            ),
            reception: Reception::new(cameras.clone(), venue.rate_hz),
            finder: PersonFinder::new(cameras, keypoints, &venue.field, &births),
            given: venue.given_persons.clone(),
            rules: Rules {
                births,
                field: venue.field,
                rate_hz: venue.rate_hz,
            },
            shared_places: SharedPlaces::default(),
            posters: Posters::default(),
            memory: Memory::default(),
            shown: ShownPeople::default(),
            subjects: Subjects::default(),
            finds_people: false,
            events: Vec::new(),
            namings: Vec::new(),
            facts: Vec::new(),
        }
    }

    /// Begins a run at `tick`.
    pub fn begin(&mut self, tick: Tick, method: &Method) {
        self.scheduler.begin(tick);
        self.take_in_given(tick, method);
    }

    /// Adds the people who were present in the previous run, before this one begins at `tick`: they
    /// may come back.
    pub fn expect(&mut self, known: &KnownPeople, tick: Tick, method: &Method) {
        self.next_id = self.next_id.max(known.next_id);
        let departed = known.people.iter();
        for departed in departed.filter_map(|person| person.departed(tick, &method.sites)) {
            self.memory.remember(departed);
        }
    }

    /// The people that a run after `tick` would expect.
    pub fn known_people(&self, tick: Tick) -> KnownPeople {
        let rate_hz = self.rules.rate_hz;
        let confirmed = self.tracks.iter().filter(|track| !track.is_tentative());
        let there = confirmed.filter_map(|track| track.departed(tick, rate_hz));
        let gone = self.memory.remembered().iter();
        let gone = gone.map(|departed| KnownPerson::from_departed(departed, false));
        KnownPeople {
            next_id: self.next_id,
            people: gone
                .chain(there.map(|departed| KnownPerson::from_departed(&departed, true)))
                .collect(),
        }
    }

    /// All tracks, in the order of their initiation.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// All tracks, in the order of their initiation.
    pub fn tracks_mut(&mut self) -> &mut [Track] {
        &mut self.tracks
    }

    /// Whether detectors find people in this venue. If no person was ever sighted, all are given by
    /// hand.
    pub fn finds_people(&self) -> bool {
        self.finds_people
    }

    /// The cameras among `own` that run the detector at `tick`, as far ahead as planned.
    pub fn detecting(&self, own: &[CameraIndex], tick: Tick) -> Vec<CameraIndex> {
        self.scheduler.detecting(own, tick)
    }

    /// Plans detection passes `ticks` ahead from now on, at least 1.
    pub fn plan_ahead(&mut self, ticks: i64) {
        self.scheduler.plan_ahead(ticks);
    }

    /// The poses of confirmed people, by id, without people who have been unseen for so long that
    /// they may be anywhere.
    pub fn published(&self) -> Vec<PersonPose> {
        let confirmed = self.tracks.iter().filter(|track| !track.is_tentative());
        let confirmed = confirmed.filter(|track| track.estimator.carried_off_m() < CARRIED_OFF_M);
        let mut poses: Vec<PersonPose> = confirmed.map(Track::published).collect();
        // A recognised person has an older id than its place.
        poses.sort_by_key(|pose| pose.person);
        poses
    }

    /// The first tick of the oldest person who is still tentative.
    pub fn undecided_from(&self) -> Option<Tick> {
        let tentative = self.tracks.iter().filter(|track| track.is_tentative());
        tentative
            .filter_map(|track| track.identity.tentative.ticks.first())
            .map(|first| first.tick)
            .min()
    }

    /// Advances all tracks by the tick that was just solved, in stages. Each uses the places after
    /// the previous stage was applied:
    ///
    /// 1. Evidence of the tick is counted for the rules.
    /// 2. Lives: tracks without evidence are dropped first, so that the next confirmed person can
    ///    be one of them. A confirmed person is recognised and solved again; only then is its place
    ///    known.
    /// 3. Places: people outside the field are dropped. A person who followed the evidence of
    ///    another steps back. This precedes the count of shared places, because it no longer stands
    ///    there. Then of two in one place the weaker is dropped.
    /// 4. The places where the remaining people were surely seen are recorded, and people who left
    ///    long ago are forgotten. Both determine which people a sighting can be.
    /// 5. Sightings that no track explains wait for their crops, are lost people, or are new.
    /// 6. People given by hand at the next tick replace the tracks that stand there.
    /// 7. Detection passes are planned: they depend on lost people and on sightings.
    pub fn step(&mut self, group: &TickGroup, method: &Method) -> Outcome {
        let tick = group.tick;
        self.reception.record(group);
        let adrift = self.tracks.iter().filter(|track| track.is_adrift());
        let missed = self.memory.missed(tick, self.rules.rate_hz);
        let wanted: Vec<PersonId> = adrift.map(Track::wire_id).chain(missed).collect();
        self.shown.see(group, &wanted, &self.finder, method);
        for track in &mut self.tracks {
            track.count(tick, method, |keypoints_m| {
                self.reception.showable(keypoints_m, tick)
            });
        }
        self.take_facts();
        let lives = lives::decide(&self.facts, tick, &self.rules);
        let mut confirmed = self.apply_lives(lives, tick, method);
        self.take_facts();
        let outside = places::outside_the_field(&self.facts, &self.rules);
        self.apply(&outside, tick, method);
        self.step_back(tick, method);
        self.take_facts();
        self.shared_places.count(&self.facts, &self.rules);
        let weaker = places::same_place(&self.facts, &self.shared_places, &self.rules);
        self.apply(&weaker, tick, method);
        self.record_last_seen(tick);
        let Rules {
            births, rate_hz, ..
        } = &self.rules;
        self.memory.forget(tick, births.return_s, *rate_hz);
        self.posters.forget(tick, *rate_hz);
        // The pose of the tick itself is among the poses of the tick. A person who is confirmed and
        // dropped at one tick is never published.
        let is_here = |id| self.tracks.iter().any(|track| track.id() == id);
        confirmed.retain(|(at, pose)| *at < tick && is_here(pose.person));
        let unusable_sightings = self.take_in_sighted(group, method);
        self.take_in_given(tick + 1, method);
        self.schedule(tick);
        Outcome {
            confirmed,
            events: std::mem::take(&mut self.events),
            namings: std::mem::take(&mut self.namings),
            unusable_sightings,
        }
    }

    /// Updates the facts of all tracks.
    fn take_facts(&mut self) {
        self.facts.clear();
        self.facts
            .extend(self.tracks.iter().map(TrackFacts::from_track));
    }

    /// Applies the events of [`lives`], drops first. Then recognises the confirmed people, and
    /// solves their tentative ticks again: returns those poses.
    fn apply_lives(
        &mut self,
        events: Vec<Event>,
        tick: Tick,
        method: &Method,
    ) -> Vec<(Tick, PersonPose)> {
        let (confirmations, others): (Vec<Event>, Vec<Event>) = events
            .into_iter()
            .partition(|event| matches!(event.kind, EventKind::Confirm { .. }));
        self.apply(&others, tick, method);
        self.remeasure(method);
        if confirmations.is_empty() {
            return Vec::new();
        }
        let confirmed: Vec<PersonId> = confirmations.iter().map(|event| event.wire_id).collect();
        let known = self.known(tick);
        let recognised = if known.is_empty() {
            Vec::new()
        } else {
            let newcomers = self.newcomers(&confirmed, method);
            recognition::decide(&newcomers, &known, &self.rules)
        };
        for event in &confirmations {
            self.apply(std::slice::from_ref(event), tick, method);
            let of = |other: &&Event| other.wire_id == event.wire_id;
            if let Some(recognised) = recognised.iter().find(of) {
                self.apply(std::slice::from_ref(recognised), tick, method);
            }
        }
        let poses = self.solve_again(&confirmed, method);
        self.take_facts();
        let elsewhere = recognition::found_elsewhere(&self.facts, &confirmed);
        self.apply(&elsewhere, tick, method);
        poses
    }

    /// Solves the tentative ticks of the `confirmed` (wire ids) again. People who arrive together
    /// are confirmed together, so one tick may have to solve them all.
    fn solve_again(&mut self, confirmed: &[PersonId], method: &Method) -> Vec<(Tick, PersonPose)> {
        let tracks = self.tracks.par_iter_mut();
        let own = tracks.filter(|track| confirmed.contains(&track.wire_id()));
        let solved: Vec<_> = own.map(|track| track.solve_again(method)).collect();
        solved.into_iter().flatten().collect()
    }

    /// The tentative people; `confirmed` (wire ids) will be confirmed at this tick.
    fn newcomers(&self, confirmed: &[PersonId], method: &Method) -> Vec<Newcomer> {
        let tentative = self.tracks.par_iter().filter(|track| track.is_tentative());
        let newcomer = |track: &Track| {
            let (appearance, since) = newcomer(track, method);
            let wire_id = track.wire_id();
            Newcomer {
                wire_id,
                appearance,
                since,
                is_confirmed: confirmed.contains(&wire_id),
            }
        };
        tentative.map(newcomer).collect()
    }

    /// People who left, and tracked people who may be elsewhere than carried.
    fn known(&self, tick: Tick) -> Vec<Candidate> {
        let lost = self
            .tracks
            .iter()
            .filter(|track| self.may_be_elsewhere(track));
        let rate_hz = self.rules.rate_hz;
        let lost = lost.filter_map(|track| track.candidate(rate_hz, &self.shown));
        let gone = self.memory.candidates(tick, rate_hz, &self.shown);
        gone.chain(lost).collect()
    }

    /// Whether `track` is lost, or was lost a short while ago and shares its place: then it follows
    /// the other person.
    fn may_be_elsewhere(&self, track: &Track) -> bool {
        let phase = track.identity.phase;
        phase.is_lost() || phase.is_suspect() && self.shared_places.includes(track.id())
    }

    /// Records who stands alone; people who followed the evidence of another step back.
    fn step_back(&mut self, tick: Tick, method: &Method) {
        self.take_facts();
        for (index, track) in self.tracks.iter_mut().enumerate() {
            if places::is_alone(&self.facts, index) {
                track.is_alone_at(tick);
            }
        }
        let back = places::step_back(&self.facts, tick, &self.rules);
        self.apply(&back, tick, method);
    }

    /// Records the places of people who are surely themselves.
    fn record_last_seen(&mut self, tick: Tick) {
        self.take_facts();
        for (index, track) in self.tracks.iter_mut().enumerate() {
            let has_own_body = places::has_own_body(&self.facts, index, &self.rules);
            let identity = &track.identity;
            let is_new = identity.last_seen.is_none() && !identity.phase.is_tentative();
            if identity.coverage.is_seen() && (has_own_body || is_new) {
                track.is_seen_at(tick);
            }
        }
    }

    /// Plans the detection passes of the next tick.
    fn schedule(&mut self, tick: Tick) {
        for track in self
            .tracks
            .iter()
            .filter(|track| track.identity.phase.is_lost())
        {
            let lost_s = self.rules.seconds(track.identity.coverage.since_two);
            let reach_m = self.rules.births.return_speed_m_s * lost_s;
            let place_m = track.estimator.joints_m()[0];
            self.scheduler.request_for_lost(tick, place_m, reach_m);
        }
        for (place_m, gone) in self.memory.places_of_missed(tick, self.rules.rate_hz) {
            let gone_s = (tick - gone) as f64 / self.rules.rate_hz;
            let reach_m = self.rules.births.return_speed_m_s * gone_s;
            self.scheduler.request_for_lost(tick, place_m, reach_m);
        }
        self.scheduler.plan(tick + 1);
    }

    fn new_id(&mut self) -> PersonId {
        let id = PersonId(self.next_id);
        self.next_id = self.next_id.saturating_add(1);
        id
    }
}

/// The appearance of a newcomer in its tentative ticks, and the first of them.
fn newcomer(track: &Track, method: &Method) -> (Appearance, Tick) {
    let record = &track.identity.tentative;
    let seen: Vec<(f64, ObservedJoints)> = record
        .ticks
        .iter()
        .map(|t| {
            let joints = ObservedJoints::from_estimates(&t.estimates, &method.sites);
            (t.tick.0 as f64 * method.dt_s, joints)
        })
        .collect();
    let velocity_m_s = velocity_m_s(&seen);
    let ticks: Vec<ObservedJoints> = seen.into_iter().map(|(_, joints)| joints).collect();
    let fitted = fit(&ticks, &method.parameters.ik, None);
    let skeleton = fitted.map_or_else(
        |_| track.estimator.body.skeleton.clone(),
        |body| body.skeleton,
    );
    let seconds = record.ticks.len() as f64 * method.dt_s;
    let since = record.ticks.first().map_or(Tick::default(), |t| t.tick);
    let whereabouts = Whereabouts {
        place_m: record.place_m,
        ..track.whereabouts()
    };
    let appearance = Appearance {
        lengths: Lengths::from_skeleton(&skeleton, seconds),
        whereabouts: velocity_m_s.map_or(whereabouts, |v_m_s| whereabouts.moving(&v_m_s)),
    };
    (appearance, since)
}
