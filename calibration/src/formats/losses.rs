//! What a format cannot hold of cameras that are written in it: nothing is refused for it, and nothing is lost unsaid.

use super::Format;
use super::camera::{CameraRecord, Remark, RemarkKind};

/// A pose nearer to that of the world itself is the same, metres and radians.
const SAME_WORLD: f64 = 1e-9;

/// What is lost of `cameras` in `format`, a remark each: names, where the world is, the unit of length. What a format
/// cannot say of a lens is refused by [`super::export`].
pub fn losses(cameras: &[CameraRecord], format: Format) -> Vec<Remark> {
    let lost = match format {
        Format::Caliscope => vec![names(cameras, format, |i| format!("cam_{i}"))],
        Format::Kalibr => vec![
            names(cameras, format, |i| format!("cam{i}")),
            world(cameras, format),
        ],
        Format::Colmap => vec![unit(cameras, format)],
        Format::Farfield
        | Format::FreeMoCap
        | Format::OpenCvYaml
        | Format::OpenCvJson
        | Format::Qualisys
        | Format::Theia
        | Format::EasyMocap
        | Format::Vicon => Vec::new(),
    };
    let lost = lost.into_iter().flatten();
    lost.map(|text| Remark::of_all(RemarkKind::Doubtful, text))
        .collect()
}

/// Numbers in the place of names; `numbered` is what a camera is called then.
fn names(
    cameras: &[CameraRecord],
    format: Format,
    numbered: impl Fn(usize) -> String,
) -> Option<String> {
    let renamed = cameras.iter().enumerate();
    let renamed = renamed.map(|(i, camera)| (camera.name.as_str(), numbered(i)));
    let renamed = renamed.filter(|(name, number)| name != number);
    let renamed: Vec<String> = renamed
        .map(|(name, number)| format!("`{name}` is `{number}`"))
        .collect();
    (!renamed.is_empty()).then(|| {
        format!(
            "the format `{format}` has numbers in the place of names: {}",
            renamed.join(", ")
        )
    })
}

/// The first camera in the place of the world.
fn world(cameras: &[CameraRecord], format: Format) -> Option<String> {
    let first = cameras.first()?;
    let pose = first.camera_from_world?;
    let is_world =
        pose.rotation.angle() < SAME_WORLD && pose.translation.vector.norm() < SAME_WORLD;
    (!is_world).then(|| {
        format!(
            "the format `{format}` cannot hold where the world is: camera `{}` is its origin there, and which way is up and \
             where the floor is are lost; keep the file that was read",
            first.name
        )
    })
}

/// Lengths without a unit.
fn unit(cameras: &[CameraRecord], format: Format) -> Option<String> {
    let is_placed = cameras.iter().any(|it| it.camera_from_world.is_some());
    is_placed.then(|| {
        format!(
            "the format `{format}` has no unit of length: its numbers are metres, which whoever reads it must be told"
        )
    })
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Intrinsics, LensModel};
    use nalgebra::{Isometry3, Vector3};

    use super::super::{ImportOptions, export, import};
    use super::*;

    /// What is said of a file without one, by whoever writes it and whoever reads it.
    const NO_UNIT: &str = "no unit of length";

    /// Cameras of these names, the first at `first_m` of the world.
    fn cameras(names: &[&str], first_m: f64) -> Vec<CameraRecord> {
        let camera = |(i, name): (usize, &&str)| {
            let along_m = first_m + 2.0 * i as f64;
            CameraRecord {
                name: (*name).to_owned(),
                size_px: [640, 480],
                intrinsics: Intrinsics {
                    fx_px: 600.0,
                    fy_px: 600.0,
                    cx_px: 319.5,
                    cy_px: 239.5,
                },
                lens: LensModel::ideal(),
                camera_from_world: Some(Isometry3::new(Vector3::x() * along_m, Vector3::zeros())),
            }
        };
        names.iter().enumerate().map(camera).collect()
    }

    fn said(cameras: &[CameraRecord], format: Format) -> Vec<String> {
        let remarks = losses(cameras, format).into_iter();
        remarks.map(|remark| remark.text).collect()
    }

    #[test]
    fn names_that_become_numbers_are_told_with_these_once() {
        let lost = said(
            &cameras(&["north", "cam_1", "south"], 0.0),
            Format::Caliscope,
        );
        let [only] = lost.as_slice() else {
            panic!("{lost:?}")
        };
        assert!(
            only.ends_with(": `north` is `cam_0`, `south` is `cam_2`"),
            "{only}"
        );
        let none: [String; 0] = [];
        assert_eq!(
            said(&cameras(&["cam_0", "cam_1"], 3.0), Format::Caliscope),
            none
        );
    }

    #[test]
    fn a_world_that_becomes_the_first_camera_is_told() {
        let lost = said(&cameras(&["north", "south"], 3.0), Format::Kalibr);
        let [names, world] = lost.as_slice() else {
            panic!("{lost:?}")
        };
        assert!(names.contains("`south` is `cam1`"), "{names}");
        assert!(
            world.contains("camera `north` is its origin there"),
            "{world}"
        );
        let none: [String; 0] = [];
        assert_eq!(said(&cameras(&["cam0", "cam1"], 0.0), Format::Kalibr), none);
    }

    fn has_moved((read, written): (&CameraRecord, &CameraRecord)) -> bool {
        let of = |camera: &CameraRecord| camera.camera_from_world.unwrap().to_homogeneous();
        (of(read) - of(written)).abs().max() > SAME_WORLD
    }

    #[test]
    fn what_comes_back_otherwise_than_it_was_written_is_told_and_nothing_else() {
        let cameras = cameras(&["north", "south"], 3.0);
        for format in Format::ALL {
            let files = export(&cameras, format).unwrap();
            let options = ImportOptions {
                format: Some(format),
                ..ImportOptions::default()
            };
            let back = import(&files, &options).unwrap();
            assert_eq!(back.cameras.len(), cameras.len(), "{format}");
            let mut pairs = back.cameras.iter().zip(&cameras);
            assert!(pairs.clone().all(|(a, b)| a.size_px == b.size_px));
            let is_renamed = pairs.clone().any(|(a, b)| a.name != b.name);
            let assumed: Vec<&str> = back.remarks.iter().map(|it| it.text.as_str()).collect();
            let differences = [
                ("numbers in the place of names", is_renamed),
                ("where the world is", pairs.any(has_moved)),
                (NO_UNIT, assumed.iter().any(|text| text.contains(NO_UNIT))),
            ];
            let lost = said(&cameras, format);
            for (words, is_there) in differences {
                let is_told = lost.iter().any(|text| text.contains(words));
                assert_eq!(is_told, is_there, "{format}: {words}");
            }
            let count = differences.iter().filter(|(_, is_there)| *is_there);
            assert_eq!(lost.len(), count.count(), "{format}: {lost:?}");
        }
    }
}
