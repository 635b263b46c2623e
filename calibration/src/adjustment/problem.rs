//! The problem of an adjustment: cameras, their free parameters, observations.

use super::camera_state::{CameraState, Observation};
use super::path::Path;
use super::projection::PARAMETERS;

/// A group of a camera's parameters that are free or fixed together.
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

/// The free parameters of a camera, with the standard deviations of priors about their start.
///
/// Units of the parameters: radians and metres for the pose, shares for focal length and rate, pixels for the principal
/// point, seconds for the time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Free {
    sigmas: [Option<f64>; PARAMETERS],
}

impl Free {
    /// No free parameter.
    pub fn none() -> Self {
        Self {
            sigmas: [None; PARAMETERS],
        }
    }

    /// Frees `block` without a prior.
    #[must_use]
    pub fn with(self, block: Block) -> Self {
        self.with_prior(block, f64::INFINITY)
    }

    /// Frees `block` with a prior of standard deviation `sigma` about its start.
    #[must_use]
    pub fn with_prior(mut self, block: Block, sigma: f64) -> Self {
        for parameter in block.parameters() {
            self.sigmas[parameter] = Some(sigma);
        }
        self
    }

    /// Fixes `block`.
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

/// A camera with its free parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdjustedCamera {
    /// The current state.
    pub state: CameraState,
    /// The start, which is the mean of priors.
    pub start: CameraState,
    /// The free parameters.
    pub free: Free,
}

impl AdjustedCamera {
    /// A camera whose priors, if any, have the mean `state`.
    pub fn new(state: CameraState, free: Free) -> Self {
        Self {
            state,
            start: state,
            free,
        }
    }
}

/// All inputs of an adjustment.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// The cameras.
    pub cameras: Vec<AdjustedCamera>,
    /// The observed points.
    pub path: Path,
    /// The sights.
    pub observations: Vec<Observation>,
    /// The loss of residuals.
    pub loss: Loss,
}

/// A robust loss rho of the squared residual s (in standard deviations, over both image axes); its cost is 1/2 rho(s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Least squares: rho = s.
    Squared,
    /// Cauchy: rho = c2 ln(1 + s / c2), with c in standard deviations.
    Cauchy(f64),
    /// Huber: s up to c2, then 2 c sqrt(s) - c2, with c in standard deviations.
    Huber(f64),
}

impl Loss {
    /// rho(s) and its derivative, which is the weight of the residual in the normal equations.
    pub fn value_and_weight(self, s: f64) -> (f64, f64) {
        match self {
            Self::Squared => (s, 1.0),
            Self::Cauchy(c) => {
                let ratio = s / (c * c);
                (c * c * libm::log1p(ratio), 1.0 / (1.0 + ratio))
            }
            Self::Huber(c) if s <= c * c => (s, 1.0),
            Self::Huber(c) => {
                let root = s.sqrt();
                (2.0 * c * root - c * c, c / root)
            }
        }
    }
}
