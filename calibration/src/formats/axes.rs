//! Unit, handedness and axes of a file's world: derived from the numbers, and corrected where they leave no doubt.
//! [`plausibility`] warns about the resulting world, also where the caller stated these facts.

mod plausibility;

use farfield_proto::calibration::MAX_DISTANCE_M;
use farfield_proto::camera::Intrinsics;
use farfield_proto::plausibility::{FAR_ORIGIN_M, pose_step_mm};
use farfield_proto::toml_file::FileError;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use self::plausibility::{check_directions, check_size, check_up, meeting_place};
use super::ImportOptions;
use super::camera::{
    CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, Remark, RemarkKind,
};
use super::tree::Source;

/// Cameras of one venue that are all closer together than this are in another unit, metres.
const TOO_NEAR_M: f64 = 0.1;
/// Above this many units two interpretations are possible: a stadium in metres, a desk in millimetres.
const LARGE: f64 = 60.0;
/// An automatic origin is rounded to this, metres: a round number is easy to add back.
const ROUNDED_M: f64 = 10.0;
/// Cameras look at the middle of people, this high above the floor, metres.
const MIDDLE_M: f64 = 1.0;
/// Least height of a camera above the floor, metres.
const LOWEST_M: f64 = 0.5;

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

    /// As on the command line: `x`, `-x`, `y`, ...
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

/// What the numbers of a pose mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PoseMeaning {
    /// As the format defines them.
    #[default]
    AsFormat,
    /// The inverse of what the format defines (camera to world instead of world to camera).
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

/// The point of the file's world that becomes the origin, metres, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// This point.
    At([f64; 3]),
    /// A point on the floor between the cameras.
    Auto,
}

/// Cameras in metres, right-handed.
pub(super) struct Settled {
    pub(super) cameras: Vec<CameraRecord>,
    /// The position that was subtracted from all positions.
    pub(super) origin_m: Option<[f64; 3]>,
    pub(super) remarks: Vec<Remark>,
}

/// `raw` in metres, right-handed, z up if the options state the axis, with all remarks.
///
/// # Errors
/// [`FileError`] for a mirrored world if no option states the axis, and for a stated mirror that does not exist.
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
    let origin_m = move_origin(options.origin, &mut cameras, &mut remarks);
    check_directions(&cameras, &mut remarks);
    if options.metres_per_unit.is_some() {
        check_size(&cameras, metres, &mut remarks);
    }
    check_up(&cameras, options.up, &mut remarks);
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

/// Refuses a focal length of 0 and numbers that are not finite. Some programs write 0 for an unknown value.
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
            return refuse(
                "focal length",
                focal_px,
                "a finite number of pixels other than 0",
            );
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

/// A left-handed world has rotations with determinant -1.
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
            "the option states that an axis is mirrored, but all rotations of the file are right-handed; leave the option out",
            )),
        };
    }
    if mirrored.len() < placed().count() {
        return Err(source.error(format!(
            "the rotations of `{}` are mirrored (determinant -1) and the others are not: one world cannot have both",
            mirrored.join("`, `")
        )));
    }
    let Some(axis) = options.mirrored else {
        return Err(source.error(
            "all rotations are mirrored (determinant -1): the file's world is left-handed; state the axis to reverse with the \
             option `mirrored` (x, y or z; usually y or z)",
        ));
    };
    let flip = Matrix3::identity() - 2.0 * axis.vector() * axis.vector().transpose();
    for pose in cameras.iter_mut().filter_map(|camera| camera.pose.as_mut()) {
        pose.rotation *= flip;
    }
    let text = format!(
        "the file's world is left-handed; its {} axis was reversed",
        axis.name().trim_start_matches('-')
    );
    remarks.push(Remark::of_all(RemarkKind::Corrected, text));
    Ok(())
}

/// The largest distance between two cameras; for one camera, its distance from the origin.
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
    let mut remark = |kind, text: String| remarks.push(Remark::of_all(kind, text));
    let Some(spread) = spread(cameras) else {
        return 1.0;
    };
    let apart = format!("the cameras are up to {spread:.3} units apart");
    match unit {
        FileUnit::Millimetres => {
            if spread * 1e-3 < TOO_NEAR_M && spread > 0.0 {
                remark(
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
            remark(
                RemarkKind::Corrected,
                format!(
                    "{apart}: the file is in millimetres, and was turned into metres: now up to {now_m:.2} m (else give the metres per unit)"
                ),
            );
            1e-3
        }
        FileUnit::None => {
            remark(
                RemarkKind::Assumed,
                format!(
                    "the format has no unit of length; {apart}, taken as metres. If they are not, give the metres per unit"
                ),
            );
            1.0
        }
        FileUnit::Metres => {
            if spread > LARGE {
                remark(
                    RemarkKind::Doubtful,
                    format!(
                        "{apart}, taken as metres; if they are millimetres, give 0.001 as metres per unit"
                    ),
                );
            } else if spread > 0.0 && spread < TOO_NEAR_M {
                remark(
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

/// The rotation that brings z to `up`: from the world with z up to the file's world.
pub(super) fn turn_up(up: WorldAxis) -> Matrix3<f64> {
    let rotation = Rotation3::rotation_between(&Vector3::z(), &up.vector())
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
    // Whole quarter turns: entries are 0, 1 or -1.
    rotation.matrix().map(f64::round)
}

/// Moves the origin to the requested point.
///
/// Returns the subtracted position, metres.
fn move_origin(
    origin: Option<Origin>,
    cameras: &mut [RawCamera],
    remarks: &mut Vec<Remark>,
) -> Option<[f64; 3]> {
    let poses: Vec<RawPose> = cameras.iter().filter_map(|camera| camera.pose).collect();
    let mean_m =
        poses.iter().map(RawPose::center).sum::<Vector3<f64>>() / poses.len().max(1) as f64;
    let Some(origin) = origin else {
        let away_m = mean_m.norm();
        if !poses.is_empty() && away_m > FAR_ORIGIN_M {
            let text = format!(
                "the cameras stand {:.0} km from the origin, where poses have steps of {:.1} mm: `farfield calibrate convert --origin auto` \
                 moves the origin to the cameras",
                away_m / 1e3,
                pose_step_mm(away_m)
            );
            remarks.push(Remark::of_all(RemarkKind::Doubtful, text));
        }
        return None;
    };
    let origin_m = match origin {
        Origin::At(at) => Vector3::from(at),
        Origin::Auto => near(&poses, mean_m),
    };
    for pose in cameras.iter_mut().filter_map(|camera| camera.pose.as_mut()) {
        pose.translation += pose.rotation * origin_m;
    }
    let [x, y, z]: [f64; 3] = origin_m.into();
    let guessed = match origin {
        Origin::Auto => {
            ", whose z is a guess of the floor's height (`--origin X,Y,Z` states another)"
        }
        Origin::At(_) => "",
    };
    let text = format!(
        "the origin was moved to ({x}, {y}, {z}) of the file{guessed}: add these metres to positions to get the file's again"
    );
    remarks.push(Remark::of_all(RemarkKind::Corrected, text));
    Some([x, y, z])
}

/// A rounded point between the cameras, on the floor.
fn near(poses: &[RawPose], mean_m: Vector3<f64>) -> Vector3<f64> {
    let lowest_m = poses
        .iter()
        .map(|pose| pose.center().z)
        .fold(f64::INFINITY, f64::min);
    let looked_at_m = meeting_place(poses).map_or(f64::INFINITY, |place| place.z - MIDDLE_M);
    let floor_m = looked_at_m.min(lowest_m - LOWEST_M).round();
    let [x, y] = [mean_m.x, mean_m.y].map(|it| (it / ROUNDED_M).round() * ROUNDED_M);
    Vector3::new(x, y, if floor_m.is_finite() { floor_m } else { 0.0 })
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

#[cfg(test)]
mod tests {
    use super::super::tests::ring;
    use super::super::{Format, ImportOptions, Imported, LensModel, export, import};
    use super::*;

    /// Cameras around a place that has the coordinates `at_m` in the file.
    fn read_at(at_m: [f64; 3], origin: Option<Origin>) -> Imported {
        let mut cameras = ring(Vector3::z(), LensModel::ideal());
        for pose in cameras
            .iter_mut()
            .filter_map(|it| it.camera_from_world.as_mut())
        {
            // The ring looks at a place 1 m above the floor.
            pose.translation.vector -= pose.rotation * (Vector3::from(at_m) + Vector3::z());
        }
        let files = export(&cameras, Format::Farfield).unwrap();
        let options = ImportOptions {
            origin,
            ..ImportOptions::default()
        };
        import(&files, &options).unwrap()
    }

    fn texts(read: &Imported) -> String {
        let texts: Vec<String> = read.remarks.iter().map(ToString::to_string).collect();
        texts.join("\n")
    }

    #[test]
    fn an_automatic_origin_lies_between_surveyed_cameras_and_is_reported() {
        let utm = [500_003.0, 5_000_004.0, 120.0];
        let read = read_at(utm, Some(Origin::Auto));
        assert_eq!(read.origin_m, Some([500_000.0, 5_000_000.0, 120.0]));
        assert!(
            texts(&read)
                .contains("moved to (500000, 5000000, 120) of the file, whose z is a guess"),
            "{}",
            texts(&read)
        );
        let stated = read_at(utm, Some(Origin::At([500_000.0, 5_000_000.0, 120.0])));
        for (camera, near) in stated
            .cameras
            .iter()
            .zip(ring(Vector3::z(), LensModel::ideal()))
        {
            let centers = [camera, &near]
                .map(|it| it.camera_from_world.unwrap().inverse().translation.vector);
            let apart_m = centers[0] - centers[1] - Vector3::new(3.0, 4.0, 1.0);
            assert!(apart_m.norm() < 1e-6, "{apart_m:?}");
        }
    }

    #[test]
    fn coarse_poses_are_reported_only_far_from_the_origin() {
        let far = texts(&read_at([50_000.0, 0.0, 0.0], None));
        assert!(
            far.contains("50 km from the origin, where poses have steps of 3.9 mm"),
            "{far}"
        );
        let near = texts(&read_at([900.0, 0.0, 0.0], None));
        assert!(!near.contains("origin"), "{near}");
    }
}
