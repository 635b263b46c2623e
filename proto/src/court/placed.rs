//! A court at its place in a venue, as lines to draw.

use std::f64::consts::TAU;

use super::{Court, LineShape};

/// Straight pieces of a full circle.
const PIECES_OF_CIRCLE: f64 = 72.0;

/// A court at its place on the floor of a venue.
#[derive(Debug, Clone, PartialEq)]
pub struct PlacedCourt {
    /// The court.
    pub court: Court,
    /// Its centre, world x and y, metres.
    pub centre_m: [f64; 2],
    /// Its rotation, from +x towards +y, radians.
    pub turn_rad: f64,
}

impl PlacedCourt {
    /// The points of `shape`, a line of the court, in the world: x and y, metres. Arcs become
    /// straight pieces of 5 degrees.
    pub fn points_m(&self, shape: &LineShape) -> Vec<[f64; 2]> {
        let (sin, cos) = libm::sincos(self.turn_rad);
        let place = |[x, y]: [f64; 2]| {
            [
                self.centre_m[0] + cos * x - sin * y,
                self.centre_m[1] + sin * x + cos * y,
            ]
        };
        match *shape {
            LineShape::Segment { from_m, to_m } => vec![place(from_m), place(to_m)],
            LineShape::Arc {
                centre_m,
                radius_m,
                from_rad,
                by_rad,
            } => {
                let pieces = (by_rad.abs() / TAU * PIECES_OF_CIRCLE).ceil();
                let pieces = pieces.clamp(1.0, PIECES_OF_CIRCLE) as u32;
                let at = |piece: u32| {
                    let turn = from_rad + by_rad * f64::from(piece) / f64::from(pieces);
                    let (sin, cos) = libm::sincos(turn);
                    place([centre_m[0] + radius_m * cos, centre_m[1] + radius_m * sin])
                };
                (0..=pieces).map(at).collect()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use super::*;

    fn futsal(centre_m: [f64; 2], turn_rad: f64) -> PlacedCourt {
        PlacedCourt {
            court: Court::of("futsal", None).unwrap(),
            centre_m,
            turn_rad,
        }
    }

    fn points(placed: &PlacedCourt, line: &str) -> Vec<[f64; 2]> {
        placed.points_m(&placed.court.line(line).unwrap().shape)
    }

    #[test]
    fn a_court_lies_about_its_middle_along_x_or_turned() {
        let near = |a: &[[f64; 2]], b: [[f64; 2]; 2]| {
            let far = a.iter().flatten().zip(b.as_flattened());
            far.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-12
        };
        let straight = points(&futsal([1.0, 2.0], 0.0), "touchline_north");
        assert!(
            near(&straight, [[-19.0, 12.0], [21.0, 12.0]]),
            "{straight:?}"
        );
        let turned = points(&futsal([1.0, 2.0], FRAC_PI_2), "touchline_north");
        assert!(near(&turned, [[-9.0, -18.0], [-9.0, 22.0]]), "{turned:?}");
    }

    #[test]
    fn arcs_are_drawn_on_their_circle_from_end_to_end() {
        let circle = points(&futsal([0.0; 2], 0.3), "centre_circle");
        assert_eq!(circle.len(), 73);
        for [x, y] in &circle {
            assert!((libm::hypot(*x, *y) - 3.0).abs() < 1e-12);
        }
        let quarter = points(&futsal([0.0; 2], 0.0), "penalty_area_arc_north_west");
        assert_eq!(quarter.len(), 19);
        let (first, last) = (quarter[0], quarter[18]);
        assert!((first[0] + 14.0).abs() < 1e-9, "{first:?}");
        assert!((last[0] + 20.0).abs() < 1e-9, "{last:?}");
    }
}
