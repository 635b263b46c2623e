//! What of a picture may be the thing: blobs of a credible size that are round.

use nalgebra::Vector2;

use super::blobs::{Blob, Blobs};
use super::chart::{BallLens, Chart};
use super::outline::{Seed, covered_middle, outline, rays};
use super::picture::Picture;
use super::round::fit;

/// Diameter below which the middle is taken from what covers each pixel, pixels.
pub const SMALLEST_OUTLINE_PX: f64 = 7.0;
/// Most blobs of a picture whose outline is looked for.
const MOST_BLOBS: usize = 24;
/// Area of a blob over that of a disc: a part may be hidden, and it may be smeared.
const LEAST_AREA: f64 = 0.3;
const MOST_AREA: f64 = 2.0;
/// Greater over lesser side of a blob's box.
const MOST_ASPECT: f64 = 2.5;
/// Least share of the outline that is on the circle, of all the rays.
const LEAST_SHARE: f64 = 0.5;
/// Share of the found disc that the blob must cover, and of the blob that may lie outside of it.
const LEAST_COVER: f64 = 0.4;
const MOST_OUTSIDE: f64 = 0.25;
/// A blob is a speck where another of so many times its area is within this share of that one's size.
const SPECK_TIMES: f64 = 5.0;
const SPECK_REACH: f64 = 0.3;
/// How much farther off the centre is than the noise of independent rays, and of independent pixels, would have it: neighbours share
/// pixels, and a background goes together. Measured on drawn balls (`tests/centre.rs`).
const OUTLINE_SIGMAS: f64 = 1.4;
const COVER_SIGMAS: f64 = 3.5;
/// Looks at an outline: the later ones from the middle that was found, so that what was hidden at first is looked for where it is.
const LOOKS: usize = 3;
/// What a blob without an outline counts, which may be anything small.
const SMALL_SCORE: f64 = 0.8;

/// One candidate of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Pixels of the whole picture.
    pub(super) px: [f64; 2],
    pub(super) diameter_px: f64,
    pub(super) sigma_px: f64,
    /// 0 to 1: how much of it is as a ball is.
    pub(super) score: f64,
    pub(super) colour: [f64; 3],
}

/// Room that is used again from picture to picture.
#[derive(Debug, Clone, Default)]
pub(super) struct Room {
    chosen: Vec<(f64, Blob)>,
    rim_px: Vec<[f64; 2]>,
    rim: Vec<Vector2<f64>>,
}

/// The candidates among `blobs`, into `found`.
pub(super) fn candidates(
    picture: &Picture<'_>,
    blobs: &mut Blobs,
    diameter_px: [f64; 2],
    lens: Option<&BallLens>,
    room: &mut Room,
    found: &mut Vec<Candidate>,
) {
    let quarter = std::f64::consts::FRAC_PI_4;
    let [least, most] = diameter_px.map(|d| quarter * d * d);
    room.chosen.clear();
    for blob in blobs.blobs() {
        let [width, height] = blob.size_px();
        let aspect = (width / height).max(height / width);
        // Pixels at the rim may be missing: those of the smallest are all rim.
        let least = (LEAST_AREA * least)
            .min(least - 2.0 * diameter_px[0])
            .max(1.0);
        let is_credible = (least..=MOST_AREA * most).contains(&blob.area_px)
            && (aspect <= MOST_ASPECT || width.max(height) <= 4.0)
            && width.max(height) <= 1.7 * diameter_px[1] + 3.0;
        if is_credible {
            let off_round =
                (blob.area_px / (width * height) - quarter).abs() + 0.3 * (aspect - 1.0);
            room.chosen.push((off_round, *blob));
        }
    }
    room.chosen
        .sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.root.cmp(&b.1.root)));
    room.chosen.truncate(MOST_BLOBS);
    let chosen = std::mem::take(&mut room.chosen);
    for (_, blob) in &chosen {
        if is_speck(blobs, blob) {
            continue;
        }
        let candidate = candidate(picture, blobs, blob, lens, room);
        let [least, most] = diameter_px;
        found.extend(candidate.filter(|it| (0.8 * least..=1.25 * most).contains(&it.diameter_px)));
    }
    room.chosen = chosen;
}

/// Whether a blob is a speck at the rim of a larger one: a smeared ball and a shirt have many.
fn is_speck(blobs: &Blobs, blob: &Blob) -> bool {
    let [x, y] = blob.middle_px();
    let is_beside = |middle: f64, [first, last]: [u32; 2]| {
        let (first, last) = (f64::from(first), f64::from(last));
        let margin = SPECK_REACH * (last - first) + 2.0;
        (first - margin..=last + margin).contains(&middle)
    };
    blobs.all().iter().any(|other| {
        other.area_px > SPECK_TIMES * blob.area_px
            && is_beside(x, other.columns)
            && is_beside(y, other.rows)
    })
}

fn candidate(
    picture: &Picture<'_>,
    blobs: &Blobs,
    blob: &Blob,
    lens: Option<&BallLens>,
    room: &mut Room,
) -> Option<Candidate> {
    let [width, height] = blob.size_px();
    let seed = Seed {
        middle_px: blob.middle_px(),
        // The mask leaves out pixels that are covered in part.
        radius_px: (0.25 * (width + height)).max((blob.area_px / std::f64::consts::PI).sqrt()),
        colour: inner_colour(picture, blobs, blob)?,
    };
    if 2.0 * seed.radius_px < SMALLEST_OUTLINE_PX {
        return small(picture, &seed, [width, height], lens);
    }
    let mut looked = seed;
    let mut last = None;
    for round in 0..LOOKS {
        let known_px = (round > 0).then_some(looked.radius_px);
        outline(picture, &looked, known_px, &mut room.rim_px);
        let chart = Chart::about(lens, in_whole(picture, looked.middle_px));
        room.rim.clear();
        let rim = room
            .rim_px
            .iter()
            .filter_map(|px| chart.on_plane(in_whole(picture, *px)));
        room.rim.extend(rim);
        let fitted = fit(&room.rim)?;
        let (px, diameter) = chart.ball(fitted.centre, fitted.radius)?;
        let scale = chart.scale(fitted.centre);
        looked.middle_px = in_part(picture, px);
        looked.radius_px = fitted.radius * scale;
        if !(0.4 * seed.radius_px..=2.0 * seed.radius_px + 2.0).contains(&looked.radius_px) {
            return None;
        }
        last = Some((px, diameter, scale, fitted));
    }
    let (px, diameter_px, scale, fitted) = last?;
    let radius_px = fitted.radius * scale;
    let share = fitted.share * room.rim.len() as f64 / rays(radius_px) as f64;
    let (cover, outside) = overlap(
        blobs,
        blob,
        in_part(picture, px),
        radius_px / fitted.axes_ratio.sqrt(),
    );
    let is_ball = share >= LEAST_SHARE && cover >= LEAST_COVER && outside <= MOST_OUTSIDE;
    is_ball.then(|| Candidate {
        px,
        diameter_px,
        sigma_px: OUTLINE_SIGMAS * fitted.sigma * scale,
        score: share.min(1.0) * fitted.axes_ratio * fitted.axes_ratio * (1.0 - outside),
        colour: seed.colour,
    })
}

/// A candidate without an outline.
fn small(
    picture: &Picture<'_>,
    seed: &Seed,
    [width, height]: [f64; 2],
    lens: Option<&BallLens>,
) -> Option<Candidate> {
    let (px, radius, sigma) = covered_middle(picture, seed)?;
    let aspect = (width.min(height) + 1.0) / (width.max(height) + 1.0);
    let chart = Chart::about(lens, in_whole(picture, px));
    // Its outline is a circle about its middle to well below what can be seen of so small a thing.
    let scale = chart.scale(Vector2::zeros());
    Some(Candidate {
        px: in_whole(picture, px),
        diameter_px: 2.0 * radius / scale,
        sigma_px: (COVER_SIGMAS * sigma).max(0.02),
        score: SMALL_SCORE * aspect,
        colour: seed.colour,
    })
}

/// Share of the disc that the blob covers, and share of the blob outside of it (with a pixel's margin).
fn overlap(blobs: &Blobs, blob: &Blob, middle_px: [f64; 2], radius_px: f64) -> (f64, f64) {
    let inside: f64 = blobs
        .runs_of(blob)
        .map(|run| within(run.row, [run.from, run.to], middle_px, radius_px))
        .sum();
    let near: f64 = blobs
        .runs_of(blob)
        .map(|run| within(run.row, [run.from, run.to], middle_px, radius_px + 1.0))
        .sum();
    let disc = std::f64::consts::PI * radius_px * radius_px;
    (inside / disc, 1.0 - near / blob.area_px.max(1.0))
}

/// Pixels of a stretch of a row within a disc.
fn within(row: u32, [from, to]: [u32; 2], middle_px: [f64; 2], radius_px: f64) -> f64 {
    let down = f64::from(row) - middle_px[1];
    let half = radius_px * radius_px - down * down;
    if half <= 0.0 {
        return 0.0;
    }
    let half = half.sqrt();
    let left = (f64::from(from) - 0.5).max(middle_px[0] - half);
    let right = (f64::from(to) - 0.5).min(middle_px[0] + half);
    (right - left).max(0.0)
}

/// Mean colour of the pixels of a blob that are nearer to its middle than half of its radius: where it is smeared, those at the
/// ends are mixed with what is behind. Of all where none is.
fn inner_colour(picture: &Picture<'_>, blobs: &Blobs, blob: &Blob) -> Option<[f64; 3]> {
    let [x, y] = blob.middle_px();
    let most = 0.25 * blob.area_px / std::f64::consts::PI;
    let mut sums = [([0.0; 3], 0.0); 2];
    for run in blobs.runs_of(blob) {
        let down = f64::from(run.row) - y;
        for column in run.from..run.to {
            let colour = picture.pixel(column, run.row)?;
            let across = f64::from(column) - x;
            let is_inner = across * across + down * down <= most;
            for (sum, count) in sums.iter_mut().skip(usize::from(!is_inner)) {
                *sum = std::array::from_fn(|c| sum[c] + colour[c]);
                *count += 1.0;
            }
        }
    }
    let (sum, count) = sums.into_iter().find(|(_, count)| *count > 0.0)?;
    Some(sum.map(|channel| channel / count))
}

/// From the picture's own pixels to those of the whole one, and back.
fn in_whole(picture: &Picture<'_>, px: [f64; 2]) -> [f64; 2] {
    let [left, top] = picture.origin_px().map(f64::from);
    [px[0] + left, px[1] + top]
}

fn in_part(picture: &Picture<'_>, px: [f64; 2]) -> [f64; 2] {
    let [left, top] = picture.origin_px().map(f64::from);
    [px[0] - left, px[1] - top]
}
