//! The similarity that maps one set of points to another.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::adjustment::CameraState;

/// x -> scale R x + shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// Lengths there over lengths here.
    pub scale: f64,
    /// R.
    pub rotation: UnitQuaternion<f64>,
    /// The new position of the origin.
    pub shift: Vector3<f64>,
}

/// The reason why no similarity was found.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum SimilarityError {
    /// Fewer than three points, or two lists of different lengths.
    #[error("found {found} points, expected at least 3")]
    TooFew {
        /// The number of points.
        found: usize,
    },
    /// All on one line.
    #[error("the points lie on one line, expected three that do not")]
    OneLine,
}

/// Least ratio of the second to the first singular value for points that are not on a line.
const LEAST_SPREAD: f64 = 1e-6;

impl Similarity {
    /// The identity.
    pub fn identity() -> Self {
        Self {
            scale: 1.0,
            rotation: UnitQuaternion::identity(),
            shift: Vector3::zeros(),
        }
    }

    /// The similarity with the least summed squared distance of the moved `from` to `to` (Umeyama 1991, eq. (40) to (42));
    /// never a reflection.
    ///
    /// # Errors
    /// [`SimilarityError`] for fewer than three points, or points on a line.
    pub fn between(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Result<Self, SimilarityError> {
        fit(from, to, Handedness::Kept)
    }

    /// The new position of `point`.
    pub fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point * self.scale + self.shift
    }

    /// `camera` in the new world.
    #[must_use]
    pub fn apply_to_camera(&self, camera: &CameraState) -> CameraState {
        CameraState {
            camera_from_world: camera.camera_from_world * self.rotation.inverse(),
            center_w: self.apply(&camera.center_w),
            ..*camera
        }
    }

    /// First this, then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        Self {
            scale: next.scale * self.scale,
            rotation: next.rotation * self.rotation,
            shift: next.apply(&self.shift),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Handedness {
    Kept,
    Reversed,
}

fn fit(
    from: &[Vector3<f64>],
    to: &[Vector3<f64>],
    handedness: Handedness,
) -> Result<Similarity, SimilarityError> {
    let found = from.len().min(to.len());
    if found < 3 || from.len() != to.len() {
        return Err(SimilarityError::TooFew { found });
    }
    let mirrored: Vec<Vector3<f64>>;
    let from = if handedness == Handedness::Kept {
        from
    } else {
        mirrored = from.iter().map(|p| Vector3::new(-p.x, p.y, p.z)).collect();
        &mirrored
    };
    let (middle_from, middle_to) = (mean(from), mean(to));
    let mut product = Matrix3::zeros();
    let mut variance = 0.0;
    for (a, b) in from.iter().zip(to) {
        product += (b - middle_to) * (a - middle_from).transpose();
        variance += (a - middle_from).norm_squared();
    }
    let svd = product.svd(true, true);
    let s = svd.singular_values;
    if s[1] <= LEAST_SPREAD * s[0] || variance <= 0.0 {
        return Err(SimilarityError::OneLine);
    }
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(SimilarityError::OneLine);
    };
    let sign = if u.determinant() * v_t.determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign));
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(u * flip * v_t));
    let scale = (s[0] + s[1] + sign * s[2]) / variance;
    Ok(Similarity {
        scale,
        rotation,
        shift: middle_to - rotation * middle_from * scale,
    })
}

/// Root of the mean squared distance of the moved `from` to `to`.
pub fn rms(similarity: &Similarity, from: &[Vector3<f64>], to: &[Vector3<f64>]) -> f64 {
    let squares = from
        .iter()
        .zip(to)
        .map(|(a, b)| (similarity.apply(a) - b).norm_squared());
    (squares.sum::<f64>() / from.len().max(1) as f64).sqrt()
}

/// The RMS that a mirrored `from` would leave on `to`; it distinguishes a mirror image from a bad fit.
///
/// # Errors
/// As [`Similarity::between`].
pub fn mirrored_rms(from: &[Vector3<f64>], to: &[Vector3<f64>]) -> Result<f64, SimilarityError> {
    let found = fit(from, to, Handedness::Reversed)?;
    let mirrored: Vec<_> = from.iter().map(|p| Vector3::new(-p.x, p.y, p.z)).collect();
    Ok(rms(&found, &mirrored, to))
}

fn mean(points: &[Vector3<f64>]) -> Vector3<f64> {
    points.iter().fold(Vector3::zeros(), |sum, p| sum + p) / points.len() as f64
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-size..size).prop_map(Vector3::from)
    }

    proptest! {
        #[test]
        fn a_similarity_is_recovered_from_its_points(
            points in prop::collection::vec(any_vector(10.0), 5..20),
            turn in any_vector(1.5),
            shift in any_vector(50.0),
            scale in 0.01f64..50.0,
        ) {
            let truth = Similarity { scale, rotation: UnitQuaternion::from_scaled_axis(turn), shift };
            let moved: Vec<_> = points.iter().map(|p| truth.apply(p)).collect();
            let found = Similarity::between(&points, &moved).unwrap();
            prop_assert!(rms(&found, &points, &moved) < 1e-8 * (1.0 + scale));
        }
    }

    #[test]
    fn a_mirror_image_fits_only_mirrored() {
        let points: Vec<_> = (0..6)
            .map(f64::from)
            .map(|i| Vector3::new(libm::sin(i), libm::cos(2.0 * i), libm::sin(3.0 * i)))
            .collect();
        let mirrored: Vec<_> = points
            .iter()
            .map(|p| Vector3::new(p.x, -p.y, p.z))
            .collect();
        let proper = Similarity::between(&points, &mirrored).unwrap();
        assert!(rms(&proper, &points, &mirrored) > 0.1);
        assert!(mirrored_rms(&points, &mirrored).unwrap() < 1e-9);
    }

    #[test]
    fn points_on_a_line_are_refused() {
        let line: Vec<_> = (0..5)
            .map(|i| Vector3::new(f64::from(i), 0.0, 0.0))
            .collect();
        let found = Similarity::between(&line, &line);
        assert_eq!(found, Err(SimilarityError::OneLine));
    }
}
