//! Corners to a few hundredths of a pixel: the point that all gradients around it are at right angles to (Foerstner and Guelch
//! 1987; `OpenCV`'s `cornerSubPix` is the same).

use nalgebra::{Matrix2, Vector2};

use super::picture::GrayPicture;

/// Rounds at most.
const MOST_ROUNDS: usize = 20;
/// A round that moves less ends it, pixels.
const STILL_PX: f64 = 1e-3;
/// Half the window's side, pixels: fewer have too few gradients, more bend with the lens.
const WINDOW_PX: [f64; 2] = [2.0, 10.0];

/// `start` moved to the corner of the picture near it; left where it is where there is none within half the window.
/// `reach_px` is how far around the corner there is nothing but its four squares.
pub(super) fn refined(
    picture: &GrayPicture<'_>,
    start: Vector2<f64>,
    reach_px: f64,
) -> Vector2<f64> {
    let half = reach_px.clamp(WINDOW_PX[0], WINDOW_PX[1]).floor();
    let mut at = start;
    for _ in 0..MOST_ROUNDS {
        let Some(next) = round(picture, at, half) else {
            return start;
        };
        let step = (next - at).norm();
        at = next;
        if (at - start).norm() > 0.5 * half + 1.0 {
            return start;
        }
        if step < STILL_PX {
            break;
        }
    }
    at
}

/// Least squares of g . (p - corner) = 0 over the window around `at`, weighed by a bell.
fn round(picture: &GrayPicture<'_>, at: Vector2<f64>, half: f64) -> Option<Vector2<f64>> {
    let side = half as i32;
    let mut matrix = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for (dy, dx) in (-side..=side).flat_map(|dy| (-side..=side).map(move |dx| (dy, dx))) {
        let offset = Vector2::new(f64::from(dx), f64::from(dy));
        let p = at + offset;
        let value = |dx: f64, dy: f64| bilinear(picture, p.x + dx, p.y + dy);
        let gradient = Vector2::new(
            value(1.0, 0.0)? - value(-1.0, 0.0)?,
            value(0.0, 1.0)? - value(0.0, -1.0)?,
        );
        let weight = libm::exp(-offset.norm_squared() / (half * half));
        let outer = weight * gradient * gradient.transpose();
        matrix += outer;
        right += outer * offset;
    }
    // An edge alone fixes one direction only.
    let eigenvalues = matrix.symmetric_eigenvalues();
    if eigenvalues.min() < 0.02 * eigenvalues.max() {
        return None;
    }
    Some(at + matrix.cholesky()?.solve(&right))
}

fn bilinear(picture: &GrayPicture<'_>, x: f64, y: f64) -> Option<f64> {
    let (left, top) = (x.floor(), y.floor());
    let inside = left >= 0.0
        && top >= 0.0
        && left + 1.0 < f64::from(picture.width)
        && top + 1.0 < f64::from(picture.height);
    if !inside {
        return None;
    }
    let first = top as usize * picture.width as usize + left as usize;
    let at = |offset: usize| picture.pixels.get(first + offset).map(|v| f64::from(*v));
    let below = picture.width as usize;
    let (fx, fy) = (x - left, y - top);
    let upper = at(0)? * (1.0 - fx) + at(1)? * fx;
    let lower = at(below)? * (1.0 - fx) + at(below + 1)? * fx;
    Some(upper * (1.0 - fy) + lower * fy)
}
