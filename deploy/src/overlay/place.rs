//! Draws the geometry of the venue over a camera's image: field, floor, axes of the world, other cameras, and the
//! usable range of a fisheye.

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::{Pixel, Point, World};
use farfield_proto::venue::Venue;
use image::RgbImage;
use nalgebra::{Point3, Vector2, Vector3};

use super::number::draw_number;
use super::{OUTLINE, bone_pixels, draw_line, pixel, stroke_radius_px};

const FLOOR: [u8; 3] = [150, 150, 150];
const FIELD: [u8; 3] = [255, 210, 0];
const CAMERA: [u8; 3] = [255, 60, 220];
const AXES: [[u8; 3]; 3] = [[255, 40, 40], [40, 220, 40], [70, 110, 255]];
const RIM: [u8; 3] = [255, 255, 255];
/// Pieces of the rim of a fisheye's usable range.
const RIM_PIECES: u32 = 180;
/// Height of the drawn field above its floor, metres: the height of people.
const TOP_M: f64 = 2.0;
/// Distance between lines of the floor, metres; the second in wide fields.
const STEPS_M: [f64; 2] = [1.0, 5.0];
/// A field with a longer side counts as wide, metres.
const WIDE_M: f64 = 30.0;
/// Length of the axes, metres.
const AXIS_M: f64 = 1.0;
/// Most lines of the floor along one side.
const MAX_LINES: f64 = 400.0;

/// Draws the geometry as the camera at `index` of `venue` should see it.
pub(crate) fn draw_place(image: &mut RgbImage, venue: &Venue, index: usize) {
    let Some(camera) = venue.cameras.get(index).map(|it| &it.model) else {
        return;
    };
    let radius_px = stroke_radius_px(image);
    let mut lines = Drawn { image, camera };
    draw_floor(&mut lines, venue, 0.4 * radius_px);
    draw_field(&mut lines, venue, 0.8 * radius_px);
    if camera.lens().is_fisheye() {
        draw_rim(&mut lines, 0.6 * radius_px);
    }
    for (axis, colour) in AXES.into_iter().enumerate() {
        let mut tip = Vector3::zeros();
        tip[axis] = AXIS_M;
        lines.line(Vector3::zeros(), tip, 1.8 * radius_px, colour);
    }
    let others = venue
        .cameras
        .iter()
        .enumerate()
        .filter(|(i, _)| *i != index);
    for (i, other) in others {
        let center = other.model.center();
        let Some(at) = pixel(camera, center) else {
            continue;
        };
        draw_line(lines.image, at, at, 3.0 * radius_px, OUTLINE);
        draw_line(lines.image, at, at, 2.4 * radius_px, CAMERA);
        let foot = at - Vector2::new(0.0, 5.0 * radius_px);
        draw_number(lines.image, i as u32 + 1, foot, radius_px, CAMERA);
    }
}

/// Draws lines of the world on the image of a camera.
struct Drawn<'a> {
    image: &'a mut RgbImage,
    camera: &'a CameraModel,
}

impl Drawn<'_> {
    /// Draws a line in world metres in pieces of 1 m, as a lens bends it.
    fn line(&mut self, from: Vector3<f64>, to: Vector3<f64>, radius_px: f64, colour: [u8; 3]) {
        let pieces = (to - from).norm().ceil().clamp(1.0, MAX_LINES);
        let at = |i: f64| -> Point<World> {
            Point::new(Point3::from(from + (to - from) * (i / pieces)))
        };
        let mut i = 0.0;
        while i < pieces {
            let pixels = bone_pixels(self.camera, at(i), at(i + 1.0));
            for piece in pixels.windows(2) {
                if let [Some(a), Some(b)] = *piece {
                    draw_line(self.image, a, b, radius_px, colour);
                }
            }
            i += 1.0;
        }
    }
}

/// Draws the limit of a fisheye's usable range; keypoints beyond it are ignored.
fn draw_rim(lines: &mut Drawn<'_>, radius_px: f64) {
    let camera = lines.camera;
    let k = camera.intrinsics();
    let at = |piece: u32| {
        let (sin, cos) =
            (std::f64::consts::TAU * f64::from(piece) / f64::from(RIM_PIECES)).sin_cos();
        // A point far beyond the rim in this direction.
        let far = Pixel::new(
            k.cx_px + 100.0 * k.fx_px * cos,
            k.cy_px + 100.0 * k.fy_px * sin,
        );
        camera.distort_wide(camera.within_view(far))
    };
    for piece in 0..RIM_PIECES {
        if let (Some(a), Some(b)) = (at(piece), at(piece + 1)) {
            draw_line(lines.image, a.vector_px(), b.vector_px(), radius_px, RIM);
        }
    }
}

fn draw_floor(lines: &mut Drawn<'_>, venue: &Venue, radius_px: f64) {
    let field = &venue.field;
    let (min, max, z) = (field.min_m, field.max_m, field.floor_m);
    let longest_m = (max[0] - min[0]).max(max[1] - min[1]);
    let step_m = STEPS_M[usize::from(longest_m > WIDE_M)].max(longest_m / MAX_LINES);
    for (across, along) in [(0, 1), (1, 0)] {
        // Lines are at multiples of the step, so that the axes are on two of them.
        let mut at_m = (min[across] / step_m).ceil() * step_m;
        while at_m <= max[across] {
            let mut ends = [Vector3::new(0.0, 0.0, z); 2];
            for (end, limit_m) in ends.iter_mut().zip([min[along], max[along]]) {
                end[across] = at_m;
                end[along] = limit_m;
            }
            lines.line(ends[0], ends[1], radius_px, FLOOR);
            at_m += step_m;
        }
    }
}

fn draw_field(lines: &mut Drawn<'_>, venue: &Venue, radius_px: f64) {
    let field = &venue.field;
    let (min, max) = (field.min_m, field.max_m);
    let corner = |i: usize, z: f64| {
        let [x, y] = [
            [min[0], min[1]],
            [max[0], min[1]],
            [max[0], max[1]],
            [min[0], max[1]],
        ][i % 4];
        Vector3::new(x, y, z)
    };
    let (floor_m, top_m) = (field.floor_m, field.floor_m + TOP_M);
    for i in 0..4 {
        for z in [floor_m, top_m] {
            lines.line(corner(i, z), corner(i + 1, z), radius_px, FIELD);
        }
        lines.line(corner(i, floor_m), corner(i, top_m), radius_px, FIELD);
    }
}
