//! Lives of simulated people whose keypoints are seen exactly. The tests check identities, not
//! accuracy.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use farfield_proto::calibration::Calibration;
use farfield_proto::id::SessionId;
use farfield_proto::message::identity_event::{IdentityEventSet, MAX_EVENTS};
use farfield_proto::message::naming::Finding;
use farfield_proto::message::{PatchSet, PersonState, SightingSet};
use farfield_proto::wire::Message;
use nalgebra::Vector3;

use super::*;
use crate::body::fixture::{Noise, standing};
use crate::body::ik::relative_sigmas;
use crate::body::observed::KeypointEstimate;
use crate::body::prior::BodyPrior;
use crate::body::skeleton::{Proportions, RangeOfMotion, sites_of};
use crate::boxes::BoxShape;
use crate::identity::subjects::Subject;
use crate::sightings::fixture::{TestHall, hall};

#[path = "tests/found_again.rs"]
mod found_again;

type TruePoints = Vec<Vector3<f64>>;

const RATE_HZ: f64 = 20.0;

pub(in crate::identity) fn venue(hall: &TestHall) -> Venue {
    let mut text = format!(
        "name = \"hall\"\nrate_hz = {RATE_HZ}\ncalibration = \"calibration.toml\"\n\
         [field]\nmin_m = [-4.0, -3.0, -0.3]\nmax_m = [4.0, 3.0, 2.6]\n\
         [tuning]\nbirths.confirm_s = 0.6\nbirths.look_again_s = 0.25\n"
    );
    for (_, model) in &hall.cameras {
        let name = model.name();
        let viewpoint = format!(
            "[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"{name}\"\n\
             source = {{ kind = \"keypoints\", path = \"{name}.jsonl\" }}\n"
        );
        text.push_str(&viewpoint);
    }
    let calibration = Calibration {
        cameras: hall
            .cameras
            .iter()
            .map(|(_, model)| (model.name().to_owned(), model.clone()))
            .collect(),
        hash: String::new(),
        rotation_lengths_rad: std::collections::BTreeMap::new(),
    };
    Venue::parse(&text, Path::new("hall.toml"), calibration).unwrap()
}

pub(in crate::identity) fn method(venue: &Venue) -> Method {
    let keypoints = KeypointSet::coco17();
    let parameters = venue.parameters.clone();
    Method {
        dt_s: 1.0 / RATE_HZ,
        sites: sites_of(&keypoints, &std::collections::BTreeMap::new()),
        relative_sigmas: relative_sigmas(&keypoints, &std::collections::BTreeMap::new()),
        map_size: None,
        floor_m: 0.0,
        peak_sigma_of_width: farfield_proto::model_card::PEAK_SIGMA_OF_WIDTH,
        range_of_motion: Some(RangeOfMotion::new(1.0)),
        box_shape: BoxShape {
            margin: 1.25,
            reach_m: 0.0,
            parameters: parameters.boxes.clone(),
        },
        keypoints,
        parameters,
    }
}

/// A hall that is stepped tick by tick.
struct HallFixture {
    hall: TestHall,
    registry: Registry,
    method: Method,
    tick: Tick,
    noise: Noise,
    /// Ids published so far.
    ids: BTreeSet<u32>,
}

impl HallFixture {
    fn new() -> Self {
        let hall = hall();
        let venue = venue(&hall);
        let method = method(&venue);
        let mut registry = Registry::new(&venue, KeypointSet::coco17());
        registry.begin(Tick(0), &method);
        Self {
            hall,
            registry,
            method,
            tick: Tick(0),
            noise: Noise(1),
            ids: BTreeSet::new(),
        }
    }

    /// One tick at which all cameras see `bodies`.
    fn step(&mut self, bodies: &[TruePoints]) -> Outcome {
        self.step_seen_by(bodies, &[0, 1, 2, 3])
    }

    /// One tick at which only `viewpoints` see `bodies`.
    fn step_seen_by(&mut self, bodies: &[TruePoints], viewpoints: &[u16]) -> Outcome {
        for track in self.registry.tracks_mut() {
            track.begin(&self.method);
            let pelvis_m = track.estimator.joints_m()[0];
            let near = bodies
                .iter()
                .map(|body| ((hips_m(body) - pelvis_m).norm(), body))
                .filter(|(distance, _)| *distance < 0.4)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let views = if near.is_some() {
                viewpoints.len() as u16
            } else {
                0
            };
            let places =
                near.map_or_else(|| track.estimator.keypoints_m(), |(_, body)| body.clone());
            track.estimator.evidence.estimates = places
                .iter()
                .map(|&p| KeypointEstimate {
                    weight: f64::from(views.min(1)),
                    views,
                    ..KeypointEstimate::unsupported(p, 1.0)
                })
                .collect();
            track.fit_keypoints(&self.method);
            track.estimator.smooth(&self.method);
            track.estimator.fit_joints(&self.method);
        }
        let group = self.sighted(bodies, viewpoints);
        let lived = self.registry.step(&group, &self.method);
        self.tick = self.tick + 1;
        self.ids
            .extend(self.registry.published().iter().map(|pose| pose.person.0));
        lived
    }

    fn sighted(&mut self, bodies: &[TruePoints], viewpoints: &[u16]) -> TickGroup {
        let all = if bodies.is_empty() {
            Vec::new()
        } else {
            self.hall.sightings(bodies, 1.0, &mut self.noise)
        };
        let set = |&viewpoint: &u16| {
            let camera = CameraIndex(viewpoint);
            let looks = self.registry.detecting(&[camera], self.tick) == [camera];
            looks.then(|| SightingSet {
                session: SessionId(1),
                tick: self.tick,
                viewpoint: ViewpointIndex(viewpoint),
                part: 0,
                parts: 1,
                sightings: all.iter().filter(|s| s.camera == camera).cloned().collect(),
            })
        };
        // A viewpoint sends a message whatever it sees.
        let sent = |&viewpoint: &u16| PatchSet {
            session: SessionId(1),
            tick: self.tick,
            viewpoint: ViewpointIndex(viewpoint),
            part: 0,
            parts: 1,
            sighting_parts: 0,
            timing: None,
            persons: Vec::new(),
        };
        TickGroup {
            tick: self.tick,
            patch_sets: viewpoints.iter().map(sent).collect(),
            sighting_sets: viewpoints.iter().filter_map(set).collect(),
        }
    }

    /// Several ticks with the same bodies; returns the poses of confirmed people.
    fn run_for(&mut self, bodies: &[TruePoints], seconds: f64) -> Vec<(Tick, PersonPose)> {
        (0..(seconds * RATE_HZ) as usize)
            .flat_map(|_| self.step(bodies).confirmed)
            .collect()
    }

    /// The id of the person published within 0.3 m of (`x`, `y`).
    fn id_at(&self, x: f64, y: f64) -> Option<u32> {
        let near = |pose: &&PersonPose| {
            let pelvis = pose.joints_m[0].map(f64::from);
            (pelvis[0] - x).hypot(pelvis[1] - y) < 0.3
        };
        let poses = self.registry.published();
        poses.iter().find(near).map(|pose| pose.person.0)
    }
}

fn hips_m(body: &TruePoints) -> Vector3<f64> {
    0.5 * (body[11] + body[12])
}

/// A person of this stature, always in the same posture.
fn person(x: f64, y: f64, stature_m: f64) -> TruePoints {
    standing(x, y, stature_m, &mut Noise(7))
}

#[test]
fn a_returning_person_gets_its_id_back() {
    let mut stage = HallFixture::new();
    stage.run_for(&[person(-3.0, 0.0, 1.7), person(2.0, 1.0, 1.8)], 4.0);
    let id = stage.id_at(-3.0, 0.0).unwrap();
    stage.run_for(&[person(2.0, 1.0, 1.8)], 6.0);
    assert_eq!(stage.registry.published().len(), 1, "it is dropped");
    let back = [person(-2.8, 0.4, 1.7), person(2.0, 1.0, 1.8)];
    let replayed = stage.run_for(&back, 2.0);
    assert_eq!(stage.id_at(-2.8, 0.4), Some(id));
    assert_eq!(stage.ids.len(), 2);
    assert!(replayed.len() >= 10, "its tentative ticks are handed out");
    let named = |(_, pose): &(Tick, PersonPose)| pose.person.0 == id;
    assert!(replayed.iter().all(named), "under the id that it has");
    let track = stage
        .registry
        .tracks()
        .iter()
        .find(|t| t.id().0 == id)
        .unwrap();
    assert_ne!(track.wire_id(), track.id(), "the edges keep its new id");
}

#[test]
fn a_stranger_of_another_size_gets_a_new_id() {
    let mut stage = HallFixture::new();
    stage.run_for(&[person(-3.0, 0.0, 1.6)], 4.0);
    stage.run_for(&[], 4.0);
    stage.run_for(&[person(-3.0, 0.3, 1.9)], 2.0);
    assert_eq!(stage.ids.len(), 2);
}

#[test]
fn a_person_is_forgotten_after_the_return_time() {
    let mut stage = HallFixture::new();
    stage.registry.rules.births.return_s = 3.0;
    stage.run_for(&[person(-3.0, 0.0, 1.7)], 4.0);
    stage.run_for(&[], 5.0);
    stage.run_for(&[person(-3.0, 0.0, 1.7)], 2.0);
    assert_eq!(stage.ids.len(), 2);
}

#[test]
fn two_returning_people_are_not_swapped() {
    for swapped in [false, true] {
        let mut stage = HallFixture::new();
        stage.run_for(&[person(-3.0, -1.0, 1.66), person(-3.0, 1.5, 1.87)], 5.0);
        let (small, tall) = (stage.id_at(-3.0, -1.0), stage.id_at(-3.0, 1.5));
        stage.run_for(&[], 8.0);
        let (y_small, y_tall) = if swapped { (1.0, -1.0) } else { (-1.0, 1.0) };
        stage.run_for(
            &[person(-3.0, y_small, 1.66), person(-3.0, y_tall, 1.87)],
            2.0,
        );
        assert_eq!(stage.id_at(-3.0, y_small), small);
        assert_eq!(stage.id_at(-3.0, y_tall), tall);
        assert_eq!(stage.ids.len(), 2);
    }
}

#[test]
fn a_lost_person_is_revived_where_it_is_sighted() {
    let mut stage = HallFixture::new();
    stage.run_for(&[person(0.0, 0.0, 1.75)], 3.0);
    let id = stage.id_at(0.0, 0.0).unwrap();
    for i in 1..=16 {
        // It runs on at 2 m/s while no camera sees it.
        stage.step_seen_by(&[person(0.1 * f64::from(i), 0.0, 1.75)], &[]);
    }
    assert_eq!(stage.registry.published()[0].state, PersonState::Coasting);
    stage.run_for(&[person(1.7, 0.0, 1.75)], 0.3);
    assert_eq!(stage.id_at(1.7, 0.0), Some(id));
    assert_eq!((stage.ids.len(), stage.registry.tracks().len()), (1, 1));
}

#[test]
fn silent_viewpoints_do_not_drop_a_person_but_absence_does() {
    let mut stage = HallFixture::new();
    stage.run_for(&[person(0.0, 0.0, 1.75)], 3.0);
    let id = stage.id_at(0.0, 0.0);
    for _ in 0..36 {
        stage.step_seen_by(&[], &[]);
    }
    assert_eq!(stage.registry.tracks().len(), 1, "none could have shown it");
    stage.run_for(&[person(0.4, 0.0, 1.75)], 0.3);
    assert_eq!(stage.id_at(0.4, 0.0), id);
    stage.run_for(&[], 1.5);
    assert!(
        stage.registry.tracks().is_empty(),
        "all could have shown it"
    );
}

#[test]
fn a_stranger_next_to_a_lost_person_gets_a_new_id() {
    let mut stage = HallFixture::new();
    stage.run_for(&[person(0.0, 0.0, 1.9)], 3.0);
    let id = stage.id_at(0.0, 0.0);
    stage.run_for(&[], 0.5);
    stage.run_for(&[person(1.0, 1.0, 1.6)], 1.0);
    assert_ne!(stage.id_at(1.0, 1.0), id);
    assert!(stage.id_at(1.0, 1.0).is_some());
}

#[test]
fn a_bystander_in_one_view_gets_no_track() {
    let mut stage = HallFixture::new();
    for _ in 0..100 {
        stage.step_seen_by(&[person(1.0, 1.0, 1.75)], &[2]);
    }
    assert!(stage.registry.tracks().is_empty());
}

#[test]
fn a_poster_gets_no_track_and_a_still_person_does() {
    let mut stage = HallFixture::new();
    let printed: TruePoints = person(3.5, 1.0, 1.8)
        .iter()
        .map(|p| Vector3::new(3.5, p.y, p.z))
        .collect();
    let still = person(-1.0, 0.0, 1.7);
    for seconds in [2.0, 4.0, 6.0] {
        stage.run_for(&[printed.clone(), still.clone()], seconds);
        assert!(stage.id_at(-1.0, 0.0).is_some());
        assert_eq!(stage.ids.len(), 1);
    }
    assert_eq!(
        stage.registry.tracks().len(),
        1,
        "it is not followed either"
    );
    // A person who steps away from the picture gets a track.
    stage.run_for(&[person(2.5, 1.0, 1.8), printed, still], 2.0);
    assert!(stage.id_at(2.5, 1.0).is_some());
}

#[test]
fn a_poster_that_moves_is_a_person() {
    let mut stage = HallFixture::new();
    for i in 0..40 {
        let y = -1.0 + 0.02 * f64::from(i);
        let body = person(0.0, 0.0, 1.8);
        let carried = body.iter().map(|p| Vector3::new(1.0, p.y + y, p.z));
        stage.step(&[carried.collect()]);
    }
    assert_eq!(stage.ids.len(), 1);
}

#[test]
fn a_tick_has_no_more_events_than_its_message_may_have() {
    let mut stage = HallFixture::new();
    let wire_id = PersonId(1);
    let kind = EventKind::Given;
    for _ in 0..=MAX_EVENTS {
        stage.registry.publish(wire_id, &Event { wire_id, kind });
    }
    let events = stage.step(&[]).events;
    assert_eq!(events.len(), MAX_EVENTS);
    let message = IdentityEventSet {
        session: SessionId(1),
        tick: Tick(0),
        events,
    };
    assert_eq!(message.check(), Ok(()));
}

/// Time of the last measurement of bodies, seconds.
const MEASURED_S: f64 = 18.0;

impl HallFixture {
    fn knowing(statures_m: &[f64]) -> Self {
        let mut stage = Self::new();
        let subject = |stature_m: &f64| Subject {
            name: format!("{stature_m:.2}"),
            body: Arc::new(BodyPrior::from_stature(*stature_m)),
        };
        stage
            .registry
            .know(statures_m.iter().map(subject).collect());
        stage
    }

    /// The namings while the same people stay.
    fn namings(&mut self, bodies: &[TruePoints], seconds: f64) -> Vec<Naming> {
        (0..(seconds * RATE_HZ) as usize)
            .flat_map(|_| self.step(bodies).namings)
            .collect()
    }
}

fn named(namings: &[Naming]) -> Vec<(u32, &str)> {
    let named = namings.iter();
    named
        .filter_map(|it| Some((it.person.0, it.name()?)))
        .collect()
}

#[test]
fn two_subjects_of_different_size_get_and_keep_their_names() {
    let mut stage = HallFixture::knowing(&[1.55, 1.95]);
    let bodies = [person(-2.0, 0.0, 1.95), person(2.0, 1.0, 1.55)];
    let namings = stage.namings(&bodies, MEASURED_S);
    let (tall, short) = (stage.id_at(-2.0, 0.0), stage.id_at(2.0, 1.0));
    let mut expected = [(tall.unwrap(), "1.95"), (short.unwrap(), "1.55")];
    let mut found = named(&namings);
    expected.sort_unstable();
    found.sort_unstable();
    assert_eq!(found, expected);
    // A person who comes back keeps its name: there is no second naming.
    stage.run_for(&bodies[1..], 6.0);
    assert!(named(&stage.namings(&bodies, MEASURED_S)).is_empty());
    assert_eq!(stage.id_at(-2.0, 0.0), tall);
}

#[test]
fn a_stranger_is_reported_once_without_a_name() {
    let mut stage = HallFixture::knowing(&[1.55]);
    let namings = stage.namings(&[person(0.0, 0.0, 1.9)], 2.0 * MEASURED_S);
    let [naming] = namings.as_slice() else {
        panic!("{namings:?}")
    };
    assert!(
        matches!(naming.finding, Finding::NobodyAlike { .. }),
        "{naming}"
    );
}

#[test]
fn a_team_is_measured_in_parts_unless_there_are_subjects() {
    let team: Vec<TruePoints> = (0..10)
        .map(|i| {
            let [row, place] = [i / 5, i % 5].map(f64::from);
            person(-3.0 + 1.5 * place, -1.0 + 2.0 * row, 1.75)
        })
        .collect();
    for (subjects_m, expected) in [(&[][..], &[8, 2][..]), (&[1.3], &[10])] {
        let mut stage = HallFixture::knowing(subjects_m);
        // They are confirmed within a second, and measured 2 and 4 s later.
        stage.run_for(&team, 1.5);
        let lengths = |stage: &HallFixture| -> Vec<Proportions> {
            let bodies = stage.registry.tracks().iter().map(|it| &it.estimator.body);
            bodies.map(|body| *body.skeleton.proportions()).collect()
        };
        let (mut before, mut measured) = (lengths(&stage), Vec::new());
        for _ in 0..(2.0 * RATE_HZ) as usize {
            stage.step(&team);
            let now = lengths(&stage);
            let new = now.iter().zip(&before).filter(|(now, was)| now != was);
            measured.extend(Some(new.count()).filter(|n| *n > 0));
            before = now;
        }
        assert_eq!(measured, expected);
    }
}

#[test]
fn lengths_move_to_the_subject_only_when_it_is_named() {
    // The true stature is 1.80 m: as near to the subject's 1.82 m as two measurements of one
    // person.
    let lengths = |subjects: &[f64]| {
        let mut stage = HallFixture::knowing(subjects);
        let body = [person(0.0, 0.0, 1.8)];
        let mut seen = Vec::new();
        for _ in 0..(MEASURED_S * RATE_HZ) as usize {
            let namings = stage.step(&body).namings;
            let track = stage.registry.tracks().first();
            let arm_m = track.map(|it| it.estimator.body.skeleton.proportions().upper_arm_m);
            seen.push((arm_m, !named(&namings).is_empty()));
        }
        seen
    };
    let (without, with) = (lengths(&[]), lengths(&[1.82]));
    let at = with.iter().position(|(_, is_named)| *is_named).unwrap();
    assert_eq!(without[..at], with[..at]);
    let known_m = Proportions::from_stature(1.82).upper_arm_m;
    let [free_m, drawn_m] = [&without, &with].map(|all| all.last().unwrap().0.unwrap());
    assert!(
        (drawn_m - known_m).abs() < (free_m - known_m).abs(),
        "{drawn_m} {free_m}"
    );
    let changes = with.windows(2).filter(|two| two[0].0 != two[1].0);
    let without = without.windows(2).filter(|two| two[0].0 != two[1].0);
    assert!(changes.count() <= without.count() + 1);
}
