//! Checks that pictures of boards determine the fitted camera, and remarks on the result.

use std::collections::BTreeMap;

use farfield_proto::camera::{CameraError, CameraModel, Intrinsics};
use farfield_proto::frames::Transform;
use nalgebra::{DMatrix, Isometry3, Vector2};

use super::BoardView;
use super::detect::Print;
use super::outcome::{BoardError, Coverage, LARGEST_COEFFICIENT, PictureFit};
use super::projection::Optics;
use crate::formats::LensModel;

/// Largest relative standard deviation of a focal length.
const FOCAL_SHARE: f64 = 0.05;
/// A larger standard deviation at a corner of the picture causes a remark, pixels.
const CORNER_PX: f64 = 2.0;
/// Boards should reach this share of the distance to a corner.
const REACHED: f64 = 0.8;

pub(super) fn check_determined(
    size_px: [u32; 2],
    optics: &Optics,
    covariance: &DMatrix<f64>,
) -> Result<(), BoardError> {
    let sigma = |i: usize| covariance[(i, i)].max(0.0).sqrt();
    for (i, focal_px) in optics.values.iter().copied().take(2).enumerate() {
        if focal_px <= 0.0 {
            return Err(BoardError::Parallel);
        }
        if sigma(i) > FOCAL_SHARE * focal_px {
            return Err(BoardError::FocalLength {
                focal_px,
                sigma_px: sigma(i),
            });
        }
    }
    let names = optics.coefficients.names();
    let coefficients = names
        .iter()
        .zip(optics.values.iter().copied().skip(4))
        .enumerate();
    for (i, (name, value)) in coefficients {
        if value.abs() > LARGEST_COEFFICIENT {
            return Err(BoardError::Coefficient {
                asked: names.len(),
                name,
                value,
                sigma: sigma(4 + i),
            });
        }
    }
    refuse_folds(size_px, optics)
}

/// Refuses a lens whose radius does not increase over the whole picture.
fn refuse_folds(size_px: [u32; 2], optics: &Optics) -> Result<(), BoardError> {
    let intrinsics = optics.intrinsics();
    match optics.lens() {
        LensModel::Rational(distortion) => {
            let model = CameraModel::new(
                "",
                size_px,
                intrinsics,
                distortion,
                Transform::new(Isometry3::identity()),
            );
            match model {
                Err(CameraError::Folds {
                    monotonic_px,
                    needed_px,
                    ..
                }) => Err(BoardError::Folds(format!(
                    "it grows up to {monotonic_px:.0} px from the principal point, and the picture to {needed_px:.0}"
                ))),
                Err(other) => Err(BoardError::Input(other.to_string())),
                Ok(_) => Ok(()),
            }
        }
        LensModel::KannalaBrandt(k) => {
            let Intrinsics {
                fx_px,
                fy_px,
                cx_px,
                cy_px,
            } = intrinsics;
            let across = |c: f64, side: u32| c.abs().max((f64::from(side) - c).abs());
            let needed = libm::hypot(
                across(cx_px, size_px[0]) / fx_px,
                across(cy_px, size_px[1]) / fy_px,
            );
            let reach = |theta: f64| {
                let t2 = theta * theta;
                theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))))
            };
            let mut last = 0.0;
            for i in 1..=314 {
                let now = reach(0.01 * f64::from(i));
                if now >= needed {
                    return Ok(());
                }
                if now <= last {
                    break;
                }
                last = now;
            }
            Err(BoardError::Folds(format!(
                "it grows up to {last:.2} focal lengths from the principal point, and the picture to {needed:.2}"
            )))
        }
    }
}

/// The largest standard deviation at the corners of the picture, for the rays that an ideal lens would project there.
pub(super) fn corner_sigma_px(
    size_px: [u32; 2],
    optics: &Optics,
    covariance: &DMatrix<f64>,
) -> f64 {
    let Intrinsics {
        fx_px,
        fy_px,
        cx_px,
        cy_px,
    } = optics.intrinsics();
    let [right, bottom] = size_px.map(|s| f64::from(s) - 1.0);
    let m = covariance.nrows();
    let sigma = |[x, y]: [f64; 2]| {
        let at = Vector2::new((x - cx_px) / fx_px, (y - cy_px) / fy_px);
        let theta = at.norm().max(1e-9);
        let ray = if optics.lens().is_fisheye() {
            (at * (libm::sin(theta) / theta)).push(libm::cos(theta))
        } else {
            at.push(1.0)
        };
        let Some(drawn) = optics.draw(&ray) else {
            return f64::INFINITY;
        };
        let by = DMatrix::from_fn(2, m, |i, j| drawn.by_parameter.get(j).map_or(0.0, |v| v[i]));
        (&by * covariance * by.transpose()).trace().max(0.0).sqrt()
    };
    let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
    corners.into_iter().map(sigma).fold(0.0, f64::max)
}

pub(super) fn remarks(
    coverage: &Coverage,
    corner_sigma_px: f64,
    pictures: &[PictureFit],
    views: &[&BoardView],
) -> Vec<String> {
    let mut remarks = prints(views);
    if corner_sigma_px > CORNER_PX || coverage.radius < REACHED {
        remarks.push(format!(
            "the boards reach {:.0} % of the way to the picture's corners, where the lens is known to {corner_sigma_px:.1} px: \
             take pictures with the board in the corners",
            100.0 * coverage.radius
        ));
    }
    let hurting: Vec<&str> = pictures
        .iter()
        .filter(|p| p.hurts)
        .map(|p| p.name.as_str())
        .collect();
    if !hurting.is_empty() {
        remarks.push(format!(
            "`{}` have much larger residuals: blurred, or corners mistaken; leave them out and check whether the result changes",
            hurting.join("`, `")
        ));
    }
    remarks
}

/// Remarks on unusual or mixed prints of the board.
fn prints(views: &[&BoardView]) -> Vec<String> {
    let mut counts: BTreeMap<Print, usize> = BTreeMap::new();
    for view in views {
        *counts.entry(view.print).or_default() += 1;
    }
    let each = counts.iter().filter_map(|(print, count)| {
        let words = print.in_words()?;
        Some(if *count == views.len() {
            format!("the board is printed {words}")
        } else {
            let total = views.len();
            format!("the board is printed {words} in {count} of {total} pictures, and otherwise in the rest: use one board")
        })
    });
    each.collect()
}
