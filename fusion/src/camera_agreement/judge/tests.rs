//! Cameras beside each other that are right, and such as seem to show the same.

use super::super::fixture::{Hall, Mistake};
use super::super::report::DisagreementCause;

#[test]
fn two_cameras_on_one_pole_may_show_the_same() {
    let hall = Hall {
        beside_m: Some(0.05),
        ..Hall::default()
    };
    assert_eq!(hall.causes(), []);
}

/// A hall looks nearly the same from the camera opposite, so that a camera which was turned fits the calibration of that one
/// better than its own: it was said to show that one's pictures, which stand elsewhere in the picture all the same.
#[test]
fn a_camera_that_was_turned_by_five_degrees_does_not_show_the_pictures_of_the_one_opposite() {
    for camera in 0..4 {
        for turned_deg in [
            [5.0, 0.0, 0.0],
            [-5.0, 0.0, 0.0],
            [0.0, 5.0, 0.0],
            [0.0, -5.0, 0.0],
        ] {
            let mistake = Mistake {
                turned_deg,
                ..Mistake::default()
            };
            let causes = Hall::with(camera, mistake).causes();
            let same = causes
                .iter()
                .find(|(_, cause)| *cause == DisagreementCause::SamePictures);
            assert_eq!(same, None, "camera {camera} by {turned_deg:?}");
            assert!(!causes.is_empty(), "camera {camera} by {turned_deg:?}");
        }
    }
}
