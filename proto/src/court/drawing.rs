//! Builds a court; every element is repeated on the symmetric sides.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::{CourtLine, CourtMark, LineShape};

/// The two ends, as signs of x, and the two sides, as signs of y.
const ENDS: [(&str, f64); 2] = [("west", -1.0), ("east", 1.0)];
const SIDES: [(&str, f64); 2] = [("north", 1.0), ("south", -1.0)];

/// Marks and lines so far.
pub(super) struct Drawing {
    /// Half the length and half the width.
    pub(super) half_m: [f64; 2],
    marks: Vec<CourtMark>,
    lines: Vec<CourtLine>,
}

impl Drawing {
    pub(super) fn new(size_m: [f64; 2]) -> Self {
        Self {
            half_m: size_m.map(|s| 0.5 * s),
            marks: Vec::new(),
            lines: Vec::new(),
        }
    }

    pub(super) fn finished(self) -> (Vec<CourtMark>, Vec<CourtLine>) {
        (self.marks, self.lines)
    }

    pub(super) fn mark(&mut self, name: impl Into<String>, position_m: [f64; 3]) {
        self.marks.push(CourtMark {
            name: name.into(),
            position_m,
        });
    }

    pub(super) fn segment(&mut self, name: impl Into<String>, from_m: [f64; 2], to_m: [f64; 2]) {
        self.lines.push(CourtLine {
            name: name.into(),
            shape: LineShape::Segment { from_m, to_m },
        });
    }

    pub(super) fn circle(&mut self, name: &str, centre_m: [f64; 2], radius_m: f64) {
        self.lines.push(CourtLine {
            name: name.to_owned(),
            shape: LineShape::Arc {
                centre_m,
                radius_m,
                from_rad: 0.0,
                by_rad: TAU,
            },
        });
    }

    /// Marks `NAME_west` and `NAME_east`, at `x` inside of each end line.
    pub(super) fn mark_at_ends(&mut self, name: &str, inside_m: f64) {
        for (end, sign) in ENDS {
            let x = sign * (self.half_m[0] - inside_m);
            self.mark(format!("{name}_{end}"), [x, 0.0, 0.0]);
        }
    }

    /// Marks `NAME_north_west` and so on, at `x` inside of each end line and `y` to both sides of
    /// the long axis.
    pub(super) fn mark_at_four(&mut self, name: &str, inside_m: f64, y: f64, z: f64) {
        for (side, up) in SIDES {
            for (end, sign) in ENDS {
                let x = sign * (self.half_m[0] - inside_m);
                self.mark(format!("{name}_{side}_{end}"), [x, up * y, z]);
            }
        }
    }

    /// Boundary, halfway line and corners. `side` is the name of the long lines, `end` of the short
    /// ones.
    pub(super) fn boundary(&mut self, side: &str, end: &str) {
        let [x, y] = self.half_m;
        for (name, up) in SIDES {
            self.segment(format!("{side}_{name}"), [-x, up * y], [x, up * y]);
        }
        for (name, sign) in ENDS {
            self.segment(format!("{end}_{name}"), [sign * x, -y], [sign * x, y]);
        }
        self.mark_at_four("corner", 0.0, y, 0.0);
        self.mark("centre", [0.0; 3]);
    }

    /// The line across the middle, and its intersections with the long lines.
    pub(super) fn halfway(&mut self, name: &str, short: &str) {
        let y = self.half_m[1];
        self.segment(name, [0.0, -y], [0.0, y]);
        for (side, up) in SIDES {
            self.mark(format!("{short}_{side}"), [0.0, up * y, 0.0]);
        }
    }

    /// A line parallel to each end line, `inside_m` from it, from -`y` to `y`: `NAME_west`,
    /// `NAME_east`.
    pub(super) fn across_ends(&mut self, name: &str, inside_m: f64, y: f64) {
        for (end, sign) in ENDS {
            let x = sign * (self.half_m[0] - inside_m);
            self.segment(format!("{name}_{end}"), [x, -y], [x, y]);
        }
    }

    /// Lines from each end inward, at `y` on both sides, from `from_m` to `to_m` inside:
    /// `NAME_north_west` and so on.
    pub(super) fn along_ends(&mut self, name: &str, y: f64, from_m: f64, to_m: f64) {
        for (side, up) in SIDES {
            for (end, sign) in ENDS {
                let x = |inside: f64| sign * (self.half_m[0] - inside);
                self.segment(
                    format!("{name}_{side}_{end}"),
                    [x(from_m), up * y],
                    [x(to_m), up * y],
                );
            }
        }
    }

    /// A rectangle at each end: its front, its two sides, and its four corners.
    pub(super) fn area(&mut self, name: &str, depth_m: f64, y: f64) {
        self.across_ends(&format!("{name}_front"), depth_m, y);
        self.along_ends(&format!("{name}_side"), y, 0.0, depth_m);
        self.mark_at_four(&format!("{name}_front"), depth_m, y, 0.0);
        self.mark_at_four(&format!("{name}_back"), 0.0, y, 0.0);
    }

    /// A goal at each end: feet of the posts and lower corners of the crossbar, at their inner
    /// edges.
    pub(super) fn goals(&mut self, width_m: f64, height_m: f64) {
        self.mark_at_four("goal_post_foot", 0.0, 0.5 * width_m, 0.0);
        self.mark_at_four("goal_crossbar", 0.0, 0.5 * width_m, height_m);
    }

    /// Arcs at both ends around (`inside_m`, 0), which open into the court by `half_rad` to either
    /// side of the long axis.
    pub(super) fn arcs_inward(&mut self, name: &str, inside_m: f64, radius_m: f64, half_rad: f64) {
        for (end, sign) in ENDS {
            let centre_m = [sign * (self.half_m[0] - inside_m), 0.0];
            let inward = if sign < 0.0 { 0.0 } else { PI };
            self.lines.push(CourtLine {
                name: format!("{name}_{end}"),
                shape: LineShape::Arc {
                    centre_m,
                    radius_m,
                    from_rad: inward - half_rad,
                    by_rad: 2.0 * half_rad,
                },
            });
        }
    }

    /// Arcs around a point of each end line, `y` to either side, from `start_rad` off the end line
    /// (0: on it, outward) by `by_rad` into the court: `NAME_north_west` and so on.
    pub(super) fn arcs_at_posts(&mut self, name: &str, y: f64, radius_m: f64, start_rad: f64) {
        for (side, up) in SIDES {
            for (end, sign) in ENDS {
                let by = FRAC_PI_2 - start_rad;
                // North-west: from along the end line (90 degrees) to along the court (0).
                let from_rad = match (up > 0.0, sign < 0.0) {
                    (true, true) => 0.0,
                    (true, false) => FRAC_PI_2 + start_rad,
                    (false, true) => -FRAC_PI_2 + start_rad,
                    (false, false) => PI,
                };
                self.lines.push(CourtLine {
                    name: format!("{name}_{side}_{end}"),
                    shape: LineShape::Arc {
                        centre_m: [sign * self.half_m[0], up * y],
                        radius_m,
                        from_rad,
                        by_rad: by,
                    },
                });
            }
        }
    }

    /// Arcs in the four corners, into the court.
    pub(super) fn arcs_in_corners(&mut self, name: &str, radius_m: f64) {
        let [x, y] = self.half_m;
        for (side, up) in SIDES {
            for (end, sign) in ENDS {
                let from_rad = match (up > 0.0, sign < 0.0) {
                    (true, true) => -FRAC_PI_2,
                    (true, false) => PI,
                    (false, true) => 0.0,
                    (false, false) => FRAC_PI_2,
                };
                self.lines.push(CourtLine {
                    name: format!("{name}_{side}_{end}"),
                    shape: LineShape::Arc {
                        centre_m: [sign * x, up * y],
                        radius_m,
                        from_rad,
                        by_rad: FRAC_PI_2,
                    },
                });
            }
        }
    }

    /// Lines from (`x`, both signs) that are parallel to the end lines: across the middle part of
    /// the court.
    pub(super) fn across_at(&mut self, name: &str, x: f64, y: f64) {
        for (end, sign) in ENDS {
            self.segment(format!("{name}_{end}"), [sign * x, -y], [sign * x, y]);
        }
        for (side, up) in SIDES {
            for (end, sign) in ENDS {
                self.mark(format!("{name}_{side}_{end}"), [sign * x, up * y, 0.0]);
            }
        }
    }
}
