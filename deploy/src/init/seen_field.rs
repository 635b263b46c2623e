//! The default field: the rectangle around the area that two viewpoints see.

use std::collections::BTreeSet;

use farfield_proto::frames::Point;
use farfield_proto::venue::Venue;
use nalgebra::Point3;

/// Sample points along either side.
const SIDE: u32 = 60;
/// Heights of sample points that must be visible, metres above the floor: people from the knees to the shoulders.
const HEIGHTS_M: [f64; 2] = [0.5, 1.4];
/// Sides are rounded to multiples of this, metres.
const ROUND_M: f64 = 0.5;
/// Margin of the field around the visible area, metres: people are seen before they are fully in view.
const MARGIN_M: f64 = 0.5;

/// `X0,Y0,X1,Y1`, metres.
pub(super) fn parse(text: &str) -> Result<[f64; 4], String> {
    let wrong =
        || format!("found `{text}`, expected X0,Y0,X1,Y1 in metres, with X0 < X1 and Y0 < Y1");
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    let sides: [f64; 4] = numbers
        .map_err(|_| wrong())?
        .try_into()
        .map_err(|_| wrong())?;
    let [x0, y0, x1, y1] = sides;
    if x0 < x1 && y0 < y1 {
        Ok(sides)
    } else {
        Err(wrong())
    }
}

/// The rectangle around all points of the field that two viewpoints of `venue` see; `None` if there are none.
pub(super) fn seen(venue: &Venue) -> Option<[f64; 4]> {
    let field = &venue.field;
    let along = |axis: usize, i: u32| {
        let share = (f64::from(i) + 0.5) / f64::from(SIDE);
        field.min_m[axis] + share * (field.max_m[axis] - field.min_m[axis])
    };
    let is_seen = |x_m: f64, y_m: f64| {
        HEIGHTS_M.into_iter().all(|height_m| {
            let p_w = Point::new(Point3::new(x_m, y_m, field.floor_m + height_m));
            let seeing = venue.cameras.iter().filter(|camera| {
                let model = &camera.model;
                model.project(p_w).is_some_and(|px| model.sees(px))
            });
            let viewpoints: BTreeSet<u16> = seeing.map(|camera| camera.viewpoint.0).collect();
            viewpoints.len() >= 2
        })
    };
    let points = (0..SIDE).flat_map(|i| (0..SIDE).map(move |j| (i, j)));
    let seen = points
        .map(|(i, j)| (along(0, i), along(1, j)))
        .filter(|&(x, y)| is_seen(x, y));
    let around = seen.fold(None, |around: Option<[f64; 4]>, (x, y)| {
        let [x0, y0, x1, y1] = around.unwrap_or([x, y, x, y]);
        Some([x0.min(x), y0.min(y), x1.max(x), y1.max(y)])
    });
    let down = |v: f64| (v / ROUND_M).floor() * ROUND_M;
    let up = |v: f64| (v / ROUND_M).ceil() * ROUND_M + 0.0;
    around
        .map(|[x0, y0, x1, y1]| {
            [
                down(x0 - MARGIN_M),
                down(y0 - MARGIN_M),
                up(x1 + MARGIN_M),
                up(y1 + MARGIN_M),
            ]
        })
        .filter(|[x0, y0, x1, y1]| x0 < x1 && y0 < y1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_two_corners() {
        assert_eq!(parse("-6,-4, 6,4"), Ok([-6.0, -4.0, 6.0, 4.0]));
        for text in ["", "1,2,3", "6,4,-6,-4", "a,b,c,d"] {
            assert!(parse(text).is_err(), "{text}");
        }
    }
}
