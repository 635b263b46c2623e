//! Everybody in the venue: who is born, who is confirmed, who leaves, and when the edges look for people.

use farfield_proto::id::{PersonId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{MAX_PERSONS, PersonPose, Sighting};
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::BirthParameters;
use farfield_proto::venue::{Field, GivenPerson, Venue};
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::lattice::KeypointEstimate;
use crate::skeleton::{Joint, Pose};

use super::birth::{BirthFinder, SightedKeypoint, SightedPerson, TrackedBody};
use super::fit::fit;
use super::ghosts::Ghosts;
use super::life::{Change, Life};
use super::observed::ObservedJoints;
use super::track::{Method, TentativeTick, Track};

/// What became of everybody after a tick.
pub struct Lived {
    /// The tentative ticks of those who are confirmed now, but for the tick itself.
    pub confirmed: Vec<(Tick, PersonPose)>,
    /// Sightings that were not used: of another viewpoint's camera, or of other keypoints.
    pub unusable_sightings: u32,
}

/// All persons, tentative ones too, by id.
pub struct Crowd {
    tracks: Vec<Track>,
    next_id: u32,
    finder: BirthFinder,
    births: BirthParameters,
    field: Field,
    given: Vec<GivenPerson>,
    rate_hz: f64,
    first_tick: Tick,
    looks_left: u32,
    ghosts: Ghosts,
    /// Per camera, whose it is.
    viewpoint_of_camera: Vec<ViewpointIndex>,
}

impl Crowd {
    /// Nobody yet.
    pub fn new(venue: &Venue, keypoints: KeypointSet) -> Self {
        let births = venue.parameters.births.clone();
        let cameras = venue
            .cameras
            .iter()
            .map(|camera| (camera.viewpoint, camera.model.clone()))
            .collect();
        Self {
            tracks: Vec::new(),
            next_id: 1,
            finder: BirthFinder::new(cameras, keypoints, &venue.field, &births),
            births,
            field: venue.field,
            given: venue.given_persons.clone(),
            rate_hz: venue.rate_hz,
            first_tick: Tick::default(),
            looks_left: 0,
            ghosts: Ghosts::default(),
            viewpoint_of_camera: venue
                .cameras
                .iter()
                .map(|camera| camera.viewpoint)
                .collect(),
        }
    }

    /// Begins a run at `tick`.
    pub fn begin(&mut self, tick: Tick, method: &Method) {
        self.first_tick = tick;
        self.bear_given(tick, method);
    }

    /// Everybody, by id.
    pub fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    /// Everybody, by id.
    pub fn tracks_mut(&mut self) -> &mut [Track] {
        &mut self.tracks
    }

    /// Whether the edges shall look for people at `tick`: all at the same ticks, because rays of
    /// different ticks do not meet.
    pub fn sights_at(&self, tick: Tick) -> bool {
        self.is_regular(tick) || self.looks_left > 0
    }

    /// The poses of those who are confirmed.
    pub fn published(&self) -> Vec<PersonPose> {
        let confirmed = self
            .tracks
            .iter()
            .filter(|track| !track.life.is_tentative());
        confirmed.map(Track::published).collect()
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
    /// who were sighted.
    pub fn live(&mut self, group: &TickGroup, method: &Method) -> Lived {
        let mut confirmed = Vec::new();
        let (rate_hz, births) = (self.rate_hz, &self.births);
        self.tracks.retain_mut(|track| {
            if track.life.is_tentative() {
                track.tentative.push(TentativeTick {
                    tick: group.tick,
                    estimates: track.estimates.clone(),
                });
            }
            match track.life.tick(track.evidence(method), rate_hz, births) {
                Change::None => {
                    if !track.life.is_tentative() {
                        track.remeasure(method);
                    }
                    true
                }
                Change::Gone => false,
                Change::Confirmed => {
                    confirmed.extend(track.settle(method));
                    true
                }
            }
        });
        self.let_go_outside();
        let ghosts = self.ghosts.found(&self.tracks, rate_hz, &self.births);
        self.tracks.retain(|track| !ghosts.contains(&track.id()));
        // The pose of the tick itself is in the poses of the tick; and who is let go was nobody.
        let is_here = |id| self.tracks.binary_search_by_key(&id, Track::id).is_ok();
        confirmed.retain(|(tick, pose)| *tick < group.tick && is_here(pose.person));
        let unusable_sightings = self.bear_sighted(group, method);
        self.bear_given(group.tick + 1, method);
        Lived {
            confirmed,
            unusable_sightings,
        }
    }

    fn let_go_outside(&mut self) {
        let Field { min_m, max_m } = self.field;
        let margin_m = self.births.outside_field_m;
        let inside =
            |value: f64, i: usize| (min_m[i] - margin_m..=max_m[i] + margin_m).contains(&value);
        self.tracks
            .retain(|track| (0..3).all(|i| inside(track.joints_m()[0][i], i)));
    }

    /// Bears those whom the sightings show; returns how many sightings could not be used.
    fn bear_sighted(&mut self, group: &TickGroup, method: &Method) -> u32 {
        if !self.sights_at(group.tick) {
            return 0;
        }
        let n_keypoints = method.sites.len();
        let (mut sightings, mut unusable) = (Vec::<Sighting>::new(), 0);
        for set in &group.sighting_sets {
            for sighting in &set.sightings {
                let owner = self.viewpoint_of_camera.get(usize::from(sighting.camera.0));
                if owner == Some(&set.viewpoint) && sighting.keypoints.len() == n_keypoints {
                    sightings.push(sighting.clone());
                } else {
                    unusable += 1;
                }
            }
        }
        for person in self.finder.find(&sightings, &self.bodies()) {
            self.bear(&person, group.tick, method);
        }
        let unexplained = self.finder.leaves_unexplained(&sightings, &self.bodies());
        self.look_again(group.tick, unexplained);
        unusable
    }

    fn bodies(&self) -> Vec<TrackedBody> {
        let body = |track: &Track| TrackedBody {
            keypoints_m: track.keypoints_m(),
        };
        self.tracks.iter().map(body).collect()
    }

    /// A sighting that nothing explains makes fusion ask for the next few ticks.
    fn look_again(&mut self, tick: Tick, unexplained: bool) {
        self.looks_left = match (unexplained, self.is_regular(tick)) {
            (false, _) => 0,
            (true, true) => self.births.look_again_ticks,
            (true, false) => self.looks_left.saturating_sub(1),
        };
    }

    fn is_regular(&self, tick: Tick) -> bool {
        let period = (self.births.sight_every_s * self.rate_hz).round().max(1.0) as i64;
        (tick - self.first_tick) % period == 0
    }

    fn bear(&mut self, person: &SightedPerson, tick: Tick, method: &Method) {
        if self.tracks.len() >= MAX_PERSONS {
            return;
        }
        let observed = ObservedJoints::from_sighted(person, &method.sites);
        let Ok(body) = fit(
            &[observed],
            &method.parameters.ik,
            method.range_of_motion.as_ref(),
        ) else {
            return;
        };
        let mut track = Track::new(
            self.new_id(),
            Life::newborn(),
            body.skeleton,
            body.pose,
            method,
        );
        track.estimates = estimates_of(person);
        track.tentative.push(TentativeTick {
            tick,
            estimates: track.estimates.clone(),
        });
        self.tracks.push(track);
    }

    fn bear_given(&mut self, tick: Tick, method: &Method) {
        let given: Vec<GivenPerson> = self
            .given
            .iter()
            .filter(|person| person.tick == tick)
            .cloned()
            .collect();
        for person in given {
            let observed = given_joints(&person, method);
            let Ok(body) = fit(
                &[observed],
                &method.parameters.ik,
                method.range_of_motion.as_ref(),
            ) else {
                continue;
            };
            self.make_room_for(&body.pose);
            if self.tracks.len() < MAX_PERSONS {
                let (id, life) = (self.new_id(), Life::given());
                self.tracks
                    .push(Track::new(id, life, body.skeleton, body.pose, method));
            }
        }
    }

    /// Who was found where a person is given by hand is that person: the hand knows better.
    fn make_room_for(&mut self, given: &Pose) {
        let near_m = self.births.explained_m;
        self.tracks
            .retain(|track| (track.joints_m()[0] - given.root_m).norm() >= near_m);
    }

    fn new_id(&mut self) -> PersonId {
        let id = PersonId(self.next_id);
        self.next_id += 1;
        id
    }
}

/// A person's keypoints as the venue file gives them: on the sites of the network's keypoints, and on
/// joints for names that only the model knows.
fn given_joints(person: &GivenPerson, method: &Method) -> ObservedJoints {
    let mut observed = ObservedJoints::default();
    for (name, position) in &person.keypoints_m {
        let site = method
            .keypoints
            .index_of(name)
            .and_then(|k| method.sites[k]);
        match (site, Joint::from_name(name)) {
            (Some(site), _) => observed.set_site(&site, Vector3::from(*position), 1.0),
            (None, Some(joint)) => observed.set(joint, Vector3::from(*position), 1.0),
            (None, None) => {}
        }
    }
    observed
}

/// The sighted keypoints as the lattice would have found them.
fn estimates_of(person: &SightedPerson) -> Vec<KeypointEstimate> {
    let unsupported = KeypointEstimate::unsupported(Vector3::repeat(f64::NAN), 0.0);
    let estimate = |point: &Option<SightedKeypoint>| {
        point.as_ref().map_or_else(
            || unsupported.clone(),
            |p| KeypointEstimate {
                position_m: p.position_m,
                support: p.score,
                weight: p.score,
                views: p.views,
                ..unsupported.clone()
            },
        )
    };
    person.keypoints_m.iter().map(estimate).collect()
}
