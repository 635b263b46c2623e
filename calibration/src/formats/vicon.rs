//! Vicon's `.xcp`: XML, millimetres. The rotation is a quaternion (world to camera) with the real part last; the position is
//! that of the camera.
//!
//! `PRINCIPAL_POINT` refers to the whole sensor. A video of its middle is cropped by (`SENSOR_SIZE` - video) / 2 at its left
//! and upper edge; the file does not state the crop ([`super::ImportOptions::video_px`]).
//! `VICON_RADIAL2` has the coefficients of r^2, r^4, r^6 in its fields 4 to 6.

use std::fmt::Write as _;

use farfield_proto::camera::Intrinsics;
use farfield_proto::toml_file::FileError;
use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

use super::camera::{
    CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, Remark, RemarkKind, all_zero,
};
use super::tree::{Source, whole_size};
use super::xml::{Element, Films, escaped, parse, select_filming, words};
use super::{ExportError, Format, ImportOptions, placed};

/// Smaller first coefficients are per square pixel: without unit they would move nothing by a tenth of a pixel.
const PER_PIXEL: f64 = 1e-4;
/// Largest deviation of a quaternion's length from 1.
const QUATERNION_TOLERANCE: f64 = 1e-2;
/// Radii at which a lens model is inverted.
const RADII: u32 = 40;

pub(super) fn read(source: &Source<'_>, options: &ImportOptions) -> Result<RawSet, FileError> {
    let document = parse(source)?;
    let root = Element {
        source: *source,
        node: document.root_element(),
    };
    let mut remarks = Vec::new();
    let mut cameras = Vec::new();
    let all = root.children("Camera");
    let mut described = Vec::new();
    for element in &all {
        let kind = ["TYPE", "DISPLAY_TYPE"].map(|name| element.text(name).unwrap_or_default());
        let films = films(&kind.join(" "));
        described.push((element.need_text("DEVICEID")?, kind.join(" "), films));
    }
    let selected = select_filming(&described, &mut remarks);
    for ((element, (name, ..)), is_selected) in all.iter().zip(described).zip(selected) {
        if !is_selected {
            continue;
        }
        let frames = element
            .child("KeyFrames")
            .map(|frames| frames.children("KeyFrame"));
        let Some(key) = frames.as_ref().and_then(|frames| frames.first()) else {
            remarks.push(Remark::of_camera(
                RemarkKind::Assumed,
                name,
                "it has no calibration in this file: left out",
            ));
            continue;
        };
        if frames.as_ref().is_some_and(|frames| frames.len() > 1) {
            remarks.push(Remark::of_camera(
                RemarkKind::Doubtful,
                name,
                "it moves (several key frames): the first was taken",
            ));
        }
        cameras.push(camera(
            name.to_owned(),
            element,
            key,
            options,
            &mut remarks,
        )?);
    }
    Ok(RawSet {
        cameras,
        unit: FileUnit::Millimetres,
        remarks,
    })
}

/// Decides by type: Vicon writes `VideoCamera` or `Vue` for cameras that film, and the model for cameras that see markers.
fn films(kind: &str) -> Films {
    const MARKERS: [&str; 7] = ["vero", "vantage", "valkyrie", "bonita", "viper", "mx", "t"];
    let words = words(kind);
    let is_of = |word: &String, model: &str| {
        let rest = word
            .strip_prefix(model)
            .map(|rest| rest.trim_end_matches("camera"));
        rest.is_some_and(|rest| {
            rest.chars().all(|c| c.is_ascii_digit()) && (model.len() > 1 || !rest.is_empty())
        })
    };
    let is_marker = |word: &String| MARKERS.iter().any(|model| is_of(word, model));
    if kind.trim().is_empty()
        || words
            .iter()
            .any(|word| word.contains("video") || word.contains("vue"))
    {
        Films::Known
    } else if words.iter().any(is_marker) {
        Films::Never
    } else {
        Films::Perhaps
    }
}

fn camera(
    name: String,
    element: &Element<'_, '_>,
    key: &Element<'_, '_>,
    options: &ImportOptions,
    remarks: &mut Vec<Remark>,
) -> Result<RawCamera, FileError> {
    let sensor = element.fixed::<2>("SENSOR_SIZE")?;
    let sensor_px = whole_size(sensor).ok_or_else(|| {
        element.error(
            "SENSOR_SIZE",
            format!("found {sensor:?}, expected pixels above 0"),
        )
    })?;
    let size_px = options.video_px.unwrap_or(sensor_px);
    if size_px[0] > sensor_px[0] || size_px[1] > sensor_px[1] {
        return Err(element.error(
            "SENSOR_SIZE",
            format!("found {sensor_px:?}, smaller than the video of {size_px:?}"),
        ));
    }
    if options.video_px.is_none() {
        let text = "the video is taken as large as the sensor; if it is cropped, give its size";
        remarks.push(Remark::of_camera(RemarkKind::Assumed, &name, text));
    }
    let crop = [0, 1].map(|i| f64::from(sensor_px[i] - size_px[i]) / 2.0);
    let focal = key.number("FOCAL_LENGTH")?;
    let aspect = element
        .text("PIXEL_ASPECT_RATIO")
        .map_or(Ok(1.0), |_| element.number("PIXEL_ASPECT_RATIO"))?;
    if aspect <= 0.0 {
        return Err(element.error(
            "PIXEL_ASPECT_RATIO",
            format!("found {aspect}, expected a number above 0"),
        ));
    }
    if element.number_or_zero("SKEW")? != 0.0 {
        return Err(element.error("SKEW", "expected 0: a skew is not supported"));
    }
    let center = key.fixed::<2>("PRINCIPAL_POINT")?;
    let radius_px = 0.5 * Vector3::new(sensor[0], sensor[1], 0.0).norm();
    let lens = lens(&name, &radial(key)?, focal, radius_px, remarks);
    Ok(RawCamera {
        name,
        size_px: Some(size_px),
        intrinsics: Intrinsics {
            fx_px: focal,
            fy_px: focal / aspect,
            cx_px: center[0] - crop[0],
            cy_px: center[1] - crop[1],
        },
        lens,
        pose: Some(RawPose::at(
            orientation(key)?,
            Vector3::from(key.fixed::<3>("POSITION")?),
        )),
    })
}

fn orientation(key: &Element<'_, '_>) -> Result<Matrix3<f64>, FileError> {
    let [x, y, z, w] = key.fixed::<4>("ORIENTATION")?;
    let q = Quaternion::new(w, x, y, z);
    if (q.norm() - 1.0).abs() > QUATERNION_TOLERANCE {
        let problem = format!("found a quaternion of length {:.3}, expected 1", q.norm());
        return Err(key.error("ORIENTATION", problem));
    }
    Ok(UnitQuaternion::from_quaternion(q)
        .to_rotation_matrix()
        .into_inner())
}

/// The coefficients of r^2, r^4, r^6.
fn radial(key: &Element<'_, '_>) -> Result<[f64; 3], FileError> {
    const ATTRIBUTE: &str = "VICON_RADIAL2";
    let Some(text) = key.text(ATTRIBUTE) else {
        return match key.text("VICON_RADIAL") {
            Some(_) => key.fixed::<2>("VICON_RADIAL").map(|[k1, k2]| [k1, k2, 0.0]),
            None => Ok([0.0; 3]),
        };
    };
    let words: Vec<&str> = text.split_whitespace().skip(3).collect();
    let mut k = [0.0; 3];
    if words.is_empty() || words.len() > 3 {
        return Err(key.error(
            ATTRIBUTE,
            format!("found `{text}`, expected `ViconRadial2`, the centre and up to 3 coefficients"),
        ));
    }
    for (k, word) in k.iter_mut().zip(words) {
        let number = word.parse::<f64>().ok().filter(|n| n.is_finite());
        *k = number.ok_or_else(|| {
            key.error(
                ATTRIBUTE,
                format!("found `{word}`, expected a finite number"),
            )
        })?;
    }
    Ok(k)
}

/// Coefficients without unit are OpenCV's. Those per pixel correct the distorted picture, and are inverted.
fn lens(
    name: &str,
    k: &[f64; 3],
    focal: f64,
    radius_px: f64,
    remarks: &mut Vec<Remark>,
) -> LensModel {
    if all_zero(k) || k[0].abs() >= PER_PIXEL {
        return LensModel::rational(&[k[0], k[1], 0.0, 0.0, k[2]]).unwrap_or_else(LensModel::ideal);
    }
    let f2 = focal * focal;
    let correcting = [k[0] * f2, k[1] * f2 * f2, k[2] * f2 * f2 * f2];
    let (k, worst) = inverted(&correcting, radius_px / focal);
    let text = format!(
        "its distortion is per pixel and corrects the distorted picture; inverted to OpenCV's k1, k2, k3 within {:.2} px",
        worst * focal
    );
    remarks.push(Remark::of_camera(RemarkKind::Corrected, name, text));
    LensModel::rational(&[k[0], k[1], 0.0, 0.0, k[2]]).unwrap_or_else(LensModel::ideal)
}

/// Coefficients that draw what `correcting` corrects, ideal = drawn (1 + sum k drawn^2i), up to the drawn radius `to` (focal
/// lengths): least squares over the radius. Also returns the largest difference.
fn inverted(correcting: &[f64; 3], to: f64) -> ([f64; 3], f64) {
    let ideal = |r: f64| {
        r * (1.0 + r * r * (correcting[0] + r * r * (correcting[1] + r * r * correcting[2])))
    };
    let radii = || (1..=RADII).map(|i| to * f64::from(i) / f64::from(RADII));
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for drawn in radii() {
        let r = ideal(drawn);
        let row = Vector3::new(r * r * r, r.powi(5), r.powi(7));
        normal += row * row.transpose();
        right += row * (drawn - r);
    }
    let k = normal
        .svd(true, true)
        .solve(&right, 1e-18)
        .unwrap_or_else(|_| Vector3::zeros());
    let worst = radii().map(|drawn| {
        let r = ideal(drawn);
        (r * (1.0 + r * r * (k.x + r * r * (k.y + r * r * k.z))) - drawn).abs()
    });
    let worst = worst.fold(0.0, f64::max);
    (k.into(), worst)
}

pub(super) fn write(cameras: &[CameraRecord]) -> Result<String, ExportError> {
    let mut text = String::from(
        "<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"no\" ?>\n<Cameras NAME=\"\" VERSION=\"1.0\">\n",
    );
    for (i, camera) in cameras.iter().enumerate() {
        let pose = placed(camera, Format::Vicon)?;
        let refuse = |has| ExportError::Lens {
            camera: camera.name.clone(),
            format: Format::Vicon,
            has,
        };
        let LensModel::Rational(d) = camera.lens else {
            return Err(refuse("k1, k2, k3"));
        };
        if !all_zero(&[d.p1, d.p2, d.k4, d.k5, d.k6]) {
            return Err(refuse("k1, k2, k3, no tangential coefficient"));
        }
        if d.k1 != 0.0 && d.k1.abs() < PER_PIXEL {
            return Err(refuse(
                "a k1 of 0 or above 0.0001, smaller ones being per pixel",
            ));
        }
        let q = pose.rotation.coords;
        let position = pose.inverse().translation.vector * 1e3;
        let k = &camera.intrinsics;
        let name = escaped(&camera.name);
        // Writing into a string cannot fail.
        _ = writeln!(
            text,
            "  <Camera DEVICEID=\"{name}\" DISPLAY_TYPE=\"VideoInputDevice\" NAME=\"{name}\" PIXEL_ASPECT_RATIO=\"{:?}\" \
             SENSOR_SIZE=\"{} {}\" SKEW=\"0\" TYPE=\"VideoCamera\" USERID=\"{}\">\n    <KeyFrames>\n      <KeyFrame \
             FOCAL_LENGTH=\"{:?}\" FRAME=\"0\" IMAGE_ERROR=\"0\" ORIENTATION=\"{:?} {:?} {:?} {:?}\" POSITION=\"{:?} {:?} {:?}\" \
             PRINCIPAL_POINT=\"{:?} {:?}\" VICON_RADIAL2=\"ViconRadial2 0 0 {:?} {:?} {:?}\" WORLD_ERROR=\"0\"/>\n    \
             </KeyFrames>\n  </Camera>",
            k.fx_px / k.fy_px,
            camera.size_px[0],
            camera.size_px[1],
            i + 1,
            k.fx_px,
            q.x,
            q.y,
            q.z,
            q.w,
            position.x,
            position.y,
            position.z,
            k.cx_px,
            k.cy_px,
            d.k1,
            d.k2,
            d.k3,
        );
    }
    text.push_str("</Cameras>\n");
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverted_lenses_are_accurate_to_a_twentieth_of_a_pixel() {
        // A barrel of 5 % at the corner of a sensor of 1920 x 1080 with f = 1500.
        let (k, worst) = inverted(&[0.09, 0.01, 0.0], 1101.0 / 1500.0);
        assert!(worst * 1500.0 < 0.05, "{}", worst * 1500.0);
        assert!((k[0] + 0.09).abs() < 0.02, "{k:?}");
    }
}
