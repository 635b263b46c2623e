//! Input of all streams: the people of one tick with joints, angles and the export skeleton's pose.
//!
//! [`FrameMaker`] creates a [`Frame`] from each [`PoseSet`] of fusion. It also tracks state beyond
//! a tick: velocities, and the [`Roster`] of present and recently lost people.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use farfield_export::edits::Identities;
use farfield_export::skeleton::{Angles, Motion, Offsets, RestPose, Rig, links_of};
use farfield_fusion::body::skeleton::{Joint, N_ANGLES, N_JOINTS};
use farfield_proto::camera::CameraModel;
use farfield_proto::id::{PersonId, SessionId};
use farfield_proto::message::{PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::people::make_unique;

/// Time for which a missing person stays in the roster, seconds, so that it keeps label, skeleton
/// and port.
const ROSTER_S: f64 = 10.0;
/// Time over which velocities are measured, seconds; differences of single ticks are mostly noise.
const SPEED_S: f64 = 0.1;
/// Rest pose of the export skeleton in all streams.
pub const REST: RestPose = RestPose::TPose;

/// Facts about the source of the poses.
#[derive(Debug, Clone, PartialEq)]
pub struct VenueFacts {
    /// Name of the venue.
    pub venue: String,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Names of people; a person without a name is `person_<id>`, and equal names get the id
    /// appended.
    pub names: BTreeMap<PersonId, String>,
    /// The venue's cameras, for streams that show them.
    pub cameras: Vec<CameraModel>,
}

/// The people of one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Name of the venue.
    pub venue: Arc<str>,
    /// Ticks per second.
    pub rate_hz: f64,
    /// The session to which the person ids belong.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// Time of the tick since the first streamed one, seconds; restarts with a session.
    pub elapsed_s: f64,
    /// All people by id, including tentative ones.
    pub persons: Vec<PersonFrame>,
    /// People seen within the last ten seconds.
    pub roster: Arc<Roster>,
}

/// One person at one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonFrame {
    /// The id.
    pub id: PersonId,
    /// The name.
    pub name: Arc<str>,
    /// Phase of the track.
    pub state: PersonState,
    /// Number of viewpoints with evidence.
    pub views: u16,
    /// The 29 joints in the world, metres, by [`Joint::index`].
    pub joints_m: [Vector3<f64>; N_JOINTS],
    /// One standard deviation of each joint per axis, metres; `None` if unknown.
    pub sigma_m: Option<[f64; N_JOINTS]>,
    /// The 40 reported angles, radians (metres for root translations).
    pub angles: Angles,
    /// Bit i: angle i comes from a prior only.
    pub unobserved: u64,
    /// Velocity of the pelvis in the world, metres per second, over the last tenth of a second;
    /// initially zero.
    pub velocity_m_s: Vector3<f64>,
    /// The export skeleton's pose relative to its T-pose.
    pub motion: Motion,
    /// The export skeleton at rest, with the lengths of this tick; [`Motion::heads_m`] gives the
    /// joints.
    pub rig: Rig,
}

/// People seen within the last ten seconds, in order of arrival. Streams assign numbers, labels and
/// ports by this list.
#[derive(Debug, Clone, PartialEq)]
pub struct Roster {
    /// Changes whenever the list changes.
    pub version: u64,
    /// The people.
    pub people: Vec<RosterEntry>,
}

/// A person of the roster.
#[derive(Debug, Clone, PartialEq)]
pub struct RosterEntry {
    /// The id.
    pub id: PersonId,
    /// The name.
    pub name: Arc<str>,
    /// Body measures at the person's arrival.
    pub offsets: Offsets,
}

impl Roster {
    /// The ids, in order.
    pub fn ids(&self) -> impl Iterator<Item = PersonId> + Clone {
        self.people.iter().map(|entry| entry.id)
    }
}

impl Frame {
    /// All confirmed people, by id.
    pub fn confirmed(&self) -> impl Iterator<Item = &PersonFrame> {
        self.persons
            .iter()
            .filter(|person| person.state != PersonState::Tentative)
    }

    /// The confirmed person with this id.
    pub fn find(&self, id: PersonId) -> Option<&PersonFrame> {
        self.confirmed().find(|person| person.id == id)
    }

    /// Time since the first tick, microseconds.
    pub fn elapsed_us(&self) -> u64 {
        (self.elapsed_s * 1e6).round() as u64
    }
}

/// Creates frames from fusion's poses.
#[derive(Debug)]
pub struct FrameMaker {
    facts: VenueFacts,
    people: Identities,
    venue: Arc<str>,
    start: Option<(SessionId, Tick)>,
    last: Option<Tick>,
    tracks: BTreeMap<PersonId, VecDeque<(Tick, Vector3<f64>)>>,
    seen: BTreeMap<PersonId, Tick>,
    roster: Arc<Roster>,
    unreadable: u64,
}

impl FrameMaker {
    /// A maker without any poses yet.
    pub fn new(mut facts: VenueFacts) -> Self {
        make_unique(&mut facts.names);
        Self {
            venue: facts.venue.as_str().into(),
            facts,
            people: Identities::default(),
            start: None,
            last: None,
            tracks: BTreeMap::new(),
            seen: BTreeMap::new(),
            roster: Arc::new(Roster {
                version: 0,
                people: Vec::new(),
            }),
            unreadable: 0,
        }
    }

    /// Applies edits from now on: `people` merges, splits, drops and names people. Names that are
    /// not unique get the id appended; a person without a name is `person_<id>`. Removed ids leave
    /// the roster immediately.
    pub fn edit(&mut self, people: Identities) {
        let names = people.names().iter();
        let mut names: BTreeMap<PersonId, String> = names
            .map(|(id, name)| (PersonId(*id), name.clone()))
            .collect();
        make_unique(&mut names);
        self.facts.names = names;
        self.seen.retain(|id, _| people.is_there(id.0));
        self.tracks.retain(|id, _| people.is_there(id.0));
        self.people = people;
    }

    /// Number of poses dropped for a wrong number of values, or values that are not finite.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// Creates the frame of these poses.
    pub fn frame(&mut self, poses: &PoseSet) -> Frame {
        let first = self.first_tick(poses);
        let mut persons = Vec::with_capacity(poses.persons.len());
        for (id, pose) in self.people_by_id(poses) {
            match self.person(poses.tick, id, pose) {
                Some(person) => persons.push(person),
                None => self.unreadable += 1,
            }
        }
        self.drop_old(poses.tick);
        self.update_roster(poses.tick, &persons);
        Frame {
            venue: Arc::clone(&self.venue),
            rate_hz: self.facts.rate_hz,
            session: poses.session,
            tick: poses.tick,
            elapsed_s: poses.tick.0.saturating_sub(first.0) as f64 / self.facts.rate_hz,
            persons,
            roster: Arc::clone(&self.roster),
        }
    }

    /// The poses by edited id. If a tick has two poses of one person, the better seen one is used.
    fn people_by_id<'a>(&self, poses: &'a PoseSet) -> BTreeMap<PersonId, &'a PersonPose> {
        let better = |pose: &PersonPose| {
            let state = match pose.state {
                PersonState::Tracked => 2,
                PersonState::Coasting => 1,
                PersonState::Tentative => 0,
            };
            (state, pose.views)
        };
        let mut people = BTreeMap::<PersonId, &PersonPose>::new();
        for pose in &poses.persons {
            let person = self.people.person_at(poses.tick.0, pose.person.0);
            let Some(person) = person.map(PersonId) else {
                continue;
            };
            let known = people.entry(person).or_insert(pose);
            if better(pose) > better(known) {
                *known = pose;
            }
        }
        people
    }

    /// The tick of time 0. Another session, or a tick before the last one, restarts the time.
    fn first_tick(&mut self, poses: &PoseSet) -> Tick {
        let goes_on = self.last.is_none_or(|last| last <= poses.tick);
        self.last = Some(poses.tick);
        match self.start {
            Some((session, first)) if session == poses.session && goes_on => first,
            _ => {
                self.start = Some((poses.session, poses.tick));
                self.tracks.clear();
                self.seen.clear();
                self.clear_roster();
                poses.tick
            }
        }
    }

    /// Ids of another session refer to other people.
    fn clear_roster(&mut self) {
        if !self.roster.people.is_empty() {
            self.roster = Arc::new(Roster {
                version: self.roster.version + 1,
                people: Vec::new(),
            });
        }
    }

    fn person(&mut self, tick: Tick, id: PersonId, pose: &PersonPose) -> Option<PersonFrame> {
        let joints_m = joints_of(&pose.joints_m)?;
        let angles = angles_of(&pose.angles)?;
        let mut links = links_of(&angles);
        let offsets = Offsets::measured(&joints_m, &links);
        // The joint and the translations among the angles are rounded separately; use the joint as
        // root.
        links.joints_m[Joint::Pelvis.index()] = joints_m[Joint::Pelvis.index()];
        Some(PersonFrame {
            id,
            name: self.name(id),
            state: pose.state,
            views: pose.views,
            velocity_m_s: self.velocity(tick, id, joints_m[Joint::Pelvis.index()]),
            joints_m,
            sigma_m: sigma_of(&pose.sigma_m),
            angles,
            unobserved: pose.unobserved,
            motion: Motion::of_links(&links, REST),
            rig: Rig::new(&offsets, REST),
        })
    }

    fn name(&self, id: PersonId) -> Arc<str> {
        match self.facts.names.get(&id) {
            Some(name) => name.as_str().into(),
            None => format!("person_{id}").into(),
        }
    }

    fn velocity(&mut self, tick: Tick, id: PersonId, pelvis_m: Vector3<f64>) -> Vector3<f64> {
        let rate_hz = self.facts.rate_hz;
        let track = self.tracks.entry(id).or_default();
        track.push_back((tick, pelvis_m));
        let age_s = |at: Tick| tick.0.saturating_sub(at.0) as f64 / rate_hz;
        // Keep the youngest entry of at least this age; entries before a gap are dropped below.
        while track.len() > 2 && track.get(1).is_some_and(|&(at, _)| age_s(at) >= SPEED_S) {
            track.pop_front();
        }
        if track
            .front()
            .is_some_and(|&(at, _)| age_s(at) > 2.0 * SPEED_S)
        {
            track.pop_front();
        }
        match track.front() {
            Some(&(at, from_m)) if at != tick => (pelvis_m - from_m) / age_s(at),
            _ => Vector3::zeros(),
        }
    }

    fn drop_old(&mut self, tick: Tick) {
        let is_old = |at: Tick| tick.0.saturating_sub(at.0) as f64 / self.facts.rate_hz > ROSTER_S;
        self.seen.retain(|_, last| !is_old(*last));
        self.tracks
            .retain(|_, track| track.back().is_some_and(|&(at, _)| !is_old(at)));
    }

    fn update_roster(&mut self, tick: Tick, persons: &[PersonFrame]) {
        let confirmed = || {
            persons
                .iter()
                .filter(|person| person.state != PersonState::Tentative)
        };
        self.seen
            .extend(confirmed().map(|person| (person.id, tick)));
        let mut people: Vec<RosterEntry> = self.roster.people.clone();
        people.retain(|entry| self.seen.contains_key(&entry.id));
        for person in confirmed() {
            if !people.iter().any(|entry| entry.id == person.id) {
                people.push(RosterEntry {
                    id: person.id,
                    name: Arc::clone(&person.name),
                    offsets: Offsets::measured(&person.joints_m, &person.motion.links(REST)),
                });
            }
        }
        for entry in &mut people {
            let name = self.name(entry.id);
            if name != entry.name {
                entry.name = name;
            }
        }
        let names = |people: &[RosterEntry]| {
            let names = people.iter().map(|e| (e.id, Arc::clone(&e.name)));
            names.collect::<Vec<_>>()
        };
        if names(&people) != names(&self.roster.people) {
            self.roster = Arc::new(Roster {
                version: self.roster.version + 1,
                people,
            });
        }
    }
}

fn joints_of(joints_m: &[[f32; 3]]) -> Option<[Vector3<f64>; N_JOINTS]> {
    let all: &[[f32; 3]; N_JOINTS] = joints_m.try_into().ok()?;
    let all = all.map(|at_m| Vector3::from(at_m.map(f64::from)));
    all.iter()
        .all(|at_m| at_m.iter().all(|v| v.is_finite()))
        .then_some(all)
}

fn angles_of(angles: &[f32]) -> Option<Angles> {
    let all: &[f32; N_ANGLES] = angles.try_into().ok()?;
    let all = all.map(f64::from);
    all.iter().all(|v| v.is_finite()).then_some(all)
}

fn sigma_of(sigma_m: &[f32]) -> Option<[f64; N_JOINTS]> {
    let all: &[f32; N_JOINTS] = sigma_m.try_into().ok()?;
    let all = all.map(f64::from);
    all.iter().all(|v| v.is_finite()).then_some(all)
}

#[cfg(test)]
#[path = "frame_tests.rs"]
mod tests;
