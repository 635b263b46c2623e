//! The state of a camera in an adjustment, and its observations.

use farfield_proto::camera::{CameraModel, Distortion, Intrinsics, LensModel};
use nalgebra::{UnitQuaternion, Vector3};

/// The state of one camera in the adjustment.
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
    /// Lens: k1, k2, p1, p2, k3, k4, k5, k6 of OpenCV; for a fisheye k1, k2, k3, k4 of its model, then zeros.
    pub distortion: [f64; 8],
    /// Whether the lens is OpenCV's fisheye.
    pub is_fisheye: bool,
    /// Time of frame `pivot_frame`, seconds.
    pub pivot_s: f64,
    /// The frame at which time and rate are independent: near the middle of the camera's sights.
    pub pivot_frame: f64,
    /// Time between frames, seconds.
    pub period_s: f64,
}

impl CameraState {
    /// A camera at the origin that looks along z, at one frame per second.
    pub fn at_origin(intrinsics: Intrinsics, lens: impl Into<LensModel>) -> Self {
        let lens = lens.into();
        let distortion = match &lens {
            LensModel::Rational(d) => [d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6],
            LensModel::KannalaBrandt([k1, k2, k3, k4]) => [*k1, *k2, *k3, *k4, 0.0, 0.0, 0.0, 0.0],
        };
        Self {
            camera_from_world: UnitQuaternion::identity(),
            center_w: Vector3::zeros(),
            intrinsics,
            distortion,
            is_fisheye: lens.is_fisheye(),
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
            ..Self::at_origin(*model.intrinsics(), *model.lens())
        }
    }

    /// The lens in the form of `farfield_proto`.
    pub fn lens(&self) -> LensModel {
        let [k1, k2, p1, p2, k3, k4, k5, k6] = self.distortion;
        if self.is_fisheye {
            return LensModel::KannalaBrandt([k1, k2, p1, p2]);
        }
        LensModel::Rational(Distortion {
            k1,
            k2,
            p1,
            p2,
            k3,
            k4,
            k5,
            k6,
        })
    }

    /// Time of a frame, seconds.
    pub fn time_s(&self, frame: f64) -> f64 {
        self.pivot_s + (frame - self.pivot_frame) * self.period_s
    }
}

/// One sight of the point in one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Index of the camera.
    pub camera: usize,
    /// Index of the point, if the path is a set of points.
    pub point: usize,
    /// Frame of the camera, if the path is a curve in time.
    pub frame: f64,
    /// Distorted pixels.
    pub px: [f64; 2],
    /// Standard deviation of each coordinate, pixels.
    pub sigma_px: f64,
    /// Velocity of the point in the picture, pixels per second of the camera's clock, if the path is a set of points: it gives
    /// the sight at another clock offset. Zero if it is not known, and along a curve.
    pub velocity: [f64; 2],
}
