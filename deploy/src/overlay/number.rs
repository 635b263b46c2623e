//! Numbers of seven segments, for ids: no font is needed.

use image::RgbImage;
use nalgebra::Vector2;

use super::{OUTLINE, draw_line};

/// Height of a digit relative to half the width of its strokes.
const HEIGHT_STROKES: f64 = 7.0;
/// Width of a digit relative to its height, and of the gap to the next.
const WIDTH: f64 = 0.5;
const GAP: f64 = 0.35;

/// Ends of the segments, in widths right and half heights down: top, upper right, lower right, bottom, lower left,
/// upper left, middle.
const SEGMENTS: [[[f64; 2]; 2]; 7] = [
    [[0.0, 0.0], [1.0, 0.0]],
    [[1.0, 0.0], [1.0, 1.0]],
    [[1.0, 1.0], [1.0, 2.0]],
    [[0.0, 2.0], [1.0, 2.0]],
    [[0.0, 1.0], [0.0, 2.0]],
    [[0.0, 0.0], [0.0, 1.0]],
    [[0.0, 1.0], [1.0, 1.0]],
];

/// Segments of each digit, the first in the lowest bit.
const DIGITS: [u8; 10] = [0x3f, 0x06, 0x5b, 0x4f, 0x66, 0x6d, 0x7d, 0x07, 0x7f, 0x6f];

/// Draws `number` with the middle of its foot at `foot`, in strokes of half width `radius_px`.
pub(super) fn draw_number(
    image: &mut RgbImage,
    number: u32,
    foot: Vector2<f64>,
    radius_px: f64,
    colour: [u8; 3],
) {
    let text = number.to_string();
    let height_px = HEIGHT_STROKES * radius_px;
    let step_px = (WIDTH + GAP) * height_px;
    let width_px = step_px * text.len() as f64 - GAP * height_px;
    let corner = foot - Vector2::new(0.5 * width_px, height_px);
    let place = |column: usize, [x, y]: [f64; 2]| {
        let right = step_px * column as f64 + x * WIDTH * height_px;
        corner + Vector2::new(right, 0.5 * y * height_px)
    };
    let digits = text.bytes().map(|byte| usize::from(byte - b'0'));
    let lines: Vec<_> = digits
        .enumerate()
        .flat_map(|(column, digit)| {
            let on = move |segment: &usize| DIGITS[digit] >> segment & 1 == 1;
            (0..SEGMENTS.len()).filter(on).map(move |segment| {
                let [from, to] = SEGMENTS[segment];
                (place(column, from), place(column, to))
            })
        })
        .collect();
    for (radius_px, colour) in [(radius_px + 1.0, OUTLINE), (0.7 * radius_px, colour)] {
        for &(from, to) in &lines {
            draw_line(image, from, to, radius_px, colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHITE: [u8; 3] = [255; 3];

    fn drawn(number: u32) -> RgbImage {
        let mut image = RgbImage::from_pixel(90, 40, image::Rgb([90; 3]));
        draw_number(&mut image, number, Vector2::new(45.0, 35.0), 4.0, WHITE);
        image
    }

    #[test]
    fn all_digits_look_different() {
        for a in 0..10 {
            assert!((0..a).all(|b| drawn(a) != drawn(b)), "{a}");
        }
    }

    #[test]
    fn a_number_is_centred_on_its_foot() {
        for number in [8, 88] {
            let image = drawn(number);
            let touched = |&(x, y): &(u32, u32)| image.get_pixel(x, y).0 != [90; 3];
            let all = (0..90).flat_map(|x| (0..40).map(move |y| (x, y)));
            let (columns, rows): (Vec<u32>, Vec<u32>) = all.filter(touched).unzip();
            let (left, right) = (columns.iter().min().unwrap(), columns.iter().max().unwrap());
            assert!((left + right).abs_diff(90) <= 2, "{left} to {right}");
            assert!(rows.iter().max().unwrap().abs_diff(39) <= 1);
        }
    }
}
