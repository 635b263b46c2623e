//! One camera in a form common to all formats, and the remarks of an import.

use std::f64::consts::FRAC_PI_2;
use std::fmt;

pub use farfield_proto::camera::LensModel;
use farfield_proto::camera::{CameraError, CameraModel, Distortion, Intrinsics};
use farfield_proto::frames::Transform;
use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use serde::Serialize;

/// Whether the coefficients have no effect.
pub(super) fn all_zero(coefficients: &[f64]) -> bool {
    coefficients.iter().all(|&c| c == 0.0)
}

/// One camera: name, picture size, lens and pose. Pixels as in [`farfield_proto::frames::Pixel`]: (0, 0) is the centre of
/// the first pixel. The camera looks along +z with x right and y down.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRecord {
    /// Its name in the file.
    pub name: String,
    /// Width and height of the picture, pixels.
    pub size_px: [u32; 2],
    /// Focal lengths and principal point.
    pub intrinsics: Intrinsics,
    /// The lens.
    pub lens: LensModel,
    /// World metres to camera metres; `None` in a file of intrinsics alone.
    pub camera_from_world: Option<Isometry3<f64>>,
}

impl CameraRecord {
    /// The camera of the same pictures after `quarters` clockwise turns by 90 degrees; lens and pose turn with them.
    #[must_use]
    pub fn turned(&self, quarters: u32) -> Self {
        (0..quarters % 4).fold(self.clone(), |camera, _| camera.turned_once())
    }

    /// Turns right into down: (x, y) from the principal point becomes (-y, x).
    fn turned_once(self) -> Self {
        let [width, height] = self.size_px;
        let k = self.intrinsics;
        let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2);
        let turn = Isometry3::from_parts(Translation3::identity(), quarter);
        Self {
            size_px: [height, width],
            intrinsics: Intrinsics {
                fx_px: k.fy_px,
                fy_px: k.fx_px,
                cx_px: f64::from(height) - 1.0 - k.cy_px,
                cy_px: k.cx_px,
            },
            lens: match self.lens {
                LensModel::Rational(d) => LensModel::Rational(Distortion {
                    p1: d.p2,
                    p2: -d.p1,
                    ..d
                }),
                same_around_its_axis @ LensModel::KannalaBrandt(_) => same_around_its_axis,
            },
            camera_from_world: self.camera_from_world.map(|pose| turn * pose),
            name: self.name,
        }
    }
}

/// How certain a remark of an import is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(into = "&'static str")]
pub enum RemarkKind {
    /// The file does not state it, and a value was assumed.
    Assumed,
    /// The numbers leave no doubt, and the value was corrected.
    Corrected,
    /// The numbers contradict the file, and the remark names the option that would change it; or the written file stores less
    /// than was read. Nothing was changed.
    Doubtful,
}

impl RemarkKind {
    /// The name in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Assumed => "assumed",
            Self::Corrected => "corrected",
            Self::Doubtful => "doubtful",
        }
    }
}

impl From<RemarkKind> for &'static str {
    fn from(kind: RemarkKind) -> Self {
        kind.name()
    }
}

/// One fact that the user of a converted file must know.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Remark {
    /// How certain it is.
    pub kind: RemarkKind,
    /// The camera concerned; `None`: all cameras.
    pub camera: Option<String>,
    /// A sentence for the user.
    pub text: String,
}

impl Remark {
    /// A remark about all cameras.
    pub fn of_all(kind: RemarkKind, text: impl Into<String>) -> Self {
        Self {
            kind,
            camera: None,
            text: text.into(),
        }
    }

    /// A remark about one camera.
    pub fn of_camera(kind: RemarkKind, camera: &str, text: impl Into<String>) -> Self {
        Self {
            kind,
            camera: Some(camera.to_owned()),
            text: text.into(),
        }
    }
}

impl fmt::Display for Remark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(camera) = &self.camera {
            write!(f, "camera `{camera}`: ")?;
        }
        write!(f, "{} ({})", self.text, self.kind.name())
    }
}

/// The unit of length of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FileUnit {
    /// The format defines millimetres.
    Millimetres,
    /// The format defines metres, but tools write other units.
    Metres,
    /// The format defines no unit.
    None,
}

/// World to camera as in the file: any unit, perhaps mirrored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RawPose {
    /// Its rows are the camera's axes; orthonormal, determinant 1 or -1.
    pub(super) rotation: Matrix3<f64>,
    /// In the file's unit.
    pub(super) translation: Vector3<f64>,
}

impl RawPose {
    /// The pose of a camera at `position`.
    pub(super) fn at(rotation: Matrix3<f64>, position: Vector3<f64>) -> Self {
        Self {
            rotation,
            translation: -(rotation * position),
        }
    }

    /// The position of the camera in the file's unit.
    pub(super) fn center(&self) -> Vector3<f64> {
        -(self.rotation.transpose() * self.translation)
    }
}

/// A camera as in the file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawCamera {
    pub(super) name: String,
    pub(super) size_px: Option<[u32; 2]>,
    /// Focal lengths may be negative here.
    pub(super) intrinsics: Intrinsics,
    pub(super) lens: LensModel,
    pub(super) pose: Option<RawPose>,
}

/// The result of the reader of one format.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawSet {
    pub(super) cameras: Vec<RawCamera>,
    pub(super) unit: FileUnit,
    pub(super) remarks: Vec<Remark>,
}

/// Cameras with four distortion coefficients and no stated model: read as Brown's, they may as well be a fisheye's.
#[derive(Debug, Default)]
pub(super) struct AmbiguousFour(Vec<String>);

impl AmbiguousFour {
    /// Records `camera` if its `coefficients` leave the model open. Zeros do not: no calibrated fisheye has them.
    /// Neither do coefficients with which a fisheye folds inside its picture: a run refuses those.
    pub(super) fn note(&mut self, camera: &RawCamera, coefficients: &[f64]) {
        let Ok(four) = <[f64; 4]>::try_from(coefficients) else {
            return;
        };
        let folds = camera.size_px.is_some_and(|size_px| {
            let fisheye = CameraModel::new(
                camera.name.as_str(),
                size_px,
                camera.intrinsics,
                LensModel::KannalaBrandt(four),
                Transform::new(Isometry3::identity()),
            );
            matches!(fisheye, Err(CameraError::Folds { .. }))
        });
        if !all_zero(&four) && !folds {
            self.0.push(camera.name.clone());
        }
    }

    /// One remark about all recorded cameras.
    pub(super) fn remark(&self) -> Option<Remark> {
        (!self.0.is_empty()).then(|| {
            let text = format!(
                "the file does not state whether the four distortion coefficients of `{}` are a fisheye's: taken as k1, k2, p1, p2; \
                 if they are, state it in the file (`fisheye = true` in each table of TOML, `distortion_model: equidistant` in \
                 OpenCV's YAML and JSON), or convert the file with `farfield calibrate convert --four-are-fisheye`",
                self.0.join("`, `")
            );
            Remark::of_all(RemarkKind::Assumed, text)
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use farfield_proto::frames::Point;
    use nalgebra::Point3;

    use super::*;

    fn model(record: &CameraRecord) -> CameraModel {
        let pose = Transform::new(record.camera_from_world.unwrap());
        CameraModel::new("a", record.size_px, record.intrinsics, record.lens, pose).unwrap()
    }

    #[test]
    fn a_turned_camera_projects_to_the_pixels_of_the_turned_picture() {
        let camera = CameraRecord {
            name: "a".to_owned(),
            size_px: [1280, 720],
            intrinsics: Intrinsics {
                fx_px: 900.0,
                fy_px: 910.0,
                cx_px: 650.0,
                cy_px: 350.0,
            },
            lens: LensModel::Rational(Distortion {
                k1: -0.1,
                k2: 0.02,
                p1: 0.003,
                p2: -0.002,
                ..Distortion::default()
            }),
            camera_from_world: Some(Isometry3::new(
                Vector3::new(0.2, -0.1, 4.0),
                Vector3::new(0.6 * PI, 0.1, 0.2),
            )),
        };
        let drawn = |camera: &CameraRecord, at: Point3<f64>| {
            let model = model(camera);
            let pixel = model
                .distort(model.project(Point::new(at)).unwrap())
                .unwrap();
            [pixel.x(), pixel.y()]
        };
        let places = [[0.0, 0.0, 0.0], [1.0, 0.3, 0.5], [-0.8, 0.6, -0.4]];
        for at in places.map(Point3::from) {
            let [x, y] = drawn(&camera, at);
            let expected = [
                (0, [x, y]),
                (1, [719.0 - y, x]),
                (2, [1279.0 - x, 719.0 - y]),
                (3, [y, 1279.0 - x]),
                (4, [x, y]),
            ];
            for (quarters, pixel) in expected {
                let turned = drawn(&camera.turned(quarters), at);
                let apart_px = (turned[0] - pixel[0]).hypot(turned[1] - pixel[1]);
                assert!(
                    apart_px < 1e-6,
                    "{quarters}: {turned:?}, expected {pixel:?}"
                );
            }
        }
    }
}
