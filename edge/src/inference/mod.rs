//! The interfaces of the keypoint network and the detector, independent of their backend.

mod window;

use std::path::PathBuf;

use farfield_proto::id::CameraIndex;
use farfield_proto::model_card::{HeatmapCard, Letterbox};
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;

pub use window::DetectorWindow;

use crate::picture::Picture;

/// One crop as a network's input: [3, height, width], normalised, in the card's channel order.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InputTensor {
    /// The values, channel by channel, row by row.
    pub values: Vec<f32>,
}

/// A network that turns crops into part confidence maps.
pub trait KeypointNetwork: Send {
    /// The network's input and output.
    fn card(&self) -> &HeatmapCard;

    /// The maps of all `inputs`, [inputs, keypoints, height, width], row by row.
    ///
    /// Equal inputs give equal bytes.
    ///
    /// # Errors
    /// [`NetworkError`] if the backend fails or returns a result that differs from the card.
    fn infer(&mut self, inputs: &[InputTensor]) -> Result<Vec<f32>, NetworkError>;

    /// A second instance for parallel use; `None` if only one can exist.
    ///
    /// # Errors
    /// [`NetworkError`] if it cannot be loaded again.
    fn another(&self) -> Result<Option<Box<dyn KeypointNetwork>>, NetworkError>;
}

/// The input of a detector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DetectorInput {
    /// Width and height of the input, pixels.
    pub size_px: [u32; 2],
    /// Position of a picture of another aspect ratio in the input.
    pub letterbox: Letterbox,
}

/// A detector of people in pictures.
pub trait PersonDetector: Send {
    /// Its input.
    fn input(&self) -> DetectorInput;

    /// The people in the part `window` of `picture`, highest score first, in its distorted pixels.
    ///
    /// # Errors
    /// [`NetworkError`] if the backend fails or returns a result that differs from the card.
    fn detect(
        &mut self,
        picture: &Picture,
        window: &DetectorWindow,
    ) -> Result<Vec<Detection>, NetworkError>;
}

/// One person detected in a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Upper left corner (x, y) of the box, distorted pixels.
    pub min_px: [f32; 2],
    /// Lower right corner (x, y) of the box, distorted pixels.
    pub max_px: [f32; 2],
    /// Confidence, 0 to 1.
    pub score: f32,
}

/// The people detected in one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraDetections {
    /// The camera.
    pub camera: CameraIndex,
    /// The tick of the picture.
    pub tick: Tick,
    /// The people, highest score first; none if there was no picture.
    pub people: Vec<Detection>,
}

/// Why a network cannot be loaded or run.
#[derive(Debug, thiserror::Error)]
pub enum NetworkError {
    /// No inference backend could be started.
    #[error("{problem}")]
    Backend {
        /// The attempts and their results.
        problem: String,
    },
    /// The model card cannot be used.
    #[error(transparent)]
    Card(#[from] FileError),
    /// The model file cannot be used or does not match its card.
    #[error("{}: {problem}", path.display())]
    Model {
        /// The model file.
        path: PathBuf,
        /// What was found and what was expected.
        problem: String,
    },
    /// The backend failed while running.
    #[error("{}: inference failed: {problem}", path.display())]
    Run {
        /// The model file.
        path: PathBuf,
        /// The backend's message.
        problem: String,
    },
    /// A network returned another number of values than its card states.
    #[error("the network gave {got} values, its card says {expected}")]
    Length {
        /// Number of values returned.
        got: usize,
        /// Number of values by the card and the batch.
        expected: usize,
    },
}
