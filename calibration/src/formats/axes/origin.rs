//! The origin of the world, moved to the cameras: surveyed coordinates are too far from theirs to compute with.

use farfield_proto::plausibility::{FAR_ORIGIN_M, pose_step_mm};
use nalgebra::Vector3;

use super::super::camera::{RawCamera, RawPose, Remark, RemarkKind};
use super::doubts::meeting_place;

/// Which point of the file's world becomes the origin, metres, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Origin {
    /// This one.
    At([f64; 3]),
    /// One on the floor between the cameras.
    Auto,
}

/// To so much an origin is rounded that is found, metres: it is easily added again.
const ROUNDED_M: f64 = 10.0;
/// Cameras look at the middle of people, so high above the floor, metres.
const MIDDLE_M: f64 = 1.0;
/// And hang at least so high above it, metres.
const LOWEST_M: f64 = 0.5;

/// Moves the origin to where it was asked for.
///
/// Returns what was subtracted from every place, metres.
pub(super) fn move_to(
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
        "the origin was moved to ({x}, {y}, {z}) of the file{guessed}: add these metres to positions to have the file's again"
    );
    remarks.push(Remark::of_all(RemarkKind::Corrected, text));
    Some([x, y, z])
}

/// A round place between cameras, on the floor.
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

#[cfg(test)]
mod tests {
    use super::super::super::tests::ring;
    use super::super::super::{Format, ImportOptions, Imported, LensModel, export, import};
    use super::*;

    /// Cameras around a place, of which the file says that it is at `at_m`.
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

    fn said(read: &Imported) -> String {
        let texts: Vec<String> = read.remarks.iter().map(ToString::to_string).collect();
        texts.join("\n")
    }

    #[test]
    fn surveyed_cameras_come_to_an_origin_between_them_and_it_is_said_which() {
        let utm = [500_003.0, 5_000_004.0, 120.0];
        let read = read_at(utm, Some(Origin::Auto));
        assert_eq!(read.origin_m, Some([500_000.0, 5_000_000.0, 120.0]));
        assert!(
            said(&read).contains("moved to (500000, 5000000, 120) of the file, whose z is a guess"),
            "{}",
            said(&read)
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
    fn coarse_poses_are_said_of_cameras_far_from_the_origin_alone() {
        let far = said(&read_at([50_000.0, 0.0, 0.0], None));
        assert!(
            far.contains("50 km from the origin, where poses have steps of 3.9 mm"),
            "{far}"
        );
        let near = said(&read_at([900.0, 0.0, 0.0], None));
        assert!(!near.contains("origin"), "{near}");
    }
}
