//! Geometry of few views: relative pose of two cameras, pose of one from known points, triangulation of a point.
//!
//! Sights are unit vectors in the camera's axes (x right, y down, z forward), without lenses; errors are angles in radians.

mod essential;
mod polynomial;
mod resection;
mod triangulation;
mod two_view;

pub(crate) use resection::three_point;
pub use resection::{Resection, resect};
pub use triangulation::{Sight, triangulate};
pub use two_view::{RelativePose, TwoViews, least_loss, refined_pose, relative_pose, sampson_rad};
