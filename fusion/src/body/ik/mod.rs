//! Inverse kinematics: the pose whose joints lie nearest to targets, paper (10)-(12) and (14)-(15).
//!
//! ```text
//!   argmin_q  ½ Σₜ rₜᵀ Aₜ rₜ + ½ Σᵢ vᵢ³ (qᵢ - restᵢ)²/σᵢ² + ½ Σᵢ vᵢ² (qᵢ - lastᵢ)²/ςᵢ²     lo <= q <= hi
//! ```
//!
//! (rₜ = pₜ(q) - yₜ; Aₜ is the inverse covariance of the target. Of one that is known across a ray only, it is singular.)
//!
//! Damped Gauss-Newton (Levenberg-Marquardt) with the analytic Jacobian; without bounds, where keypoints that no body
//! fits leave residuals, with the curvature of the cost from the second step on. What targets say is summed per link
//! (`composite.rs`), and the normal equations keep the sparsity of the tree (`normal.rs`, `factor.rs`). Bounds are an
//! active set and hold exactly.
//!
//! The weight vᵢ is why the priors do not bias what the targets determine. With Σᵢ the variance that
//! the targets alone leave to DoF i (each DoF being even over its clinical range before), and τᵢ the
//! deviation at which it counts as unknown, vᵢ = Σᵢ / (Σᵢ + τᵢ²): near 0 where the targets know, near
//! 1 where they do not. The rest pose has one power more, so that it gives way first: it errs in every
//! tick alike and its pull would stay, while the pull to the last pose is gone once a person is still.
//! The same test, Σᵢ > τᵢ² after the solve, of the targets as evidence, flags a reported angle as unobserved.

mod aims;
mod composite;
mod constants;
mod covariance;
mod factor;
mod normal;
mod observability;
mod prior_term;
mod priors;
mod relative_sigma;
mod solver;
mod target;

pub(crate) use constants::{PoseElimination, SeenPoint};
pub use covariance::{JointSpread, PointInformation};
pub use priors::Priors;
pub use relative_sigma::relative_sigmas;
pub use solver::IkSolver;
pub use target::{Solution, Target};

#[cfg(test)]
mod dense_tests;
#[cfg(test)]
mod tests;
