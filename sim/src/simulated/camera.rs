//! One camera of a scene as a source of frames.

use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use farfield_edge::source::{Frame, FrameContent, FrameSource, SourceError};
use farfield_proto::tick::Tick;
use farfield_proto::venue::SimulatedContent;
use image::RgbImage;

use crate::faults::{MapFaults, SceneCrowd};
use crate::render::{RenderSettings, Renderer};
use crate::scene::Scene;

/// Finished pictures in the queue: one while the next is rendered.
const AHEAD: usize = 1;

/// The frames of one camera, tick by tick.
pub struct SimulatedSource {
    frames: Frames,
    /// The next tick of the scene.
    next: Tick,
    end: Tick,
    /// The venue's tick at the scene's tick 0.
    first: Tick,
    camera: String,
}

enum Frames {
    /// Rendered by a thread that ends when the receiver is gone.
    Pixels {
        pictures: Receiver<RgbImage>,
        capture_offset_us: i32,
    },
    Maps(Box<MapFaults>),
}

impl SimulatedSource {
    /// Camera `camera` of the crowd's scene, over `ticks` of the scene; `first` is the venue's tick
    /// at the scene's tick 0. Cameras of one process share their crowd. Free-running cameras
    /// capture at an offset from their ticks; pictures have none of the scene's other faults.
    ///
    /// # Errors
    /// [`SourceError::Scene`] for an unknown camera, a scene with a mirror, which pictures cannot
    /// show, or if no thread can be started.
    pub fn new(
        crowd: &Arc<SceneCrowd>,
        camera: usize,
        content: SimulatedContent,
        ticks: Range<Tick>,
        first: Tick,
    ) -> Result<Self, SourceError> {
        let scene = crowd.scene();
        let Some(model) = scene.cameras().get(camera) else {
            return Err(SourceError::Scene {
                camera: camera.to_string(),
                problem: format!("the scene has {} cameras", scene.cameras().len()),
            });
        };
        let name = model.name().to_owned();
        if content == SimulatedContent::Pixels && !scene.mirrors().is_empty() {
            return Err(SourceError::Scene {
                camera: name,
                problem: "the scene has a `[[mirror]]`, which pictures cannot show: only maps and keypoints can".to_owned(),
            });
        }
        let maps = MapFaults::with_crowd(Arc::clone(crowd), camera);
        let (next, end) = (ticks.start, ticks.end);
        let frames = match content {
            SimulatedContent::Maps => Frames::Maps(Box::new(maps)),
            SimulatedContent::Pixels => {
                let capture_offset_us = maps.capture_offset_us();
                let reel = Reel {
                    scene: Arc::clone(scene),
                    camera,
                    ticks,
                    offset_s: f64::from(capture_offset_us) * 1e-6,
                };
                let pictures = reel.spawn().map_err(|error| SourceError::Scene {
                    camera: name.clone(),
                    problem: format!("its pictures cannot be rendered: {error}"),
                })?;
                Frames::Pixels {
                    pictures,
                    capture_offset_us,
                }
            }
        };
        Ok(Self {
            frames,
            next,
            end,
            first,
            camera: name,
        })
    }
}

impl FrameSource for SimulatedSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        if self.next >= self.end {
            return Ok(None);
        }
        let tick = self.next;
        self.next = tick + 1;
        let (content, capture_offset_us) = match &mut self.frames {
            Frames::Pixels {
                pictures,
                capture_offset_us,
            } => {
                let picture = pictures.recv().map_err(|_| SourceError::Scene {
                    camera: self.camera.clone(),
                    problem: format!("rendering its picture of tick {tick} failed"),
                })?;
                (FrameContent::Image(picture.into()), *capture_offset_us)
            }
            Frames::Maps(maps) => {
                let observation = maps.observe(tick);
                let offset_us = observation.capture_offset_us();
                (FrameContent::Painted(Arc::new(observation)), offset_us)
            }
        };
        Ok(Some(Frame {
            tick: tick + self.first.0,
            capture_offset_us,
            content,
        }))
    }
}

/// The pictures of one camera to render.
struct Reel {
    scene: Arc<Scene>,
    camera: usize,
    ticks: Range<Tick>,
    /// From a tick to its capture.
    offset_s: f64,
}

impl Reel {
    fn spawn(self) -> std::io::Result<Receiver<RgbImage>> {
        let (pictures, taken) = sync_channel(AHEAD);
        std::thread::Builder::new()
            .name("render".to_owned())
            .spawn(move || self.render(&pictures))?;
        Ok(taken)
    }

    /// Renders until all is done, or the receiver is gone.
    fn render(self, pictures: &SyncSender<RgbImage>) {
        let settings = RenderSettings::default();
        let Some(renderer) = Renderer::new(Arc::clone(&self.scene), self.camera, settings) else {
            return;
        };
        for tick in self.ticks.start.0..self.ticks.end.0 {
            let time_s = self.scene.time_s(Tick(tick)) + self.offset_s;
            if pictures.send(renderer.render(time_s)).is_err() {
                return;
            }
        }
    }
}
