//! Cameras and venues for unit tests.

use std::path::Path;

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::{CameraModel, Distortion, Intrinsics, LensModel};
use farfield_proto::frames::Transform;
use farfield_proto::venue::Venue;
use nalgebra::Isometry3;

/// A camera of any lens but a fisheye.
pub(crate) fn distorted(name: &str, size_px: [u32; 2], distortion: Distortion) -> CameraModel {
    let [width, height] = size_px.map(f64::from);
    let intrinsics = Intrinsics {
        fx_px: width,
        fy_px: width,
        cx_px: (width - 1.0) / 2.0,
        cy_px: (height - 1.0) / 2.0,
    };
    let at_origin = Transform::new(Isometry3::identity());
    CameraModel::new(name, size_px, intrinsics, distortion, at_origin).unwrap()
}

/// A camera without distortion.
pub(crate) fn pinhole(name: &str, size_px: [u32; 2]) -> CameraModel {
    distorted(name, size_px, Distortion::default())
}

/// A camera whose barrel distortion moves the corner of a 16:10 image by a tenth of its distance.
pub(crate) fn bent(name: &str, size_px: [u32; 2]) -> CameraModel {
    distorted(
        name,
        size_px,
        Distortion {
            k1: -0.3,
            k2: 0.1,
            p1: 1e-3,
            ..Distortion::default()
        },
    )
}

/// A fisheye with 180 degrees across its picture, of which 120 are used.
pub(crate) fn fisheye(name: &str, size_px: [u32; 2]) -> CameraModel {
    let [width, height] = size_px.map(f64::from);
    let focal_px = width / std::f64::consts::PI;
    let intrinsics = Intrinsics {
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: (width - 1.0) / 2.0,
        cy_px: (height - 1.0) / 2.0,
    };
    let at_origin = Transform::new(Isometry3::identity());
    let lens = LensModel::KannalaBrandt([0.0; 4]);
    CameraModel::new(name, size_px, intrinsics, lens, at_origin).unwrap()
}

/// A venue of one viewpoint with pinhole cameras of 640 x 480 pixels and one source per camera, in
/// the syntax of a venue file.
pub(crate) fn venue(sources: &[&str]) -> Venue {
    let head = "name = \"hall\"\nrate_hz = 60.0\ncalibration = \"c.toml\"\nnetwork = \"n.toml\"\n[[viewpoint]]\nname = \"v\"\n";
    let calibrated = |i: usize| {
        format!(
            "[c{i}]\nname = \"c{i}\"\nsize = [640, 480]\n\
             matrix = [[640.0, 0.0, 319.5], [0.0, 640.0, 239.5], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [0.0, 0.0, 0.0]\ntranslation = [{i}.0, 0.0, 0.0]\n"
        )
    };
    let listed = |(i, source): (usize, &&str)| {
        format!("[[viewpoint.camera]]\nname = \"c{i}\"\nsource = {source}\n")
    };
    let calibration: String = (0..sources.len()).map(calibrated).collect();
    let cameras: String = sources.iter().enumerate().map(listed).collect();
    let venue = format!("{head}{cameras}");
    let calibration = Calibration::parse(&calibration, Path::new("c.toml")).unwrap();
    Venue::parse(&venue, Path::new("v.toml"), calibration).unwrap()
}
