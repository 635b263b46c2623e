//! How a thing differs from everything else, and the pixels that may belong to it.

use super::background::Background;
use super::blobs::Blobs;
use super::colour::{ColourRange, ColourTable};
use super::picture::{BallError, Picture, PixelLayout};

/// How the thing differs from everything else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Appearance {
    /// By colour alone: for scenes without large things of this colour.
    Colour(ColourRange),
    /// By colour and motion: for scenes where seats or signs have the colour too. The camera must stand still.
    MovingColour(ColourRange),
    /// A light in the dark, by its brightness.
    Bright {
        /// Least brightness, 0 to 255.
        least: u8,
    },
    /// A difference from the still background: a drone against the sky. The camera must stand still. What moves with the
    /// thing, as a hand that carries it, is part of it.
    Moving {
        /// Least difference, levels of 255.
        contrast: u8,
    },
}

/// The conditions for a pixel, with buffers.
#[derive(Debug, Clone)]
pub(super) struct Mask {
    colours: Option<ColourTable>,
    least_brightness: u8,
    /// Least change of a moving pixel, levels.
    contrast: Option<u8>,
    background: Background,
    place_px: Option<[u32; 4]>,
    row: Vec<bool>,
    brightness: Vec<u8>,
}

/// Least change of a pixel of a coloured thing that moves, levels.
const COLOUR_CONTRAST: u8 = 16;

impl Mask {
    pub(super) fn new(appearance: &Appearance) -> Self {
        let (colours, least_brightness, contrast) = match appearance {
            Appearance::Colour(range) => (Some(ColourTable::new(range)), 0, None),
            Appearance::MovingColour(range) => {
                (Some(ColourTable::new(range)), 0, Some(COLOUR_CONTRAST))
            }
            Appearance::Bright { least } => (None, *least, None),
            Appearance::Moving { contrast } => (None, 0, Some(*contrast)),
        };
        Self {
            colours,
            least_brightness,
            contrast,
            background: Background::default(),
            place_px: None,
            row: Vec::new(),
            brightness: Vec::new(),
        }
    }

    /// Finds the blobs of `picture`.
    ///
    /// # Errors
    /// [`BallError`] for a grey picture when a colour is requested, or another size or origin when motion is requested.
    pub(super) fn find(
        &mut self,
        picture: &Picture<'_>,
        blobs: &mut Blobs,
    ) -> Result<(), BallError> {
        blobs.clear();
        if self.colours.is_some() && picture.layout() == PixelLayout::Grey8 {
            return Err(BallError::Grey);
        }
        let [width, height] = picture.size_px();
        if self.contrast.is_some() {
            let [left, top] = picture.origin_px();
            let found_px = [width, height, left, top];
            let expected_px = *self.place_px.get_or_insert(found_px);
            if expected_px != found_px {
                return Err(BallError::SizeChanged {
                    found_px,
                    expected_px,
                });
            }
            let per_pixel = if self.colours.is_some() { 3 } else { 1 };
            self.background
                .begin(per_pixel * width as usize, height as usize);
        }
        self.row.resize(width as usize, false);
        self.brightness.resize(width as usize, 0);
        for y in 0..height {
            self.fill_row(y, picture.row(y), picture.layout());
            blobs.add_row(y, &self.row);
        }
        self.background.end();
        Ok(())
    }

    fn fill_row(&mut self, y: u32, bytes: &[u8], layout: PixelLayout) {
        if let Some(table) = &self.colours {
            for (is_in, pixel) in self.row.iter_mut().zip(bytes.chunks_exact(3)) {
                *is_in = matches!(pixel, [r, g, b] if table.contains(*r, *g, *b));
            }
        }
        if self.colours.is_some() {
            // All three channels are compared: an orange ball is as bright as grey boards and grass.
            if let Some(contrast) = self.contrast {
                self.background
                    .keep_moving::<3>(y as usize, bytes, contrast, &mut self.row);
            }
            return;
        }
        match layout {
            PixelLayout::Grey8 => self.brightness.copy_from_slice(bytes),
            PixelLayout::Rgb8 => {
                for (brightness, pixel) in self.brightness.iter_mut().zip(bytes.chunks_exact(3)) {
                    *brightness = brightness_of(pixel);
                }
            }
        }
        for (is_in, brightness) in self.row.iter_mut().zip(&self.brightness) {
            *is_in = *brightness >= self.least_brightness;
        }
        if let Some(contrast) = self.contrast {
            let (mask, brightness) = (&mut self.row, &self.brightness);
            self.background
                .keep_moving::<1>(y as usize, brightness, contrast, mask);
        }
    }
}

/// A quarter of red and blue, half of green: close enough to the luminance.
fn brightness_of(pixel: &[u8]) -> u8 {
    match pixel {
        [r, g, b] => ((u16::from(*r) + 2 * u16::from(*g) + u16::from(*b)) / 4) as u8,
        _ => 0,
    }
}
