//! All crops of a tick, collected for one inference. Each worker cuts and processes its share.

use farfield_proto::camera::CameraModel;
use rayon::prelude::*;

use crate::crop::{CropGeometry, CropShape, Cropper, PixelFormat};
use crate::inference::{InputTensor, KeypointNetwork, NetworkError};
use crate::picture::Picture;

/// Most crops per call of the network: bounds its memory (at 192 x 256 about 19 MB of input). More
/// crops take several calls.
pub(super) const MAX_CROPS_PER_CALL: usize = 32;

/// A picture and its camera.
pub(super) type TakenPicture<'a> = (&'a Picture, &'a CameraModel);

/// A worker; workers run in parallel.
struct Worker {
    network: Box<dyn KeypointNetwork>,
    cropper: Cropper,
}

/// A crop and the index of its camera in the viewpoint.
struct Wanted {
    camera: usize,
    crop: CropGeometry,
}

/// The network with its input and output buffers, reused every tick.
pub struct Batch {
    /// At least one.
    workers: Vec<Worker>,
    /// Runs all crops in place of the workers' networks, if set.
    accelerator: Option<Box<dyn KeypointNetwork>>,
    shape: CropShape,
    format: PixelFormat,
    box_margin: f64,
    wanted: Vec<Wanted>,
    /// The first `cut` are in use; the others keep their memory.
    inputs: Vec<InputTensor>,
    cut: usize,
    maps: Vec<f32>,
    values_per_crop: usize,
}

impl Batch {
    /// A batch with one worker that uses `network`.
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

    /// Sets the number of parallel workers, at least one; returns the resulting number.
    ///
    /// # Errors
    /// If the network cannot be loaded again.
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

    /// Makes `accelerator`, with the same network, run all crops; the workers still cut them.
    /// `None` restores the workers.
    pub fn accelerate(&mut self, accelerator: Option<Box<dyn KeypointNetwork>>) {
        self.accelerator = accelerator;
    }

    /// Makes one worker do everything on the CPU, which gives the same bits on every computer.
    ///
    /// # Errors
    /// None, because there is always one worker.
    pub fn work_alone(&mut self) -> Result<(), NetworkError> {
        self.accelerator = None;
        self.set_workers(1).map(|_| ())
    }

    /// A second instance of the network; `None` if only one can exist.
    ///
    /// # Errors
    /// If it cannot be loaded again.
    pub(super) fn another(&self) -> Result<Option<Box<dyn KeypointNetwork>>, NetworkError> {
        self.workers[0].network.another()
    }

    pub(super) fn shape(&self) -> CropShape {
        self.shape
    }

    /// Growth of a detected box.
    pub(super) fn box_margin(&self) -> f64 {
        self.box_margin
    }

    /// Removes the crops of the last tick.
    pub(super) fn clear(&mut self) {
        self.wanted.clear();
        self.cut = 0;
    }

    /// Number of crops added since.
    pub(super) fn len(&self) -> usize {
        self.wanted.len()
    }

    /// Adds a crop of the camera at this index; returns its number for [`Self::map`].
    pub(super) fn push(&mut self, camera: usize, crop: CropGeometry) -> usize {
        self.wanted.push(Wanted { camera, crop });
        self.wanted.len() - 1
    }

    /// Cuts the new crops from the `pictures` of the cameras, in their order. Crops without a
    /// picture stay unknown.
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

    /// Runs the network on all cut crops. An accelerator that fails is not used again.
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

    /// Runs the network on this many empty crops, to measure its time.
    ///
    /// # Errors
    /// If the network fails.
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
