//! What is adjusted: cameras, their freedoms, observations.

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
use nalgebra::{UnitQuaternion, Vector3};

use super::loss::Loss;
use super::path::Path;
use super::projection::PARAMETERS;

/// One camera as the adjustment holds it.
///
/// A point X of the world is seen from R (X - C); time in seconds is `pivot_s + (frame - pivot_frame) period_s`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraState {
    /// R: world axes to camera axes.
    pub camera_from_world: UnitQuaternion<f64>,
    /// C: the pinhole in the world, metres (or units of the first baseline, before alignment).
    pub center_w: Vector3<f64>,
    /// Pinhole, pixels.
    pub intrinsics: Intrinsics,
    /// Lens, as k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV.
    pub distortion: [f64; 8],
    /// Time of frame `pivot_frame`, seconds.
    pub pivot_s: f64,
    /// The frame at which time and rate do not mix: about the middle of what the camera saw.
    pub pivot_frame: f64,
    /// Time from frame to frame, seconds.
    pub period_s: f64,
}

impl CameraState {
    /// A camera at the origin that looks along z, at one frame per second.
    pub fn at_origin(intrinsics: Intrinsics, distortion: &Distortion) -> Self {
        let d = distortion;
        Self {
            camera_from_world: UnitQuaternion::identity(),
            center_w: Vector3::zeros(),
            intrinsics,
            distortion: [d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6],
            pivot_s: 0.0,
            pivot_frame: 0.0,
            period_s: 1.0,
        }
    }

    /// The state of a calibrated camera, at one frame per second.
    pub fn of_model(model: &CameraModel) -> Self {
        let pose = model.camera_from_world().isometry();
        Self {
            camera_from_world: pose.rotation,
            center_w: model.center().coordinates_m().coords,
            ..Self::at_origin(*model.intrinsics(), model.distortion())
        }
    }

    /// The lens as proto has it.
    pub fn lens(&self) -> Distortion {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.distortion;
        Distortion {
            k1,
            k2,
            p1,
            p2,
            k3,
            k4,
            k5,
            k6,
        }
    }

    /// Time of a frame, seconds.
    pub fn time_s(&self, frame: f64) -> f64 {
        self.pivot_s + (frame - self.pivot_frame) * self.period_s
    }
}

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

/// One sight of the point by one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Index of the camera.
    pub camera: usize,
    /// Index of the point, where the path is a set of points.
    pub point: usize,
    /// Frame of the camera, where the path is a curve in time.
    pub frame: f64,
    /// Distorted pixels.
    pub px: [f64; 2],
    /// Standard deviation of each coordinate, pixels.
    pub sigma_px: f64,
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
