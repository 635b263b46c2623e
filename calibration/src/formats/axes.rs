//! Unit, handedness and axes of a file's world: recognised from the numbers, put right where there is no doubt. What is
//! doubtful of the world that comes out is said, also where somebody has stated how the file's is ([`doubts`]).

mod doubts;
mod origin;

use farfield_proto::calibration::MAX_DISTANCE_M;
use farfield_proto::camera::Intrinsics;
use farfield_proto::toml_file::FileError;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use self::doubts::{look_at_directions, look_at_size, look_at_up};
pub use self::origin::Origin;
use super::ImportOptions;
use super::camera::{
    CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, Remark, RemarkKind,
};
use super::tree::Source;

/// Cameras of one venue that are nearer to each other, all of them, stand in another unit, metres.
const TOO_NEAR_M: f64 = 0.1;
/// Above this many units two readings are possible: a stadium in metres, a desk in millimetres.
const LARGE: f64 = 60.0;

/// An axis of the world with its direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WorldAxis {
    /// +x.
    X,
    /// -x.
    MinusX,
    /// +y.
    Y,
    /// -y.
    MinusY,
    /// +z.
    Z,
    /// -z.
    MinusZ,
}

impl WorldAxis {
    /// All six.
    pub const ALL: [Self; 6] = [
        Self::X,
        Self::MinusX,
        Self::Y,
        Self::MinusY,
        Self::Z,
        Self::MinusZ,
    ];

    /// `x`, `-x`, `y`, ...: as the command line has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::MinusX => "-x",
            Self::Y => "y",
            Self::MinusY => "-y",
            Self::Z => "z",
            Self::MinusZ => "-z",
        }
    }

    /// The axis of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|axis| axis.name() == name)
    }

    pub(super) fn vector(self) -> Vector3<f64> {
        match self {
            Self::X => Vector3::x(),
            Self::MinusX => -Vector3::x(),
            Self::Y => Vector3::y(),
            Self::MinusY => -Vector3::y(),
            Self::Z => Vector3::z(),
            Self::MinusZ => -Vector3::z(),
        }
    }
}

/// What the numbers called a pose mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PoseMeaning {
    /// What the format says.
    #[default]
    AsFormat,
    /// The file has the inverse of what its format says (camera to world instead of world to camera).
    Inverse,
}

/// The axes of a camera in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CameraAxes {
    /// x right, y down, looking along +z.
    #[default]
    OpenCv,
    /// x right, y up, looking along -z (OpenGL, Blender).
    OpenGl,
}

/// Cameras in metres, right-handed.
pub(super) struct Settled {
    pub(super) cameras: Vec<CameraRecord>,
    /// What was subtracted from every place.
    pub(super) origin_m: Option<[f64; 3]>,
    pub(super) remarks: Vec<Remark>,
}

/// `raw` in metres, right-handed, z up where the options say how; with all that is to be said of it.
///
/// # Errors
/// [`FileError`] for a mirrored world when no option says which axis, and for a mirror that there is not.
pub(super) fn settle(
    raw: RawSet,
    options: &ImportOptions,
    source: &Source<'_>,
) -> Result<Settled, FileError> {
    let mut remarks = raw.remarks;
    let mut cameras = raw.cameras;
    for camera in &mut cameras {
        check_numbers(camera, source)?;
        make_focal_lengths_positive(camera, &mut remarks);
        let pose = camera.pose.filter(|_| !options.only_lenses);
        camera.pose = pose.map(|pose| reread(pose, options.pose, options.camera_axes));
    }
    unmirror(&mut cameras, options, source, &mut remarks)?;
    let metres = metres_per_unit(&cameras, raw.unit, options, &mut remarks);
    for pose in cameras.iter_mut().filter_map(|camera| camera.pose.as_mut()) {
        pose.translation *= metres;
        if let Some(up) = options.up {
            pose.rotation *= turn_up(up);
        }
    }
    let origin_m = origin::move_to(options.origin, &mut cameras, &mut remarks);
    look_at_directions(&cameras, &mut remarks);
    if options.metres_per_unit.is_some() {
        look_at_size(&cameras, metres, &mut remarks);
    }
    look_at_up(&cameras, options.up, &mut remarks);
    let records = cameras
        .into_iter()
        .map(|camera| record(camera, &mut remarks));
    let cameras = records.collect();
    Ok(Settled {
        cameras,
        origin_m,
        remarks,
    })
}

/// A lens with a focal length of 0, or a number that is none, draws nothing; some programs write 0 where they do not know.
fn check_numbers(camera: &RawCamera, source: &Source<'_>) -> Result<(), FileError> {
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = camera.intrinsics;
    let refuse = |what: &str, found: f64, expected: &str| {
        Err(source.error(format!(
            "camera `{}`: {what}: found {found}, expected {expected}",
            camera.name
        )))
    };
    for focal_px in [fx_px, fy_px] {
        if !focal_px.is_finite() || focal_px == 0.0 {
            return refuse("focal length", focal_px, "a finite number of pixels but 0");
        }
    }
    if let Some(found) = [cx_px, cy_px].into_iter().find(|v| !v.is_finite()) {
        return refuse("principal point", found, "finite pixels");
    }
    let mut coefficients = camera.lens.coefficients().into_iter();
    if let Some(found) = coefficients.find(|v| !v.is_finite()) {
        return refuse("coefficient of the lens", found, "a finite number");
    }
    Ok(())
}

/// A negative focal length is a mirrored axis of the camera: x = f X / Z = (-f) (-X) / Z.
fn make_focal_lengths_positive(camera: &mut RawCamera, remarks: &mut Vec<Remark>) {
    let Intrinsics { fx_px, fy_px, .. } = camera.intrinsics;
    let sign = [fx_px, fy_px].map(|f| if f < 0.0 { -1.0 } else { 1.0 });
    if sign.iter().all(|&s| s > 0.0) {
        return;
    }
    camera.intrinsics.fx_px = fx_px.abs();
    camera.intrinsics.fy_px = fy_px.abs();
    if let LensModel::Rational(d) = &mut camera.lens {
        d.p2 *= sign[0];
        d.p1 *= sign[1];
    }
    if let Some(pose) = &mut camera.pose {
        let flip = Matrix3::from_diagonal(&Vector3::new(sign[0], sign[1], 1.0));
        pose.rotation = flip * pose.rotation;
        pose.translation = flip * pose.translation;
    }
    let text = format!(
        "its focal lengths are {fx_px:.1} and {fy_px:.1}; the camera's axes were turned so that both are above 0, which \
         draws the same picture"
    );
    remarks.push(Remark::of_camera(RemarkKind::Corrected, &camera.name, text));
}

fn reread(pose: RawPose, meaning: PoseMeaning, axes: CameraAxes) -> RawPose {
    let pose = match meaning {
        PoseMeaning::AsFormat => pose,
        PoseMeaning::Inverse => RawPose {
            rotation: pose.rotation.transpose(),
            translation: pose.center(),
        },
    };
    match axes {
        CameraAxes::OpenCv => pose,
        CameraAxes::OpenGl => {
            let flip = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
            RawPose {
                rotation: flip * pose.rotation,
                translation: flip * pose.translation,
            }
        }
    }
}

/// A world whose axes are a left hand's has rotations with determinant -1.
fn unmirror(
    cameras: &mut [RawCamera],
    options: &ImportOptions,
    source: &Source<'_>,
    remarks: &mut Vec<Remark>,
) -> Result<(), FileError> {
    let placed = || {
        cameras
            .iter()
            .filter_map(|camera| Some((&camera.name, camera.pose?)))
    };
    let is_mirrored = |pose: &RawPose| pose.rotation.determinant() < 0.0;
    let mirrored: Vec<&str> = placed()
        .filter(|(_, pose)| is_mirrored(pose))
        .map(|(name, _)| name.as_str())
        .collect();
    if mirrored.is_empty() {
        return match options.mirrored {
            None => Ok(()),
            Some(_) => Err(source.error(
                "the option says that an axis is mirrored, but all rotations of the file are right-handed; leave the option out",
            )),
        };
    }
    if mirrored.len() < placed().count() {
        return Err(source.error(format!(
            "the rotations of `{}` are mirrored (determinant -1) and the others are not: no one world has both",
            mirrored.join("`, `")
        )));
    }
    let Some(axis) = options.mirrored else {
        return Err(source.error(
            "all rotations are mirrored (determinant -1): the file's world has the axes of a left hand; say which axis to \
             turn round with the option `mirrored` (x, y or z; mostly y or z)",
        ));
    };
    let flip = Matrix3::identity() - 2.0 * axis.vector() * axis.vector().transpose();
    for pose in cameras.iter_mut().filter_map(|camera| camera.pose.as_mut()) {
        pose.rotation *= flip;
    }
    let text = format!(
        "the file's world has the axes of a left hand; its {} axis was turned round",
        axis.name().trim_start_matches('-')
    );
    remarks.push(Remark::of_all(RemarkKind::Corrected, text));
    Ok(())
}

/// The largest distance between two cameras; of one camera, from the origin.
fn spread(cameras: &[RawCamera]) -> Option<f64> {
    let centers: Vec<Vector3<f64>> = cameras
        .iter()
        .filter_map(|c| Some(c.pose?.center()))
        .collect();
    if let [only] = centers.as_slice() {
        return Some(only.norm());
    }
    let pairs = centers
        .iter()
        .enumerate()
        .flat_map(|(i, a)| centers.iter().skip(i + 1).map(move |b| (a - b).norm()));
    pairs.max_by(f64::total_cmp)
}

fn metres_per_unit(
    cameras: &[RawCamera],
    unit: FileUnit,
    options: &ImportOptions,
    remarks: &mut Vec<Remark>,
) -> f64 {
    if let Some(metres) = options.metres_per_unit {
        return metres;
    }
    let mut say = |kind, text: String| remarks.push(Remark::of_all(kind, text));
    let Some(spread) = spread(cameras) else {
        return 1.0;
    };
    let apart = format!("the cameras are up to {spread:.3} units apart");
    match unit {
        FileUnit::Millimetres => {
            if spread * 1e-3 < TOO_NEAR_M && spread > 0.0 {
                say(
                    RemarkKind::Doubtful,
                    format!(
                        "the format is in millimetres, but {apart}; if they are metres, give 1 as metres per unit"
                    ),
                );
            }
            1e-3
        }
        _ if spread > MAX_DISTANCE_M => {
            let now_m = spread * 1e-3;
            say(
                RemarkKind::Corrected,
                format!(
                    "{apart}: the file is in millimetres, and was turned into metres: now up to {now_m:.2} m (else give the metres per unit)"
                ),
            );
            1e-3
        }
        FileUnit::None => {
            say(
                RemarkKind::Assumed,
                format!(
                    "the format has no unit of length; {apart}, taken as metres. If they are not, give the metres per unit"
                ),
            );
            1.0
        }
        FileUnit::Metres => {
            if spread > LARGE {
                say(
                    RemarkKind::Doubtful,
                    format!(
                        "{apart}, taken as metres; if they are millimetres, give 0.001 as metres per unit"
                    ),
                );
            } else if spread > 0.0 && spread < TOO_NEAR_M {
                say(
                    RemarkKind::Doubtful,
                    format!(
                        "{apart}, taken as metres, which is nearer than cameras stand; give the metres per unit"
                    ),
                );
            }
            1.0
        }
    }
}

/// Takes the world with z up to the file's: the rotation that brings z to `up`.
pub(super) fn turn_up(up: WorldAxis) -> Matrix3<f64> {
    let rotation = Rotation3::rotation_between(&Vector3::z(), &up.vector())
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    // Whole quarter turns: entries are 0, 1 or -1.
    rotation.matrix().map(f64::round)
}

fn record(camera: RawCamera, remarks: &mut Vec<Remark>) -> CameraRecord {
    let Intrinsics { cx_px, cy_px, .. } = camera.intrinsics;
    let size_px = camera.size_px.unwrap_or_else(|| {
        let size = [cx_px, cy_px].map(|c| (2.0 * c + 1.0).round().clamp(1.0, 65_536.0) as u32);
        let text = format!(
            "the file has no size of the picture; taken as {} x {} with the principal point in its middle",
            size[0], size[1]
        );
        remarks.push(Remark::of_camera(RemarkKind::Assumed, &camera.name, text));
        size
    });
    let camera_from_world = camera.pose.map(|pose| {
        let rotation = Rotation3::from_matrix_unchecked(pose.rotation);
        Isometry3::from_parts(
            Translation3::from(pose.translation),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    });
    CameraRecord {
        name: camera.name,
        size_px,
        intrinsics: camera.intrinsics,
        lens: camera.lens,
        camera_from_world,
    }
}
