//! Targets of the first inverse kinematics: the keypoints of a tick.
//!
//! ```text
//!   A = c I + (p/σ²) 1          seen: I of `uncertainty::observation`, the information of all views about the place
//!   A = (p/σ²) 1                not seen: the predicted place
//!   E = (I⁻¹ + v 1)⁻¹ + (p/σ²) 1    the same as evidence, with a lasting error of variance v
//! ```
//!
//! The paper weights a keypoint by a number, (12). Views have different information along different
//! axes: two that face each other have none along the line between them, and a single one has none
//! along its ray. There p keeps the place of the search, which is that of the prediction.

use nalgebra::Matrix3;

use crate::body::ik::Target;
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::Site;
use crate::method::Method;

/// c: weight of a tick's information relative to the last pose. A network's errors last, so ten
/// ticks have little more information than one. Tuned on the project's own scenes (0.02 to 1.4 were
/// tried: below 0.05 the pose lags, above it jitters).
const SHARE_OF_INFORMATION: f64 = 0.1;

/// Error of a network's keypoint that lasts as long as a pose, metres per axis, in all views. With
/// the information of four views the total is 20 mm, which the limits of determined angles assume.
const LASTING_M: f64 = 0.016;

/// Fills `targets` with the keypoints of `estimates`, at their `sites`.
pub(crate) fn aim_at_keypoints(
    estimates: &[KeypointEstimate],
    sites: &[Option<Site>],
    method: &Method,
    targets: &mut Vec<Target>,
) {
    let ik = &method.parameters.ik;
    let full = 1.0 / (ik.keypoint_sigma_m * ik.keypoint_sigma_m);
    targets.clear();
    let keypoints = estimates.iter().zip(sites);
    for ((estimate, site), sigma) in keypoints.zip(&method.relative_sigmas) {
        let Some(site) = site else { continue };
        let full = full / (sigma * sigma);
        let mut target = Target::isotropic(site, estimate.position_m, ik.prediction_weight * full);
        if estimate.weight > 0.0 {
            // A sighting has no information of its views.
            let (information, evidence) = if estimate.information.trace() > 0.0 {
                let lasting_m = LASTING_M * sigma;
                (
                    estimate.information * SHARE_OF_INFORMATION,
                    with_error(&estimate.information, lasting_m * lasting_m),
                )
            } else {
                let per_axis = estimate.weight.max(ik.min_weight) * full;
                [per_axis; 2].map(Matrix3::from_diagonal_element).into()
            };
            target.information += information;
            target.evidence += evidence;
        }
        targets.push(target);
    }
}

/// `information` with an additional error of this variance (m²) on every axis: (I⁻¹ + v 1)⁻¹, also
/// of a singular one.
fn with_error(information: &Matrix3<f64>, variance_m2: f64) -> Matrix3<f64> {
    let grown = Matrix3::identity() + information * variance_m2;
    grown
        .try_inverse()
        .map_or_else(Matrix3::zeros, |inverse| information * inverse)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_lasting_error_is_added_along_every_known_axis(
            sigmas_m in prop::array::uniform3(0.002f64..0.2), turn in prop::array::uniform3(-3.0f64..3.0),
            lasting_m in 0.001f64..0.05, is_seen_by_one in any::<bool>(),
        ) {
            let axes = nalgebra::Rotation3::from_scaled_axis(Vector3::from(turn));
            let mut known = Vector3::from(sigmas_m).map(|sigma_m| sigma_m.powi(-2));
            if is_seen_by_one {
                known.z = 0.0;
            }
            let world = |known: &Vector3<f64>| axes * Matrix3::from_diagonal(known) * axes.inverse();
            let expected = known.map(|known| known / (1.0 + known * lasting_m * lasting_m));
            let found = with_error(&world(&known), lasting_m * lasting_m);
            prop_assert!((found - world(&expected)).norm() < 1e-9 * expected.norm());
        }
    }
}
