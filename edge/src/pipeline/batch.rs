//! All crops of a tick, gathered for one inference.

use farfield_proto::camera::CameraModel;
use image::RgbImage;

use crate::crop::{CropGeometry, CropShape, Cropper, PixelFormat};
use crate::inference::{InputTensor, KeypointNetwork, NetworkError};

/// Most crops of one call of the network: bounds its memory (at 192 x 256 about 19 MB of input).
/// More crops than this take several calls.
pub(super) const MAX_CROPS_PER_CALL: usize = 32;

/// The network with its input and output buffers, used again every tick.
pub(super) struct Batch {
    network: Box<dyn KeypointNetwork>,
    shape: CropShape,
    format: PixelFormat,
    cropper: Cropper,
    /// The first `n` are in use, the others are kept for their memory.
    inputs: Vec<InputTensor>,
    n: usize,
    maps: Vec<f32>,
}

impl Batch {
    pub(super) fn new(network: Box<dyn KeypointNetwork>) -> Self {
        let card = network.card();
        let (shape, format) = (
            CropShape::of_card(card),
            PixelFormat::new(&card.input, &card.normalize),
        );
        let (cropper, inputs, maps) = (Cropper::default(), Vec::new(), Vec::new());
        Self {
            network,
            shape,
            format,
            cropper,
            inputs,
            n: 0,
            maps,
        }
    }

    pub(super) fn shape(&self) -> CropShape {
        self.shape
    }

    /// What a detected box is grown by.
    pub(super) fn box_margin(&self) -> f64 {
        self.network.card().box_margin
    }

    /// Forgets the crops of the last tick.
    pub(super) fn clear(&mut self) {
        self.n = 0;
    }

    /// How many crops were pushed since.
    pub(super) fn len(&self) -> usize {
        self.n
    }

    /// Adds a crop; the number by which [`Self::map`] knows it.
    pub(super) fn push(
        &mut self,
        image: &RgbImage,
        camera: &CameraModel,
        crop: &CropGeometry,
    ) -> usize {
        if self.inputs.len() == self.n {
            self.inputs.push(InputTensor::default());
        }
        let [width, height] = self.shape.input_px;
        let values = &mut self.inputs[self.n].values;
        values.resize(3 * width * height, 0.0);
        self.cropper
            .crop(image, Some(camera), crop, &self.format, values);
        self.n += 1;
        self.n - 1
    }

    /// Runs the network on everything that was pushed.
    pub(super) fn infer(&mut self) -> Result<(), NetworkError> {
        self.maps.clear();
        for inputs in self.inputs[..self.n].chunks(MAX_CROPS_PER_CALL) {
            let maps = self.network.infer(inputs)?;
            let expected = inputs.len() * self.values_per_crop();
            if maps.len() != expected {
                return Err(NetworkError::Length {
                    got: maps.len(),
                    expected,
                });
            }
            self.maps.extend_from_slice(&maps);
        }
        Ok(())
    }

    /// The map of one keypoint of one crop, row by row.
    pub(super) fn map(&self, crop: usize, keypoint: usize) -> &[f32] {
        let cells = self.shape.cells.map(usize::from).iter().product::<usize>();
        &self.maps[crop * self.values_per_crop() + keypoint * cells..][..cells]
    }

    fn values_per_crop(&self) -> usize {
        let [width, height] = self.shape.cells.map(usize::from);
        self.network.card().output.keypoints.len() * width * height
    }
}
