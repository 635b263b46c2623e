//! What every stream draws from: the persons of one tick, with joints, angles and the export skeleton's pose.
//!
//! [`FrameMaker`] makes a [`Frame`] of each [`PoseSet`] that fusion publishes. It keeps what protocols need beyond a tick:
//! how fast people go, and the [`Roster`] of who is there or was a moment ago.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use farfield_export::skeleton::{Angles, Motion, Offsets, RestPose, Rig, links_of};
use farfield_fusion::body::skeleton::{Joint, N_ANGLES, N_JOINTS};
use farfield_proto::camera::CameraModel;
use farfield_proto::id::{PersonId, SessionId};
use farfield_proto::message::{PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::people::names::tell_apart;

/// How long who has gone stays in the roster, seconds: who is lost for a while keeps label, skeleton and port.
const ROSTER_S: f64 = 10.0;
/// Over how long speeds are measured, seconds: a difference of single ticks is mostly the noise of the pose.
const SPEED_S: f64 = 0.1;
/// How the export skeleton rests in all streams.
pub const REST: RestPose = RestPose::TPose;

/// What streams say about where poses come from.
#[derive(Debug, Clone, PartialEq)]
pub struct VenueFacts {
    /// Name of the venue.
    pub venue: String,
    /// Ticks per second.
    pub rate_hz: f64,
    /// What persons are called; who is not in it is `person_<id>`, and who is called like another has the id besides.
    pub names: BTreeMap<PersonId, String>,
    /// The venue's cameras, for streams that show them.
    pub cameras: Vec<CameraModel>,
}

/// The persons of one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// Name of the venue.
    pub venue: Arc<str>,
    /// Ticks per second.
    pub rate_hz: f64,
    /// The session whose person ids are meant.
    pub session: SessionId,
    /// The tick.
    pub tick: Tick,
    /// Time of the tick since the first that was streamed, seconds; it begins again with a session.
    pub elapsed_s: f64,
    /// Everybody, by id, tentative ones among them.
    pub persons: Vec<PersonFrame>,
    /// Who is there or was within the last ten seconds.
    pub roster: Arc<Roster>,
}

/// One person at one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct PersonFrame {
    /// Who.
    pub id: PersonId,
    /// What the person is called.
    pub name: Arc<str>,
    /// Phase of the track.
    pub state: PersonState,
    /// Viewpoints that gave evidence.
    pub views: u16,
    /// The 29 joints in the world, metres, by [`Joint::index`].
    pub joints_m: [Vector3<f64>; N_JOINTS],
    /// One standard deviation of each joint per axis, metres; `None` while it is not known.
    pub sigma_m: Option<[f64; N_JOINTS]>,
    /// The 40 reported angles, radians (root translations: metres).
    pub angles: Angles,
    /// Bit i: only a prior tells angle i.
    pub unobserved: u64,
    /// How the pelvis moves in the world, metres per second, over the last tenth of a second; zero at first.
    pub velocity_m_s: Vector3<f64>,
    /// The export skeleton's pose, against its T-pose.
    pub motion: Motion,
    /// The export skeleton at rest, of the lengths of this tick: [`Motion::heads_m`] gives the joints again.
    pub rig: Rig,
}

/// Who is there, or was within the last ten seconds, in the order in which they came. Streams that number people, label
/// them or give them a port do it by this list.
#[derive(Debug, Clone, PartialEq)]
pub struct Roster {
    /// Another number for another list of people.
    pub version: u64,
    /// The people.
    pub people: Vec<RosterEntry>,
}

/// A person of the roster.
#[derive(Debug, Clone, PartialEq)]
pub struct RosterEntry {
    /// Who.
    pub id: PersonId,
    /// What the person is called.
    pub name: Arc<str>,
    /// The body as it was measured when the person came.
    pub offsets: Offsets,
}

impl Roster {
    /// The people's ids, in order.
    pub fn ids(&self) -> impl Iterator<Item = PersonId> + Clone {
        self.people.iter().map(|entry| entry.id)
    }
}

impl Frame {
    /// Everybody who is confirmed, by id.
    pub fn confirmed(&self) -> impl Iterator<Item = &PersonFrame> {
        self.persons
            .iter()
            .filter(|person| person.state != PersonState::Tentative)
    }

    /// The confirmed person of that id.
    pub fn find(&self, id: PersonId) -> Option<&PersonFrame> {
        self.confirmed().find(|person| person.id == id)
    }

    /// Time since the first tick, microseconds.
    pub fn elapsed_us(&self) -> u64 {
        (self.elapsed_s * 1e6).round() as u64
    }
}

/// Makes frames of what fusion publishes.
#[derive(Debug)]
pub struct FrameMaker {
    facts: VenueFacts,
    venue: Arc<str>,
    start: Option<(SessionId, Tick)>,
    last: Option<Tick>,
    tracks: BTreeMap<PersonId, VecDeque<(Tick, Vector3<f64>)>>,
    seen: BTreeMap<PersonId, Tick>,
    roster: Arc<Roster>,
    unreadable: u64,
}

impl FrameMaker {
    /// One that has seen no pose yet.
    pub fn new(mut facts: VenueFacts) -> Self {
        tell_apart(&mut facts.names);
        Self {
            venue: facts.venue.as_str().into(),
            facts,
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

    /// People are called so from now on, with the id besides where that would be another's name too; who is not in `names`
    /// is `person_<id>`.
    pub fn rename(&mut self, mut names: BTreeMap<PersonId, String>) {
        tell_apart(&mut names);
        self.facts.names = names;
    }

    /// How many poses had not the numbers of the model, or some that are none, and were left out.
    pub fn unreadable(&self) -> u64 {
        self.unreadable
    }

    /// The frame of these poses.
    pub fn frame(&mut self, poses: &PoseSet) -> Frame {
        let first = self.first_tick(poses);
        let mut persons = Vec::with_capacity(poses.persons.len());
        for pose in &poses.persons {
            match self.person(poses.tick, pose) {
                Some(person) => persons.push(person),
                None => self.unreadable += 1,
            }
        }
        persons.sort_by_key(|person| person.id);
        self.forget(poses.tick);
        self.call_the_roll(poses.tick, &persons);
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

    /// The tick of time 0. Another session, or a tick before the last, begins anew.
    fn first_tick(&mut self, poses: &PoseSet) -> Tick {
        let goes_on = self.last.is_none_or(|last| last <= poses.tick);
        self.last = Some(poses.tick);
        match self.start {
            Some((session, first)) if session == poses.session && goes_on => first,
            _ => {
                self.start = Some((poses.session, poses.tick));
                self.tracks.clear();
                self.seen.clear();
                self.forget_everybody();
                poses.tick
            }
        }
    }

    /// Ids of another session mean other people.
    fn forget_everybody(&mut self) {
        if !self.roster.people.is_empty() {
            self.roster = Arc::new(Roster {
                version: self.roster.version + 1,
                people: Vec::new(),
            });
        }
    }

    fn person(&mut self, tick: Tick, pose: &PersonPose) -> Option<PersonFrame> {
        let joints_m = joints_of(&pose.joints_m)?;
        let angles = angles_of(&pose.angles)?;
        let mut links = links_of(&angles);
        let offsets = Offsets::measured(&joints_m, &links);
        // The joint and the angles' translations are rounded separately: one of them is the root.
        links.joints_m[Joint::Pelvis.index()] = joints_m[Joint::Pelvis.index()];
        Some(PersonFrame {
            id: pose.person,
            name: self.name(pose.person),
            state: pose.state,
            views: pose.views,
            velocity_m_s: self.velocity(tick, pose.person, joints_m[Joint::Pelvis.index()]),
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
        let age_s = |of: Tick| tick.0.saturating_sub(of.0) as f64 / rate_hz;
        // The oldest is the last one that is at least that old; what lies before a gap is not looked at.
        while track.len() > 2 && track.get(1).is_some_and(|&(of, _)| age_s(of) >= SPEED_S) {
            track.pop_front();
        }
        if track
            .front()
            .is_some_and(|&(of, _)| age_s(of) > 2.0 * SPEED_S)
        {
            track.pop_front();
        }
        match track.front() {
            Some(&(of, from_m)) if of != tick => (pelvis_m - from_m) / age_s(of),
            _ => Vector3::zeros(),
        }
    }

    fn forget(&mut self, tick: Tick) {
        let is_old = |of: Tick| tick.0.saturating_sub(of.0) as f64 / self.facts.rate_hz > ROSTER_S;
        self.seen.retain(|_, last| !is_old(*last));
        self.tracks
            .retain(|_, track| track.back().is_some_and(|&(of, _)| !is_old(of)));
    }

    fn call_the_roll(&mut self, tick: Tick, persons: &[PersonFrame]) {
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
        let called = |people: &[RosterEntry]| {
            let called = people.iter().map(|e| (e.id, Arc::clone(&e.name)));
            called.collect::<Vec<_>>()
        };
        if called(&people) != called(&self.roster.people) {
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
mod tests {
    use farfield_export::skeleton::Bone;

    use super::*;
    use crate::synthetic;

    fn ids(roster: &Roster) -> Vec<u32> {
        roster.ids().map(|PersonId(id)| id).collect()
    }

    #[test]
    fn joints_come_out_of_the_export_skeleton_again() {
        let frame = synthetic::frame(33);
        for person in &frame.persons {
            let heads_m = person.motion.heads_m(&person.rig);
            for bone in Bone::ALL {
                if !matches!(bone, Bone::LeftToes | Bone::RightToes) {
                    let apart_m = heads_m[bone.index()] - person.joints_m[bone.joint().index()];
                    assert!(apart_m.norm() < 1e-9, "{bone:?}");
                }
            }
        }
    }

    #[test]
    fn who_has_gone_stays_in_the_roster_for_ten_seconds() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let both = maker.frame(&synthetic::poses_at(2, 0)).roster;
        assert_eq!((ids(&both), both.version), (vec![1, 2], 1));
        let kept = maker.frame(&synthetic::poses_at(1, 600)).roster;
        assert_eq!((ids(&kept), kept.version), (vec![1, 2], 1));
        let gone = maker.frame(&synthetic::poses_at(1, 601)).roster;
        assert_eq!((ids(&gone), gone.version), (vec![1], 2));
        // Who comes back is the last of the list.
        let mut poses = synthetic::poses_at(2, 602);
        poses.persons.swap(0, 1);
        let back = maker.frame(&poses).roster;
        assert_eq!((ids(&back), back.version), (vec![1, 2], 3));
    }

    #[test]
    fn who_is_named_is_called_so_from_the_next_tick_on() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let before = maker.frame(&synthetic::poses_at(2, 0));
        maker.rename([(PersonId(2), "Anna".to_owned())].into());
        let after = maker.frame(&synthetic::poses_at(2, 1));
        let names = |frame: &Frame| -> Vec<String> {
            let listed = frame.roster.people.iter().map(|it| it.name.to_string());
            let there = frame.persons.iter().map(|it| it.name.to_string());
            listed.chain(there).collect()
        };
        assert_eq!(names(&after), ["person_1", "Anna", "person_1", "Anna"]);
        assert_ne!(before.roster.version, after.roster.version);
        maker.rename([1, 2].map(|id| (PersonId(id), "Anna".to_owned())).into());
        let alike = maker.frame(&synthetic::poses_at(2, 2));
        assert_eq!(names(&alike), ["Anna 1", "Anna 2", "Anna 1", "Anna 2"]);
    }

    #[test]
    fn tentative_people_are_in_frames_but_not_in_the_roster() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let mut poses = synthetic::poses_at(2, 0);
        poses.persons[1].state = PersonState::Tentative;
        let frame = maker.frame(&poses);
        assert_eq!(frame.persons.len(), 2);
        assert_eq!(ids(&frame.roster), [1]);
        assert!(frame.find(PersonId(2)).is_none());
    }

    #[test]
    fn poses_with_other_numbers_than_the_models_are_left_out_and_counted() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let mut poses = synthetic::poses_at(4, 0);
        poses.persons[0].joints_m[3][1] = f32::NAN;
        poses.persons[1].joints_m.pop();
        poses.persons[2].angles.clear();
        let frame = maker.frame(&poses);
        assert_eq!(frame.persons.len(), 1);
        assert_eq!(frame.persons[0].id, PersonId(4));
        assert_eq!(maker.unreadable(), 3);
    }

    #[test]
    fn another_session_begins_at_time_0_with_nobody_from_before() {
        let mut maker = FrameMaker::new(synthetic::facts());
        maker.frame(&synthetic::poses_at(2, 1000));
        let before = maker.frame(&synthetic::poses_at(2, 1030));
        assert_eq!(before.elapsed_us(), 500_000);
        let mut poses = synthetic::poses_at(1, 1031);
        poses.session = SessionId(8);
        let frame = maker.frame(&poses);
        assert_eq!((frame.elapsed_us(), ids(&frame.roster)), (0, vec![1]));
        assert_ne!(frame.roster.version, before.roster.version);
        // So does a tick that lies before the last one.
        let again = maker.frame(&synthetic::poses_at(1, 5));
        assert_eq!(again.elapsed_us(), 0);
    }
}
