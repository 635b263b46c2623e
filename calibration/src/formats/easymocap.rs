//! `EasyMocap`'s `intri.yml` and `extri.yml`: `K_<name>`, `dist_<name>`; `R_<name>` is the Rodrigues vector, `Rot_<name>` the
//! matrix, `T_<name>` in metres.

use std::fmt::Write as _;

use farfield_proto::toml_file::FileError;

use super::camera::{AmbiguousFour, CameraRecord, FileUnit, RawCamera, RawPose, RawSet};
use super::opencv::{value, yaml_matrix};
use super::toml_tables::lens;
use super::tree::{Node, Source, whole_size};
use super::{ExportError, Format, ImportOptions, TextFile, placed};

/// Largest difference between the two forms of one rotation.
const SAME_ROTATION: f64 = 1e-3;

pub(super) fn read(sources: &[Source<'_>], options: &ImportOptions) -> Result<RawSet, FileError> {
    let values = sources.iter().map(value).collect::<Result<Vec<_>, _>>()?;
    let roots: Vec<Node<'_>> = sources
        .iter()
        .zip(&values)
        .map(|(source, value)| Node::root(*source, value))
        .collect();
    let find = |name: &str| roots.iter().find_map(|root| root.get(name));
    let mut cameras = Vec::new();
    let mut ambiguous = AmbiguousFour::default();
    for (key, matrix) in roots.iter().flat_map(Node::fields) {
        let Some(name) = key.strip_prefix("K_") else {
            continue;
        };
        let distortion = find(&format!("dist_{name}"))
            .or_else(|| find(&format!("D_{name}")))
            .ok_or_else(|| matrix.error(format!("its `dist_{name}` is missing")))?;
        let size = match (find(&format!("W_{name}")), find(&format!("H_{name}"))) {
            (Some(width), Some(height)) => whole_size([width.number()?, height.number()?]),
            _ => None,
        };
        let coefficients = distortion.numbers()?;
        let camera = RawCamera {
            name: name.to_owned(),
            size_px: size,
            intrinsics: matrix.intrinsics()?,
            lens: lens(&distortion, &coefficients, options.four_are_fisheye)?,
            pose: pose(name, &find)?,
        };
        if !options.four_are_fisheye {
            ambiguous.note(&camera, &coefficients);
        }
        cameras.push(camera);
    }
    Ok(RawSet {
        cameras,
        unit: FileUnit::Metres,
        remarks: ambiguous.remark().into_iter().collect(),
    })
}

fn pose<'a>(
    name: &str,
    find: &impl Fn(&str) -> Option<Node<'a>>,
) -> Result<Option<RawPose>, FileError> {
    let vector = find(&format!("R_{name}"));
    let matrix = find(&format!("Rot_{name}"));
    let Some(node) = matrix.as_ref().or(vector.as_ref()) else {
        return Ok(None);
    };
    let rotation = node.rotation()?;
    if let Some(vector) = &vector {
        let off = (vector.rotation()? - rotation).abs().max();
        if off > SAME_ROTATION {
            return Err(vector.error(format!(
                "it differs from `Rot_{name}` by {off:.3}, expected the same rotation as a Rodrigues vector"
            )));
        }
    }
    let translation = find(&format!("T_{name}"))
        .ok_or_else(|| node.error(format!("its `T_{name}` is missing")))?
        .vector()?;
    Ok(Some(RawPose {
        rotation,
        translation,
    }))
}

/// `intri.yml` and `extri.yml`.
pub(super) fn write(cameras: &[CameraRecord]) -> Result<Vec<TextFile>, ExportError> {
    let names: Vec<String> = cameras
        .iter()
        .map(|camera| format!("   - {}\n", serde_json::Value::from(camera.name.as_str())))
        .collect();
    let head = format!("%YAML:1.0\n---\nnames:\n{}", names.concat());
    let (mut intrinsics, mut extrinsics) = (head.clone(), head);
    for camera in cameras {
        let name = &camera.name;
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') {
            return Err(ExportError::Name {
                camera: name.clone(),
                format: Format::EasyMocap,
                expected: "letters, digits and underscores",
            });
        }
        let pose = placed(camera, Format::EasyMocap)?;
        let k = &camera.intrinsics;
        let matrix = [k.fx_px, 0.0, k.cx_px, 0.0, k.fy_px, k.cy_px, 0.0, 0.0, 1.0];
        intrinsics.push_str(&yaml_matrix(&format!("K_{name}"), 3, &matrix, ""));
        let coefficients = camera.lens.coefficients();
        if camera.lens.is_fisheye() || coefficients.len() > 5 {
            return Err(ExportError::Lens {
                camera: name.clone(),
                format: Format::EasyMocap,
                has: "5 coefficients of OpenCV",
            });
        }
        intrinsics.push_str(&yaml_matrix(&format!("dist_{name}"), 1, &coefficients, ""));
        let [width, height] = camera.size_px;
        // Writing into a string cannot fail.
        _ = write!(intrinsics, "H_{name}: {height}\nW_{name}: {width}\n");
        let vector: [f64; 3] = pose.rotation.scaled_axis().into();
        extrinsics.push_str(&yaml_matrix(&format!("R_{name}"), 3, &vector, ""));
        let rotation = pose.rotation.to_rotation_matrix();
        extrinsics.push_str(&yaml_matrix(
            &format!("Rot_{name}"),
            3,
            rotation.matrix().transpose().as_slice(),
            "",
        ));
        extrinsics.push_str(&yaml_matrix(
            &format!("T_{name}"),
            3,
            pose.translation.vector.as_slice(),
            "",
        ));
    }
    Ok(vec![
        TextFile {
            path: "intri.yml".into(),
            text: intrinsics,
        },
        TextFile {
            path: "extri.yml".into(),
            text: extrinsics,
        },
    ])
}
