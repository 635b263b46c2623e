//! Encoded messages of a frame; each is created once for all clients, at the first request.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Duration;

use farfield_export::formats::foxglove::{Body, Stamp, angles, people, person_frames};
use farfield_export::skeleton::Bone;
use farfield_proto::id::PersonId;

use crate::frame::{Frame, PersonFrame};
use crate::wall_clock::{WallClock, since_1970};

/// Lifetime of a drawn person that is not updated, seconds.
const LIFETIME_S: f64 = 1.0;

/// A frame and its messages.
#[derive(Debug)]
pub(super) struct Encoded {
    pub(super) frame: Arc<Frame>,
    pub(super) stamp: Stamp,
    people: OnceLock<Vec<u8>>,
    frames: OnceLock<Vec<u8>>,
    angles: OnceLock<BTreeMap<u32, Vec<u8>>>,
}

impl Encoded {
    fn new(frame: &Arc<Frame>, stamp: Stamp) -> Self {
        Self {
            frame: Arc::clone(frame),
            stamp,
            people: OnceLock::new(),
            frames: OnceLock::new(),
            angles: OnceLock::new(),
        }
    }

    pub(super) fn people(&self) -> &[u8] {
        self.people.get_or_init(|| {
            let bodies: Vec<Body<'_>> = self.frame.confirmed().map(body).collect();
            let gone = self.frame.roster.people.iter().map(|entry| entry.id);
            let gone = gone.filter(|id| self.frame.find(*id).is_none());
            let gone: Vec<u32> = gone.map(|PersonId(id)| id).collect();
            people(self.stamp, &bodies, &gone, LIFETIME_S)
        })
    }

    pub(super) fn frames(&self) -> &[u8] {
        self.frames.get_or_init(|| {
            let bodies: Vec<Body<'_>> = self.frame.confirmed().map(body).collect();
            person_frames(self.stamp, &bodies)
        })
    }

    pub(super) fn angles(&self, person: u32) -> Option<&[u8]> {
        let all = self.angles.get_or_init(|| {
            let tick = self.frame.tick.0;
            let bodies = self.frame.confirmed().map(body);
            bodies.map(|body| (body.id, angles(tick, &body))).collect()
        });
        all.get(&person).map(Vec::as_slice)
    }
}

fn body(person: &PersonFrame) -> Body<'_> {
    Body {
        id: person.id.0,
        name: &person.name,
        state: person.state,
        views: u32::from(person.views),
        joints_m: &person.joints_m,
        pelvis: &person.motion.rotations[Bone::Hips.index()],
        angles: &person.angles,
        unobserved: person.unobserved,
    }
}

/// Encodes and stamps frames.
#[derive(Debug, Default)]
pub(super) struct Encoder(Mutex<(WallClock, Option<Arc<Encoded>>)>);

impl Encoder {
    pub(super) fn encode(&self, frame: &Arc<Frame>) -> Arc<Encoded> {
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (clock, encoded) = &mut *last;
        match encoded {
            Some(encoded) if Arc::ptr_eq(&encoded.frame, frame) => Arc::clone(encoded),
            _ => {
                let stamp = stamp(clock.stamp(frame.elapsed_s, since_1970()));
                let made = Arc::new(Encoded::new(frame, stamp));
                *encoded = Some(Arc::clone(&made));
                made
            }
        }
    }

    /// The stamp for messages without a tick.
    pub(super) fn now(&self) -> Stamp {
        let last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let (_, encoded) = &*last;
        // Not later than messages already sent.
        let newest = encoded.as_ref().map(|it| it.stamp);
        newest.unwrap_or_else(|| stamp(since_1970()))
    }
}

fn stamp(since_1970: Duration) -> Stamp {
    // Valid until 2554.
    Stamp {
        nanos: u64::try_from(since_1970.as_nanos()).unwrap_or(u64::MAX),
    }
}
