//! Kalibr's `camchain.yaml`: each camera has its pose relative to the previous one, `T_cn_cnm1`; the first is the world.

use std::fmt::Write as _;

use farfield_proto::camera::{Distortion, Intrinsics};
use farfield_proto::toml_file::FileError;
use nalgebra::{Matrix3, Matrix4, Vector3};

use super::camera::{
    CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, Remark, RemarkKind, all_zero,
};
use super::opencv::value;
use super::tree::{Node, Source};
use super::{ExportError, Format, placed};

pub(super) fn read(source: &Source<'_>) -> Result<RawSet, FileError> {
    let value = value(source)?;
    let root = Node::root(*source, &value);
    let mut cameras = Vec::new();
    let mut before = RawPose {
        rotation: Matrix3::identity(),
        translation: Vector3::zeros(),
    };
    // Numeric order: `cam10` comes after `cam9`.
    for index in 0.. {
        let Some(table) = root.get(&format!("cam{index}")) else {
            break;
        };
        if index > 0 {
            let step = table.need(&["T_cn_cnm1"])?;
            let (rotation, translation) = rigid(&step)?;
            before = RawPose {
                rotation: rotation * before.rotation,
                translation: rotation * before.translation + translation,
            };
        }
        cameras.push(camera(format!("cam{index}"), &table, before)?);
    }
    if cameras.is_empty() {
        return Err(root.error("found no `cam0`, expected Kalibr's `cam0`, `cam1`, ..."));
    }
    let text = "the world is the first camera: x right, y down, z forward";
    Ok(RawSet {
        cameras,
        unit: FileUnit::Metres,
        remarks: vec![Remark::of_all(RemarkKind::Assumed, text)],
    })
}

fn rigid(step: &Node<'_>) -> Result<(Matrix3<f64>, Vector3<f64>), FileError> {
    let m = Matrix4::from_row_slice(&step.fixed::<16>()?);
    if m.row(3) != nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0) {
        return Err(step.error("expected a last row of 0, 0, 0, 1"));
    }
    let rotation = step.orthonormal(m.fixed_view::<3, 3>(0, 0).into_owned())?;
    Ok((rotation, m.fixed_view::<3, 1>(0, 3).into_owned()))
}

fn camera(name: String, table: &Node<'_>, pose: RawPose) -> Result<RawCamera, FileError> {
    let model = table.need(&["camera_model"])?;
    if model.text().as_deref() != Some("pinhole") {
        return Err(model.error(format!("found {}, expected `pinhole`", model.value())));
    }
    let [fx_px, fy_px, cx_px, cy_px] = table.need(&["intrinsics"])?.fixed::<4>()?;
    let kind = table.need(&["distortion_model"])?;
    let coefficients = || {
        table
            .need(&["distortion_coeffs"])
            .and_then(|c| c.fixed::<4>())
    };
    let lens = match kind.text().as_deref() {
        Some("none") => LensModel::ideal(),
        Some("equidistant") => LensModel::KannalaBrandt(coefficients()?),
        Some("radtan") => {
            let [k1, k2, p1, p2] = coefficients()?;
            LensModel::Rational(Distortion {
                k1,
                k2,
                p1,
                p2,
                ..Distortion::default()
            })
        }
        _ => {
            return Err(kind.error(format!(
                "found {}, expected `radtan`, `equidistant` or `none`",
                kind.value()
            )));
        }
    };
    Ok(RawCamera {
        name,
        size_px: Some(table.need(&["resolution"])?.size()?),
        intrinsics: Intrinsics {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
        },
        lens,
        pose: Some(pose),
    })
}

/// One `camchain.yaml`. The first camera becomes the world.
pub(super) fn write(cameras: &[CameraRecord]) -> Result<String, ExportError> {
    let mut text = String::new();
    let mut before = None;
    for (i, camera) in cameras.iter().enumerate() {
        let pose = placed(camera, Format::Kalibr)?;
        let k = &camera.intrinsics;
        let (model, coefficients) = match camera.lens {
            LensModel::KannalaBrandt(k) => ("equidistant", k),
            LensModel::Rational(d) if all_zero(&[d.k3, d.k4, d.k5, d.k6]) => {
                ("radtan", [d.k1, d.k2, d.p1, d.p2])
            }
            LensModel::Rational(_) => {
                return Err(ExportError::Lens {
                    camera: camera.name.clone(),
                    format: Format::Kalibr,
                    has: "k1, k2, p1, p2 or the fisheye model",
                });
            }
        };
        let comment = camera.name.replace(char::is_control, " ");
        // Writing into a string cannot fail.
        _ = writeln!(text, "cam{i}: # {comment}");
        if let Some(before) = before {
            let step = (pose * nalgebra::Isometry3::inverse(&before)).to_homogeneous();
            text.push_str("  T_cn_cnm1:\n");
            for row in step.row_iter() {
                _ = writeln!(
                    text,
                    "  - [{:?}, {:?}, {:?}, {:?}]",
                    row[0], row[1], row[2], row[3]
                );
            }
        }
        _ = writeln!(
            text,
            "  camera_model: pinhole\n  intrinsics: {:?}\n  distortion_model: {model}\n  distortion_coeffs: {coefficients:?}\n  \
             resolution: {:?}\n  rostopic: /cam{i}/image_raw",
            [k.fx_px, k.fy_px, k.cx_px, k.cy_px],
            camera.size_px,
        );
        before = Some(pose);
    }
    Ok(text)
}
