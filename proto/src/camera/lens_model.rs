//! The two supported lens models.

use nalgebra::{Matrix2, Vector2};

use super::fisheye;
use super::rational::Distortion;

/// A lens model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LensModel {
    /// OpenCV's rational model with tangential terms.
    Rational(Distortion),
    /// Kannala and Brandt 2006 as in OpenCV's `fisheye`, k1 to k4. A point at the angle theta to
    /// the axis is drawn at the radius theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4
    /// theta^8), in focal lengths.
    KannalaBrandt([f64; 4]),
}

impl From<Distortion> for LensModel {
    fn from(distortion: Distortion) -> Self {
        Self::Rational(distortion)
    }
}

impl From<&Distortion> for LensModel {
    fn from(distortion: &Distortion) -> Self {
        Self::Rational(*distortion)
    }
}

impl LensModel {
    /// A lens without distortion.
    pub fn ideal() -> Self {
        Self::Rational(Distortion::default())
    }

    /// Whether the lens has no distortion.
    pub fn is_none(&self) -> bool {
        match self {
            Self::Rational(distortion) => distortion.is_none(),
            Self::KannalaBrandt(_) => false,
        }
    }

    /// Whether it is the fisheye model.
    #[inline]
    pub fn is_fisheye(&self) -> bool {
        matches!(self, Self::KannalaBrandt(_))
    }

    /// In OpenCV's order: 4 coefficients of the fisheye model, else 5, or 8 if the denominator is
    /// used.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::KannalaBrandt(k) => k.to_vec(),
            Self::Rational(d) => {
                let mut all = vec![d.k1, d.k2, d.p1, d.p2, d.k3];
                if [d.k4, d.k5, d.k6].iter().any(|&k| k != 0.0) {
                    all.extend([d.k4, d.k5, d.k6]);
                }
                all
            }
        }
    }

    /// The names of the coefficients, in OpenCV's order.
    pub fn coefficient_names(&self) -> &'static [&'static str] {
        match self {
            Self::KannalaBrandt(_) => &["k1", "k2", "k3", "k4"],
            Self::Rational(_) => &["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"],
        }
    }

    /// The rational model from OpenCV's order (k1, k2, p1, p2, k3, k4, k5, k6); missing
    /// coefficients are 0. `None` for more than 8 coefficients, unless all further ones (thin
    /// prism, tilt) are 0.
    pub fn rational(coefficients: &[f64]) -> Option<Self> {
        let at = |i: usize| coefficients.get(i).copied().unwrap_or(0.0);
        if coefficients.len() > 14 || coefficients.iter().skip(8).any(|&c| c != 0.0) {
            return None;
        }
        Some(Self::Rational(Distortion {
            k1: at(0),
            k2: at(1),
            p1: at(2),
            p2: at(3),
            k3: at(4),
            k4: at(5),
            k5: at(6),
            k6: at(7),
        }))
    }

    /// The distorted position of an ideal pinhole's point `p`, and its derivative by `p`. Both are
    /// in focal lengths from the principal point; the valid region is not checked.
    pub fn draw_with_jacobian(&self, p: Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        match self {
            Self::Rational(distortion) => distortion.apply(p),
            Self::KannalaBrandt(k) => fisheye::apply(k, p),
        }
    }
}
