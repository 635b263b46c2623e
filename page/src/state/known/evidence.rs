//! Inputs that led to the poses of a tick: crops, boxes and sightings. Kept for the ticks around
//! the newest until their poses arrive.

use std::collections::{BTreeMap, VecDeque};

use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::id::{CameraIndex, PersonId, ViewpointIndex};
use farfield_proto::message::identity_event::{Change, IdentityEvent};
use farfield_proto::message::{BoxSet, CameraBox, PatchSet, Sighting, SightingSet};
use farfield_proto::tick::Tick;

/// Maximum number of ticks that wait for poses.
const MAX_TICKS: usize = 256;
/// Maximum distance of a tick from the newest poses, ticks; farther ones come from wrong clocks.
const MAX_DISTANCE: i64 = 1200;
/// Maximum numbers of crops and of sightings per tick.
const MAX_CROPS: usize = 4096;
const MAX_SIGHTINGS: usize = 1024;
/// Number of box sets kept per viewpoint.
const MAX_BOX_SETS: usize = 64;
/// Maximum number of boxes per set, over all cameras.
const MAX_BOXES: usize = 4096;
/// Maximum number of people with known wire ids.
const MAX_WIRE_IDS: usize = 4096;

/// A person in a camera.
#[derive(Debug, Clone, Copy)]
pub(in crate::state) struct FrameBox {
    pub(in crate::state) person: PersonId,
    pub(in crate::state) camera: CameraIndex,
    pub(in crate::state) bounding_box: Option<BoundingBox>,
    pub(in crate::state) is_chosen: bool,
}

/// Inputs of one tick.
#[derive(Debug, Clone, Default)]
pub(in crate::state) struct TickEvidence {
    /// Boxes, with a mark on those that were cropped.
    pub(in crate::state) boxes: Vec<FrameBox>,
    crops: Vec<(ViewpointIndex, PersonId, CameraIndex)>,
    /// Detected people without a box.
    pub(in crate::state) sightings: Vec<Sighting>,
    /// When the last maps arrived, microseconds of Unix time.
    pub(in crate::state) newest_patch_us: Option<i64>,
    /// Earliest capture relative to the tick's time, microseconds.
    pub(in crate::state) earliest_capture_us: Option<i32>,
}

impl TickEvidence {
    /// Bit v: viewpoint v sent maps of the person.
    pub(in crate::state) fn viewpoints_of(&self, person: PersonId) -> u64 {
        let crops = self.crops.iter().filter(|(_, id, _)| *id == person);
        crops
            .filter(|(viewpoint, ..)| viewpoint.0 < 64)
            .fold(0, |bits, (viewpoint, ..)| bits | 1 << viewpoint.0)
    }
}

/// The boxes for a viewpoint at a tick.
type BoxesOfTick = (Tick, Vec<(PersonId, CameraBox)>);

/// Inputs of the ticks around the newest.
#[derive(Debug, Clone, Default)]
pub(in crate::state) struct Evidence {
    ticks: BTreeMap<Tick, TickEvidence>,
    boxes: BTreeMap<ViewpointIndex, VecDeque<BoxesOfTick>>,
    /// Published ids by the ids in patches and boxes, where they differ.
    ids: BTreeMap<PersonId, PersonId>,
    newest: Option<Tick>,
}

impl Evidence {
    fn tick(&mut self, tick: Tick) -> Option<&mut TickEvidence> {
        if let Some(newest) = self.newest
            && (tick <= newest || tick - newest > MAX_DISTANCE)
        {
            return None;
        }
        if self.ticks.len() >= MAX_TICKS && !self.ticks.contains_key(&tick) {
            // The next poses are nearest; ticks far ahead come from a wrong clock.
            if self.newest.is_some()
                && self
                    .ticks
                    .last_key_value()
                    .is_some_and(|(last, _)| tick > *last)
            {
                return None;
            }
            match self.newest {
                Some(_) => self.ticks.pop_last(),
                None => self.ticks.pop_first(),
            };
        }
        Some(self.ticks.entry(tick).or_default())
    }

    pub(in crate::state) fn take_patches(&mut self, set: &PatchSet, at_us: i64) {
        let Some(tick) = self.tick(set.tick) else {
            return;
        };
        tick.newest_patch_us = Some(
            tick.newest_patch_us
                .map_or(at_us, |newest| newest.max(at_us)),
        );
        for patch in &set.persons {
            let offset_us = patch.capture_offset_us;
            let earliest = tick
                .earliest_capture_us
                .map_or(offset_us, |us| us.min(offset_us));
            tick.earliest_capture_us = Some(earliest);
            if tick.crops.len() < MAX_CROPS {
                tick.crops.push((set.viewpoint, patch.person, patch.camera));
            }
        }
    }

    pub(in crate::state) fn take_sightings(&mut self, set: SightingSet) {
        if let Some(tick) = self.tick(set.tick) {
            let room = MAX_SIGHTINGS.saturating_sub(tick.sightings.len());
            tick.sightings.extend(set.sightings.into_iter().take(room));
        }
    }

    pub(in crate::state) fn take_boxes(&mut self, viewpoint: ViewpointIndex, set: BoxSet) {
        let sets = self.boxes.entry(viewpoint).or_default();
        let boxes = set.persons.into_iter().flat_map(|person| {
            let id = person.person;
            person.cameras.into_iter().map(move |camera| (id, camera))
        });
        if let Some((_, known)) = sets.iter_mut().find(|(tick, _)| *tick == set.tick) {
            let room = MAX_BOXES.saturating_sub(known.len());
            known.extend(boxes.take(room));
            return;
        }
        if sets.len() >= MAX_BOX_SETS {
            sets.pop_front();
        }
        sets.push_back((set.tick, boxes.take(MAX_BOXES).collect()));
    }

    /// Records which id patches use for a person.
    pub(in crate::state) fn take_event(&mut self, event: &IdentityEvent) {
        let id = match event.change {
            Change::Recognise { old, .. } => old,
            _ => event.person,
        };
        if matches!(event.change, Change::Drop { .. }) || id == event.wire_id {
            self.ids.remove(&event.wire_id);
        } else if self.ids.len() < MAX_WIRE_IDS {
            self.ids.insert(event.wire_id, id);
        }
    }

    /// The ids of people, without data of single ticks.
    pub(in crate::state) fn checkpoint(&self) -> Self {
        Self {
            ids: self.ids.clone(),
            ..Self::default()
        }
    }

    /// Takes the inputs of a tick whose poses arrived; earlier ticks are dropped.
    pub(in crate::state) fn take_tick(&mut self, tick: Tick) -> TickEvidence {
        let mut found = self.ticks.remove(&tick).unwrap_or_default();
        self.ticks = self.ticks.split_off(&tick);
        self.newest = Some(tick);
        let published = |wire: PersonId| self.ids.get(&wire).copied().unwrap_or(wire);
        for (_, person, _) in &mut found.crops {
            *person = published(*person);
        }
        for sets in self.boxes.values() {
            let Some((at, boxes)) = nearest(sets, tick) else {
                continue;
            };
            found
                .boxes
                .extend(boxes.iter().map(|(person, camera)| FrameBox {
                    person: published(*person),
                    camera: camera.camera,
                    bounding_box: Some(camera.bounding_box.moved_on(&camera.rate, tick - *at)),
                    is_chosen: false,
                }));
        }
        mark_chosen(&mut found);
        found
    }
}

/// The newest set at or before `tick`; otherwise the first after it.
fn nearest<T>(sets: &VecDeque<(Tick, T)>, tick: Tick) -> Option<&(Tick, T)> {
    let before = sets
        .iter()
        .filter(|(at, _)| *at <= tick)
        .max_by_key(|(at, _)| *at);
    before.or_else(|| sets.iter().min_by_key(|(at, _)| *at))
}

/// Marks the boxes that edges cropped; adds an entry for crops without a box.
fn mark_chosen(evidence: &mut TickEvidence) {
    for (_, person, camera) in &evidence.crops {
        let is_it = |b: &&mut FrameBox| b.person == *person && b.camera == *camera;
        match evidence.boxes.iter_mut().find(is_it) {
            Some(found) => found.is_chosen = true,
            None => evidence.boxes.push(FrameBox {
                person: *person,
                camera: *camera,
                bounding_box: None,
                is_chosen: true,
            }),
        }
    }
}
