//! All crops of a tick, gathered for one inference. Every worker cuts its share of them, and runs it.

use farfield_proto::camera::CameraModel;
use rayon::prelude::*;

use crate::crop::{CropGeometry, CropShape, Cropper, PixelFormat};
use crate::inference::{InputTensor, KeypointNetwork, NetworkError};
use crate::picture::Picture;

/// Most crops of one call of the network: bounds its memory (at 192 x 256 about 19 MB of input).
/// More crops than this take several calls.
pub(super) const MAX_CROPS_PER_CALL: usize = 32;

/// A picture and the camera that it is of.
pub(super) type TakenPicture<'a> = (&'a Picture, &'a CameraModel);

/// One of those who work at the same time.
struct Worker {
    network: Box<dyn KeypointNetwork>,
    cropper: Cropper,
}

/// A crop, and the position of its camera at the viewpoint.
struct Wanted {
    camera: usize,
    crop: CropGeometry,
}

/// The network with its input and output buffers, used again every tick.
pub struct Batch {
    /// At least one.
    workers: Vec<Worker>,
    /// What runs all crops in place of the workers' networks, while it does.
    accelerator: Option<Box<dyn KeypointNetwork>>,
    shape: CropShape,
    format: PixelFormat,
    box_margin: f64,
    wanted: Vec<Wanted>,
    /// As many as are cut are in use, the others are kept for their memory.
    inputs: Vec<InputTensor>,
    cut: usize,
    maps: Vec<f32>,
    values_per_crop: usize,
}

impl Batch {
    /// With one worker, who has `network`.
    pub fn new(network: Box<dyn KeypointNetwork>) -> Self {
        let card = network.card();
        let (shape, format, box_margin) = (
            CropShape::of_card(card),
            PixelFormat::new(&card.input, &card.normalize),
            card.box_margin,
        );
        let cells: usize = shape.cells.map(usize::from).iter().product();
        Self {
            values_per_crop: card.output.keypoints.len() * cells,
            workers: vec![Worker {
                network,
                cropper: Cropper::default(),
            }],
            accelerator: None,
            shape,
            format,
            box_margin,
            wanted: Vec::new(),
            inputs: Vec::new(),
            cut: 0,
            maps: Vec::new(),
        }
    }

    /// Lets `workers` work at the same time, at least one; as many as there are then.
    ///
    /// # Errors
    /// When the network cannot be loaded again.
    pub fn set_workers(&mut self, workers: usize) -> Result<usize, NetworkError> {
        self.workers.truncate(workers.max(1));
        while self.workers.len() < workers
            && let Some(network) = self.another()?
        {
            self.workers.push(Worker {
                network,
                cropper: Cropper::default(),
            });
        }
        Ok(self.workers.len())
    }

    /// Lets `accelerator` run all crops, which has the same network; the workers cut them. `None`: as before.
    pub fn accelerate(&mut self, accelerator: Option<Box<dyn KeypointNetwork>>) {
        self.accelerator = accelerator;
    }

    /// Makes one worker do all on the processor: the same bits on every computer.
    ///
    /// # Errors
    /// None with one worker or more.
    pub fn work_alone(&mut self) -> Result<(), NetworkError> {
        self.accelerator = None;
        self.set_workers(1).map(|_| ())
    }

    /// The same network once more; `None` where there can only be one.
    ///
    /// # Errors
    /// When it cannot be loaded again.
    pub(super) fn another(&self) -> Result<Option<Box<dyn KeypointNetwork>>, NetworkError> {
        self.workers[0].network.another()
    }

    pub(super) fn shape(&self) -> CropShape {
        self.shape
    }

    /// What a detected box is grown by.
    pub(super) fn box_margin(&self) -> f64 {
        self.box_margin
    }

    /// Forgets the crops of the last tick.
    pub(super) fn clear(&mut self) {
        self.wanted.clear();
        self.cut = 0;
    }

    /// How many crops were pushed since.
    pub(super) fn len(&self) -> usize {
        self.wanted.len()
    }

    /// Adds a crop of the camera at that position; the number by which [`Self::map`] knows it.
    pub(super) fn push(&mut self, camera: usize, crop: CropGeometry) -> usize {
        self.wanted.push(Wanted { camera, crop });
        self.wanted.len() - 1
    }

    /// Cuts what was pushed since the last time out of the cameras' `pictures`, in their order. What has none stays unknown.
    pub(super) fn cut(&mut self, pictures: &[Option<TakenPicture<'_>>]) {
        let n = self.wanted.len();
        let [width, height] = self.shape.input_px;
        if self.inputs.len() < n {
            self.inputs.resize_with(n, InputTensor::default);
        }
        let (wanted, inputs) = (&self.wanted[self.cut..], &mut self.inputs[self.cut..n]);
        let share = wanted.len().div_ceil(self.workers.len()).max(1);
        let shares = wanted.par_chunks(share).zip(inputs.par_chunks_mut(share));
        let shares = shares.zip(self.workers.par_iter_mut());
        shares.for_each(|((wanted, inputs), worker)| {
            for (wanted, input) in wanted.iter().zip(inputs) {
                let (values, crop) = (&mut input.values, &wanted.crop);
                values.resize(3 * width * height, 0.0);
                match pictures.get(wanted.camera).copied().flatten() {
                    Some((picture, model)) => {
                        let cropper = &mut worker.cropper;
                        cropper.crop(picture, Some(model), crop, &self.format, values);
                    }
                    None => values.fill(0.0),
                }
            }
        });
        self.cut = n;
    }

    /// Runs the network on everything that was cut. An accelerator that fails is not asked again.
    pub(super) fn infer(&mut self) -> Result<(), NetworkError> {
        let inputs = &self.inputs[..self.cut];
        let values_per_crop = self.values_per_crop;
        self.maps.resize(inputs.len() * values_per_crop, 0.0);
        if let Some(accelerator) = &mut self.accelerator {
            match run(&mut **accelerator, inputs, values_per_crop, &mut self.maps) {
                Ok(()) => return Ok(()),
                Err(error) => {
                    tracing::warn!(%error, "the accelerator failed: the processor runs the network from now on");
                    self.accelerator = None;
                }
            }
        }
        let share = inputs.len().div_ceil(self.workers.len()).max(1);
        let maps = self.maps.par_chunks_mut(share * values_per_crop);
        let shares = inputs.par_chunks(share).zip(maps);
        let shares = shares.zip(self.workers.par_iter_mut());
        shares.try_for_each(|((inputs, maps), worker)| {
            run(&mut *worker.network, inputs, values_per_crop, maps)
        })
    }

    /// Runs the network on so many crops of nothing, to learn what it takes.
    ///
    /// # Errors
    /// When the network fails.
    pub fn rehearse(&mut self, crops: usize) -> Result<(), NetworkError> {
        let [width, height] = self.shape.input_px;
        self.clear();
        self.inputs.resize_with(crops, InputTensor::default);
        for input in &mut self.inputs {
            input.values.resize(3 * width * height, 0.0);
        }
        self.cut = crops;
        let outcome = self.infer();
        self.clear();
        outcome
    }

    /// The map of one keypoint of one crop, row by row.
    pub(super) fn map(&self, crop: usize, keypoint: usize) -> &[f32] {
        let cells = self.shape.cells.map(usize::from).iter().product::<usize>();
        &self.maps[crop * self.values_per_crop + keypoint * cells..][..cells]
    }
}

/// Runs `network` on `inputs`, in calls of bounded size.
fn run(
    network: &mut dyn KeypointNetwork,
    inputs: &[InputTensor],
    values_per_crop: usize,
    maps: &mut [f32],
) -> Result<(), NetworkError> {
    let calls = inputs.chunks(MAX_CROPS_PER_CALL);
    let maps = maps.chunks_mut(MAX_CROPS_PER_CALL * values_per_crop);
    for (inputs, maps) in calls.zip(maps) {
        let made = network.infer(inputs)?;
        if made.len() != maps.len() {
            return Err(NetworkError::Length {
                got: made.len(),
                expected: maps.len(),
            });
        }
        maps.copy_from_slice(&made);
    }
    Ok(())
}
