//! Checks a venue's calibration from its numbers alone, before any source is opened.
//!
//! Read [`of_venue`] first. A finding is [`Severity::Wrong`] if no run can be correct with it; the
//! calibration is then refused. It is [`Severity::Doubtful`] if it is correct in some venues; it is
//! then reported. Mistakes that only people reveal (swapped videos, a late camera, a moved camera)
//! are not checked here.

mod conventions;
mod coverage;
mod lens;
mod places;
mod upright;

use crate::calibration::Calibration;
use crate::camera::CameraModel;
use crate::frames::Pixel;
use crate::venue::{Field, Source, Venue, VenueCamera};

pub use self::coverage::{Coverage, coverage, of_viewpoints};
pub use self::places::{FAR_ORIGIN_M, pose_step_mm};
pub use self::upright::looks_over_heads;
pub use crate::finding::Severity;

/// The kind of a mistake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Cause {
    /// An axis other than z points up, or z points down.
    WorldAxes,
    /// The file's poses are camera to world.
    Backwards,
    /// The file's cameras have y up and z backward.
    CameraAxes,
    /// A camera is below the floor.
    UnderFloor,
    /// A camera has an unusual height.
    Height,
    /// A camera's picture is upside down.
    UpsideDown,
    /// A camera's picture is turned by about 90 degrees.
    Sideways,
    /// All cameras are above people and look up: the calibration is a mirror image.
    LookUp,
    /// A rotation vector is longer than half a turn.
    LongRotation,
    /// The field of view does not match a lens and the picture's size.
    FieldOfView,
    /// The focal lengths along rows and columns differ.
    PixelShape,
    /// The principal point is far from the picture's middle.
    PrincipalPoint,
    /// The distortion is not plausible for a lens.
    Distortion,
    /// All cameras are very close together or very far apart: another unit of length.
    Units,
    /// All cameras are so far from the origin that poses are coarse.
    FarOrigin,
    /// Two cameras are at the same place.
    SamePlace,
    /// Cameras of one viewpoint are far apart.
    ViewpointApart,
    /// A camera sees no part of the field.
    LooksAway,
    /// Two viewpoints see little of the field.
    FieldUnseen,
    /// The field is too low, too narrow or too wide for people.
    FieldSize,
    /// There is only one viewpoint.
    OneViewpoint,
    /// Pictures of another size than the calibration's.
    PictureSize,
}

impl Cause {
    /// The name for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::WorldAxes => "world_axes",
            Self::Backwards => "backwards",
            Self::CameraAxes => "camera_axes",
            Self::UnderFloor => "under_floor",
            Self::Height => "height",
            Self::UpsideDown => "upside_down",
            Self::Sideways => "sideways",
            Self::LookUp => "look_up",
            Self::LongRotation => "long_rotation",
            Self::FieldOfView => "field_of_view",
            Self::PixelShape => "pixel_shape",
            Self::PrincipalPoint => "principal_point",
            Self::Distortion => "distortion",
            Self::Units => "units",
            Self::FarOrigin => "far_origin",
            Self::SamePlace => "same_place",
            Self::ViewpointApart => "viewpoint_apart",
            Self::LooksAway => "looks_away",
            Self::FieldUnseen => "field_unseen",
            Self::FieldSize => "field_size",
            Self::OneViewpoint => "one_viewpoint",
            Self::PictureSize => "picture_size",
        }
    }
}

/// One reason against a calibration.
pub type Finding = crate::finding::Finding<Cause>;

/// All findings about the calibration of `venue`, wrong ones first, then in the order of its
/// cameras.
pub fn of_venue(venue: &Venue) -> Vec<Finding> {
    let sights: Vec<Sight> = venue.cameras.iter().map(Sight::from_camera).collect();
    let seen = coverage(venue);
    let mut findings = Vec::new();
    findings.extend(
        venue
            .cameras
            .iter()
            .flat_map(|it| lens::findings(&it.model)),
    );
    let mut stand = standing(&sights, &venue.field);
    stand.extend(coverage::findings(venue, &seen));
    if let Some(finding) = conventions::of_all(venue, &stand) {
        // One cause; its consequences would only hide it.
        stand.clear();
        stand.push(finding);
    } else {
        conventions::of_single(venue, &seen, &mut stand);
    }
    findings.extend(stand);
    findings.extend(coverage::field_size(venue));
    findings.sort_by_key(|finding| !finding.is_wrong());
    findings
}

/// Findings about rotation vectors: the same vector in degrees is another rotation. Vectors longer
/// than a full turn are refused earlier ([`Calibration::parse`]).
pub fn of_rotations(calibration: &Calibration) -> Vec<Finding> {
    let long = calibration
        .rotation_lengths_rad
        .iter()
        .filter(|(_, length_rad)| **length_rad > std::f64::consts::PI + 1e-6);
    long.map(|(camera, length_rad)| Finding {
        camera: Some(camera.clone()),
        cause: Cause::LongRotation,
        severity: Severity::Doubtful,
        found: format!("`rotation` is a vector of length {length_rad:.2}"),
        expected: "radians, at most 3.14".to_owned(),
        remedy: "if these are degrees, multiply them by 0.017453".to_owned(),
    })
    .collect()
}

/// The finding about pictures of `found_px` (width, height) for `camera`, which was calibrated with
/// another size.
pub fn of_picture_size(camera: &CameraModel, found_px: [u32; 2]) -> Option<Finding> {
    let [width, height] = camera.size_px();
    if found_px == [width, height] {
        return None;
    }
    let same_shape =
        u64::from(found_px[0]) * u64::from(height) == u64::from(found_px[1]) * u64::from(width);
    let remedy = if found_px == [height, width] {
        "the pictures are turned by 90 degrees: turn the calibration clockwise by 90 or -90 as these are (`farfield calibrate \
         convert FILE --turn CAMERA=90 --out DIR`), or turn these \
         (`ffmpeg -i IN -vf transpose=1 OUT` clockwise, `transpose=2` the other way); if a rotation tag alone turns them, take it away \
         (`ffmpeg -i IN -c copy -metadata:s:v rotate=0 OUT`, from ffmpeg 6 on `ffmpeg -display_rotation 0 -i IN -c copy OUT`)"
            .to_owned()
    } else if same_shape {
        let factor = f64::from(found_px[0]) / f64::from(width);
        format!(
            "if the pictures were only scaled, multiply `size` and the first two rows of `matrix` by {factor:.6}; \
             if they are cropped, calibrate again"
        )
    } else {
        "calibrate with pictures of this size: these are cropped, or of another camera".to_owned()
    };
    Some(Finding {
        camera: Some(camera.name().to_owned()),
        cause: Cause::PictureSize,
        severity: Severity::Wrong,
        found: format!("its pictures have {}x{} pixels", found_px[0], found_px[1]),
        expected: format!("{width}x{height}, the calibration's `size`"),
        remedy,
    })
}

/// The used share of a camera's picture, 0 to 1: below 1 for a fisheye that sees more than 120
/// degrees.
pub fn used_share(camera: &CameraModel) -> f64 {
    const SIDE: u32 = 64;
    let [width, height] = camera.size_px().map(f64::from);
    let at = |i: u32, size: f64| (f64::from(i) + 0.5) / f64::from(SIDE) * size - 0.5;
    let used = (0..SIDE * SIDE).filter(|i| {
        let pixel = Pixel::new(at(i % SIDE, width), at(i / SIDE, height));
        camera.undistort(pixel).is_some()
    });
    used.count() as f64 / f64::from(SIDE * SIDE)
}

/// Position and orientation of a camera, in the axes of the world.
#[derive(Debug, Clone)]
struct Sight {
    name: String,
    /// Whether a network processes its pictures.
    has_pictures: bool,
    viewpoint: usize,
    center_m: [f64; 3],
    /// Directions of the picture's right, its upper edge and its middle, unit vectors.
    right: [f64; 3],
    up: [f64; 3],
    forward: [f64; 3],
}

impl Sight {
    fn from_camera(camera: &VenueCamera) -> Self {
        Self {
            has_pictures: !matches!(camera.source, Source::Keypoints { .. }),
            ..Self::of_model(&camera.model, usize::from(camera.viewpoint.0))
        }
    }

    fn of_model(model: &CameraModel, viewpoint: usize) -> Self {
        let rotation = model
            .camera_from_world()
            .isometry()
            .rotation
            .to_rotation_matrix();
        // The rows of the rotation are the camera's axes: x right, y down, z forward.
        let row = |i: usize| [0, 1, 2].map(|j| rotation[(i, j)]);
        let center = model.center().coordinates_m();
        Self {
            name: model.name().to_owned(),
            has_pictures: true,
            viewpoint,
            center_m: [center.x, center.y, center.z],
            right: row(0),
            up: row(1).map(|v| -v),
            forward: row(2),
        }
    }
}

/// Findings about the poses of the cameras.
fn standing(sights: &[Sight], field: &Field) -> Vec<Finding> {
    let mut findings = upright::findings(sights, field);
    // If the world has another axis up, heights have no meaning.
    if !findings.iter().any(|it| it.cause == Cause::WorldAxes) {
        findings.extend(places::heights(sights, field));
    }
    findings.extend(places::distances(sights));
    findings.extend(places::origin(sights));
    findings
}

#[cfg(test)]
mod tests;
