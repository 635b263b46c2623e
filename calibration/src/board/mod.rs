//! Cameras from boards and known points: chessboards and `ChArUco` in pictures ([`detect_chessboard`], [`detect_charuco`]), how a
//! camera sees ([`calibrate`]), and where it stands by points whose places are known ([`pose_from_points`]).
//!
//! Pictures come as grey bytes; who decodes files is the caller.

mod adjust;
mod carried;
mod charuco;
mod coverage;
mod detect;
mod found;
mod homography;
mod intrinsics;
mod other_charuco;
mod picture;
mod pose;
mod print;
mod projection;
mod refine;
mod size;
mod start;
mod turned;

use nalgebra::{Vector2, Vector3};

use self::adjust::Sighting;
pub use self::charuco::{Charuco, detect_charuco};
pub use self::coverage::Coverage;
pub use self::detect::{Chessboard, DetectError, detect_chessboard};
pub use self::found::{BoardCalibration, BoardError, PictureFit};
pub use self::intrinsics::calibrate;
pub use self::other_charuco::{OtherCharuco, other_charuco};
pub use self::picture::GrayPicture;
pub use self::pose::{OtherPose, PointPose, PoseError, pose_from_points};
pub use self::print::Print;
pub use self::projection::Coefficients;
pub use self::size::check_size;

/// Raise it whenever another lens comes of the same pictures: what was found with another one is looked for again.
pub const BOARD_REVISION: u32 = 1;

/// The corners of a board in one picture.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    /// The picture's name.
    pub name: String,
    /// Corners on the board, x along a row, y along a column, metres.
    pub board_m: Vec<[f64; 2]>,
    /// Where each was seen, distorted pixels; (0, 0) is the centre of the first.
    pub pixels: Vec<[f64; 2]>,
    /// How the board is printed.
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
