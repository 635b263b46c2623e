//! The interfaces of the keypoint network and the detector, independent of their backend.

use std::path::PathBuf;

#[cfg(feature = "network")]
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::id::CameraIndex;
use farfield_proto::model_card::{HeatmapCard, Letterbox};
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;

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

/// A part of a picture, upright, with the aspect of a detector's input; it can extend beyond the
/// picture.
///
/// In distorted pixels as recorded, from the outer corner of the first pixel (whose centre is at
/// 0.5).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorWindow {
    /// Left and top, distorted pixels from the outer corner.
    pub min_px: [f64; 2],
    /// Width and height, distorted pixels.
    pub size_px: [f64; 2],
}

impl DetectorWindow {
    /// The whole picture of `size_px` in an input of `input_px`, placed by `letterbox`.
    pub fn whole(size_px: [u32; 2], input_px: [u32; 2], letterbox: Letterbox) -> Self {
        let picture = size_px.map(f64::from);
        let input = input_px.map(f64::from);
        let pixels_per_input = (picture[0] / input[0]).max(picture[1] / input[1]);
        let size_px = input.map(|side| side * pixels_per_input);
        let min_px = match letterbox {
            Letterbox::TopLeft => [0.0; 2],
            Letterbox::Centre => [0, 1].map(|i| (picture[i] - size_px[i]) / 2.0),
        };
        Self { min_px, size_px }
    }

    /// Right and bottom, distorted pixels from the outer corner.
    pub fn max_px(&self) -> [f64; 2] {
        [0, 1].map(|i| self.min_px[i] + self.size_px[i])
    }

    /// Input pixels per pixel of the picture, for an input as wide as `input_px`.
    pub fn scale(&self, input_px: [u32; 2]) -> f64 {
        f64::from(input_px[0]) / self.size_px[0]
    }

    /// Whether a box (left, top, right, bottom) is inside, with a distance of at least `margin_px`
    /// to the edges. Edges outside a picture of `picture_px` (width and height) do not count,
    /// because the picture ends there.
    pub fn holds(&self, [l, t, r, b]: [f64; 4], margin_px: f64, picture_px: [u32; 2]) -> bool {
        let [left, top] = self.min_px;
        let [right, bottom] = self.max_px();
        let [width, height] = picture_px.map(f64::from);
        let after = |edge: f64, at: f64| edge <= 0.0 || at >= edge + margin_px;
        let before = |edge: f64, at: f64, end: f64| edge >= end || at <= edge - margin_px;
        after(left, l) && after(top, t) && before(right, r, width) && before(bottom, b, height)
    }

    /// The window as a box, in pixels with integer centres.
    #[cfg(feature = "network")]
    pub(crate) fn bounding_box(&self) -> BoundingBox {
        BoundingBox {
            center_px: [0, 1].map(|i| (self.min_px[i] + self.size_px[i] / 2.0 - 0.5) as f32),
            size_px: self.size_px.map(|side| side as f32),
            rotation_rad: 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_whole_picture_keeps_its_aspect_and_its_corner() {
        for (letterbox, left_px) in [(Letterbox::TopLeft, 0.0), (Letterbox::Centre, -420.0)] {
            let window = DetectorWindow::whole([1080, 1920], [416, 416], letterbox);
            let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|i| (a[i] - b[i]).abs() < 1e-9);
            assert!(near(window.min_px, [left_px, 0.0]) && near(window.size_px, [1920.0; 2]));
            assert!((window.scale([416, 416]) - 416.0 / 1920.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_box_at_the_edge_of_the_picture_is_inside() {
        let window = DetectorWindow {
            min_px: [0.0, 100.0],
            size_px: [400.0, 300.0],
        };
        let holds = |b| window.holds(b, 2.0, [1000, 400]);
        assert!(
            holds([0.0, 150.0, 50.0, 400.0]),
            "left and bottom of the picture"
        );
        assert!(!holds([0.0, 101.0, 50.0, 200.0]), "cut at the top");
        assert!(!holds([300.0, 150.0, 399.0, 200.0]), "cut at the right");
    }
}
