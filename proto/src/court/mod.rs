//! Courts as defined by the rules of each sport: named marks and lines. They replace measurements
//! of the floor, and the viewer draws them under the people.
//!
//! The origin is the middle of the court on the floor, x along its length, y across it, z up,
//! metres. On a map with x to the right and y up, west is -x, east +x, south -y, north +y. So
//! `corner_north_west` is (-length/2, width/2, 0). The user chooses which end is west, but it must
//! be the same in all cameras.
//!
//! Lines have a width. Their position follows the rules: boundary lines at their outer edge
//! (football, futsal, handball, volleyball, tennis), in basketball at their inner edge. Posts are
//! given by the inner edge of their foot and of the crossbar.

mod drawing;
mod sports;

use std::f64::consts::TAU;

use drawing::Drawing;

use crate::toml_file::unknown_name;

/// A named point of a court.
#[derive(Debug, Clone, PartialEq)]
pub struct CourtMark {
    /// `corner_north_west`, `penalty_spot_east`, ...
    pub name: String,
    /// Metres from the middle of the court.
    pub position_m: [f64; 3],
}

/// The shape of a line on the floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LineShape {
    /// A straight line.
    Segment {
        /// x and y, metres.
        from_m: [f64; 2],
        /// x and y, metres.
        to_m: [f64; 2],
    },
    /// A part of a circle.
    Arc {
        /// x and y, metres.
        centre_m: [f64; 2],
        /// Metres.
        radius_m: f64,
        /// Start angle, from +x towards +y, radians.
        from_rad: f64,
        /// Angle of the arc, towards +y; 2 pi is a circle.
        by_rad: f64,
    },
}

/// A named line of a court.
#[derive(Debug, Clone, PartialEq)]
pub struct CourtLine {
    /// `touchline_north`, `centre_circle`, ...
    pub name: String,
    /// Its geometry.
    pub shape: LineShape,
}

/// The marks and lines of a court.
#[derive(Debug, Clone, PartialEq)]
pub struct Court {
    /// `futsal`, `football`, ...
    pub name: &'static str,
    /// The federation and the part of its rules.
    pub rules: &'static str,
    /// Length and width, metres.
    pub size_m: [f64; 2],
    /// Named points.
    pub marks: Vec<CourtMark>,
    /// Named lines, also for drawing.
    pub lines: Vec<CourtLine>,
}

struct Rules {
    name: &'static str,
    source: &'static str,
    /// Default length and width, and the range that the rules (or common practice) allow.
    usual_m: [f64; 2],
    least_m: [f64; 2],
    most_m: [f64; 2],
    draw: fn(&mut Drawing),
}

const COURTS: [Rules; 6] = [
    Rules {
        name: "basketball",
        source: "FIBA, Official Basketball Rules, article 2",
        usual_m: [28.0, 15.0],
        least_m: [22.0, 13.0],
        most_m: [28.7, 15.3],
        draw: sports::basketball,
    },
    Rules {
        name: "football",
        source: "IFAB, Laws of the Game, law 1",
        usual_m: [105.0, 68.0],
        least_m: [90.0, 45.0],
        most_m: [120.0, 90.0],
        draw: sports::football,
    },
    Rules {
        name: "futsal",
        source: "FIFA, Futsal Laws of the Game, law 1",
        usual_m: [40.0, 20.0],
        least_m: [25.0, 15.0],
        most_m: [42.0, 25.0],
        draw: sports::futsal,
    },
    Rules {
        name: "handball",
        source: "IHF, Rules of the Game: Indoor Handball, rule 1",
        usual_m: [40.0, 20.0],
        least_m: [38.0, 18.0],
        most_m: [44.0, 22.0],
        draw: sports::handball,
    },
    Rules {
        name: "tennis",
        source: "ITF, Rules of Tennis, rule 1",
        usual_m: [23.77, 10.97],
        least_m: [23.77, 10.97],
        most_m: [23.77, 10.97],
        draw: sports::tennis,
    },
    Rules {
        name: "volleyball",
        source: "FIVB, Official Volleyball Rules, rule 1",
        usual_m: [18.0, 9.0],
        least_m: [18.0, 9.0],
        most_m: [18.0, 9.0],
        draw: sports::volleyball,
    },
];

impl Court {
    /// The names of all courts, in alphabetical order.
    pub fn names() -> Vec<&'static str> {
        COURTS.iter().map(|rules| rules.name).collect()
    }

    /// The court `name` with its default size, or with `size_m` (length, width).
    ///
    /// # Errors
    /// A description of an unknown name, or of a size that the rules do not allow.
    pub fn of(name: &str, size_m: Option<[f64; 2]>) -> Result<Self, String> {
        let Some(rules) = COURTS.iter().find(|rules| rules.name == name) else {
            return Err(unknown_name("court", name, &Self::names()));
        };
        let size_m = size_m.unwrap_or(rules.usual_m);
        let fits = |axis: usize| (rules.least_m[axis]..=rules.most_m[axis]).contains(&size_m[axis]);
        if !(fits(0) && fits(1)) {
            let ([a, b], [c, d]) = (rules.least_m, rules.most_m);
            return Err(format!(
                "found a {name} court of {} x {} m, expected {a} to {c} m by {b} to {d} m ({})",
                size_m[0], size_m[1], rules.source
            ));
        }
        let mut drawing = Drawing::new(size_m);
        (rules.draw)(&mut drawing);
        let (marks, lines) = drawing.finished();
        Ok(Self {
            name: rules.name,
            rules: rules.source,
            size_m,
            marks,
            lines,
        })
    }

    /// The mark `name`.
    pub fn mark(&self, name: &str) -> Option<&CourtMark> {
        self.marks.iter().find(|mark| mark.name == name)
    }

    /// The line `name`.
    pub fn line(&self, name: &str) -> Option<&CourtLine> {
        self.lines.iter().find(|line| line.name == name)
    }
}

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
mod tests;
