//! The calibration file that `farfield_proto::calibration` reads.

use std::fmt::Write as _;

use crate::adjustment::CameraState;

/// One camera of the file: name, width and height, state.
type Entry<'a> = (&'a str, [u32; 2], &'a CameraState);

/// The text of a calibration file: a table per camera, world to camera, rotations as Rodrigues vectors, numbers that read
/// back as the same bits.
pub fn calibration_toml<'a>(cameras: impl IntoIterator<Item = Entry<'a>>) -> String {
    let mut text = String::new();
    for (index, (name, [width, height], state)) in cameras.into_iter().enumerate() {
        let i = &state.intrinsics;
        let turn = state.camera_from_world.scaled_axis();
        let shift = -(state.camera_from_world * state.center_w);
        let used = if state.distortion[5..].iter().any(|c| *c != 0.0) {
            8
        } else {
            5
        };
        let name = toml::Value::String(name.to_owned());
        let coefficients = &state.distortion[..used];
        // Writing to a string cannot fail.
        let written = write!(
            text,
            "[cam_{index}]\nname = {name}\nsize = [{width}, {height}]\nmatrix = [[{:?}, 0.0, {:?}], [0.0, {:?}, {:?}], \
             [0.0, 0.0, 1.0]]\ndistortions = {coefficients:?}\nrotation = [{:?}, {:?}, {:?}]\ntranslation = [{:?}, {:?}, \
             {:?}]\nfisheye = false\n\n",
            i.fx_px, i.cx_px, i.fy_px, i.cy_px, turn.x, turn.y, turn.z, shift.x, shift.y, shift.z
        );
        debug_assert!(written.is_ok());
    }
    text
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::calibration::Calibration;
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_written_reads_back(
            turn in prop::array::uniform3(-1.8f64..1.8),
            center in prop::array::uniform3(-50.0f64..50.0),
            k1 in -0.05f64..0.05,
            k4 in prop::sample::select(vec![0.0, 0.01]),
        ) {
            let intrinsics = Intrinsics { fx_px: 1234.5, fy_px: 1230.1, cx_px: 955.2, cy_px: 601.7 };
            let lens = Distortion { k1, k4, ..Distortion::default() };
            let state = CameraState {
                camera_from_world: UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
                center_w: Vector3::from(center),
                ..CameraState::at_origin(intrinsics, &lens)
            };
            let text = calibration_toml([("north \"east\"", [1920, 1200], &state)]);
            let read = Calibration::parse(&text, Path::new("calibration.toml")).unwrap();
            let camera = &read.cameras["north \"east\""];
            prop_assert_eq!(camera.intrinsics(), &intrinsics);
            prop_assert_eq!(camera.distortion(), &lens);
            prop_assert_eq!(camera.size_px(), [1920, 1200]);
            prop_assert!((camera.center().coordinates_m().coords - state.center_w).norm() < 1e-9);
            let rotation = camera.camera_from_world().isometry().rotation;
            prop_assert!(rotation.angle_to(&state.camera_from_world) < 1e-9);
        }
    }
}
