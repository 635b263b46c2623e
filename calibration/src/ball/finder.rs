//! The pictures of one camera in, the sightings of one thing out.

use std::fmt::Write as _;

use super::appearance::Appearance;
use super::blobs::Blobs;
use super::candidate::{Candidate, Room, candidates};
use super::chart::BallLens;
use super::colour::{ColourRange, hsv};
use super::error::BallError;
use super::mask::Mask;
use super::picture::Picture;
use super::track::{Choice, choose};
use crate::points::Sighting;

/// What is looked for in the pictures of one camera.
#[derive(Debug, Clone, Copy)]
pub struct BallRequest {
    /// By what it is told.
    pub appearance: Appearance,
    /// Least and most diameter that it can have in a picture, pixels, 1 to 2000.
    pub diameter_px: [f64; 2],
    /// How the camera sees; without it the middle of the outline stands for the centre, which is off toward the corners of wide
    /// lenses ([`super::outline_offset_px`]).
    pub lens: Option<BallLens>,
}

/// Where the thing was in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallSighting {
    /// The frame as it was numbered by the caller.
    pub frame: u64,
    /// Its centre in the middle of the exposure, distorted pixels of the whole picture; (0, 0) is the centre of the first.
    pub px: [f64; 2],
    /// How large it appears: the angle that it spans times the focal length; without a lens the diameter of its outline.
    /// A ball of radius R is at about 2 f R / diameter from the camera.
    pub diameter_px: f64,
    /// Standard deviation of the centre along each axis, pixels, told from how the outline lies about the circle. It does not
    /// know of what is common to all of the outline.
    pub sigma_px: f64,
    /// 0 to 1: which share of an undisturbed, round outline was found. At most 0.8 of things too small for one.
    pub score: f64,
}

/// Raise it whenever other sightings come of the same pictures: what was found with another one is looked for again.
pub const FINDER_REVISION: u32 = 1;

/// Most frames with something in them, and most candidates of one.
const MOST_FRAMES: usize = 2_000_000;
const MOST_KEPT: usize = 8;
const DIAMETERS_PX: [f64; 2] = [1.0, 2000.0];

/// Looks at the pictures of one camera, and finds what moves through them.
#[derive(Debug, Clone)]
pub struct BallFinder {
    request: BallRequest,
    mask: Mask,
    blobs: Blobs,
    room: Room,
    found: Vec<Candidate>,
    kept: Vec<(u64, Candidate)>,
    last_frame: Option<u64>,
}

impl BallFinder {
    /// A finder that has seen nothing yet.
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
                expected: "two rising numbers of pixels from 1 to 2000",
            });
        }
        if let Appearance::Colour(range) | Appearance::MovingColour(range) = &request.appearance
            && !range.is_sound()
        {
            return Err(BallError::Request {
                field: "colour",
                found: format!("{range:?}"),
                expected: "hues of 0 to 360 degrees, rising saturations and values of 0 to 1",
            });
        }
        Ok(Self {
            mask: Mask::of(&request.appearance),
            request,
            blobs: Blobs::default(),
            room: Room::default(),
            found: Vec::new(),
            kept: Vec::new(),
            last_frame: None,
        })
    }

    /// Looks at the picture of `frame`; how many candidates it has. Work and room are bounded by the size of the picture; what
    /// stays of it is eight candidates.
    ///
    /// # Errors
    /// [`BallError`] for a frame that does not rise, a grey picture where colours are asked, one of another size or place where
    /// motion is, more frames than are kept.
    pub fn look(&mut self, frame: u64, picture: &Picture<'_>) -> Result<usize, BallError> {
        if let Some(last) = self.last_frame.filter(|last| *last >= frame) {
            return Err(BallError::Order { found: frame, last });
        }
        self.mask.look(picture, &mut self.blobs)?;
        self.last_frame = Some(frame);
        self.found.clear();
        candidates(
            picture,
            &mut self.blobs,
            self.request.diameter_px,
            self.request.lens.as_ref(),
            &mut self.room,
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

    /// The one thing that moves, over all that was seen: at most one sighting per frame, in their order.
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

    /// The colour of the most saturated round thing that moves: after a first pass with [`Appearance::MovingColour`] of
    /// [`ColourRange::saturated`] over some pictures, what a second one looks for. `None` where nothing was found.
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

/// Hue, so that reds on both sides of 0 stand together.
fn hue(colour: &[f64; 3]) -> f64 {
    let [hue, ..] = hsv(colour.map(|c| c as u8));
    if hue > 300.0 { hue - 360.0 } else { hue }
}

/// As [`crate::points`] takes them.
pub fn sightings(found: &[BallSighting]) -> Vec<Sighting> {
    let each = found.iter().map(|it| Sighting {
        frame: it.frame as f64,
        px: it.px,
    });
    each.collect()
}

/// As [`crate::points::parse`] reads them: `frame x y` on each line, pixels to four digits.
pub fn sightings_text(found: &[BallSighting]) -> String {
    let mut text = "frame x y\n".to_owned();
    for it in found {
        // Writing to a string does not fail.
        writeln!(text, "{} {:.4} {:.4}", it.frame, it.px[0], it.px[1]).ok();
    }
    text
}
