//! COLMAP's text files `cameras.txt` and `images.txt`. The centre of the first pixel is (0.5, 0.5). The quaternion's real part
//! comes first, world to camera. There is no unit of length.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use farfield_proto::camera::{Distortion, Intrinsics};
use farfield_proto::toml_file::FileError;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::camera::{CameraRecord, FileUnit, LensModel, RawCamera, RawPose, RawSet, all_zero};
use super::tree::{Source, whole_size};
use super::{ExportError, Format, TextFile, placed};

/// Largest deviation of a quaternion's length from 1.
const QUATERNION_TOLERANCE: f64 = 1e-2;
/// COLMAP's coordinate of the centre of the first pixel.
const HALF: f64 = 0.5;
/// The supported camera models of COLMAP, and the number of parameters of each.
const MODELS: [(&str, usize); 7] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
];

/// Whether the text has the lines of `cameras.txt`.
pub(super) fn is_cameras(text: &str) -> bool {
    let line = text.lines().find(|line| is_data(line)).unwrap_or_default();
    let model = line.split_whitespace().nth(1).unwrap_or_default();
    MODELS.iter().any(|(name, _)| *name == model) || model.ends_with("_FISHEYE") || model == "FOV"
}

/// Whether the text has the lines of `images.txt`.
pub(super) fn is_images(text: &str) -> bool {
    let line = text.lines().find(|line| is_data(line)).unwrap_or_default();
    let words: Vec<&str> = line.split_whitespace().collect();
    words.len() >= 10 && words.iter().take(9).all(|word| word.parse::<f64>().is_ok())
}

fn is_data(line: &str) -> bool {
    let line = line.trim();
    !line.is_empty() && !line.starts_with('#')
}

type Optics = ([u32; 2], Intrinsics, LensModel);

pub(super) fn read(cameras: &Source<'_>, images: Option<&Source<'_>>) -> Result<RawSet, FileError> {
    let optics = read_cameras(cameras)?;
    let found = match images {
        Some(images) => read_images(images, &optics)?,
        None => optics
            .iter()
            .map(|(id, (size_px, intrinsics, lens))| RawCamera {
                name: format!("cam_{id}"),
                size_px: Some(*size_px),
                intrinsics: *intrinsics,
                lens: *lens,
                pose: None,
            })
            .collect(),
    };
    Ok(RawSet {
        cameras: found,
        unit: FileUnit::None,
        remarks: Vec::new(),
    })
}

fn read_cameras(source: &Source<'_>) -> Result<BTreeMap<u64, Optics>, FileError> {
    let mut found = BTreeMap::new();
    for (i, line) in source
        .text
        .lines()
        .enumerate()
        .filter(|(_, line)| is_data(line))
    {
        let wrong = |problem: String| source.error(problem).at_line(i + 1);
        let words: Vec<&str> = line.split_whitespace().collect();
        let [id, model, width, height, parameters @ ..] = words.as_slice() else {
            return Err(wrong(
                "expected CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS".to_owned(),
            ));
        };
        let id = id.parse::<u64>().map_err(|_| {
            wrong(format!(
                "found `{id}` as CAMERA_ID, expected a whole number"
            ))
        })?;
        let number = |word: &str| {
            finite(word).ok_or_else(|| wrong(format!("found `{word}`, expected a finite number")))
        };
        let size = [number(width)?, number(height)?];
        let size = whole_size(size).ok_or_else(|| {
            wrong(format!(
                "found a picture of {size:?}, expected pixels above 0"
            ))
        })?;
        let parameters = parameters
            .iter()
            .map(|word| number(word))
            .collect::<Result<Vec<_>, _>>()?;
        let (intrinsics, lens) = optics(model, &parameters).map_err(&wrong)?;
        if found.insert(id, (size, intrinsics, lens)).is_some() {
            return Err(wrong(format!("a second camera has the id {id}")));
        }
    }
    Ok(found)
}

fn finite(word: &str) -> Option<f64> {
    word.parse::<f64>().ok().filter(|number| number.is_finite())
}

fn optics(model: &str, p: &[f64]) -> Result<(Intrinsics, LensModel), String> {
    let Some((_, count)) = MODELS.iter().find(|(name, _)| *name == model) else {
        let known: Vec<&str> = MODELS.iter().map(|(name, _)| *name).collect();
        return Err(format!(
            "found the model `{model}`, expected one of {}",
            known.join(", ")
        ));
    };
    if p.len() != *count {
        return Err(format!(
            "found {} parameters, `{model}` has {count}",
            p.len()
        ));
    }
    let at = |i: usize| p.get(i).copied().unwrap_or(0.0);
    let one_focal = matches!(model, "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL");
    let next = if one_focal { 1 } else { 2 };
    let intrinsics = Intrinsics {
        fx_px: at(0),
        fy_px: at(next - 1),
        cx_px: at(next) - HALF,
        cy_px: at(next + 1) - HALF,
    };
    let k = |i: usize| at(next + 2 + i);
    let lens = match model {
        "OPENCV_FISHEYE" => LensModel::KannalaBrandt([k(0), k(1), k(2), k(3)]),
        "SIMPLE_RADIAL" | "RADIAL" => LensModel::Rational(Distortion {
            k1: k(0),
            k2: k(1),
            ..Distortion::default()
        }),
        _ => LensModel::Rational(Distortion {
            k1: k(0),
            k2: k(1),
            p1: k(2),
            p2: k(3),
            k3: k(4),
            k4: k(5),
            k5: k(6),
            k6: k(7),
        }),
    };
    Ok((intrinsics, lens))
}

/// Two lines per image; the second has its points, and may be empty.
fn read_images(
    source: &Source<'_>,
    optics: &BTreeMap<u64, Optics>,
) -> Result<Vec<RawCamera>, FileError> {
    let mut found = Vec::new();
    let mut lines = source.text.lines().enumerate();
    while let Some((i, line)) = lines.next() {
        if !is_data(line) {
            continue;
        }
        let wrong = |problem: String| source.error(problem).at_line(i + 1);
        let words: Vec<&str> = line.split_whitespace().collect();
        let (Some(numbers), Some(camera), Some(names)) =
            (words.get(1..8), words.get(8), words.get(9..))
        else {
            return Err(wrong(format!(
                "found {} fields, expected IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME",
                words.len()
            )));
        };
        let mut v = [0.0; 7];
        for (v, word) in v.iter_mut().zip(numbers) {
            *v = finite(word)
                .ok_or_else(|| wrong(format!("found `{word}`, expected a finite number")))?;
        }
        let [qw, qx, qy, qz, tx, ty, tz] = v;
        let q = Quaternion::new(qw, qx, qy, qz);
        if (q.norm() - 1.0).abs() > QUATERNION_TOLERANCE {
            return Err(wrong(format!(
                "found a quaternion of length {:.3}, expected 1",
                q.norm()
            )));
        }
        let known = camera.parse().ok().and_then(|id: u64| optics.get(&id));
        let (size_px, intrinsics, lens) = known.ok_or_else(|| {
            wrong(format!(
                "found CAMERA_ID `{camera}`, which cameras.txt does not have"
            ))
        })?;
        let file = names.join(" ");
        let name = file
            .rsplit_once('.')
            .map_or(file.as_str(), |(stem, _)| stem)
            .to_owned();
        found.push(RawCamera {
            name,
            size_px: Some(*size_px),
            intrinsics: *intrinsics,
            lens: *lens,
            pose: Some(RawPose {
                rotation: UnitQuaternion::from_quaternion(q)
                    .to_rotation_matrix()
                    .into_inner(),
                translation: Vector3::new(tx, ty, tz),
            }),
        });
        // The line of points is not needed.
        _ = lines.next();
    }
    Ok(found)
}

/// `cameras.txt`, `images.txt` and an empty `points3D.txt`, which COLMAP needs to read the others.
pub(super) fn write(cameras: &[CameraRecord]) -> Result<Vec<TextFile>, ExportError> {
    let mut optics = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    let mut images = String::from(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    for (i, camera) in cameras.iter().enumerate() {
        let pose = placed(camera, Format::Colmap)?;
        let id = i + 1;
        let k = &camera.intrinsics;
        let (model, coefficients) = match camera.lens {
            LensModel::KannalaBrandt(k) => ("OPENCV_FISHEYE", k.to_vec()),
            LensModel::Rational(d) if d.is_none() => ("PINHOLE", Vec::new()),
            LensModel::Rational(d) if all_zero(&[d.k3, d.k4, d.k5, d.k6]) => {
                ("OPENCV", vec![d.k1, d.k2, d.p1, d.p2])
            }
            LensModel::Rational(d) => (
                "FULL_OPENCV",
                vec![d.k1, d.k2, d.p1, d.p2, d.k3, d.k4, d.k5, d.k6],
            ),
        };
        let mut parameters = vec![k.fx_px, k.fy_px, k.cx_px + HALF, k.cy_px + HALF];
        parameters.extend(coefficients);
        let parameters: Vec<String> = parameters.iter().map(|p| format!("{p:?}")).collect();
        let [width, height] = camera.size_px;
        let q = pose.rotation.coords;
        let t = pose.translation.vector;
        if camera.name.is_empty() || camera.name.contains(char::is_whitespace) {
            return Err(ExportError::Name {
                camera: camera.name.clone(),
                format: Format::Colmap,
                expected: "a name without spaces",
            });
        }
        // Writing into a string cannot fail.
        _ = writeln!(
            optics,
            "{id} {model} {width} {height} {}",
            parameters.join(" ")
        );
        _ = writeln!(
            images,
            "{id} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {id} {}.png\n",
            q.w, q.x, q.y, q.z, t.x, t.y, t.z, camera.name
        );
    }
    let file = |path: &str, text| TextFile {
        path: path.into(),
        text,
    };
    Ok(vec![
        file("cameras.txt", optics),
        file("images.txt", images),
        file(
            "points3D.txt",
            "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]\n".to_owned(),
        ),
    ])
}
