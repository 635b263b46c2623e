//! A summary of all keypoints of a file: it must contain people, and their keypoints must be inside
//! the camera's picture.
//!
//! A file that fails these checks is well-formed. Without them a run would detect no person and
//! would report no reason.

use farfield_proto::finding::Advice;
use farfield_proto::keypoints::COCO17;
use farfield_proto::order_statistics::FEWEST_REACHING;

use super::SURE;
use crate::source::{ExpectedSource, KeypointFrame, SourceError};

/// Keypoints within this distance from the origin are shares of the picture's size, not pixels ...
const SHARE_OF_PICTURE: f64 = 1.5;
/// ... if at most this share of the keypoints is farther away (some may be wrong). Keypoints at the
/// origin itself are missing ones.
const FAR_SHARE: f64 = 0.01;
/// ... and if there are at least the keypoints of two people.
const MIN_POINTS: u64 = 2 * COCO17.len() as u64;
/// Networks can place hidden keypoints outside the picture by this share of its width and height.
const MARGIN: f64 = 0.1;
/// From this share of keypoints beyond the margin, they belong to another picture. For people at
/// the edge of the picture only a few are outside.
const MAX_OUTSIDE_SHARE: f64 = 0.1;

/// Summary of a keypoint file.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct KeypointContents {
    /// Number of lines.
    pub lines: u64,
    /// Number of keypoints.
    pub points: u64,
    /// Keypoints with a reliable score.
    pub sure: u64,
    /// Reliable keypoints clearly outside the picture.
    pub outside: u64,
    /// Width and height of the calibrated picture.
    pub size_px: [u32; 2],
    /// The reliable keypoint farthest outside, pixels.
    farthest_px: [f64; 2],
    /// Its distance relative to the picture's width or height.
    farthest: f64,
    /// Keypoints that are not at the origin, and how many of these lie within [`SHARE_OF_PICTURE`]
    /// of it.
    away: u64,
    near: u64,
}

impl KeypointContents {
    /// An empty summary for a camera with pictures of `size_px`.
    pub(super) fn new(size_px: [u32; 2]) -> Self {
        Self {
            size_px,
            ..Self::default()
        }
    }

    /// Counts the next frame of a file.
    pub(super) fn add(&mut self, frame: &KeypointFrame) {
        self.lines += 1;
        for point in frame.peaks.iter().flatten() {
            let at = point.position.vector_px();
            self.points += 1;
            let from_corner_px = at.amax();
            self.away += u64::from(from_corner_px > 0.0);
            self.near += u64::from(from_corner_px > 0.0 && from_corner_px <= SHARE_OF_PICTURE);
            if f64::from(point.score) < SURE {
                continue;
            }
            self.sure += 1;
            let outside = |axis: usize| {
                let size = f64::from(self.size_px[axis].max(1));
                (-at[axis]).max(at[axis] - size) / size
            };
            let farthest = outside(0).max(outside(1));
            self.outside += u64::from(farthest > MARGIN);
            if farthest > self.farthest {
                (self.farthest, self.farthest_px) = (farthest, [at[0], at[1]]);
            }
        }
    }

    /// Refuses a file whose coordinates are no pixels.
    pub(super) fn check(&self, expected: &ExpectedSource) -> Result<(), SourceError> {
        let far = self.away - self.near;
        let is_few = far < FEWEST_REACHING as u64 || far as f64 <= FAR_SHARE * self.away as f64;
        if self.near >= MIN_POINTS && is_few {
            return Err(SourceError::Unreadable {
                at: expected.at.clone(),
                problem: format!(
                    "{} of {} keypoints lie within {SHARE_OF_PICTURE} pixels of the corner, as shares of a picture do; \
                     expected pixels of {} x {}",
                    self.near, self.away, expected.size_px[0], expected.size_px[1]
                ),
            });
        }
        Ok(())
    }

    /// A warning about the file, if there is a reason for one.
    pub fn doubt(&self) -> Option<Advice> {
        let [width, height] = self.size_px;
        if self.points == 0 {
            return Some(Advice::doubtful(
                format!("none of its {} lines contains a person", self.lines),
                "check that the program that wrote it detected people in this camera's pictures: a line has them in `persons` \
                         (docs/venue.md)",
            ));
        }
        let share = self.outside as f64 / self.sure.max(1) as f64;
        let is_suspect = self.sure >= MIN_POINTS && share > MAX_OUTSIDE_SHARE;
        is_suspect.then(|| Advice::doubtful(
            format!(
                "{} of its {} keypoints ({:.0} %) lie outside its picture of {width} x {height}, as far as x = {:.0}, y = {:.0}",
                self.outside,
                self.sure,
                100.0 * share,
                self.farthest_px[0],
                self.farthest_px[1]
            ),
            "were they found in pictures of another size, or of another camera? Give them in pixels of the pictures that \
                     were calibrated, from their top left corner",
        ))
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Pixel;

    use super::*;
    use crate::source::KeypointCandidate;

    /// A file for pictures of 100 x 50 pixels, with one line per point.
    fn contents(points: impl IntoIterator<Item = [f64; 2]>) -> KeypointContents {
        scored(points.into_iter().map(|at| (at, 0.8)))
    }

    /// The same with a score per point.
    fn scored(points: impl IntoIterator<Item = ([f64; 2], f32)>) -> KeypointContents {
        let mut contents = KeypointContents::new([100, 50]);
        for ([x, y], score) in points {
            let position = Pixel::new(x, y);
            let seen = KeypointCandidate { position, score };
            contents.add(&KeypointFrame {
                persons: Vec::new(),
                peaks: vec![vec![seen]],
            });
        }
        contents
    }

    #[test]
    fn a_file_without_people_causes_a_warning() {
        let mut empty = KeypointContents::new([100, 50]);
        empty.add(&KeypointFrame::default());
        let doubt = empty.doubt().unwrap();
        assert_eq!(doubt.problem, "none of its 1 lines contains a person");
    }

    #[test]
    fn keypoints_outside_the_picture_cause_a_warning_with_their_extent() {
        let of_double_size = contents((0..40).map(|i| [5.0 * f64::from(i), 2.5 * f64::from(i)]));
        let doubt = of_double_size.doubt().unwrap();
        for words in ["100 x 50", "x = 195, y = 98", "(42 %)"] {
            assert!(doubt.problem.contains(words), "{words}: {doubt:?}");
        }
    }

    #[test]
    fn guessed_feet_below_the_picture_cause_no_warning() {
        let cut_off = contents((0..40).map(|i| [50.0, if i % 12 == 0 { 70.0 } else { 48.0 }]));
        assert_eq!((cut_off.outside, cut_off.doubt()), (4, None));
        let a_little = contents((0..40).map(|_| [109.0, 54.0]));
        assert_eq!(a_little.doubt(), None);
        // Half of the body is below the picture; its keypoints are guessed.
        let guessed = (0..40).map(|i| {
            (
                [50.0, 25.0 + 2.0 * f64::from(i)],
                if i < 13 { 0.8 } else { 0.1 },
            )
        });
        assert_eq!(scored(guessed).doubt(), None);
        let from_the_middle = contents((0..40).map(|i| [f64::from(i) - 40.0, f64::from(i) - 20.0]));
        let doubt = from_the_middle.doubt().unwrap();
        assert!(doubt.problem.contains("x = -40, y = -20"), "{doubt:?}");
    }
}
