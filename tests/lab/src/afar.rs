//! Real recordings as from a camera much farther away: images are scaled down and placed in a large grey image, and the
//! calibration is changed to match. People keep their positions and have fewer pixels.

use farfield_edge::source::{Frame, FrameContent, FrameSource, SourceError};
use farfield_proto::camera::{CameraError, CameraModel, Intrinsics};
use farfield_proto::venue::Venue;
use image::imageops::{FilterType, overlay, resize};
use image::{Rgb, RgbImage};

/// Colour around the small image.
const GREY: Rgb<u8> = Rgb([112; 3]);

/// Scale and canvas of the new images.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Afar {
    /// Factor on images, 0 to 1.
    pub scale: f64,
    /// Width and height of the new images, pixels.
    pub size_px: [u32; 2],
}

impl Afar {
    /// Size of the small image, and its first pixel in the large one.
    fn laid(&self, size_px: [u32; 2]) -> ([u32; 2], [u32; 2]) {
        let small = size_px.map(|side| (f64::from(side) * self.scale).round().max(1.0) as u32);
        let free = |i: usize| self.size_px[i].saturating_sub(small[i]);
        // Off the middle, to avoid the border of a tile.
        (small, [free(0) * 5 / 9, free(1) * 4 / 9])
    }

    /// The camera of the new images.
    ///
    /// # Errors
    /// The new numbers are not a valid camera.
    pub fn camera(&self, camera: &CameraModel) -> Result<CameraModel, CameraError> {
        let size_px = camera.size_px();
        let (small, at) = self.laid(size_px);
        let ratio = [0, 1].map(|i| f64::from(small[i]) / f64::from(size_px[i]));
        let k = camera.intrinsics();
        let intrinsics = Intrinsics {
            fx_px: k.fx_px * ratio[0],
            fy_px: k.fy_px * ratio[1],
            cx_px: (k.cx_px + 0.5) * ratio[0] - 0.5 + f64::from(at[0]),
            cy_px: (k.cy_px + 0.5) * ratio[1] - 0.5 + f64::from(at[1]),
        };
        CameraModel::new(
            camera.name(),
            self.size_px,
            intrinsics,
            *camera.lens(),
            *camera.camera_from_world(),
        )
    }

    /// `venue` with the new cameras.
    ///
    /// # Errors
    /// See [`Self::camera`].
    pub fn venue(&self, venue: &Venue) -> Result<Venue, CameraError> {
        let mut afar = venue.clone();
        for camera in &mut afar.cameras {
            camera.model = self.camera(&camera.model)?;
        }
        Ok(afar)
    }

    /// `source` with the new images.
    pub fn source(&self, source: Box<dyn FrameSource>) -> Box<dyn FrameSource> {
        Box::new(Small {
            source,
            afar: *self,
        })
    }

    fn picture(&self, picture: &RgbImage) -> RgbImage {
        let ([width, height], [left, top]) = self.laid([picture.width(), picture.height()]);
        // A triangle filter averages like a lens farther away.
        let small = resize(picture, width, height, FilterType::Triangle);
        let mut large = RgbImage::from_pixel(self.size_px[0], self.size_px[1], GREY);
        overlay(&mut large, &small, left.into(), top.into());
        large
    }
}

struct Small {
    source: Box<dyn FrameSource>,
    afar: Afar,
}

impl FrameSource for Small {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        let frame = self.source.next_frame()?;
        Ok(frame.map(|frame| Frame {
            content: match frame.content {
                FrameContent::Image(picture) => {
                    FrameContent::Image(self.afar.picture(&picture.into_rgb()).into())
                }
                other => other,
            },
            ..frame
        }))
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::frames::Point;

    use super::*;
    use farfield_sim::embedded;

    #[test]
    fn a_point_of_the_picture_stays_under_the_camera_that_sees_it() {
        let scene = embedded::scene("court").unwrap();
        let camera = &scene.cameras()[0];
        let afar = Afar {
            scale: 0.1,
            size_px: [1920, 1200],
        };
        let [width, height] = camera.size_px();
        let mut picture = RgbImage::new(width, height);
        let p_w = Point::new([0.3, -0.2, 0.9].into());
        let seen = camera.distort(camera.project(p_w).unwrap()).unwrap();
        for (dx, dy) in (-15..=15).flat_map(|x| (-15..=15).map(move |y| (x, y))) {
            let at = [seen.x() as i64 + dx, seen.y() as i64 + dy].map(|v| v as u32);
            picture.put_pixel(at[0], at[1], Rgb([255; 3]));
        }
        let small = afar.picture(&picture);
        let model = afar.camera(camera).unwrap();
        let drawn = model.distort(model.project(p_w).unwrap()).unwrap();
        let at = [drawn.x().round() as u32, drawn.y().round() as u32];
        assert_eq!(small.dimensions(), (1920, 1200));
        assert!(small.get_pixel(at[0], at[1])[0] > 200, "{at:?}");
        assert_eq!(*small.get_pixel(5, 5), GREY);
    }
}
