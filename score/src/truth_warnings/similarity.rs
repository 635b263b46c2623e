//! The similarity that maps points of a truth to those of poses: turn, scale and shift, or some of these.

use nalgebra::{Matrix3, Vector3};

/// Fewest pairs of points for an estimate. From so many, turn, scale and shift absorb almost no noise if the points are of
/// several keypoints ([`super::comparison::n_shared_kinds`]).
const MIN_POINTS: usize = 40;
/// Points lie on a line if their second singular value is below this share of the first: the turn about the line is then
/// undetermined.
const ON_A_LINE: f64 = 1e-3;

/// Which parts of a similarity are estimated; the others are those of the identity.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Freedom {
    pub(super) turn: bool,
    pub(super) scale: bool,
    pub(super) shift: bool,
}

impl Freedom {
    pub(super) const ALL: Self = Self {
        turn: true,
        scale: true,
        shift: true,
    };

    /// Every combination of parts, including none.
    pub(super) fn choices() -> [Self; 8] {
        std::array::from_fn(|bits| Self {
            turn: bits & 1 != 0,
            scale: bits & 2 != 0,
            shift: bits & 4 != 0,
        })
    }

    /// The number of free parts.
    pub(super) fn count(self) -> usize {
        usize::from(self.turn) + usize::from(self.scale) + usize::from(self.shift)
    }
}

/// Whether the similarity mirrors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Handedness {
    Unchanged,
    Mirrored,
}

/// Maps points of the truth to the poses.
///
/// ```text
///   p = s R q + t,   q: a point of the truth, p: the same of the poses; world, metres
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Similarity {
    /// `s`, above 0.
    pub(super) scale: f64,
    /// `R`, orthogonal; with a determinant of -1 it also mirrors.
    pub(super) turn: Matrix3<f64>,
    /// `t`.
    pub(super) shift_m: Vector3<f64>,
}

impl Similarity {
    /// Maps every point to itself.
    pub(super) fn identity() -> Self {
        Self {
            scale: 1.0,
            turn: Matrix3::identity(),
            shift_m: Vector3::zeros(),
        }
    }

    /// The similarity with the least sum of squared distances over `points`, `[truth, pose]` (Umeyama 1991, eq. (40) to
    /// (42)). Without a shift, the turn and the scale are about the origin.
    ///
    /// `None` if there are few points, or they do not determine it: all in one place, on a line, or out of range.
    pub(super) fn between(
        points: &[[Vector3<f64>; 2]],
        free: Freedom,
        hand: Handedness,
    ) -> Option<Self> {
        if points.len() < MIN_POINTS {
            return None;
        }
        let middle = |which: usize| {
            let sum = points.iter().map(|pair| pair[which]).sum::<Vector3<f64>>();
            if free.shift {
                sum / points.len() as f64
            } else {
                Vector3::zeros()
            }
        };
        let [q_middle, p_middle] = [0, 1].map(middle);
        let mut product = Matrix3::<f64>::zeros();
        let mut square = 0.0;
        for [q, p] in points {
            let q = q - q_middle;
            product += (p - p_middle) * q.transpose();
            square += q.norm_squared();
        }
        let turn = if free.turn {
            nearest_orthogonal(&product, hand)?
        } else {
            Matrix3::identity()
        };
        let scale = if free.scale {
            (turn.transpose() * product).trace() / square
        } else {
            1.0
        };
        let similarity = Self {
            scale,
            turn,
            shift_m: p_middle - turn * q_middle * scale,
        };
        (scale > 0.0 && scale.is_finite()).then_some(similarity)
    }

    /// Where the poses have the point `point_m` of the truth.
    pub(super) fn apply(&self, point_m: Vector3<f64>) -> Vector3<f64> {
        self.turn * point_m * self.scale + self.shift_m
    }
}

/// The orthogonal `R` with the given handedness and the largest trace of `Rᵀ product`.
fn nearest_orthogonal(product: &Matrix3<f64>, hand: Handedness) -> Option<Matrix3<f64>> {
    let largest = product.amax();
    let is_known = largest > 0.0 && product.iter().all(|entry| entry.is_finite());
    if !is_known {
        return None;
    }
    // Scaled to about one, so that no square overflows.
    let svd = (product / largest).svd(true, true);
    if svd.singular_values[1] < ON_A_LINE * svd.singular_values[0] {
        return None;
    }
    let (u, v_t) = (svd.u?, svd.v_t?);
    let wanted = match hand {
        Handedness::Unchanged => 1.0,
        Handedness::Mirrored => -1.0,
    };
    let has_other_hand = u.determinant() * v_t.determinant() * wanted < 0.0;
    let last = if has_other_hand { -1.0 } else { 1.0 };
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, last)) * v_t)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    /// Bound on rounding errors, metres.
    const ROUNDING_M: f64 = 1e-9;

    fn points(moved: impl Fn(Vector3<f64>) -> Vector3<f64>) -> Vec<[Vector3<f64>; 2]> {
        let place = |i: u32| {
            let t = f64::from(i);
            Vector3::new(3.0 * t.sin(), 2.0 * (1.7 * t).cos(), 0.02 * t)
        };
        (0..60).map(|i| [place(i), moved(place(i))]).collect()
    }

    /// The largest distance that remains.
    fn rest_m(points: &[[Vector3<f64>; 2]], free: Freedom, hand: Handedness) -> f64 {
        let Some(similarity) = Similarity::between(points, free, hand) else {
            return f64::INFINITY;
        };
        let apart_m = points
            .iter()
            .map(|[q, p]| (similarity.apply(*q) - p).norm());
        apart_m.fold(0.0, f64::max)
    }

    #[test]
    fn the_motion_of_the_points_is_estimated_by_free_parts_only() {
        let turn = Rotation3::from_euler_angles(0.3, -0.2, 2.0);
        let moved = points(|q| turn * q * 0.9 + Vector3::new(1.0, -2.0, 0.5));
        assert!(rest_m(&moved, Freedom::ALL, Handedness::Unchanged) < ROUNDING_M);
        for free in Freedom::choices() {
            let is_whole = free == Freedom::ALL;
            assert!(is_whole || rest_m(&moved, free, Handedness::Unchanged) > 0.1);
        }
    }

    #[test]
    fn a_mirror_image_needs_a_mirroring_similarity() {
        let mirrored = points(|q| Vector3::new(q.x, -q.y, q.z));
        assert!(rest_m(&mirrored, Freedom::ALL, Handedness::Mirrored) < ROUNDING_M);
        assert!(rest_m(&mirrored, Freedom::ALL, Handedness::Unchanged) > 0.1);
    }

    #[test]
    fn points_that_determine_no_similarity_are_refused() {
        let between = |points: &[[Vector3<f64>; 2]]| {
            Similarity::between(points, Freedom::ALL, Handedness::Unchanged)
        };
        assert!(between(&points(|q| q)[..MIN_POINTS - 1]).is_none());
        assert!(between(&points(|_| Vector3::zeros())).is_none());
        let along = Vector3::new(0.5, 2.0, -1.0);
        let line: Vec<_> = (0..60).map(|i| [along * f64::from(i); 2]).collect();
        assert!(between(&line).is_none());
        let unturned = Freedom {
            turn: false,
            ..Freedom::ALL
        };
        assert!(rest_m(&line, unturned, Handedness::Unchanged) < ROUNDING_M);
        assert!(between(&points(|q| q * 1e200)).is_some());
        assert!(between(&points(|q| q * 1e308)).is_none());
    }
}
