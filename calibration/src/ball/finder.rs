//! Finds the sightings of one thing in the pictures of one camera.

use std::fmt::Write as _;

use super::blobs::Blobs;
use super::candidate::{Buffers, Candidate, candidates};
use super::chart::BallLens;
use super::colour::{ColourRange, hsv};
use super::mask::{Appearance, Mask};
use super::picture::{BallError, Picture};
use super::track::{Choice, choose};
use crate::points::Sighting;

/// What to search for in the pictures of one camera.
#[derive(Debug, Clone, Copy)]
pub struct BallRequest {
    /// How the thing differs from everything else.
    pub appearance: Appearance,
    /// Smallest and largest diameter that it can have in a picture, pixels, 1 to 2000.
    pub diameter_px: [f64; 2],
    /// The camera's lens. Without it the middle of the outline is used as the centre, which is wrong toward the corners of
    /// wide lenses ([`super::outline_offset_px`]).
    pub lens: Option<BallLens>,
}

/// Where the thing was in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallSighting {
    /// Number of the frame, as the caller gave it.
    pub frame: u64,
    /// Centre at the middle of the exposure, distorted pixels of the whole picture; (0, 0) is the centre of the first pixel.
    pub px: [f64; 2],
    /// Apparent diameter: the angle that the thing spans, times the focal length; without a lens the diameter of its outline.
    /// A ball of radius R is at about 2 f R / diameter from the camera.
    pub diameter_px: f64,
    /// Standard deviation of the centre along each axis, pixels, from the scatter of the outline about the circle. Errors that
    /// the whole outline shares are not included.
    pub sigma_px: f64,
    /// 0 to 1: share of an undisturbed, round outline that was found. At most 0.8 for things too small for an outline.
    pub score: f64,
}

/// Increase it whenever the same pictures give other sightings: results of another revision are then computed again.
pub const FINDER_REVISION: u32 = 1;

/// Largest number of frames with candidates.
const MOST_FRAMES: usize = 2_000_000;
/// Largest number of candidates of one frame.
const MOST_KEPT: usize = 8;
const DIAMETERS_PX: [f64; 2] = [1.0, 2000.0];

/// Finds what moves through the pictures of one camera.
#[derive(Debug, Clone)]
pub struct BallFinder {
    request: BallRequest,
    mask: Mask,
    blobs: Blobs,
    buffers: Buffers,
    found: Vec<Candidate>,
    kept: Vec<(u64, Candidate)>,
    last_frame: Option<u64>,
}

impl BallFinder {
    /// A finder without pictures.
    ///
    /// # Errors
    /// [`BallError::Request`] for an impossible diameter or range of colours.
    pub fn new(request: BallRequest) -> Result<Self, BallError> {
        let [least, most] = request.diameter_px;
        let is_range = least >= DIAMETERS_PX[0] && least <= most && most <= DIAMETERS_PX[1];
        if !is_range {
            return Err(BallError::Request {
                field: "diameter_px",
                found: format!("{least} to {most}"),
                expected: "two increasing numbers of pixels from 1 to 2000",
            });
        }
        if let Appearance::Colour(range) | Appearance::MovingColour(range) = &request.appearance
            && !range.is_sound()
        {
            return Err(BallError::Request {
                field: "colour",
                found: format!("{range:?}"),
                expected: "hues of 0 to 360 degrees, increasing saturations and values of 0 to 1",
            });
        }
        Ok(Self {
            mask: Mask::new(&request.appearance),
            request,
            blobs: Blobs::default(),
            buffers: Buffers::default(),
            found: Vec::new(),
            kept: Vec::new(),
            last_frame: None,
        })
    }

    /// Processes the picture of `frame` and returns its number of candidates. Time and memory are bounded by the size of the
    /// picture; at most eight candidates are kept.
    ///
    /// # Errors
    /// [`BallError`] for a frame that is not later than the one before, a grey picture when a colour is requested, a picture of
    /// another size or origin when motion is requested, or too many frames.
    pub fn look(&mut self, frame: u64, picture: &Picture<'_>) -> Result<usize, BallError> {
        if let Some(last) = self.last_frame.filter(|last| *last >= frame) {
            return Err(BallError::Order { found: frame, last });
        }
        self.mask.find(picture, &mut self.blobs)?;
        self.last_frame = Some(frame);
        self.found.clear();
        candidates(
            picture,
            &mut self.blobs,
            self.request.diameter_px,
            self.request.lens.as_ref(),
            &mut self.buffers,
            &mut self.found,
        );
        self.found.sort_by(|a, b| b.score.total_cmp(&a.score));
        self.found.truncate(MOST_KEPT);
        if self.kept.len() + self.found.len() > MOST_KEPT * MOST_FRAMES {
            return Err(BallError::TooMany { most: MOST_FRAMES });
        }
        self.kept.extend(self.found.iter().map(|it| (frame, *it)));
        Ok(self.found.len())
    }

    /// The sightings of the one thing that moves, at most one per frame, in the order of frames.
    pub fn finish(&self) -> Vec<BallSighting> {
        let chosen = choose(&self.kept, Choice::Roundest);
        let sightings = chosen.into_iter().filter_map(|index| self.kept.get(index));
        sightings
            .map(|(frame, it)| BallSighting {
                frame: *frame,
                px: it.px,
                diameter_px: it.diameter_px,
                sigma_px: it.sigma_px,
                score: it.score,
            })
            .collect()
    }

    /// The colour of the most saturated round thing that moves, or `None` if there is none. A first pass over some pictures
    /// with [`Appearance::MovingColour`] of [`ColourRange::saturated`] gives the colour for a second pass.
    pub fn colour(&self) -> Option<ColourRange> {
        let chosen = choose(&self.kept, Choice::MostSaturated);
        let mut colours: Vec<[f64; 3]> = chosen
            .iter()
            .filter_map(|index| Some(self.kept.get(*index)?.1.colour))
            .collect();
        colours.sort_by(|a, b| hue(a).total_cmp(&hue(b)));
        let middle = colours.get(colours.len() / 2)?;
        Some(ColourRange::about(middle.map(|c| c as u8)))
    }
}

/// Hue, with the reds on both sides of 0 next to each other.
fn hue(colour: &[f64; 3]) -> f64 {
    let [hue, ..] = hsv(colour.map(|c| c as u8));
    if hue > 300.0 { hue - 360.0 } else { hue }
}

/// The sightings as [`crate::points`] takes them.
pub fn sightings(found: &[BallSighting]) -> Vec<Sighting> {
    let each = found.iter().map(|it| Sighting {
        frame: it.frame as f64,
        px: it.px,
    });
    each.collect()
}

/// The sightings as [`crate::points::parse`] reads them: `frame x y` on each line, pixels with four decimals.
pub fn sightings_text(found: &[BallSighting]) -> String {
    let mut text = "frame x y\n".to_owned();
    for it in found {
        // Writing to a string does not fail.
        writeln!(text, "{} {:.4} {:.4}", it.frame, it.px[0], it.px[1]).ok();
    }
    text
}
