//! Everybody in the venue: who is born, who is confirmed, who leaves and comes back.

mod arrivals;
mod newborns;
mod returns;

use farfield_proto::id::{CameraIndex, PersonId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::BirthParameters;
use farfield_proto::venue::{Field, GivenPerson, Venue};
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::body::skeleton::Joints;

use super::memory::{Departed, Memory};
use super::track::Track;
use crate::identity::detection_scheduler::Lookout;
use crate::identity::duplicates::{Ghosts, distance_m};
use crate::identity::phase::{Change, Life, Verdict};
use crate::identity::poster::Pictures;
use crate::identity::tentative::TentativeTick;
use crate::method::Method;
use crate::sightings::finder::{BirthFinder, TrackedBody};

/// Two people whose pelvises are farther apart do not stand in each other's place, metres.
const APART_M: f64 = 0.6;

/// What became of everybody after a tick.
pub struct Lived {
    /// The tentative ticks of those who are confirmed now, but for the tick itself.
    pub confirmed: Vec<(Tick, PersonPose)>,
    /// Sightings that were not used: of another viewpoint's camera, or of other keypoints.
    pub unusable_sightings: u32,
}

/// All persons, tentative ones too, in the order of their births.
pub struct Crowd {
    tracks: Vec<Track>,
    next_id: u32,
    finder: BirthFinder,
    births: BirthParameters,
    field: Field,
    given: Vec<GivenPerson>,
    rate_hz: f64,
    lookout: Lookout,
    ghosts: Ghosts,
    pictures: Pictures,
    memory: Memory,
    /// Per camera, whose it is.
    viewpoint_of_camera: Vec<ViewpointIndex>,
    /// Buffer: everybody's joints, and whether it is surely they.
    places: Vec<(Joints, bool)>,
    /// Buffer: everybody's pelvis, world metres.
    pelvises_m: Vec<Vector3<f64>>,
}

impl Crowd {
    /// Nobody yet.
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
            lookout: Lookout::new(cameras.clone(), venue.field, &births, venue.rate_hz),
            finder: BirthFinder::new(cameras, keypoints, &venue.field, &births),
            births,
            field: venue.field,
            given: venue.given_persons.clone(),
            rate_hz: venue.rate_hz,
            ghosts: Ghosts::default(),
            pictures: Pictures::default(),
            memory: Memory::default(),
            places: Vec::new(),
            pelvises_m: Vec::new(),
        }
    }

    /// Begins a run at `tick`.
    pub fn begin(&mut self, tick: Tick, method: &Method) {
        self.lookout.begin(tick);
        self.bear_given(tick, method);
    }

    /// Everybody, in the order of their births.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Everybody, in the order of their births.
    pub fn tracks_mut(&mut self) -> &mut [Track] {
        &mut self.tracks
    }

    /// Which of the cameras `own` shall look for people at `tick`, as far ahead as it is planned.
    pub fn looking(&self, own: &[CameraIndex], tick: Tick) -> Vec<CameraIndex> {
        self.lookout.looking(own, tick)
    }

    /// Plans from now on who looks `ticks` ahead, at least 1.
    pub fn look_ahead(&mut self, ticks: i64) {
        self.lookout.look_ahead(ticks);
    }

    /// The poses of those who are confirmed, by id.
    pub fn published(&self) -> Vec<PersonPose> {
        let confirmed = self
            .tracks
            .iter()
            .filter(|track| !track.life.is_tentative());
        let mut poses: Vec<PersonPose> = confirmed.map(Track::published).collect();
        // Who was recognised has an older id than its place.
        poses.sort_by_key(|pose| pose.person);
        poses
    }

    /// The first tick of the oldest person who is still tentative.
    pub fn undecided_from(&self) -> Option<Tick> {
        let tentative = self.tracks.iter().filter(|track| track.life.is_tentative());
        tentative
            .filter_map(|track| track.tentative.first())
            .map(|first| first.tick)
            .min()
    }

    /// Moves every life on by the tick that has just been solved: confirms, lets go, and bears those
    /// who were sighted. Plans who looks at the next tick.
    pub fn live(&mut self, group: &TickGroup, method: &Method) -> Lived {
        let tick = group.tick;
        let just_confirmed = self.age(tick, method);
        let mut confirmed = self.welcome(&just_confirmed, method);
        self.let_go_outside();
        self.give_way(tick, method);
        let ghosts = self.ghosts.found(&self.tracks, self.rate_hz, &self.births);
        self.let_go(|track| ghosts.contains(&track.id()));
        self.note_who_is_seen(tick);
        self.memory.forget(tick, self.births.return_s, self.rate_hz);
        self.pictures.forget(tick, self.rate_hz);
        // The pose of the tick itself is in the poses of the tick; and who is let go was nobody.
        let is_here = |id| self.tracks.iter().any(|track| track.id() == id);
        confirmed.retain(|(at, pose)| *at < tick && is_here(pose.person));
        let unusable_sightings = self.bear_sighted(group, method);
        self.bear_given(tick + 1, method);
        self.plan_looks(tick);
        Lived {
            confirmed,
            unusable_sightings,
        }
    }

    /// Counts a tick in every life; returns who is confirmed by it (wire ids).
    fn age(&mut self, tick: Tick, method: &Method) -> Vec<PersonId> {
        let (rate_hz, births) = (self.rate_hz, &self.births);
        let (mut confirmed, mut gone) = (Vec::new(), Vec::new());
        let held = self.in_somebodys_place();
        for track in &mut self.tracks {
            track.lived_ticks = track.lived_ticks.saturating_add(1);
            let mut verdict = Verdict::Somebody;
            if track.life.is_tentative() {
                track.tentative.push(TentativeTick {
                    tick,
                    estimates: track.estimates.clone(),
                });
                verdict = track.trial.verdict(&track.tentative, method);
                if verdict == Verdict::Somebody && held.contains(&track.wire_id()) {
                    verdict = Verdict::Open;
                }
            }
            match track
                .life
                .tick(track.made_of(method), verdict, rate_hz, births)
            {
                Change::None => {
                    if !track.life.is_tentative() {
                        track.remeasure(method);
                    }
                }
                Change::Confirmed => confirmed.push(track.wire_id()),
                Change::Gone => {
                    gone.push(track.wire_id());
                    if verdict == Verdict::Picture {
                        self.pictures.add(track.keypoints_m(), tick);
                    }
                }
            }
        }
        self.let_go(|track| gone.contains(&track.wire_id()));
        confirmed
    }

    /// The tentative who stand in the place of somebody who is confirmed (wire ids).
    fn in_somebodys_place(&self) -> Vec<PersonId> {
        let are = |tentative: bool| {
            let tracks = self.tracks.iter();
            tracks.filter(move |track| track.life.is_tentative() == tentative)
        };
        let near_m = self.births.same_place_m;
        let held = are(true).filter(|track| {
            are(false).any(|other| distance_m(track.joints_m(), other.joints_m()) < near_m)
        });
        held.map(Track::wire_id).collect()
    }

    /// Who was lost and comes to stand in the place of somebody who is surely there has followed what was
    /// seen of that one.
    fn give_way(&mut self, tick: Tick, method: &Method) {
        let places = &mut self.places;
        places.clear();
        places.extend(self.tracks.iter().map(|track| {
            // A newborn that never stood alone was born on somebody's body.
            let is_itself = !track.life.is_tentative() || track.was_apart();
            let is_sure = !track.life.is_doubtful() && is_itself;
            (*track.joints_m(), is_sure)
        }));
        let places = &*places;
        let near_m = self.births.same_place_m;
        for (index, track) in self.tracks.iter_mut().enumerate() {
            let own_m = places[index].0;
            let others = || {
                let others = places.iter().enumerate().filter(move |(i, _)| *i != index);
                others.map(|(_, other)| other)
            };
            if others().all(|(other_m, _)| (other_m[0] - own_m[0]).norm() > APART_M) {
                track.is_apart_at(tick);
            } else if track.life.is_doubtful()
                && others()
                    .any(|(other_m, is_sure)| *is_sure && distance_m(&own_m, other_m) < near_m)
            {
                track.steps_back(tick, method);
            }
        }
    }

    fn let_go_outside(&mut self) {
        let Field { min_m, max_m } = self.field;
        let margin_m = self.births.outside_field_m;
        let inside =
            |value: f64, i: usize| (min_m[i] - margin_m..=max_m[i] + margin_m).contains(&value);
        self.let_go(|track| !(0..3).all(|i| inside(track.joints_m()[0][i], i)));
    }

    /// Lets people go, and remembers those who were published.
    fn let_go(&mut self, leaves: impl Fn(&Track) -> bool) {
        let (memory, rate_hz) = (&mut self.memory, self.rate_hz);
        self.tracks.retain(|track| {
            let stays = !leaves(track);
            if !stays
                && !track.life.was_tentative()
                && let Some(departed) = Departed::of(track, rate_hz)
            {
                memory.remember(departed);
            }
            stays
        });
    }

    /// Takes note of where people are who are surely themselves.
    fn note_who_is_seen(&mut self, tick: Tick) {
        let pelvises_m = &mut self.pelvises_m;
        pelvises_m.clear();
        pelvises_m.extend(self.tracks.iter().map(|track| track.joints_m()[0]));
        for (index, track) in self.tracks.iter_mut().enumerate() {
            let mut others = pelvises_m
                .iter()
                .enumerate()
                .filter(|(other, _)| *other != index);
            let alone = others.all(|(_, other_m)| (other_m - pelvises_m[index]).norm() > APART_M);
            let is_new = track.last_seen.is_none() && !track.life.is_tentative();
            if track.life.missing_ticks() == 0 && (alone || is_new) {
                track.is_seen_at(tick);
            }
        }
    }

    /// Everybody who is where the track says, and the pictures on the walls; with `lost` also those who
    /// may be elsewhere by now: the lost, and newborns who wait for their first crops.
    fn bodies(&self, lost: Lost) -> Vec<TrackedBody> {
        let may_be_elsewhere = |life: &Life| life.is_lost() || life.is_awaited();
        let counts = |track: &&Track| lost == Lost::Too || !may_be_elsewhere(&track.life);
        let body = |track: &Track| TrackedBody {
            keypoints_m: track.keypoints_m(),
        };
        let people = self.tracks.iter().filter(counts).map(body);
        people.chain(self.pictures.bodies()).collect()
    }

    fn plan_looks(&mut self, tick: Tick) {
        for track in self.tracks.iter().filter(|t| t.life.is_lost()) {
            let lost_s = f64::from(track.life.missing_ticks()) / self.rate_hz;
            let reach_m = self.births.return_speed_m_s * lost_s;
            self.lookout
                .ask_for_lost(tick, track.joints_m()[0], reach_m);
        }
        self.lookout.plan(tick + 1);
    }

    fn new_id(&mut self) -> PersonId {
        let id = PersonId(self.next_id);
        self.next_id += 1;
        id
    }
}

/// Whether those count who are carried by the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Lost {
    /// They do.
    Too,
    /// They do not.
    Not,
}

#[cfg(test)]
#[path = "registry/tests.rs"]
mod tests;
