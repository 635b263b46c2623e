//! One tick as the page stores it: encoded once for all, with the data that single clients may
//! request.

use std::sync::Arc;

use farfield_proto::frames::Point;
use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{PersonPose, PersonState, PoseSet, Sighting};
use farfield_proto::tick::Tick;
use nalgebra::Point3;

use super::context::Context;
use super::evidence::{FrameBox, TickEvidence};
use crate::protocol::camera_view::{CameraView, ViewedPerson, ViewedSighting};
use crate::protocol::chosen_angles::ChosenAngles;
use crate::protocol::tick::{TickMessage, TickPerson, as_history, json_tick, sigma_code};

/// Approximate size of a frame without its lists, bytes.
const FRAME_BYTES: usize = 256;

/// One tick.
#[derive(Debug)]
pub(crate) struct Frame {
    /// The tick.
    pub(crate) tick: Tick,
    /// The lower half of fusion's session.
    pub(crate) session: u32,
    /// Message kind 1, marked as live.
    pub(crate) encoded: Vec<u8>,
    persons: Vec<FramePerson>,
    boxes: Vec<FrameBox>,
    sightings: Vec<Sighting>,
}

/// Data of a person that the encoded tick lacks.
#[derive(Debug)]
struct FramePerson {
    id: PersonId,
    state: PersonState,
    angles: Box<[f32]>,
    unobserved: u64,
    /// In steps of the context's grid, as joints are.
    keypoints: Box<[[i16; 3]]>,
}

/// Angles of one person at one tick.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PersonAngles<'a> {
    /// All angles.
    pub(crate) values: &'a [f32],
    /// Bits of the angles that come from a prior.
    pub(crate) unobserved: u64,
}

impl Frame {
    /// Builds a tick from fusion's poses and their inputs.
    pub(super) fn new(
        context: &Context,
        poses: PoseSet,
        at_us: i64,
        evidence: TickEvidence,
    ) -> Self {
        let joints = context.skeleton.joints.len() as u8;
        let session = poses.session.0 as u32;
        let persons = poses.persons.iter().map(|pose| TickPerson {
            id: pose.person,
            state: pose.state,
            views: pose.views,
            viewpoints: evidence.viewpoints_of(pose.person),
            unobserved: pose.unobserved,
            clamped: clamped(context, pose),
            joints: context_joints(context, pose, usize::from(joints)),
            sigma: (0..usize::from(joints))
                .map(|joint| sigma_code(pose.sigma_m.get(joint).copied()))
                .collect(),
        });
        let message = TickMessage {
            is_live: true,
            session,
            tick: poses.tick,
            at_us,
            grid: context.grid,
            joints,
            persons: persons.collect(),
        };
        let stored = poses.persons.into_iter().map(|pose| FramePerson {
            id: pose.person,
            state: pose.state,
            unobserved: pose.unobserved,
            keypoints: pose
                .keypoints_m
                .iter()
                .map(|&at_m| context.grid.steps(at_m))
                .collect(),
            angles: pose.angles.into_boxed_slice(),
        });
        Self {
            tick: message.tick,
            session,
            encoded: message.encode(),
            persons: stored.collect(),
            boxes: evidence.boxes,
            sightings: evidence.sightings,
        }
    }

    /// The tick encoded as part of the past.
    pub(crate) fn as_history(&self) -> Vec<u8> {
        as_history(&self.encoded)
    }

    /// Approximate memory use, bytes.
    pub(crate) fn size_bytes(&self) -> usize {
        let persons = self.persons.iter().map(|person| {
            size_of::<FramePerson>() + 4 * person.angles.len() + 6 * person.keypoints.len()
        });
        let sightings = self
            .sightings
            .iter()
            .map(|sighting| size_of::<Sighting>() + 16 * sighting.keypoints.len());
        FRAME_BYTES
            + self.encoded.capacity()
            + persons.sum::<usize>()
            + size_of::<FrameBox>() * self.boxes.len()
            + sightings.sum::<usize>()
    }

    /// Number of people by phase: tentative, tracked, coasting.
    pub(super) fn phases(&self) -> [usize; 3] {
        let count = |state| {
            self.persons
                .iter()
                .filter(|person| person.state == state)
                .count()
        };
        [
            PersonState::Tentative,
            PersonState::Tracked,
            PersonState::Coasting,
        ]
        .map(count)
    }

    /// The people cropped from a camera.
    pub(super) fn persons_of(&self, camera: CameraIndex) -> Vec<u32> {
        let chosen = self
            .boxes
            .iter()
            .filter(|b| b.camera == camera && b.is_chosen);
        chosen.map(|b| b.person.0).collect()
    }

    /// The angles of a person, if present.
    pub(crate) fn angles_of(&self, person: u32) -> Option<PersonAngles<'_>> {
        let found = self.persons.iter().find(|known| known.id.0 == person)?;
        Some(PersonAngles {
            values: &found.angles,
            unobserved: found.unobserved,
        })
    }

    /// Encodes message kind 3 for those of `persons` that are present.
    pub(crate) fn chosen_angles(&self, persons: &[u32], angles: &[u16]) -> Vec<u8> {
        let of_person = |&person: &u32| {
            let all = self.angles_of(person)?.values;
            let value = |&angle: &u16| all.get(usize::from(angle)).copied().unwrap_or_default();
            Some((PersonId(person), angles.iter().map(value).collect()))
        };
        ChosenAngles {
            session: self.session,
            tick: self.tick,
            angles: angles.len() as u8,
            persons: persons.iter().filter_map(of_person).collect(),
        }
        .encode()
    }

    /// Encodes message kind 2; `None` if the venue lacks the camera.
    pub(crate) fn camera_view(&self, context: &Context, camera: CameraIndex) -> Option<Vec<u8>> {
        let model = &context.venue.camera(camera)?.model;
        let project = |&steps: &[i16; 3]| {
            let [x, y, z] = context.grid.point_m(steps).map(f64::from);
            let pixel = model.project(Point::new(Point3::new(x, y, z)))?;
            Some([pixel.x() as f32, pixel.y() as f32])
        };
        let persons = self.persons.iter().map(|person| {
            let is_it = |b: &&FrameBox| b.camera == camera && b.person == person.id;
            let found = self.boxes.iter().find(is_it);
            ViewedPerson {
                id: person.id,
                bounding_box: found.and_then(|found| found.bounding_box),
                is_chosen: found.is_some_and(|found| found.is_chosen),
                keypoints_px: person.keypoints.iter().map(project).collect(),
            }
        });
        let sightings = self
            .sightings
            .iter()
            .filter(|sighting| sighting.camera == camera);
        let sightings = sightings.map(|sighting| ViewedSighting {
            score: sighting.score,
            keypoints_px: sighting
                .keypoints
                .iter()
                .map(|peak| peak.map(|peak| peak.position_px))
                .collect(),
        });
        let view = CameraView {
            camera,
            session: self.session,
            tick: self.tick,
            keypoints: u8::try_from(context.skeleton.keypoints.len()).unwrap_or(u8::MAX),
            persons: persons.collect(),
            sightings: sightings.collect(),
        };
        Some(view.encode())
    }

    /// The tick as JSON.
    pub(crate) fn json(&self, is_live: bool) -> String {
        let angles: Vec<&[f32]> = self.persons.iter().map(|person| &*person.angles).collect();
        match TickMessage::decode(&self.encoded) {
            Ok(tick) => json_tick(&TickMessage { is_live, ..tick }, &angles),
            Err(error) => {
                tracing::error!(%error, "cannot decode a tick that this page encoded");
                "{}".to_owned()
            }
        }
    }
}

/// A frame with several owners.
pub(crate) type SharedFrame = Arc<Frame>;

fn context_joints(context: &Context, pose: &PersonPose, joints: usize) -> Vec<[i16; 3]> {
    if pose.joints_m.is_empty() {
        return Vec::new();
    }
    let joint = |i: usize| pose.joints_m.get(i).copied().unwrap_or_default();
    (0..joints).map(|i| context.grid.steps(joint(i))).collect()
}

/// Bit a: angle a is at a limit of its range.
fn clamped(context: &Context, pose: &PersonPose) -> u64 {
    let angles = context.skeleton.angles.iter().zip(&pose.angles).take(64);
    let at_bound = angles
        .enumerate()
        .filter(|(_, (angle, value))| angle.is_at_bound(**value));
    at_bound.fold(0, |bits, (index, _)| bits | 1 << index)
}
