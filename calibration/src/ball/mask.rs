//! Which pixels may be of the thing.

use super::appearance::Appearance;
use super::background::Background;
use super::blobs::Blobs;
use super::colour::ColourTable;
use super::error::BallError;
use super::picture::{Picture, PixelLayout};

/// What is asked of a pixel, with the room that it needs.
#[derive(Debug, Clone)]
pub(super) struct Mask {
    colours: Option<ColourTable>,
    least_brightness: u8,
    /// Least change, levels, of what moves.
    contrast: Option<u8>,
    background: Background,
    place_px: Option<[u32; 4]>,
    row: Vec<bool>,
    brightness: Vec<u8>,
}

/// Least change of a pixel of a coloured thing that moves, levels.
const COLOUR_CONTRAST: u8 = 16;

impl Mask {
    pub(super) fn of(appearance: &Appearance) -> Self {
        let (colours, least_brightness, contrast) = match appearance {
            Appearance::Colour(range) => (Some(ColourTable::of(range)), 0, None),
            Appearance::MovingColour(range) => {
                (Some(ColourTable::of(range)), 0, Some(COLOUR_CONTRAST))
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
    /// [`BallError`] for a grey picture where colours are asked, or one of another size where motion is.
    pub(super) fn look(
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
            self.of_row(y, picture.row(y), picture.layout());
            blobs.add_row(y, &self.row);
        }
        self.background.end();
        Ok(())
    }

    fn of_row(&mut self, y: u32, bytes: &[u8], layout: PixelLayout) {
        if let Some(table) = &self.colours {
            for (is_in, pixel) in self.row.iter_mut().zip(bytes.chunks_exact(3)) {
                *is_in = matches!(pixel, [r, g, b] if table.contains(*r, *g, *b));
            }
        }
        if self.colours.is_some() {
            // By each of its colours: an orange ball is as bright as grey boards and grass.
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

/// A quarter of red and blue, half of green: near enough to the luminance.
fn brightness_of(pixel: &[u8]) -> u8 {
    match pixel {
        [r, g, b] => ((u16::from(*r) + 2 * u16::from(*g) + u16::from(*b)) / 4) as u8,
        _ => 0,
    }
}
