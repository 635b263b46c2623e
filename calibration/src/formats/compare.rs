//! Compares two calibrations and measures by how much they differ.

use nalgebra::Vector2;

use super::camera::CameraRecord;

/// Cameras closer than this stand at one place, metres: files keep a tenth of a millimetre.
const SAME_PLACE_M: f64 = 1e-3;
/// Smaller rotations count as none, radians: 1 mm at 10 m.
const SAME_TURN_RAD: f64 = 1e-4;
/// Lenses that project all points closer than this are equal, pixels: below the accuracy of any keypoint.
const SAME_LENS_PX: f64 = 0.5;
/// Points along each side of a picture where lenses are compared.
const GRID: u32 = 5;

/// Describes how `b` differs from `a`: the cameras and the distances. `None` if they agree.
/// Cameras are matched by name, or by order if no names match.
pub fn difference(a: &[CameraRecord], b: &[CameraRecord]) -> Option<String> {
    let by_name = |camera: &CameraRecord| b.iter().find(|it| it.name == camera.name);
    let named: Vec<_> = a.iter().filter_map(|it| Some((it, by_name(it)?))).collect();
    let have_names = named.len() == a.len().max(b.len());
    let pairs = if named.is_empty() && a.len() == b.len() {
        a.iter().zip(b).collect()
    } else {
        named
    };
    let mut parts = Vec::new();
    if !have_names && pairs.len() < a.len().max(b.len()) {
        parts.push(format!("it has {} cameras, not {}", b.len(), a.len()));
    }
    let apart_m = largest(&pairs, |a, b| {
        let [a, b] = [a, b].map(|it| {
            it.camera_from_world
                .map(|pose| pose.inverse().translation.vector)
        });
        Some((a? - b?).norm())
    });
    if let Some((name, apart_m)) = apart_m.filter(|(_, apart_m)| *apart_m > SAME_PLACE_M) {
        parts.push(format!("it places camera {name} {apart_m:.3} m away"));
    }
    let turn_rad = largest(&pairs, |a, b| {
        Some(
            a.camera_from_world?
                .rotation
                .angle_to(&b.camera_from_world?.rotation),
        )
    });
    if let Some((name, turn_rad)) = turn_rad.filter(|(_, turn_rad)| *turn_rad > SAME_TURN_RAD) {
        parts.push(format!(
            "it turns camera {name} by {:.2} degrees",
            turn_rad.to_degrees()
        ));
    }
    let lens_px = largest(&pairs, |a, b| Some(lens_px(a, b)));
    if let Some((name, lens_px)) = lens_px.filter(|(_, lens_px)| *lens_px > SAME_LENS_PX) {
        let text = if lens_px.is_finite() {
            format!("its lens of camera {name} draws up to {lens_px:.1} px elsewhere")
        } else {
            format!("its lens of camera {name} is for pictures of another size")
        };
        parts.push(text);
    }
    let unplaced = pairs
        .iter()
        .find(|(a, b)| a.camera_from_world.is_some() != b.camera_from_world.is_some());
    parts.extend(unplaced.map(|(a, _)| format!("only one has a pose of camera {}", a.name)));
    (!parts.is_empty()).then(|| parts.join(", "))
}

/// The largest value of a measure, and its camera.
fn largest<'a>(
    pairs: &[(&'a CameraRecord, &CameraRecord)],
    measure: impl Fn(&CameraRecord, &CameraRecord) -> Option<f64>,
) -> Option<(&'a str, f64)> {
    let measured = pairs
        .iter()
        .filter_map(|(a, b)| Some((a.name.as_str(), measure(a, b)?)));
    measured.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// The largest distance between the pixels of one direction in two lenses; infinite for different picture sizes.
fn lens_px(a: &CameraRecord, b: &CameraRecord) -> f64 {
    if a.size_px != b.size_px {
        return f64::INFINITY;
    }
    let at = |i: u32, size: u32| f64::from(i) / f64::from(GRID - 1) * f64::from(size - 1);
    let points = (0..GRID * GRID).map(|i| {
        let [x, y] = [at(i % GRID, a.size_px[0]), at(i / GRID, a.size_px[1])];
        let direction = Vector2::new(
            (x - a.intrinsics.cx_px) / a.intrinsics.fx_px,
            (y - a.intrinsics.cy_px) / a.intrinsics.fy_px,
        );
        let drawn = [a, b].map(|it| {
            let (on, _) = it.lens.draw_with_jacobian(direction);
            let k = &it.intrinsics;
            Vector2::new(k.fx_px * on.x + k.cx_px, k.fy_px * on.y + k.cy_px)
        });
        (drawn[0] - drawn[1]).norm()
    });
    points.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::super::LensModel;
    use super::super::tests::ring;
    use super::*;
    use nalgebra::{Translation3, Vector3};

    #[test]
    fn differences_are_reported_in_metres_degrees_and_pixels() {
        let a = ring(Vector3::z(), LensModel::ideal());
        assert_eq!(difference(&a, &a), None);
        let mut renamed = a.clone();
        for camera in &mut renamed {
            camera.name = format!("other_{}", camera.name);
        }
        assert_eq!(difference(&a, &renamed), None);
        let mut moved = a.clone();
        let pose = moved[1].camera_from_world.unwrap();
        moved[1].camera_from_world = Some(Translation3::new(0.3, 0.0, 0.0) * pose);
        let text = difference(&a, &moved).unwrap();
        assert_eq!(text, "it places camera cam1 0.300 m away");
        let mut longer = a.clone();
        longer[2].intrinsics.fx_px *= 1.01;
        let text = difference(&a, &longer).unwrap();
        assert_eq!(text, "its lens of camera cam2 draws up to 9.6 px elsewhere");
        longer[2].size_px = [1280, 720];
        assert!(difference(&a, &longer).unwrap().contains("another size"));
        assert!(
            difference(&a, &a[..3])
                .unwrap()
                .contains("it has 3 cameras, not 4")
        );
    }
}
