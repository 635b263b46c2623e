//! One step of an edge: from the frames of a tick and fusion's boxes to patches and sightings.
//!
//! For each person the box is moved to the tick, a camera is chosen and the crop is cut. All crops
//! of the tick, including those of detections, go through the network in one batch. The maps are
//! quantised, encoded and split into messages. For cameras with keypoint files the maps are drawn
//! ([`crate::gaussian_maps`]). For cameras simulated without pixels the source paints them. Except
//! for the network and the detector this is pure: no clock, no file, no socket.

mod batch;
mod camera;
mod detection_pass;
mod error;
mod map_encoder;
mod parts;
mod sighting;
#[cfg(test)]
mod tests;
mod tracked;
mod viewpoint_detector;

use std::collections::BTreeMap;

use farfield_proto::id::{CameraIndex, PersonId, SessionId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::live::PatchTiming;
use farfield_proto::message::{BoxSet, PatchSet, PersonBoxes, PersonPatch, SightingSet};
use farfield_proto::patch::{CompressionLevel, Maps, quantize};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_proto::venue::parameters::CameraChoice;
use farfield_proto::wire;

use self::batch::TakenPicture;
use self::camera::{EdgeCamera, cameras_of, check_shapes};
use self::map_encoder::MapEncoder;
use self::tracked::{Tracked, is_turned};
use self::viewpoint_detector::TiledDetector;
use crate::crop::CropGeometry;
use crate::gaussian_maps::draw_maps;
use crate::inference::{CameraDetections, KeypointNetwork, PersonDetector};
use crate::source::{Frame, FrameContent, MapCrop};

pub use batch::Batch;
pub use camera::BeyondView;
pub use error::PipelineError;
#[cfg(feature = "study")]
pub use map_encoder::StandIn;
pub use viewpoint_detector::ViewpointDetector;

/// A measured part of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EdgeStage {
    /// Choosing cameras, cutting crops of persons with boxes.
    Crop,
    /// The detection pass: detecting people without boxes, cutting their crops.
    Detect,
    /// The network on all crops.
    Infer,
    /// Reading peaks, drawing, quantising and encoding maps.
    Encode,
}

/// What an edge sends for one tick.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeOutput {
    /// The persons with boxes that a camera sees; at least one message.
    pub patch_sets: Vec<PatchSet>,
    /// The people detected without boxes; empty without a detection pass.
    pub sighting_sets: Vec<SightingSet>,
}

impl EdgeOutput {
    /// Adds the sightings of the same tick, which were made separately.
    pub fn add_sightings(&mut self, sets: Vec<SightingSet>) {
        for set in &mut self.patch_sets {
            set.sighting_parts = sets.len() as u16;
        }
        self.sighting_sets = sets;
    }
}

/// The edge of one viewpoint.
pub struct EdgePipeline {
    viewpoint: ViewpointIndex,
    cameras: Vec<EdgeCamera>,
    keypoints: KeypointSet,
    choice: CameraChoice,
    batch: Option<Batch>,
    detector: Option<ViewpointDetector>,
    ticks_per_pass: i64,
    encoder: MapEncoder,
    maps: Maps,
    session: SessionId,
    last_camera: BTreeMap<PersonId, CameraIndex>,
    detection_share: f64,
    second_crops: bool,
    tracked_crops: usize,
    message_version: u8,
}

impl EdgePipeline {
    /// The edge of `viewpoint`. Without a `detector`, cameras with pictures give no sightings.
    ///
    /// # Errors
    /// [`PipelineError`] if the viewpoint does not exist, a camera delivers pictures without a
    /// `network`, or the maps of the network or a source's `grid` exceed the limits of messages.
    pub fn new(
        venue: &Venue,
        viewpoint: ViewpointIndex,
        network: Option<Box<dyn KeypointNetwork>>,
        detector: Option<Box<dyn PersonDetector>>,
    ) -> Result<Self, PipelineError> {
        let cameras = cameras_of(venue, viewpoint)?;
        let keypoints = network
            .as_ref()
            .map_or(&venue.keypoints, |n| &n.card().output.keypoints)
            .clone();
        let batch = network.map(Batch::new);
        check_shapes(venue, &cameras, &keypoints, batch.as_ref())?;
        let ticks_per_pass = venue.parameters.births.ticks_per_look(venue.rate_hz);
        let detector = detector.map(|detector| {
            let indices = cameras.iter().map(|camera| camera.index).collect();
            ViewpointDetector::new(TiledDetector::new(venue, detector), indices, ticks_per_pass)
        });
        let level = venue.parameters.link.quality;
        let level = level.unwrap_or(CompressionLevel::LOSSLESS);
        Ok(Self {
            viewpoint,
            cameras,
            keypoints,
            choice: venue.parameters.boxes.camera_choice,
            batch,
            detector,
            ticks_per_pass,
            encoder: MapEncoder::new(level),
            maps: Maps::new(1, 1, 1),
            session: SessionId::default(),
            last_camera: BTreeMap::new(),
            detection_share: 0.0,
            second_crops: true,
            tracked_crops: 0,
            message_version: wire::VERSION,
        })
    }

    /// Processes one tick. `frames` has one entry per camera of the viewpoint, in the venue's
    /// order, `None` for a missing frame. `mark` is called after each stage, for time measurements.
    ///
    /// # Errors
    /// [`PipelineError`] if the frames have another tick, frames or boxes do not belong to this
    /// viewpoint, or the network fails. The pipeline remains usable.
    pub fn step(
        &mut self,
        frames: &[Option<Frame>],
        request: &StepRequest<'_>,
        mark: &mut dyn FnMut(EdgeStage),
    ) -> Result<EdgeOutput, PipelineError> {
        self.check(frames, request)?;
        let StepRequest {
            tick,
            boxes,
            detection_cameras,
            ..
        } = *request;
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
        let persons = boxes.persons.iter();
        let requested = persons.filter(|p| request.includes(p.person));
        let tracked = requested.filter_map(|p| self.track(p, age, frames));
        let tracked: Vec<Tracked> = tracked.collect();
        self.tracked_crops = tracked.iter().map(|it| it.crops.len()).sum();
        self.cut(frames);
        mark(EdgeStage::Crop);
        let detects = !detection_cameras.is_empty() && self.can_sight(request.detections);
        let n_tracked = self.batch.as_ref().map_or(0, Batch::len);
        let pending = if detects {
            self.detect(frames, request)?
        } else {
            Vec::new()
        };
        self.cut(frames);
        let n_crops = self.batch.as_ref().map_or(0, Batch::len);
        self.detection_share = (n_crops - n_tracked) as f64 / n_crops.max(1) as f64;
        mark(EdgeStage::Detect);
        if let Some(batch) = &mut self.batch {
            batch.infer()?;
        }
        mark(EdgeStage::Infer);
        let mut sighting_sets = Vec::new();
        if detects {
            let (session, viewpoint) = (self.session, self.viewpoint);
            let head = SightingSet {
                session,
                tick,
                viewpoint,
                part: 0,
                parts: 1,
                sightings: Vec::new(),
            };
            let sightings = self.sightings(&pending, frames, detection_cameras);
            sighting_sets = parts::sighting_sets(&head, sightings, self.message_version);
        }
        let persons = tracked
            .into_iter()
            .filter_map(|t| self.patch(t, frames, boxes.tick))
            .collect();
        mark(EdgeStage::Encode);
        let head = PatchSet {
            session: self.session,
            tick,
            viewpoint: self.viewpoint,
            part: 0,
            parts: 1,
            sighting_parts: sighting_sets.len() as u16,
            timing: request.timing,
            persons: Vec::new(),
        };
        Ok(EdgeOutput {
            patch_sets: parts::patch_sets(&head, persons),
            sighting_sets,
        })
    }

    /// Cuts the waiting crops.
    fn cut(&mut self, frames: &[Option<Frame>]) {
        let Some(batch) = &mut self.batch else {
            return;
        };
        let picture = |(frame, camera)| -> Option<TakenPicture<'_>> {
            let (frame, camera): (&Option<Frame>, &EdgeCamera) = (frame, camera);
            match &frame.as_ref()?.content {
                FrameContent::Image(image) => Some((image, &camera.model)),
                FrameContent::Keypoints(_) | FrameContent::Painted(_) => None,
            }
        };
        let pictures: Vec<Option<TakenPicture<'_>>> =
            frames.iter().zip(&self.cameras).map(picture).collect();
        batch.cut(&pictures);
    }

    /// The networks; `None` if no camera delivers pictures.
    pub fn batch(&mut self) -> Option<&mut Batch> {
        self.batch.as_mut()
    }

    /// Separates the detector, and a pipeline with its own network that makes sightings of detected
    /// people. `None` without a detector, or if the network cannot be loaded twice.
    ///
    /// # Errors
    /// [`PipelineError`] if the network cannot be loaded again.
    pub fn detach_detection(&mut self) -> Result<Option<(ViewpointDetector, Self)>, PipelineError> {
        let (Some(_), Some(batch)) = (&self.detector, &self.batch) else {
            return Ok(None);
        };
        let Some(network) = batch.another()? else {
            return Ok(None);
        };
        let sighter = Self {
            viewpoint: self.viewpoint,
            cameras: self.cameras.clone(),
            keypoints: self.keypoints.clone(),
            choice: self.choice,
            batch: Some(Batch::new(network)),
            detector: None,
            ticks_per_pass: self.ticks_per_pass,
            encoder: MapEncoder::new(CompressionLevel::LOSSLESS),
            maps: Maps::new(1, 1, 1),
            session: SessionId::default(),
            last_camera: BTreeMap::new(),
            detection_share: 0.0,
            second_crops: true,
            tracked_crops: 0,
            message_version: self.message_version,
        };
        Ok(self.detector.take().map(|detector| (detector, sighter)))
    }

    /// Sets the compression level of the next steps. Initially it is the venue's `[link] quality`,
    /// or else [`CompressionLevel::LOSSLESS`].
    pub fn set_compression_level(&mut self, level: CompressionLevel) {
        self.encoder.set_level(level);
    }

    /// Whether the legs of tilted people get a second, upright crop in the next steps; initially
    /// true.
    pub fn set_second_crops(&mut self, second_crops: bool) {
        self.second_crops = second_crops;
    }

    /// Sets the message version of the next steps, which determines how much fits one message.
    /// Initially [`wire::VERSION`].
    pub fn set_message_version(&mut self, version: u8) {
        self.message_version = version;
    }

    /// Replaces the codec by `stand_in` from now on, at every compression level.
    #[cfg(feature = "study")]
    pub fn set_stand_in(&mut self, stand_in: Box<dyn StandIn>) {
        self.encoder.set_stand_in(stand_in);
    }

    /// Share of people without boxes in the crops of the last inference, 0 to 1.
    pub fn detection_share(&self) -> f64 {
        self.detection_share
    }

    /// Crops of people with boxes in the last step.
    pub fn tracked_crops(&self) -> usize {
        self.tracked_crops
    }

    /// Number of these people with a possible second crop in a step.
    pub fn count_second_crops(persons: &[PersonBoxes]) -> usize {
        let may_have_two = |person: &&PersonBoxes| person.cameras.iter().any(is_turned);
        persons.iter().filter(may_have_two).count()
    }

    /// The content left out so far, for each camera that showed people beyond its used view.
    pub fn beyond_view(&self) -> impl Iterator<Item = (&str, BeyondView)> {
        self.cameras
            .iter()
            .filter(|camera| !camera.beyond_view.is_none())
            .map(|camera| (camera.model.name(), camera.beyond_view))
    }

    /// Refuses frames and boxes that do not belong together.
    fn check(
        &self,
        frames: &[Option<Frame>],
        request: &StepRequest<'_>,
    ) -> Result<(), PipelineError> {
        if request.boxes.viewpoint != self.viewpoint {
            return Err(PipelineError::OtherViewpoint {
                got: request.boxes.viewpoint,
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
        match tick {
            Some(got) if got != request.tick => Err(PipelineError::OtherTick {
                got,
                expected: request.tick,
            }),
            _ => Ok(()),
        }
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
            ..
        } = &self.cameras[tracked.camera];
        let frame = frames[tracked.camera].as_ref()?;
        let first = tracked.crops.first()?.grid();
        match (&frame.content, drawing, &self.batch) {
            (FrameContent::Keypoints(keypoints), Some(drawing), _) => {
                draw_maps(
                    &keypoints.peaks,
                    model,
                    &first,
                    drawing.sigma_cells,
                    &mut self.maps,
                );
            }
            (FrameContent::Painted(painter), Some(drawing), _) => {
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
                    floor: self.encoder.floor(),
                };
                painter.paint(&crop, &mut self.maps);
            }
            (FrameContent::Image(_), None, Some(batch)) => {
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
        let maps = self.encoder.encode(&mut self.maps);
        Some(PersonPatch {
            person: tracked.person,
            camera: *index,
            box_tick,
            capture_offset_us: frame.capture_offset_us,
            crops: tracked.crops.iter().map(CropGeometry::grid).collect(),
            crop_of_keypoint: tracked.crop_of_keypoint,
            maps,
        })
    }
}

/// The pipeline's task at a tick: in lock-step all that fusion requests, in live mode what time and
/// link allow.
#[derive(Debug, Clone, Copy)]
pub struct StepRequest<'a> {
    /// The tick of the frames.
    pub tick: Tick,
    /// Expected positions of people, moved to the frames' tick if they are for another one.
    pub boxes: &'a BoxSet,
    /// The cameras of this tick's detection pass; empty without a pass.
    pub detection_cameras: &'a [CameraIndex],
    /// Detections of an earlier tick; if present, the detector does not run now.
    pub detections: Option<&'a [CameraDetections]>,
    /// The persons with boxes to process, ascending; `None` for all.
    pub persons: Option<&'a [PersonId]>,
    /// Placeholder for the timing that is set on sending; it counts towards the message's size.
    pub timing: Option<PatchTiming>,
}

impl<'a> StepRequest<'a> {
    /// All that fusion requests in `boxes`, at their tick.
    pub fn of(boxes: &'a BoxSet) -> Self {
        Self {
            tick: boxes.tick,
            boxes,
            detection_cameras: &boxes.detection_cameras,
            detections: None,
            persons: None,
            timing: None,
        }
    }

    pub(super) fn includes(&self, person: PersonId) -> bool {
        self.persons
            .is_none_or(|persons| persons.binary_search(&person).is_ok())
    }
}
