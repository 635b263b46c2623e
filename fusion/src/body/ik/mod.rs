//! Inverse kinematics: the pose whose joints lie nearest to targets, paper (10)-(12) and (14)-(15).
//!
//! ```text
//!   argmin_q  ½ Σₜ rₜᵀ Aₜ rₜ + ½ Σᵢ vᵢ³ (qᵢ - restᵢ)²/σᵢ² + ½ Σᵢ vᵢ² (qᵢ - lastᵢ)²/ςᵢ²     lo <= q <= hi
//! ```
//!
//! (rₜ = pₜ(q) - yₜ; Aₜ is the inverse covariance of the target. It is singular for a target that
//! is known only across a ray.)
//!
//! Damped Gauss-Newton (Levenberg-Marquardt) with the analytic Jacobian. Without bounds, keypoints
//! that fit no body leave residuals, so the curvature of the cost is used from the second step on.
//! Targets are summed per link (`composite.rs`), and the normal equations keep the sparsity of the
//! tree (`normal.rs`). Bounds are an active set and hold exactly.
//!
//! Because of the weight vᵢ the priors do not bias what the targets determine. Σᵢ is the variance
//! that the targets alone leave to DoF i (each DoF being uniform over its clinical range before),
//! and τᵢ the deviation at which it counts as unknown. Then vᵢ = Σᵢ / (Σᵢ + τᵢ²): near 0 for
//! determined DoF, near 1 for others. The rest pose has one power more, so that it yields first: it
//! has the same error in every tick and its pull would stay, while the pull to the last pose
//! vanishes once a person is still. The same test, Σᵢ > τᵢ² after the solve, of the targets as
//! evidence, flags a reported angle as unobserved.

mod composite;
mod constants;
mod covariance;
mod normal;
mod observability;
mod priors;
mod solver;
mod target;

pub(crate) use constants::{PoseElimination, SeenPoint};
pub use covariance::{JointSpread, PointInformation};
pub use priors::Priors;
pub use solver::IkSolver;
pub use target::{Solution, Target, relative_sigmas};

#[cfg(test)]
mod dense_tests;
#[cfg(test)]
mod tests;
