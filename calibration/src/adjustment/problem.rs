//! What is adjusted: cameras, their freedoms, observations.

use super::camera_state::{CameraState, Observation};
use super::loss::Loss;
use super::path::Path;
use super::projection::PARAMETERS;

/// A group of a camera's numbers that is free or fixed as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Block {
    /// Rotation and centre.
    Pose,
    /// One factor on both focal lengths.
    Focal,
    /// The principal point.
    Principal,
    /// k1 alone.
    FirstRadial,
    /// k1, k2, p1, p2, k3.
    FiveCoefficients,
    /// All eight coefficients.
    EightCoefficients,
    /// The four of a fisheye.
    FisheyeCoefficients,
    /// The time of the pivot frame.
    TimeOffset,
    /// The frame rate.
    Rate,
}

impl Block {
    fn parameters(self) -> std::ops::Range<usize> {
        match self {
            Self::Pose => 0..6,
            Self::Focal => 6..7,
            Self::Principal => 7..9,
            Self::FirstRadial => 9..10,
            Self::FiveCoefficients => 9..14,
            Self::EightCoefficients => 9..17,
            Self::FisheyeCoefficients => 9..13,
            Self::TimeOffset => 17..18,
            Self::Rate => 18..19,
        }
    }
}

/// Which numbers of a camera may move, and how far from where they started (standard deviations of a prior).
///
/// Units of the parameters: radians and metres for the pose, shares for focal length and rate, pixels for the principal
/// point, seconds for the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Free {
    sigmas: [Option<f64>; PARAMETERS],
}

impl Free {
    /// Nothing moves.
    pub fn none() -> Self {
        Self {
            sigmas: [None; PARAMETERS],
        }
    }

    /// With `block` free, without a prior.
    #[must_use]
    pub fn with(self, block: Block) -> Self {
        self.with_prior(block, f64::INFINITY)
    }

    /// With `block` free, with a prior of standard deviation `sigma` about where it starts.
    #[must_use]
    pub fn with_prior(mut self, block: Block, sigma: f64) -> Self {
        for parameter in block.parameters() {
            self.sigmas[parameter] = Some(sigma);
        }
        self
    }

    /// With `block` fixed again.
    #[must_use]
    pub fn without(mut self, block: Block) -> Self {
        for parameter in block.parameters() {
            self.sigmas[parameter] = None;
        }
        self
    }

    /// The free parameters with the standard deviation of their prior (infinite: none).
    pub fn parameters(&self) -> impl Iterator<Item = (usize, f64)> + use<'_> {
        let free = self.sigmas.iter().enumerate();
        free.filter_map(|(parameter, sigma)| sigma.map(|sigma| (parameter, sigma)))
    }
}

/// A camera with its freedoms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjustedCamera {
    /// Where it is now.
    pub state: CameraState,
    /// Where priors pull it to: where it started.
    pub start: CameraState,
    /// What may move.
    pub free: Free,
}

impl AdjustedCamera {
    /// A camera whose priors, if any, hold it to `state`.
    pub fn new(state: CameraState, free: Free) -> Self {
        Self {
            state,
            start: state,
            free,
        }
    }
}

/// All that an adjustment needs.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// The cameras.
    pub cameras: Vec<AdjustedCamera>,
    /// What they saw.
    pub path: Path,
    /// The sights.
    pub observations: Vec<Observation>,
    /// How residuals count.
    pub loss: Loss,
}
