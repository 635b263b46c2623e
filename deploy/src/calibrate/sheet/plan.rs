//! Plans from above: path, cameras, scale.

use std::fmt::Write as _;

use farfield_calibration::points::{FoundCamera, PointCalibration};

use farfield_proto::court::{Court, PlacedCourt};

use super::escaped;

/// Side of a plan, pixels of the page, and its margin.
const PLAN_PX: f64 = 640.0;
const MARGIN_PX: f64 = 60.0;
/// Limit for the drawn points of the path.
const MAX_DRAWN: usize = 4000;

/// A plan: x to the right, y up, fitted to its content.
pub(super) struct Plan {
    least_m: [f64; 2],
    extent_m: f64,
    height_px: f64,
}

impl Plan {
    /// A plan of all `places_m`; `None` if these are one point.
    pub(super) fn new(places_m: impl IntoIterator<Item = [f64; 2]>) -> Option<Self> {
        let (mut least_m, mut most_m) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let is_number = |at: &[f64; 2]| at.iter().all(|v| v.is_finite());
        for at in places_m.into_iter().filter(is_number) {
            for axis in 0..2 {
                least_m[axis] = least_m[axis].min(at[axis]);
                most_m[axis] = most_m[axis].max(at[axis]);
            }
        }
        let sides_m = [0, 1].map(|axis| most_m[axis] - least_m[axis]);
        let extent_m = sides_m[0].max(sides_m[1]);
        (extent_m.is_finite() && extent_m > 0.0).then(|| Self {
            least_m,
            extent_m,
            height_px: 2.0 * MARGIN_PX + sides_m[1] / extent_m * (PLAN_PX - 2.0 * MARGIN_PX),
        })
    }

    /// Pixels of the page per metre.
    pub(super) fn scale(&self) -> f64 {
        (PLAN_PX - 2.0 * MARGIN_PX) / self.extent_m
    }

    /// The position of a place on the page.
    pub(super) fn px(&self, at_m: [f64; 2]) -> [f64; 2] {
        [
            MARGIN_PX + (at_m[0] - self.least_m[0]) * self.scale(),
            self.height_px - MARGIN_PX - (at_m[1] - self.least_m[1]) * self.scale(),
        ]
    }

    // Writing to a string does not fail.

    pub(super) fn begin(&self, page: &mut String, label: &str) {
        writeln!(
            page,
            "<svg viewBox=\"0 0 {PLAN_PX} {:.0}\" role=\"img\" aria-label=\"{}\">",
            self.height_px,
            escaped(label)
        )
        .ok();
    }

    /// The lines of a court at the origin of the venue.
    pub(super) fn court(&self, page: &mut String, court: Option<&Court>) {
        let Some(court) = court else { return };
        let placed = PlacedCourt {
            court: court.clone(),
            centre_m: [0.0; 2],
            turn_rad: 0.0,
        };
        page.push_str("<g fill=\"none\" stroke=\"currentColor\" stroke-opacity=\".7\">\n");
        for line in &court.lines {
            page.push_str("<polyline points=\"");
            for at_m in placed.points_m(&line.shape) {
                let [x, y] = self.px(at_m);
                write!(page, "{x:.1},{y:.1} ").ok();
            }
            writeln!(page, "\"><title>{}</title></polyline>", escaped(&line.name)).ok();
        }
        page.push_str("</g>\n");
    }

    /// Cameras and scale, and the end of the drawing.
    pub(super) fn end(&self, page: &mut String, cameras: &[FoundCamera]) {
        for camera in cameras {
            let (at, ahead) = seen_from_above(camera);
            if !at.iter().all(|v| v.is_finite()) {
                continue;
            }
            let [x, y] = self.px(at);
            let [to_x, to_y] = [x + 36.0 * ahead[0], y - 36.0 * ahead[1]];
            // Towards the middle, where a name has space.
            let (anchor, aside) = if x > 0.75 * PLAN_PX {
                ("end", -8.0)
            } else {
                ("start", 8.0)
            };
            writeln!(
                page,
                "<line x1=\"{x:.1}\" y1=\"{y:.1}\" x2=\"{to_x:.1}\" y2=\"{to_y:.1}\" stroke=\"currentColor\"/>\
                 <circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#d9822b\" stroke=\"currentColor\"/>\
                 <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"13\" text-anchor=\"{anchor}\" fill=\"currentColor\">{}</text>",
                x + aside,
                y - 8.0,
                escaped(&camera.name)
            )
            .ok();
        }
        let metres = nice_length_m(self.extent_m);
        let [from, to] = [MARGIN_PX, MARGIN_PX + metres * self.scale()];
        writeln!(
            page,
            "<line x1=\"{from}\" y1=\"{y}\" x2=\"{to:.1}\" y2=\"{y}\" stroke=\"currentColor\" stroke-width=\"2\"/>\
             <text x=\"{from}\" y=\"{above}\" font-size=\"13\" fill=\"currentColor\">{metres} m</text>\n</svg>",
            y = self.height_px - 16.0,
            above = self.height_px - 22.0
        )
        .ok();
    }
}

/// Position and direction of the camera from above.
pub(super) fn seen_from_above(camera: &FoundCamera) -> ([f64; 2], [f64; 2]) {
    let at = camera.state.center_w;
    let ahead = camera.state.camera_from_world.inverse() * nalgebra::Vector3::z();
    ([at.x, at.y], [ahead.x, ahead.y])
}

/// Cameras and path from above.
pub(super) fn path(page: &mut String, found: &PointCalibration) {
    let step = found.path.len().div_ceil(MAX_DRAWN).max(1);
    let path = found.path.iter().step_by(step);
    let path: Vec<[f64; 2]> = path
        .map(|it| [it.position_m[0], it.position_m[1]])
        .filter(|at| at.iter().all(|v| v.is_finite()))
        .collect();
    let cameras = found.cameras.iter().map(|camera| seen_from_above(camera).0);
    let field = found.report.field.as_ref();
    let court = field.and_then(|field| field.court.as_ref());
    let corners = court.into_iter().flat_map(|court| {
        let [x, y] = court.size_m.map(|side_m| 0.5 * side_m);
        [[-x, -y], [x, y]]
    });
    let Some(plan) = Plan::new(path.iter().copied().chain(cameras).chain(corners)) else {
        return;
    };
    page.push_str("<h2>From above</h2>\n");
    plan.begin(page, "cameras and path from above");
    plan.court(page, court);
    for at in path {
        let [x, y] = plan.px(at);
        writeln!(
            page,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1\" fill=\"#4c8bf5\"/>"
        )
        .ok();
    }
    plan.end(page, &found.cameras);
}

/// A round length of about a quarter of the extent.
fn nice_length_m(extent_m: f64) -> f64 {
    let lengths = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0];
    let fits = lengths
        .into_iter()
        .rev()
        .find(|length| *length <= 0.4 * extent_m);
    fits.unwrap_or(0.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_is_a_round_length_that_fits() {
        for (extent_m, length_m) in [(24.0, 5.0), (118.0, 20.0), (5.0, 2.0), (0.01, 0.1)] {
            assert!(
                (nice_length_m(extent_m) - length_m).abs() < 1e-12,
                "{extent_m}"
            );
        }
    }

    #[test]
    fn a_court_is_drawn_at_its_place() {
        let court = Court::of("futsal", None).unwrap();
        let plan = Plan::new([[-20.0, -10.0], [20.0, 10.0]]).unwrap();
        let mut page = String::new();
        plan.court(&mut page, Some(&court));
        let [x, y] = plan.px([-20.0, 10.0]);
        assert!(page.contains(&format!("{x:.1},{y:.1} ")), "{page}");
        assert!(page.contains("<title>touchline_north</title>"), "{page}");
        let mut none = String::new();
        plan.court(&mut none, None);
        assert!(none.is_empty());
    }

    #[test]
    fn a_plan_shows_all_places_and_north_is_up() {
        let places = [[-3.0, 2.0], [21.0, 2.0], [5.0, 14.0], [f64::NAN, 0.0]];
        let plan = Plan::new(places).unwrap();
        let [west, east, north] = [plan.px(places[0]), plan.px(places[1]), plan.px(places[2])];
        assert!(east[0] > west[0] && north[1] < west[1]);
        assert!(north[1] >= MARGIN_PX - 1e-9 && east[0] <= PLAN_PX - MARGIN_PX + 1e-9);
        assert!(Plan::new([[1.0, 1.0]]).is_none() && Plan::new([]).is_none());
    }
}
