//! Tests whether cameras would have plausible poses if the file used the convention of another
//! program.
//!
//! ```text
//!   ours:          x_c = R x_w + t, x to the right, y down, z forward
//!   turned axes:   F R, F t, F = diag(1, -1, -1): y up, z backward, as OpenGL, Blender, NeRF and ARKit have cameras
//!   pose:          R', -R' t: camera to world
//! ```

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::camera::CameraModel;
use crate::frames::Transform;
use crate::venue::{Venue, VenueCamera};

use super::coverage::{self, coverage};
use super::{Cause, Coverage, Finding, Severity, Sight, places, standing, upright};

/// Minimum share of the field that a camera sees in its own convention; a small share is in most
/// pictures by chance.
const SEES: f64 = 0.1;

/// How a program writes camera poses.
#[derive(Debug, Clone, Copy)]
enum Convention {
    /// Camera to world.
    Pose,
    /// World to camera, with y up and z backward.
    TurnedAxes,
    /// Camera to world, with y up and z backward.
    PoseOfTurnedAxes,
}

impl Convention {
    const ALL: [Self; 3] = [Self::Pose, Self::TurnedAxes, Self::PoseOfTurnedAxes];

    /// The pose `written` in this convention, as world to camera in our axes.
    fn read(self, written: &Isometry3<f64>) -> Isometry3<f64> {
        let half_turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let turned = Isometry3::from_parts(Translation3::identity(), half_turn);
        match self {
            Self::Pose => written.inverse(),
            Self::TurnedAxes => turned * written,
            Self::PoseOfTurnedAxes => turned * written.inverse(),
        }
    }

    fn cause(self) -> Cause {
        match self {
            Self::Pose => Cause::Backwards,
            Self::TurnedAxes | Self::PoseOfTurnedAxes => Cause::CameraAxes,
        }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Pose => "the other way round (camera to world)",
            Self::TurnedAxes => {
                "with y up and z backward (as OpenGL, Blender and NeRF have cameras)"
            }
            Self::PoseOfTurnedAxes => {
                "as camera to world with y up and z backward (as OpenGL, Blender and NeRF have cameras)"
            }
        }
    }

    fn expected(self) -> &'static str {
        match self {
            Self::Pose => {
                "`rotation` and `translation` that take world coordinates to the camera's"
            }
            Self::TurnedAxes | Self::PoseOfTurnedAxes => {
                "`rotation` and `translation` that take world coordinates to the camera's, with x to the right, y down and z forward"
            }
        }
    }

    fn remedy(self) -> &'static str {
        match self {
            Self::Pose => "write the inverse: R' and -R' t",
            Self::TurnedAxes => {
                "negate the second and third row of the rotation matrix (of a rotation vector: of its matrix, as `cv2.Rodrigues` gives it), and the \
                 second and third number of `translation`"
            }
            Self::PoseOfTurnedAxes => {
                "write the inverse, R' and -R' t, with its second and third row and number negated (of a rotation vector: of its matrix)"
            }
        }
    }

    fn of_camera(self, camera: &VenueCamera) -> Option<VenueCamera> {
        let model = &camera.model;
        let read = self.read(model.camera_from_world().isometry());
        let model = CameraModel::new(
            model.name(),
            model.size_px(),
            *model.intrinsics(),
            *model.lens(),
            Transform::new(read),
        );
        Some(VenueCamera {
            model: model.ok()?,
            ..camera.clone()
        })
    }
}

/// The convention of another program in which all cameras would be plausible.
pub(super) fn of_all(venue: &Venue, findings: &[Finding]) -> Option<Finding> {
    let is_bad = |finding: &&Finding| {
        finding.is_wrong() || matches!(finding.cause, Cause::LooksAway | Cause::UnderFloor)
    };
    if venue.cameras.len() < 2 || !findings.iter().any(|it| is_bad(&it)) {
        return None;
    }
    let is_well = |convention: &Convention| {
        let cameras = venue.cameras.iter();
        let cameras: Option<Vec<_>> = cameras.map(|it| convention.of_camera(it)).collect();
        cameras.is_some_and(|cameras| all_is_well(venue, cameras))
    };
    let convention = Convention::ALL.into_iter().find(is_well)?;
    Some(Finding {
        camera: None,
        cause: convention.cause(),
        severity: Severity::Wrong,
        found: format!(
            "as written, {}; read {} all cameras stand upright around the field",
            findings
                .iter()
                .find(is_bad)
                .map_or("nothing fits", |it| it.found.as_str()),
            convention.words()
        ),
        expected: convention.expected().to_owned(),
        remedy: convention.remedy().to_owned(),
    })
}

fn all_is_well(venue: &Venue, cameras: Vec<VenueCamera>) -> bool {
    let mut read = venue.clone();
    read.cameras = cameras;
    let sights: Vec<Sight> = read.cameras.iter().map(Sight::from_camera).collect();
    read.field = places::around(&sights, &venue.field);
    let seen = coverage(&read);
    standing(&sights, &read.field).is_empty() && coverage::findings(&read, &seen).is_empty()
}

/// Cameras that see nothing of the field, but would in the convention of another program. It
/// replaces their other findings, which follow from it.
pub(super) fn of_single(venue: &Venue, seen: &Coverage, findings: &mut Vec<Finding>) {
    for (index, camera) in venue.cameras.iter().enumerate() {
        if seen.of_camera[index] > 0.0 {
            continue;
        }
        let stands_well = |convention: &Convention| {
            let Some(read) = convention.of_camera(camera) else {
                return false;
            };
            let sight = [Sight::from_camera(&read)];
            let mut alone = venue.clone();
            alone.cameras = vec![read];
            upright::findings(&sight, &venue.field).is_empty()
                && places::heights(&sight, &venue.field).is_empty()
                && coverage(&alone).of_camera[0] >= SEES
        };
        let Some(convention) = Convention::ALL.into_iter().find(stands_well) else {
            continue;
        };
        let name = Some(camera.model.name().to_owned());
        let is_own = |finding: &Finding| finding.camera == name && !finding.is_wrong();
        findings.retain(|finding| !is_own(finding));
        findings.push(Finding {
            camera: name,
            cause: convention.cause(),
            severity: Severity::Doubtful,
            found: format!(
                "as written it sees no point of the field; read {} it stands upright and does",
                convention.words()
            ),
            expected: convention.expected().to_owned(),
            remedy: convention.remedy().to_owned(),
        });
    }
}
