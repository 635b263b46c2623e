//! One step of an edge: the frames of a tick and fusion's boxes in, patches and sightings out.
//!
//! Per person the box is moved on to the tick, a camera chosen, the crop cut; all crops of the tick,
//! those of detections too, go through the network together; the maps are quantised, encoded and
//! shared out to messages. Cameras whose source is a file of keypoints have their maps drawn
//! instead, and cameras without pixels have them painted. Pure but for what network and detector do: no clock, no file, no socket.

mod batch;
mod camera;
mod error;
#[cfg(test)]
pub(crate) mod fixtures;
mod inference;
mod parts;
mod sighting;
#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::collections::BTreeMap;

use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::{
    BoxSet, CameraBox, Order, PatchSet, PersonBoxes, PersonPatch, Sighting, SightingSet,
};
use farfield_proto::patch::{Encoder, Maps, quantize};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::venue::parameters::CameraChoice;

use self::batch::Batch;
use self::camera::{EdgeCamera, cameras_of, check_shapes};
use self::sighting::Pending;
use crate::choose::{View, choose};
use crate::crop::{CropGeometry, enclosing_upright};
use crate::gaussian_maps::draw_maps;
use crate::source::{Content, Frame, MapCrop};

pub use error::PipelineError;
pub use inference::{Detection, InputTensor, KeypointNetwork, NetworkError, PersonDetector};
pub use parts::MESSAGE_BYTES;

/// Tilt of a box from which the legs get an upright crop of their own, radians (10 degrees): below,
/// one crop serves networks that were trained on people turned by up to 40 degrees.
const TWO_CROPS_FROM_RAD: f32 = 0.175;

/// A part of a step, for whoever measures how long each takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Choosing cameras, detecting, cutting crops.
    Crop,
    /// The network on all crops.
    Infer,
    /// Reading peaks, drawing, quantising and encoding maps.
    Encode,
}

/// What an edge has to say about one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeOutput {
    /// The persons with boxes that a camera sees, in at least one message.
    pub patch_sets: Vec<PatchSet>,
    /// The people found without boxes; empty when the edge did not look.
    pub sighting_sets: Vec<SightingSet>,
}

/// One person at this tick: who, in which camera, on which crops.
struct Tracked {
    person: PersonId,
    /// Position among the cameras of the viewpoint.
    camera: usize,
    /// Where that camera should see them.
    region: CameraBox,
    crops: Vec<CropGeometry>,
    crop_of_keypoint: Vec<u8>,
    /// Number of the first crop in the batch.
    input: usize,
}

/// The edge of one viewpoint.
pub struct Pipeline {
    viewpoint: ViewpointIndex,
    cameras: Vec<EdgeCamera>,
    keypoints: KeypointSet,
    floor: f32,
    choice: CameraChoice,
    batch: Option<Batch>,
    detector: Option<Box<dyn PersonDetector>>,
    encoder: Encoder,
    maps: Maps,
    session: SessionId,
    last_camera: BTreeMap<PersonId, CameraIndex>,
}

impl Pipeline {
    /// The edge of `viewpoint`. Without a `detector`, cameras with pictures give no sightings.
    ///
    /// # Errors
    /// [`PipelineError`] when the viewpoint does not exist, a camera gives pictures without a
    /// `network`, or the maps of the network or a source's `grid` do not fit the wire.
    pub fn new(
        venue: &Venue,
        viewpoint: ViewpointIndex,
        network: Option<Box<dyn KeypointNetwork>>,
        detector: Option<Box<dyn PersonDetector>>,
    ) -> Result<Self, PipelineError> {
        let cameras = cameras_of(venue, viewpoint)?;
        let keypoints = network
            .as_ref()
            .map_or_else(KeypointSet::coco17, |n| n.card().output.keypoints.clone());
        let batch = network.map(Batch::new);
        check_shapes(&cameras, &keypoints, batch.as_ref())?;
        Ok(Self {
            viewpoint,
            cameras,
            keypoints,
            floor: venue.parameters.link.floor as f32,
            choice: venue.parameters.boxes.camera_choice,
            batch,
            detector,
            encoder: Encoder::new(),
            maps: Maps::new(1, 1, 1),
            session: SessionId::default(),
            last_camera: BTreeMap::new(),
        })
    }

    /// Works on one tick. `frames` has one entry per camera of the viewpoint, in the venue's order,
    /// `None` for a camera that gave nothing.
    ///
    /// # Errors
    /// [`PipelineError`] when the frames or boxes do not belong to this viewpoint or the network
    /// fails. The pipeline can be used again.
    pub fn step(
        &mut self,
        frames: &[Option<Frame>],
        boxes: &BoxSet,
    ) -> Result<EdgeOutput, PipelineError> {
        self.step_marked(frames, boxes, &mut |_| {})
    }

    /// As [`Self::step`]; `mark` is told after each stage, for whoever measures.
    ///
    /// # Errors
    /// As [`Self::step`].
    pub fn step_marked(
        &mut self,
        frames: &[Option<Frame>],
        boxes: &BoxSet,
        mark: &mut dyn FnMut(Stage),
    ) -> Result<EdgeOutput, PipelineError> {
        let tick = self.check(frames, boxes)?.unwrap_or(boxes.tick);
        if boxes.session != self.session {
            self.session = boxes.session;
            self.last_camera.clear();
        }
        if let Some(batch) = &mut self.batch {
            batch.clear();
        }
        self.last_camera
            .retain(|person, _| boxes.persons.iter().any(|p| p.person == *person));
        let age = tick - boxes.tick;
        let tracked: Vec<Tracked> = boxes
            .persons
            .iter()
            .filter_map(|p| self.track(p, age, frames))
            .collect();
        let looks = boxes.order == Order::TrackAndSight && self.can_sight();
        let pending = if looks {
            self.detect(frames)?
        } else {
            Vec::new()
        };
        mark(Stage::Crop);
        if let Some(batch) = &mut self.batch {
            batch.infer()?;
        }
        mark(Stage::Infer);
        let mut sighting_sets = Vec::new();
        if looks {
            let (session, viewpoint) = (self.session, self.viewpoint);
            let head = SightingSet {
                session,
                tick,
                viewpoint,
                part: 0,
                parts: 1,
                sightings: Vec::new(),
            };
            sighting_sets = parts::sighting_sets(&head, self.sightings(&pending, frames));
        }
        let persons = tracked
            .into_iter()
            .filter_map(|t| self.patch(t, frames, boxes.tick))
            .collect();
        mark(Stage::Encode);
        let head = PatchSet {
            session: self.session,
            tick,
            viewpoint: self.viewpoint,
            part: 0,
            parts: 1,
            sighting_parts: sighting_sets.len() as u16,
            persons: Vec::new(),
        };
        Ok(EdgeOutput {
            patch_sets: parts::patch_sets(&head, persons),
            sighting_sets,
        })
    }

    /// The tick of the frames, if there are any; refuses what does not belong together.
    fn check(
        &self,
        frames: &[Option<Frame>],
        boxes: &BoxSet,
    ) -> Result<Option<Tick>, PipelineError> {
        if boxes.viewpoint != self.viewpoint {
            return Err(PipelineError::OtherViewpoint {
                got: boxes.viewpoint,
                expected: self.viewpoint,
            });
        }
        if frames.len() != self.cameras.len() {
            return Err(PipelineError::FrameCount {
                got: frames.len(),
                expected: self.cameras.len(),
            });
        }
        let mut tick = None;
        for (camera, frame) in self.cameras.iter().zip(frames) {
            let Some(frame) = frame else { continue };
            let expected = *tick.get_or_insert(frame.tick);
            if frame.tick != expected {
                let camera = camera.model.name().to_owned();
                return Err(PipelineError::MixedTicks {
                    camera,
                    got: frame.tick,
                    expected,
                });
            }
            if let Some(problem) = camera.mismatch(&frame.content, self.keypoints.len()) {
                return Err(PipelineError::WrongFrame {
                    camera: camera.model.name().to_owned(),
                    problem,
                });
            }
        }
        Ok(tick)
    }

    /// Chooses the camera for a person, and cuts the crops; `None` when no camera sees the person.
    fn track(
        &mut self,
        boxes: &PersonBoxes,
        age: i64,
        frames: &[Option<Frame>],
    ) -> Option<Tracked> {
        let mut at = Vec::with_capacity(self.cameras.len());
        let mut views = Vec::with_capacity(self.cameras.len());
        for (i, camera) in self
            .cameras
            .iter()
            .enumerate()
            .filter(|&(i, _)| frames[i].is_some())
        {
            if let Some(camera_box) = boxes.cameras.iter().find(|b| b.camera == camera.index) {
                at.push(i);
                views.push(View {
                    model: &camera.model,
                    camera_box: moved_on(camera_box, age),
                });
            }
        }
        let last = self.last_camera.get(&boxes.person);
        let last = last.and_then(|&index| at.iter().position(|&i| self.cameras[i].index == index));
        let chosen = choose(self.choice, &views, last)?;
        let (camera, region) = (at[chosen], views[chosen].camera_box);
        let bounding_box = region.bounding_box;
        self.last_camera
            .insert(boxes.person, self.cameras[camera].index);
        let EdgeCamera { model, drawing, .. } = &self.cameras[camera];
        let mut crop_of_keypoint = vec![0; self.keypoints.len()];
        if let Some(drawing) = drawing {
            // What is drawn does not depend on how the crop is turned.
            let crops = vec![CropGeometry::new(&bounding_box, drawing.shape)?];
            return Some(Tracked {
                person: boxes.person,
                camera,
                region,
                crops,
                crop_of_keypoint,
                input: 0,
            });
        }
        let (batch, Content::Image(image)) =
            (self.batch.as_mut()?, &frames[camera].as_ref()?.content)
        else {
            return None;
        };
        let mut crops = vec![CropGeometry::new(&bounding_box, batch.shape())?];
        if turned_by(bounding_box.rotation_rad) > TWO_CROPS_FROM_RAD {
            crops.push(CropGeometry::new(
                &enclosing_upright(&bounding_box),
                batch.shape(),
            )?);
            for (keypoint, crop) in crop_of_keypoint.iter_mut().enumerate() {
                *crop = u8::from(!self.keypoints.is_upper(keypoint));
            }
        }
        let inputs: Vec<usize> = crops
            .iter()
            .map(|crop| batch.push(image, model, crop))
            .collect();
        Some(Tracked {
            person: boxes.person,
            camera,
            region,
            crops,
            crop_of_keypoint,
            input: inputs[0],
        })
    }

    /// Whether this edge can find people without boxes at all.
    fn can_sight(&self) -> bool {
        let reads_pictures = self.detector.is_some() && self.batch.is_some();
        self.cameras
            .iter()
            .any(|c| c.drawing.is_some() || reads_pictures)
    }

    /// Runs the detector on every picture and puts the crops into the batch.
    fn detect(&mut self, frames: &[Option<Frame>]) -> Result<Vec<Pending>, PipelineError> {
        let mut pending = Vec::new();
        let (Some(detector), Some(batch)) = (&mut self.detector, &mut self.batch) else {
            return Ok(pending);
        };
        for (camera, frame) in self.cameras.iter().zip(frames) {
            if let Some(Frame {
                content: Content::Image(image),
                ..
            }) = frame
            {
                let detections = detector.detect(image)?;
                pending.extend(sighting::enqueue(
                    &detections,
                    image,
                    (camera.index, &camera.model),
                    batch,
                ));
            }
        }
        Ok(pending)
    }

    /// The sightings of all cameras, after inference.
    fn sightings(&self, pending: &[Pending], frames: &[Option<Frame>]) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        for (camera, frame) in self.cameras.iter().zip(frames) {
            if let Some(batch) = &self.batch {
                let of_camera = pending.iter().filter(|p| p.camera() == camera.index);
                sightings.extend(of_camera.map(|p| {
                    sighting::read(p, &camera.model, batch, self.keypoints.len(), self.floor)
                }));
            }
            let given = match frame.as_ref().map(|f| &f.content) {
                Some(Content::Keypoints(keypoints)) => Cow::Borrowed(&keypoints.persons[..]),
                Some(Content::Painted(painter)) => Cow::Owned(painter.persons()),
                Some(Content::Image(_)) | None => continue,
            };
            sightings.extend(sighting::from_persons(&given, camera.index, &camera.model));
        }
        sighting::bounded(sightings)
    }

    /// Packs the maps of one person.
    fn patch(
        &mut self,
        tracked: Tracked,
        frames: &[Option<Frame>],
        box_tick: Tick,
    ) -> Option<PersonPatch> {
        let EdgeCamera {
            index,
            model,
            drawing,
        } = &self.cameras[tracked.camera];
        let frame = frames[tracked.camera].as_ref()?;
        let first = tracked.crops.first()?.grid();
        match (&frame.content, drawing, &self.batch) {
            (Content::Keypoints(keypoints), Some(drawing), _) => {
                draw_maps(
                    &keypoints.peaks,
                    model,
                    &first,
                    drawing.sigma_cells,
                    &mut self.maps,
                );
            }
            (Content::Painted(painter), Some(drawing), _) => {
                self.maps.resize(
                    first.width.into(),
                    first.height.into(),
                    self.keypoints.len(),
                );
                let crop = MapCrop {
                    region: &tracked.region,
                    grid: &first,
                    sigma_cells: drawing.sigma_cells,
                    camera: model,
                    floor: quantize(self.floor),
                };
                painter.paint(&crop, &mut self.maps);
            }
            (Content::Image(_), None, Some(batch)) => {
                self.maps.resize(
                    first.width.into(),
                    first.height.into(),
                    self.keypoints.len(),
                );
                for (keypoint, &crop) in tracked.crop_of_keypoint.iter().enumerate() {
                    let map = batch.map(tracked.input + usize::from(crop), keypoint);
                    for (cell, &value) in self.maps.cells_mut(keypoint).iter_mut().zip(map) {
                        *cell = quantize(value);
                    }
                }
            }
            _ => return None,
        }
        Some(PersonPatch {
            person: tracked.person,
            camera: *index,
            box_tick,
            capture_offset_us: frame.capture_offset_us,
            crops: tracked.crops.iter().map(CropGeometry::grid).collect(),
            crop_of_keypoint: tracked.crop_of_keypoint,
            maps: self.encoder.encode(&self.maps, quantize(self.floor)),
        })
    }
}

/// The box and the projected joints of a person, moved on by `ticks`.
fn moved_on(camera_box: &CameraBox, ticks: i64) -> CameraBox {
    let n = ticks.max(0) as f32;
    let along = |p: [f32; 2]| [0, 1].map(|i| p[i] + n * camera_box.rate.center_px[i]);
    CameraBox {
        bounding_box: camera_box.bounding_box.moved_on(&camera_box.rate, ticks),
        torso_px: along(camera_box.torso_px),
        neck_px: along(camera_box.neck_px),
        ..*camera_box
    }
}

/// How far a rotation is from upright, 0 to pi.
fn turned_by(rotation_rad: f32) -> f32 {
    let turn = rotation_rad.rem_euclid(std::f32::consts::TAU);
    turn.min(std::f32::consts::TAU - turn)
}
