//! Candidates of one picture: round blobs of a plausible size.

use nalgebra::Vector2;

use super::blobs::{Blob, Blobs};
use super::chart::{BallLens, Chart};
use super::outline::{Seed, covered_middle, outline, rays};
use super::picture::Picture;
use super::round::fit;

/// Diameter below which the centre is computed from the covered share of each pixel, pixels.
pub const SMALLEST_OUTLINE_PX: f64 = 7.0;
/// Most blobs of a picture whose outline is searched.
const MOST_BLOBS: usize = 24;
/// Limits of a blob's area over that of a disc: a part may be hidden, or motion may blur it.
const LEAST_AREA: f64 = 0.3;
const MOST_AREA: f64 = 2.0;
/// Longer over shorter side of a blob's box.
const MOST_ASPECT: f64 = 2.5;
/// Least share of all rays whose edge is on the circle.
const LEAST_SHARE: f64 = 0.5;
/// Least share of the fitted disc that the blob must cover.
const LEAST_COVER: f64 = 0.4;
/// Greatest share of the blob outside the disc.
const MOST_OUTSIDE: f64 = 0.25;
/// A blob is a speck if another one near it has at least so many times its area.
const SPECK_TIMES: f64 = 5.0;
/// Greatest distance of a speck from the larger blob, share of the size of that.
const SPECK_REACH: f64 = 0.3;
/// Error of the centre of an outline over that of independent rays: neighbours share pixels, and the background is correlated.
/// Measured on drawn balls (`tests/centre.rs`).
const OUTLINE_SIGMAS: f64 = 1.4;
/// The same for a blob without an outline, over that of independent pixels.
const COVER_SIGMAS: f64 = 3.5;
/// Searches of an outline. Later ones start from the fitted centre, so that edges missed at first are searched in the right place.
const SEARCHES: usize = 3;
/// Score of a round blob too small for an outline: it may be any small thing.
const SMALL_SCORE: f64 = 0.8;

/// One candidate of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Pixels of the whole picture.
    pub(super) px: [f64; 2],
    pub(super) diameter_px: f64,
    pub(super) sigma_px: f64,
    /// 0 to 1: how similar it is to a ball.
    pub(super) score: f64,
    pub(super) colour: [f64; 3],
}

/// Buffers that are used again from picture to picture.
#[derive(Debug, Clone, Default)]
pub(super) struct Buffers {
    chosen: Vec<(f64, Blob)>,
    rim_px: Vec<[f64; 2]>,
    rim: Vec<Vector2<f64>>,
}

/// Adds the candidates among `blobs` to `found`.
pub(super) fn candidates(
    picture: &Picture<'_>,
    blobs: &mut Blobs,
    diameter_px: [f64; 2],
    lens: Option<&BallLens>,
    buffers: &mut Buffers,
    found: &mut Vec<Candidate>,
) {
    let quarter = std::f64::consts::FRAC_PI_4;
    let [least, most] = diameter_px.map(|d| quarter * d * d);
    buffers.chosen.clear();
    for blob in blobs.blobs() {
        let [width, height] = blob.size_px();
        let aspect = (width / height).max(height / width);
        // Pixels at the rim may be missing, and the smallest discs are all rim.
        let least = (LEAST_AREA * least)
            .min(least - 2.0 * diameter_px[0])
            .max(1.0);
        let is_credible = (least..=MOST_AREA * most).contains(&blob.area_px)
            && (aspect <= MOST_ASPECT || width.max(height) <= 4.0)
            && width.max(height) <= 1.7 * diameter_px[1] + 3.0;
        if is_credible {
            let off_round =
                (blob.area_px / (width * height) - quarter).abs() + 0.3 * (aspect - 1.0);
            buffers.chosen.push((off_round, *blob));
        }
    }
    buffers
        .chosen
        .sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.root.cmp(&b.1.root)));
    buffers.chosen.truncate(MOST_BLOBS);
    let chosen = std::mem::take(&mut buffers.chosen);
    for (_, blob) in &chosen {
        if is_speck(blobs, blob) {
            continue;
        }
        let candidate = candidate(picture, blobs, blob, lens, buffers);
        let [least, most] = diameter_px;
        found.extend(candidate.filter(|it| (0.8 * least..=1.25 * most).contains(&it.diameter_px)));
    }
    buffers.chosen = chosen;
}

/// True for a speck at the rim of a larger blob: blurred balls and shirts have many.
fn is_speck(blobs: &Blobs, blob: &Blob) -> bool {
    let [x, y] = blob.middle_px();
    let is_near = |middle: f64, [first, last]: [u32; 2]| {
        let (first, last) = (f64::from(first), f64::from(last));
        let margin = SPECK_REACH * (last - first) + 2.0;
        (first - margin..=last + margin).contains(&middle)
    };
    blobs.all().iter().any(|other| {
        other.area_px > SPECK_TIMES * blob.area_px
            && is_near(x, other.columns)
            && is_near(y, other.rows)
    })
}

fn candidate(
    picture: &Picture<'_>,
    blobs: &Blobs,
    blob: &Blob,
    lens: Option<&BallLens>,
    buffers: &mut Buffers,
) -> Option<Candidate> {
    let [width, height] = blob.size_px();
    let seed = Seed {
        middle_px: blob.middle_px(),
        // The mask lacks pixels that are covered in part.
        radius_px: (0.25 * (width + height)).max((blob.area_px / std::f64::consts::PI).sqrt()),
        colour: inner_colour(picture, blobs, blob)?,
    };
    if 2.0 * seed.radius_px < SMALLEST_OUTLINE_PX {
        return small(picture, &seed, [width, height], lens);
    }
    let mut current = seed;
    let mut last = None;
    for round in 0..SEARCHES {
        let known_px = (round > 0).then_some(current.radius_px);
        outline(picture, &current, known_px, &mut buffers.rim_px);
        let chart = Chart::about(lens, in_whole(picture, current.middle_px));
        buffers.rim.clear();
        let rim = buffers
            .rim_px
            .iter()
            .filter_map(|px| chart.on_plane(in_whole(picture, *px)));
        buffers.rim.extend(rim);
        let fitted = fit(&buffers.rim)?;
        let (px, diameter) = chart.ball(fitted.centre, fitted.radius)?;
        let scale = chart.scale(fitted.centre);
        current.middle_px = in_part(picture, px);
        current.radius_px = fitted.radius * scale;
        if !(0.4 * seed.radius_px..=2.0 * seed.radius_px + 2.0).contains(&current.radius_px) {
            return None;
        }
        last = Some((px, diameter, scale, fitted));
    }
    let (px, diameter_px, scale, fitted) = last?;
    let radius_px = fitted.radius * scale;
    let share = fitted.share * buffers.rim.len() as f64 / rays(radius_px) as f64;
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
    // The outline of so small a thing is a circle about its middle to well below the noise.
    let scale = chart.scale(Vector2::zeros());
    Some(Candidate {
        px: in_whole(picture, px),
        diameter_px: 2.0 * radius / scale,
        sigma_px: (COVER_SIGMAS * sigma).max(0.02),
        score: SMALL_SCORE * aspect,
        colour: seed.colour,
    })
}

/// Share of the disc that the blob covers, and share of the blob outside the disc (with a margin of one pixel).
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

/// Pixels of a part of a row within a disc.
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

/// Mean colour of the blob's pixels that are nearer to its middle than half its radius, or of all pixels if there are none.
/// Pixels at the ends of a blurred blob are mixed with the background.
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

/// Converts pixels of this picture to those of the whole one; [`in_part`] is the inverse.
fn in_whole(picture: &Picture<'_>, px: [f64; 2]) -> [f64; 2] {
    let [left, top] = picture.origin_px().map(f64::from);
    [px[0] + left, px[1] + top]
}

fn in_part(picture: &Picture<'_>, px: [f64; 2]) -> [f64; 2] {
    let [left, top] = picture.origin_px().map(f64::from);
    [px[0] - left, px[1] - top]
}
