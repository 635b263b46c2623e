//! The similarity that aligns cameras with the clicks in their pictures: least squares, with the residual of each click.
//!
//! Residuals are in pixels, not in the venue. So a click far from its camera has its true weight, one camera is enough for a
//! mark, and a line does not constrain the direction along itself. Places of cameras, points of the floor and known lengths are
//! added, each over its standard deviation. Cauchy's loss limits the effect of wrong clicks; these are reported as outliers.

use nalgebra::{SMatrix, SVector, UnitQuaternion, Vector3};

use super::mark_start::start;
use super::marks::{FoundPlace, Known, MarkFreedom, Marks};
use super::sight::{Seen, Sights, across_m};
use super::similarity::Similarity;
use crate::adjustment::CameraState;

/// Rotation (3, rad), logarithm of the scale, shift (3, m), about the middle of the known positions.
const UNKNOWNS: usize = 7;
/// Tuning constant of Cauchy's loss: 95 % efficient for normal errors.
const CAUCHY: f64 = 2.385;
/// Residuals beyond this are outliers, standard deviations.
const OUTLIER_SIGMAS: f64 = 4.0;
/// Most steps of the fit.
const STEPS: usize = 100;
/// The fit ends at a smaller step (radians, shares, metres).
const LAST_STEP: f64 = 1e-10;
/// Step of the numerical derivative.
const BY: f64 = 1e-6;
/// Residual of a point that cannot be projected, standard deviations.
const NOT_DRAWN: f64 = 1e3;
/// Least ratio of the smallest to the largest eigenvalue of the scaled normal matrix of a determined fit.
const LEAST_EIGENVALUE: f64 = 1e-10;

/// The residual of one click, place, point or length.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkResidual {
    /// Its name.
    pub name: String,
    /// Its camera; `None` if it is not a click.
    pub camera: Option<String>,
    /// In the picture, pixels.
    pub px: Option<f64>,
    /// Across the line of sight in the venue, metres.
    pub m: f64,
    /// Divided by its standard deviation.
    pub sigmas: f64,
    /// Whether it exceeds the limit for outliers.
    pub is_outlier: bool,
}

/// The alignment of the cameras with the venue.
#[derive(Debug, Clone, PartialEq)]
pub struct MarkFit {
    /// From the world of the cameras to the venue.
    pub venue_from_found: Similarity,
    /// Of rotation (rad), logarithm of the scale and shift (m), in this order and about `middle_m`. It is enlarged if the
    /// residuals exceed their standard deviations.
    pub covariance: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    /// The middle of the known positions, venue, metres.
    pub middle_m: [f64; 3],
    /// One per click, place, point and length.
    pub residuals: Vec<MarkResidual>,
    /// Root of the mean squared residual in the venue without outliers, metres.
    pub rms_m: f64,
}

impl MarkFit {
    /// Standard deviation of a point of the venue due to the alignment: root of the summed variances of the three axes, metres.
    pub fn sigma_m(&self, at_m: [f64; 3]) -> f64 {
        let arm = Vector3::from(at_m) - Vector3::from(self.middle_m);
        let mut by = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-arm.cross_matrix());
        by.set_column(3, &arm);
        by.fixed_view_mut::<3, 3>(0, 4).fill_with_identity();
        (by * self.covariance * by.transpose())
            .trace()
            .max(0.0)
            .sqrt()
    }

    /// The residuals that are outliers.
    pub fn outliers(&self) -> impl Iterator<Item = &MarkResidual> {
        self.residuals.iter().filter(|it| it.is_outlier)
    }
}

/// Aligns `cameras` with `marks` and `places`.
///
/// # Errors
/// A message: an unknown camera, a click outside the range of its lens, too few observations (three marks or places that are
/// not on one line and that two cameras saw, or two cameras with four marks each), or an undetermined alignment.
pub fn fit_marks(
    marks: &Marks,
    places: &[FoundPlace],
    cameras: &[(String, CameraState)],
    freedom: MarkFreedom,
) -> Result<MarkFit, String> {
    let sights = Sights::new(marks, places, cameras)?;
    let mut fitted = start(&sights, freedom)?;
    let middle = sights.middle();
    let mut damping = 1e-3;
    let mut loss = total_loss(&sights, &fitted);
    for _ in 0..STEPS {
        let (matrix, right) = normal(&sights, &fitted, &middle, freedom);
        let mut damped = matrix;
        for i in 0..UNKNOWNS {
            damped[(i, i)] *= 1.0 + damping;
        }
        let Some(solved) = damped.cholesky() else {
            break;
        };
        let step = -solved.solve(&right);
        let next = moved(&fitted, &step, &middle);
        let next_loss = total_loss(&sights, &next);
        if next_loss <= loss {
            (fitted, loss) = (next, next_loss);
            damping = (0.2 * damping).max(1e-12);
        } else {
            damping *= 8.0;
        }
        if step.amax() < LAST_STEP || damping > 1e12 {
            break;
        }
    }
    finished(&sights, fitted, middle, freedom)
}

/// The similarity moved by a step about `middle`.
fn moved(
    similarity: &Similarity,
    step: &SVector<f64, UNKNOWNS>,
    middle: &Vector3<f64>,
) -> Similarity {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
    let scale = libm::exp(step[3]);
    let shift = Vector3::new(step[4], step[5], step[6]);
    similarity.then(&Similarity {
        scale,
        rotation: turn,
        shift: middle + shift - turn * middle * scale,
    })
}

fn total_loss(sights: &Sights<'_>, similarity: &Similarity) -> f64 {
    let each = sights.seen.iter().map(|seen| {
        let r = weighed(sights, seen, similarity).norm() / CAUCHY;
        libm::log1p(r * r)
    });
    each.sum()
}

/// A residual over its standard deviation; missing entries are zero.
fn weighed(sights: &Sights<'_>, seen: &Seen, similarity: &Similarity) -> Vector3<f64> {
    let residual = sights.residual(seen, similarity);
    residual.map_or_else(|| Vector3::repeat(NOT_DRAWN), |(r, sigma)| r / sigma)
}

/// Normal matrix and gradient, with Cauchy's weights.
fn normal(
    sights: &Sights<'_>,
    similarity: &Similarity,
    middle: &Vector3<f64>,
    freedom: MarkFreedom,
) -> (SMatrix<f64, UNKNOWNS, UNKNOWNS>, SVector<f64, UNKNOWNS>) {
    let mut matrix = SMatrix::zeros();
    let mut right = SVector::zeros();
    for seen in &sights.seen {
        let here = weighed(sights, seen, similarity);
        let r = here.norm() / CAUCHY;
        let weight = 1.0 / (1.0 + r * r);
        let mut by = SMatrix::<f64, 3, UNKNOWNS>::zeros();
        for unknown in 0..UNKNOWNS {
            let mut step = SVector::zeros();
            step[unknown] = BY;
            let there = weighed(sights, seen, &moved(similarity, &step, middle));
            let back = weighed(sights, seen, &moved(similarity, &-step, middle));
            by.set_column(unknown, &((there - back) / (2.0 * BY)));
        }
        matrix += by.transpose() * by * weight;
        right += by.transpose() * here * weight;
    }
    if freedom == MarkFreedom::Rigid {
        // The scale is fixed.
        for i in 0..UNKNOWNS {
            matrix[(3, i)] = 0.0;
            matrix[(i, 3)] = 0.0;
        }
        matrix[(3, 3)] = 1.0;
        right[3] = 0.0;
    }
    (matrix, right)
}

fn finished(
    sights: &Sights<'_>,
    fitted: Similarity,
    middle: Vector3<f64>,
    freedom: MarkFreedom,
) -> Result<MarkFit, String> {
    let lengths: Vec<f64> = sights
        .seen
        .iter()
        .map(|seen| weighed(sights, seen, &fitted).norm())
        .collect();
    let fits = |length: &f64| *length <= OUTLIER_SIGMAS;
    let squares: f64 = lengths.iter().filter(|l| fits(l)).map(|l| l * l).sum();
    let rows: f64 = sights
        .seen
        .iter()
        .zip(&lengths)
        .filter(|(_, l)| fits(l))
        .map(|(s, _)| s.rows())
        .sum();
    let unknowns = if freedom == MarkFreedom::Rigid {
        6.0
    } else {
        7.0
    };
    let agreeing = lengths.iter().filter(|l| fits(l)).count();
    // A minority can agree by chance.
    if rows < unknowns || 2 * agreeing < lengths.len() {
        return Err(contradiction(sights, agreeing));
    }
    // At least one: few marks may agree by chance.
    let raise = (squares / (rows - unknowns).max(1.0)).max(1.0);
    let (mut matrix, _) = normal(sights, &fitted, &middle, freedom);
    let scales = SVector::<f64, UNKNOWNS>::from_fn(|i, _| 1.0 / matrix[(i, i)].max(1e-300).sqrt());
    for i in 0..UNKNOWNS {
        for j in 0..UNKNOWNS {
            matrix[(i, j)] *= scales[i] * scales[j];
        }
    }
    let least = matrix.symmetric_eigenvalues().min();
    let inverse = matrix.cholesky().map(|c| c.inverse());
    let Some(inverse) = inverse.filter(|_| least > LEAST_EIGENVALUE) else {
        return Err("the clicked marks do not determine the positions of the cameras: click marks that are not on one line".to_owned());
    };
    let mut covariance = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::from_fn(|i, j| {
        raise * inverse[(i, j)] * scales[i] * scales[j]
    });
    if freedom == MarkFreedom::Rigid {
        covariance.fill_row(3, 0.0);
        covariance.fill_column(3, 0.0);
    }
    let residuals: Vec<MarkResidual> = sights
        .seen
        .iter()
        .zip(&lengths)
        .map(|(seen, sigmas)| residual(sights, seen, &fitted, *sigmas))
        .collect();
    let good: Vec<f64> = residuals
        .iter()
        .filter(|it| !it.is_outlier)
        .map(|it| it.m * it.m)
        .collect();
    Ok(MarkFit {
        venue_from_found: fitted,
        covariance,
        middle_m: middle.into(),
        rms_m: (good.iter().sum::<f64>() / good.len().max(1) as f64).sqrt(),
        residuals,
    })
}

/// The error for marks of which only `agreeing` agree.
fn contradiction(sights: &Sights<'_>, agreeing: usize) -> String {
    let names = sights.seen.iter().map(|seen| seen.name.as_str());
    let named: Vec<&str> = names.take(8).collect();
    format!(
        "the clicked marks contradict each other: of {} only {agreeing} agree ({}), expected half of them or more; check for \
         exchanged names",
        sights.seen.len(),
        named.join(", ")
    )
}

fn residual(sights: &Sights<'_>, seen: &Seen, fitted: &Similarity, sigmas: f64) -> MarkResidual {
    let length = sights
        .residual(seen, fitted)
        .map_or(f64::INFINITY, |(r, _)| r.norm());
    let camera = seen.camera().and_then(|index| sights.cameras.get(index));
    let m = camera.map_or(length, |(_, state)| length * across_m(seen, state, fitted));
    MarkResidual {
        name: seen.name.clone(),
        camera: camera.map(|(name, _)| name.clone()),
        px: camera.map(|_| length),
        m,
        sigmas,
        is_outlier: sigmas > OUTLIER_SIGMAS,
    }
}

impl Known {
    /// The number of informative entries of a click's residual.
    pub(super) fn rows(&self) -> f64 {
        match self {
            Self::Place(_) => 2.0,
            Self::OnLine(_) => 1.0,
        }
    }
}
