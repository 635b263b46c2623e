//! Intrinsics and poses of cameras from boards and known points: detection of chessboards and `ChArUco` boards in pictures
//! ([`detect_chessboard`], [`detect_charuco`]), intrinsics ([`calibrate`]), and the pose of a camera from points at known places
//! ([`pose_from_points`]).
//!
//! Pictures are grey bytes; the caller decodes files.

mod adjust;
mod carried;
mod charuco;
mod detect;
mod intrinsics;
mod outcome;
mod pose;
mod projection;
mod size;
mod start;
mod turned;

use nalgebra::{Vector2, Vector3};

use self::adjust::Sighting;
pub use self::charuco::{Charuco, OtherCharuco, detect_charuco, other_charuco};
pub use self::detect::{Chessboard, DetectError, GrayPicture, Print, detect_chessboard};
pub use self::intrinsics::calibrate;
pub use self::outcome::{BoardCalibration, BoardError, Coverage, PictureFit};
pub use self::pose::{OtherPose, PointPose, PoseError, pose_from_points};
pub use self::projection::Coefficients;
pub use self::size::check_size;

/// Raise it whenever the same pictures give another lens: cached results of other revisions are computed again.
pub const BOARD_REVISION: u32 = 1;

/// The corners of a board in one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    /// The picture's name.
    pub name: String,
    /// Corners on the board, x along a row, y along a column, metres.
    pub board_m: Vec<[f64; 2]>,
    /// Their distorted pixels; (0, 0) is the centre of the first.
    pub pixels: Vec<[f64; 2]>,
    /// The print of the board.
    pub print: Print,
}

impl BoardView {
    fn sighting(&self) -> Sighting {
        Sighting {
            board: self
                .board_m
                .iter()
                .map(|[x, y]| Vector3::new(*x, *y, 0.0))
                .collect(),
            pixels: self.pixels.iter().copied().map(Vector2::from).collect(),
        }
    }
}

#[cfg(test)]
mod charuco_tests;
#[cfg(test)]
mod tests;
