//! Facts about cameras that an output format cannot store. They are reported as remarks; the export still succeeds.

use super::Format;
use super::camera::{CameraRecord, Remark, RemarkKind};

/// A pose closer than this to the identity counts as the identity, metres and radians.
const SAME_WORLD: f64 = 1e-9;

/// Remarks on what `format` cannot store of `cameras`: names, the pose of the world, the unit of length.
/// [`super::export`] refuses lenses that the format cannot store.
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

/// Reports numbers instead of names; `numbered` gives the name that the format uses.
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
            "the format `{format}` has numbers instead of names: {}",
            renamed.join(", ")
        )
    })
}

/// Reports that the first camera becomes the world.
fn world(cameras: &[CameraRecord], format: Format) -> Option<String> {
    let first = cameras.first()?;
    let pose = first.camera_from_world?;
    let is_world =
        pose.rotation.angle() < SAME_WORLD && pose.translation.vector.norm() < SAME_WORLD;
    (!is_world).then(|| {
        format!(
            "the format `{format}` does not store the pose of the world: camera `{}` becomes the origin, and the direction of up \
             and the position of the floor are lost; keep the original file",
            first.name
        )
    })
}

/// Reports lengths without a unit.
fn unit(cameras: &[CameraRecord], format: Format) -> Option<String> {
    let is_placed = cameras.iter().any(|it| it.camera_from_world.is_some());
    is_placed.then(|| {
        format!(
            "the format `{format}` has no unit of length: its numbers are metres; set metres in the program that reads it"
        )
    })
}

#[cfg(test)]
mod tests {
    use farfield_proto::camera::{Intrinsics, LensModel};
    use nalgebra::{Isometry3, Vector3};

    use super::super::{ImportOptions, export, import};
    use super::*;

    /// The part that the remarks of both the export and the import contain.
    const NO_UNIT: &str = "no unit of length";

    /// Cameras with these names; the first stands at `first_m`.
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

    fn texts(cameras: &[CameraRecord], format: Format) -> Vec<String> {
        let remarks = losses(cameras, format).into_iter();
        remarks.map(|remark| remark.text).collect()
    }

    #[test]
    fn one_remark_lists_all_names_that_become_numbers() {
        let lost = texts(
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
            texts(&cameras(&["cam_0", "cam_1"], 3.0), Format::Caliscope),
            none
        );
    }

    #[test]
    fn a_world_that_becomes_the_first_camera_is_reported() {
        let lost = texts(&cameras(&["north", "south"], 3.0), Format::Kalibr);
        let [names, world] = lost.as_slice() else {
            panic!("{lost:?}")
        };
        assert!(names.contains("`south` is `cam1`"), "{names}");
        assert!(
            world.contains("camera `north` becomes the origin"),
            "{world}"
        );
        let none: [String; 0] = [];
        assert_eq!(
            texts(&cameras(&["cam0", "cam1"], 0.0), Format::Kalibr),
            none
        );
    }

    fn has_moved(read: &CameraRecord, written: &CameraRecord) -> bool {
        let matrix = |camera: &CameraRecord| camera.camera_from_world.unwrap().to_homogeneous();
        (matrix(read) - matrix(written)).abs().max() > SAME_WORLD
    }

    #[test]
    fn losses_are_exactly_what_a_round_trip_changes() {
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
                ("numbers instead of names", is_renamed),
                ("the pose of the world", pairs.any(|(a, b)| has_moved(a, b))),
                (NO_UNIT, assumed.iter().any(|text| text.contains(NO_UNIT))),
            ];
            let lost = texts(&cameras, format);
            for (part, is_expected) in differences {
                let is_reported = lost.iter().any(|text| text.contains(part));
                assert_eq!(is_reported, is_expected, "{format}: {part}");
            }
            let count = differences.iter().filter(|(_, is_expected)| *is_expected);
            assert_eq!(lost.len(), count.count(), "{format}: {lost:?}");
        }
    }
}
