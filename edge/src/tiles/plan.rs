//! Which parts of each camera's picture the detector runs on, and in which detection pass.
//!
//! Where a pass would need more tiles than it may have, they are spread over several passes. For that the field is cut
//! into cells, not the pictures: all edges cover the same cell of the field at the same ticks, because a track is only
//! initiated from two viewpoints at one tick. Every edge computes the same plan for all cameras of the venue, so
//! nothing has to be agreed on.

use farfield_proto::camera::CameraModel;
use farfield_proto::venue::Field;

use super::TALL_ENOUGH_PX;
use super::cells::{Cell, cells};
use super::standing::{Standing, StandingAt, on_floor, under_picture};
use crate::inference::{DetectorInput, DetectorWindow};

/// Finest scale of a tile, input pixels per pixel of the picture: beyond it enlarging adds no detail.
pub(super) const FINEST_SCALE: f64 = 1.0;

/// How much finer a scale is than the one before: a person is 48 to 96 pixels tall in the first that
/// shows them well enough.
const SCALE_STEP: f64 = 2.0;
/// People are planned for as smaller than computed by this factor: only a grid of places is tried, and people stand
/// between them.
const SLACK: f64 = 0.9;
/// And their boxes as larger by this factor, for the same reason.
const LARGER: f64 = 1.04;
/// Cells of the field at most. Where a cell still needs more tiles than a pass may have, it gets them.
const MOST_CELLS: usize = 256;
/// Tiles of one camera in one pass at most, as many as `births.tiles_per_look` may ask for.
const MOST_TILES: usize = 256;
/// Least side of a detector's input for tiles to be of use, pixels: people are up to 96 pixels tall in the first scale
/// that is fine enough, and with their surroundings do not fit into less.
const LEAST_INPUT_PX: u32 = 128;

/// The windows of the pictures of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct TilePlan {
    /// The whole picture, in every pass.
    pub whole: DetectorWindow,
    /// The tiles of each cell of the field.
    pub cells: Vec<Vec<DetectorWindow>>,
}

impl TilePlan {
    /// The windows of detection pass number `pass`: each pass covers the next cell.
    pub fn windows(&self, pass: i64) -> impl Iterator<Item = DetectorWindow> + '_ {
        let turn = i64::try_from(self.cells.len().max(1)).unwrap_or(i64::MAX);
        let cell = pass.rem_euclid(turn) as usize;
        let tiles = self.cells.get(cell).into_iter().flatten();
        std::iter::once(self.whole).chain(tiles.copied())
    }

    /// Windows of the pass that has most of them.
    pub(super) fn most_windows(&self) -> usize {
        1 + self.cells.iter().map(Vec::len).max().unwrap_or(0)
    }
}

/// Plans for `cameras`, in their order: a person of 1.7 m standing anywhere in the `field` is whole in some window in
/// which they are at least [`TALL_ENOUGH_PX`] tall, or which has the picture's full resolution, as far as the picture
/// itself holds them whole. Seen from above, a person counts as at least a quarter of that height: the breadth of the
/// shoulders.
///
/// With 0 `tiles_per_pass`, or an input of less than 128 pixels a side, there are no tiles, only the whole pictures.
/// Else the field is cut into as few cells (a power of two, at most 256) as leave each camera at most `tiles_per_pass`
/// tiles a pass. All plans have the same number of cells. Where a 256th of the field would still need more than 256
/// tiles of a camera, it gets the 256 coarsest, and people far away may be missed.
///
/// Cost: some milliseconds per camera and doubling of the cells.
pub fn plan(
    cameras: &[&CameraModel],
    field: &Field,
    input: DetectorInput,
    tiles_per_pass: usize,
) -> Vec<TilePlan> {
    let tiles_per_pass = match input.size_px.iter().min() {
        Some(&least) if least >= LEAST_INPUT_PX => tiles_per_pass.min(MOST_TILES),
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
        if fits || count >= MOST_CELLS {
            let cells = plans.iter_mut().flat_map(|plan| &mut plan.cells);
            cells.for_each(|tiles| tiles.truncate(MOST_TILES));
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

/// The tiles for `people`, scale by scale, the coarsest first; no further scale beyond [`MOST_TILES`].
fn tiles_for(
    people: &[Standing],
    picture_px: [u32; 2],
    whole: &DetectorWindow,
    input_px: [u32; 2],
) -> Vec<DetectorWindow> {
    let coarsest = whole.scale(input_px);
    let needed = |p: &Standing| (TALL_ENOUGH_PX / (SLACK * p.long_px)).min(FINEST_SCALE);
    let finest = people.iter().map(needed).fold(0.0, f64::max);
    let mut tiles = Vec::new();
    let mut scale = coarsest;
    while scale < finest && tiles.len() <= MOST_TILES {
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

/// Windows of `size_px` over all of `people`, overlapping by the largest of them; without those that
/// hold nobody, and one more than [`MOST_TILES`] at most.
fn grid(people: &[&Standing], picture_px: [u32; 2], size_px: [f64; 2]) -> Vec<DetectorWindow> {
    let picture = picture_px.map(f64::from);
    let longest = |p: &&Standing| {
        let [l, t, r, b] = p.around_px;
        (r - l).max(b - t)
    };
    let overlap_px = LARGER * people.iter().map(longest).fold(0.0, f64::max);
    let cut = |p: &&Standing| -> [f64; 4] {
        // A neighbour between two that were tried.
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
        .take(MOST_TILES + 1)
        .collect()
}

/// Where windows of `size` start to cover `from..to` of a picture of `picture` pixels, each over the
/// last by at least `overlap`.
fn starts([from, to]: [f64; 2], size: f64, overlap: f64, picture: f64) -> Vec<f64> {
    let length = to - from;
    // Inside the picture, as far as it is large enough.
    let inside = |start: f64| start.min(picture - size).max(0.0);
    if length <= size {
        return vec![inside((from + to - size) / 2.0)];
    }
    // A window that hardly moves on still moves on by a quarter.
    let step = (size - overlap).max(size / 4.0);
    let count = ((length - size) / step).ceil() as usize + 1;
    let even = (length - size) / (count - 1).max(1) as f64;
    (0..count).map(|i| inside(from + i as f64 * even)).collect()
}
