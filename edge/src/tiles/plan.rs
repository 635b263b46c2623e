//! The parts of each camera's picture on which the detector runs, by detection pass.
//!
//! If a pass would need too many tiles, they are spread over several passes. For that the field is
//! divided into cells, not the pictures: a track starts only from two viewpoints at one tick, so
//! all edges must cover the same cell at the same ticks. Every edge computes the same plan for all
//! cameras of the venue, so edges need not communicate.

use farfield_proto::camera::CameraModel;
use farfield_proto::venue::Field;

use super::TALL_ENOUGH_PX;
use super::standing::{Standing, StandingAt, on_floor, under_picture};
use crate::inference::{DetectorInput, DetectorWindow};

/// Finest scale of a tile, input pixels per pixel of the picture; enlarging adds no detail.
pub(super) const MAX_SCALE: f64 = 1.0;

/// Ratio of successive scales: a person is 48 to 96 pixels tall in the first scale that is fine
/// enough.
const SCALE_STEP: f64 = 2.0;
/// Factor on the computed size of people, because only a grid of places is evaluated.
const SIZE_SLACK: f64 = 0.9;
/// Factor on their boxes for the same reason.
const BOX_SLACK: f64 = 1.04;
/// Most cells of the field. A cell that still needs more tiles than a pass allows gets them.
const MAX_CELLS: usize = 256;
/// Most tiles of one camera in one pass: the maximum of `births.tiles_per_look`.
const MAX_TILES: usize = 256;
/// Least side of a detector's input for tiles, pixels. People are up to 96 pixels tall in the first
/// scale that is fine enough, and with their surroundings do not fit smaller inputs.
const MIN_INPUT_PX: u32 = 128;

/// The windows of the pictures of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct TilePlan {
    /// The whole picture, in every pass.
    pub whole: DetectorWindow,
    /// The tiles of each cell of the field.
    pub cells: Vec<Vec<DetectorWindow>>,
}

impl TilePlan {
    /// The windows of detection pass `pass`: each pass covers the next cell.
    pub fn windows(&self, pass: i64) -> impl Iterator<Item = DetectorWindow> + '_ {
        let turn = i64::try_from(self.cells.len().max(1)).unwrap_or(i64::MAX);
        let cell = pass.rem_euclid(turn) as usize;
        let tiles = self.cells.get(cell).into_iter().flatten();
        std::iter::once(self.whole).chain(tiles.copied())
    }

    /// The number of windows in the largest pass.
    pub(super) fn most_windows(&self) -> usize {
        1 + self.cells.iter().map(Vec::len).max().unwrap_or(0)
    }
}

/// Plans the windows of `cameras`, in their order. A person of 1.7 m standing anywhere in the
/// `field` is complete in a window that shows the person at least [`TALL_ENOUGH_PX`] tall or has
/// the picture's full resolution. This holds as far as the picture contains the person. Seen from
/// above, a person counts as at least a quarter of that height: the width of the shoulders.
///
/// With 0 `tiles_per_pass`, or an input with a side below 128 pixels, there are only the whole
/// pictures. Otherwise the field is divided into the fewest cells (a power of two, at most 256)
/// with at most `tiles_per_pass` tiles per camera and pass. All plans have the same number of
/// cells. If a 256th of the field still needs more than 256 tiles of a camera, it gets the 256
/// coarsest, and distant people may be missed.
///
/// Cost: some milliseconds per camera and doubling of the cells.
pub fn plan(
    cameras: &[&CameraModel],
    field: &Field,
    input: DetectorInput,
    tiles_per_pass: usize,
) -> Vec<TilePlan> {
    let tiles_per_pass = match input.size_px.iter().min() {
        Some(&least) if least >= MIN_INPUT_PX => tiles_per_pass.min(MAX_TILES),
        _ => 0,
    };
    let floor_m = field.floor_m;
    let under: Vec<Vec<StandingAt>> = cameras
        .iter()
        .map(|camera| under_picture(camera, floor_m))
        .collect();
    let mut count = 1;
    loop {
        let cells = match tiles_per_pass {
            0 => Vec::new(),
            _ => cells(field, count),
        };
        let mut plans: Vec<TilePlan> = cameras
            .iter()
            .zip(&under)
            .map(|(camera, under)| plan_in_cells(camera, under, &cells, floor_m, input))
            .collect();
        let fits = plans.iter().all(|p| p.most_windows() <= 1 + tiles_per_pass);
        if fits || count >= MAX_CELLS {
            let cells = plans.iter_mut().flat_map(|plan| &mut plan.cells);
            cells.for_each(|tiles| tiles.truncate(MAX_TILES));
            return plans;
        }
        count *= 2;
    }
}

fn plan_in_cells(
    camera: &CameraModel,
    under: &[StandingAt],
    cells: &[Cell],
    floor_m: f64,
    input: DetectorInput,
) -> TilePlan {
    let whole = DetectorWindow::whole(camera.size_px(), input.size_px, input.letterbox);
    let tiles_of = |cell: &Cell| {
        let under = under.iter().filter(|(at_m, _)| cell.holds(*at_m));
        let people: Vec<Standing> = on_floor(camera, cell, cells.len(), floor_m)
            .chain(under.map(|(_, person)| *person))
            .collect();
        tiles_for(&people, camera.size_px(), &whole, input.size_px)
    };
    TilePlan {
        whole,
        cells: cells.iter().map(tiles_of).collect(),
    }
}

/// The tiles for `people`, scale by scale, the coarsest first; no further scale after
/// [`MAX_TILES`].
fn tiles_for(
    people: &[Standing],
    picture_px: [u32; 2],
    whole: &DetectorWindow,
    input_px: [u32; 2],
) -> Vec<DetectorWindow> {
    let coarsest = whole.scale(input_px);
    let needed = |p: &Standing| (TALL_ENOUGH_PX / (SIZE_SLACK * p.long_px)).min(MAX_SCALE);
    let finest = people.iter().map(needed).fold(0.0, f64::max);
    let mut tiles = Vec::new();
    let mut scale = coarsest;
    while scale < finest && tiles.len() <= MAX_TILES {
        let coarser = scale;
        scale = (scale * SCALE_STEP).min(finest);
        let here: Vec<&Standing> = people
            .iter()
            .filter(|p| needed(p) > coarser && needed(p) <= scale)
            .collect();
        tiles.extend(grid(
            &here,
            picture_px,
            input_px.map(|side| f64::from(side) / scale),
        ));
    }
    tiles
}

/// Windows of `size_px` over all `people`, overlapping by the largest person. Empty windows are
/// left out; there is at most one more than [`MAX_TILES`].
fn grid(people: &[&Standing], picture_px: [u32; 2], size_px: [f64; 2]) -> Vec<DetectorWindow> {
    let picture = picture_px.map(f64::from);
    let longest = |p: &&Standing| {
        let [l, t, r, b] = p.around_px;
        (r - l).max(b - t)
    };
    let overlap_px = BOX_SLACK * people.iter().map(longest).fold(0.0, f64::max);
    let cut = |p: &&Standing| -> [f64; 4] {
        // A person between two evaluated places.
        let more = 0.5 * overlap_px;
        let [l, t, r, b] = p.around_px;
        [
            (l - more).max(0.0),
            (t - more).max(0.0),
            (r + more).min(picture[0]),
            (b + more).min(picture[1]),
        ]
    };
    let boxes: Vec<[f64; 4]> = people.iter().map(cut).collect();
    let Some(region) = boxes.iter().copied().reduce(|a, b| {
        [
            a[0].min(b[0]),
            a[1].min(b[1]),
            a[2].max(b[2]),
            a[3].max(b[3]),
        ]
    }) else {
        return Vec::new();
    };
    let starts = [0, 1].map(|i| {
        starts(
            [region[i], region[i + 2]],
            size_px[i],
            overlap_px,
            picture[i],
        )
    });
    let rows = starts[1].iter();
    let all = rows.flat_map(|&top| {
        starts[0].iter().map(move |&left| DetectorWindow {
            min_px: [left, top],
            size_px,
        })
    });
    let touches = |window: &DetectorWindow, [l, t, r, b]: &[f64; 4]| {
        let ([left, top], [right, bottom]) = (window.min_px, window.max_px());
        *l < right && *r > left && *t < bottom && *b > top
    };
    all.filter(|window| boxes.iter().any(|b| touches(window, b)))
        .take(MAX_TILES + 1)
        .collect()
}

/// Starts of windows of `size` that cover `from..to` in a picture of `picture` pixels, with an
/// overlap of at least `overlap`.
fn starts([from, to]: [f64; 2], size: f64, overlap: f64, picture: f64) -> Vec<f64> {
    let length = to - from;
    // Inside the picture if it is large enough.
    let inside = |start: f64| start.min(picture - size).max(0.0);
    if length <= size {
        return vec![inside((from + to - size) / 2.0)];
    }
    // A window moves by at least a quarter.
    let step = (size - overlap).max(size / 4.0);
    let count = ((length - size) / step).ceil() as usize + 1;
    let even = (length - size) / (count - 1).max(1) as f64;
    (0..count).map(|i| inside(from + i as f64 * even)).collect()
}

/// A part of the field's floor, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Cell {
    pub(super) min_m: [f64; 2],
    pub(super) max_m: [f64; 2],
}

impl Cell {
    /// The point at `share` (0 to 1) of both sides.
    pub(super) fn at(&self, share: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|i| self.min_m[i] + share[i] * (self.max_m[i] - self.min_m[i]))
    }

    pub(super) fn holds(&self, at_m: [f64; 2]) -> bool {
        (0..2).all(|i| at_m[i] >= self.min_m[i] && at_m[i] <= self.max_m[i])
    }
}

/// The field in `count` cells, a power of two: halved repeatedly along the longer side.
fn cells(field: &Field, count: usize) -> Vec<Cell> {
    let whole = Cell {
        min_m: [field.min_m[0], field.min_m[1]],
        max_m: [field.max_m[0], field.max_m[1]],
    };
    let mut cells = vec![whole];
    while cells.len() < count {
        cells = cells.into_iter().flat_map(halves).collect();
    }
    cells
}

fn halves(cell: Cell) -> [Cell; 2] {
    let side = |i: usize| cell.max_m[i] - cell.min_m[i];
    let along = usize::from(side(1) > side(0));
    let middle = cell.min_m[along] + side(along) / 2.0;
    let (mut first, mut second) = (cell, cell);
    first.max_m[along] = middle;
    second.min_m[along] = middle;
    [first, second]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_divide_the_field_along_its_longer_side() {
        let field = Field {
            min_m: [-10.0, -4.0, 0.0],
            max_m: [10.0, 4.0, 2.5],
            floor_m: 0.0,
        };
        assert_eq!(cells(&field, 1).len(), 1);
        let four = cells(&field, 4);
        assert_eq!(four.len(), 4);
        assert_eq!((four[0].min_m, four[0].max_m), ([-10.0, -4.0], [-5.0, 4.0]));
        assert_eq!((four[3].min_m, four[3].max_m), ([5.0, -4.0], [10.0, 4.0]));
        let area = |c: &Cell| (c.max_m[0] - c.min_m[0]) * (c.max_m[1] - c.min_m[1]);
        let sum: f64 = cells(&field, 16).iter().map(area).sum();
        assert!((sum - 160.0).abs() < 1e-9);
    }
}
