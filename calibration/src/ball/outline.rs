//! Finds the outline of a thing along rays from its middle, with subpixel accuracy.

use super::picture::Picture;

/// Pixels of the outline from ray to ray, and least and greatest number of rays.
const PX_PER_RAY: f64 = 1.5;
const RAYS: [usize; 2] = [16, 72];
/// Distance of samples along a ray.
const STEP_PX: f64 = 0.5;
/// Least difference of inside and outside, levels (root of the summed squares of three channels).
const LEAST_CONTRAST: f64 = 18.0;
/// Range to either side in which an edge is searched, pixels. One of the next two is added.
const REACH_PX: f64 = 2.0;
/// Range about a known radius if no transition was found, share of the radius.
const REACH: f64 = 0.1;
/// Range about a transition, share of its width: soft edges have wide ones.
const REACH_OF_WIDTH: f64 = 0.75;
/// Greatest range, share of the radius.
const MOST_REACH: f64 = 0.6;
/// Greatest distance of an edge from a known radius, as a share of it.
const NEAR_KNOWN: f64 = 0.2;
/// Most samples of a ray.
const MOST_SAMPLES: usize = 64;

/// Approximate position and colour of a thing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seed {
    pub(super) middle_px: [f64; 2],
    pub(super) radius_px: f64,
    /// Its mean colour.
    pub(super) colour: [f64; 3],
}

/// Number of rays for a thing of `radius_px`.
pub(super) fn rays(radius_px: f64) -> usize {
    let around = std::f64::consts::TAU * radius_px / PX_PER_RAY;
    (around as usize).clamp(RAYS[0], RAYS[1])
}

/// Finds the outline of `seed` along rays from its middle, in pixels of this picture (not of the whole one), into `found`.
///
/// First, along each ray, the transition from the colour of the seed to that of its surroundings is found: the first one, or
/// the nearest to the radius if it is known from an earlier search. Then the edge is searched more precisely near it; the softer
/// it is, the wider the range.
pub(super) fn outline(
    picture: &Picture<'_>,
    seed: &Seed,
    known_radius_px: Option<f64>,
    found: &mut Vec<[f64; 2]>,
) {
    found.clear();
    let r = seed.radius_px;
    let (near, far) = ((0.4 * r - 1.0).max(0.0), 1.6 * r + 4.0);
    let step = STEP_PX.max((far - near) / (MOST_SAMPLES - 1) as f64);
    along_rays(r, |direction| {
        let mut samples = [[0.0; 3]; MOST_SAMPLES];
        let stretch = Stretch { near, step, far };
        let count = sampled(picture, seed.middle_px, direction, stretch, &mut samples);
        let samples = samples.get(..count)?;
        let outside = mean(samples.get(count.checked_sub(4)?..)?);
        let passage = Shares::between(&seed.colour, &outside).and_then(|shares| {
            passage(samples, &shares, known_radius_px.map(|r| (r - near) / step))
        });
        let (about_px, reach_px) = match (passage, known_radius_px) {
            (Some((at, width)), _) => (near + step * at, REACH_OF_WIDTH * step * width + REACH_PX),
            // Shade may change the colour at the edge. The colours on both sides of it then still differ.
            (None, Some(known_px)) => (known_px, REACH * r + REACH_PX),
            (None, None) => return None,
        };
        let reach_px = reach_px.min(MOST_REACH * r + REACH_PX);
        found.push(edge_near(
            picture,
            seed.middle_px,
            direction,
            about_px,
            reach_px,
        )?);
        Some(())
    });
}

/// The first position, in samples, where the shares fall below a half, or the one nearest to `expected`; and the number of
/// samples over which they fall from 0.8 to 0.2.
fn passage(samples: &[[f64; 3]], shares: &Shares, expected: Option<f64>) -> Option<(f64, f64)> {
    let share = |index: usize| smooth(samples, index, shares);
    let falls = |index: &usize| {
        let is_in = share(*index).is_some_and(|s| s >= 0.5);
        is_in && share(index + 1).is_some_and(|s| s < 0.5)
    };
    let mut falling = (0..samples.len().saturating_sub(1)).filter(falls);
    let at = match expected {
        None => falling.next()?,
        Some(expected) => {
            let off = |index: &usize| (*index as f64 + 0.5 - expected).abs();
            let nearest = falling.min_by(|a, b| off(a).total_cmp(&off(b)))?;
            Some(nearest).filter(|index| off(index) <= NEAR_KNOWN * expected + 4.0)?
        }
    };
    let full = (0..=at)
        .rev()
        .find(|index| share(*index).is_some_and(|s| s > 0.8))
        .unwrap_or(0);
    let empty = (at..samples.len()).find(|index| share(*index).is_some_and(|s| s < 0.2));
    let (here, next) = (share(at)?, share(at + 1)?);
    let width = empty.unwrap_or(at + 1) - full;
    Some((at as f64 + (here - 0.5) / (here - next), width as f64))
}

fn along_rays(radius_px: f64, mut search: impl FnMut([f64; 2]) -> Option<()>) {
    let count = rays(radius_px);
    for index in 0..count {
        let turn = std::f64::consts::TAU * index as f64 / count as f64;
        // A ray without an edge adds no point.
        search([libm::cos(turn), libm::sin(turn)]);
    }
}

/// The position along a ray, about `about_px`, at which the colour is half that inside and half that outside; the nearest one
/// if there are several.
///
/// Inside and outside are the colours just before and just behind. Thus neither shade on the ball nor a background that differs
/// from side to side moves the edge.
fn edge_near(
    picture: &Picture<'_>,
    middle_px: [f64; 2],
    direction: [f64; 2],
    about_px: f64,
    reach_px: f64,
) -> Option<[f64; 2]> {
    let near = (about_px - reach_px).max(0.0);
    let far = about_px + reach_px;
    let step = STEP_PX.max((far - near) / (MOST_SAMPLES - 1) as f64);
    let mut samples = [[0.0; 3]; MOST_SAMPLES];
    let stretch = Stretch { near, step, far };
    let count = sampled(picture, middle_px, direction, stretch, &mut samples);
    let samples = samples.get(..count)?;
    let quarter = (count / 4).max(2);
    let inside = mean(samples.get(..quarter)?);
    let outside = mean(samples.get(count.checked_sub(quarter)?..)?);
    let shares = Shares::between(&inside, &outside)?;
    let mut best: Option<(f64, f64)> = None;
    for index in 0..count.saturating_sub(1) {
        let (here, next) = (
            smooth(samples, index, &shares)?,
            smooth(samples, index + 1, &shares)?,
        );
        if here < 0.5 || next >= 0.5 {
            continue;
        }
        let at = near + step * (index as f64 + (here - 0.5) / (here - next));
        let off = (at - about_px).abs();
        if best.is_none_or(|(least, _)| off < least) {
            best = Some((off, at));
        }
    }
    let (_, at) = best?;
    Some([
        middle_px[0] + at * direction[0],
        middle_px[1] + at * direction[1],
    ])
}

/// Share of the inside colour at a sample, smoothed with half the weight on each neighbour.
fn smooth(samples: &[[f64; 3]], index: usize, shares: &Shares) -> Option<f64> {
    let here = shares.share(samples.get(index)?);
    let share_of =
        |neighbour: Option<&[f64; 3]>| neighbour.map_or(here, |colour| shares.share(colour));
    let before = share_of(index.checked_sub(1).and_then(|i| samples.get(i)));
    let after = share_of(samples.get(index + 1));
    Some(0.5 * here + 0.25 * (before + after))
}

/// Share of one colour relative to another: 1 at the inside colour, 0 at the outside one.
struct Shares {
    outside: [f64; 3],
    by: [f64; 3],
}

impl Shares {
    fn between(inside: &[f64; 3], outside: &[f64; 3]) -> Option<Self> {
        let apart: [f64; 3] = std::array::from_fn(|c| inside[c] - outside[c]);
        let squared: f64 = apart.iter().map(|d| d * d).sum();
        (squared >= LEAST_CONTRAST * LEAST_CONTRAST).then(|| Self {
            outside: *outside,
            by: apart.map(|d| d / squared),
        })
    }

    fn share(&self, colour: &[f64; 3]) -> f64 {
        (0..3)
            .map(|c| (colour[c] - self.outside[c]) * self.by[c])
            .sum()
    }
}

fn mean(samples: &[[f64; 3]]) -> [f64; 3] {
    let sum = samples.iter().fold([0.0; 3], |sum, colour| {
        std::array::from_fn(|c| sum[c] + colour[c])
    });
    sum.map(|channel| channel / samples.len().max(1) as f64)
}

/// A part of a ray, pixels from its start.
#[derive(Clone, Copy)]
struct Stretch {
    near: f64,
    step: f64,
    far: f64,
}

/// Samples a part of a ray, up to the edge of the picture, and returns their number.
fn sampled(
    picture: &Picture<'_>,
    middle_px: [f64; 2],
    direction: [f64; 2],
    stretch: Stretch,
    into: &mut [[f64; 3]; MOST_SAMPLES],
) -> usize {
    let mut count = 0;
    for slot in into.iter_mut() {
        let at = stretch.near + stretch.step * count as f64;
        if at > stretch.far + 1e-9 {
            break;
        }
        let colour = picture.sample(
            middle_px[0] + at * direction[0],
            middle_px[1] + at * direction[1],
        );
        let Some(colour) = colour else { break };
        *slot = colour;
        count += 1;
    }
    count
}

/// The middle of a thing too small for an outline, its radius, and the noise of the middle, pixels. Each pixel has its covered
/// share as weight: that of the seed's colour relative to the colour around.
pub(super) fn covered_middle(picture: &Picture<'_>, seed: &Seed) -> Option<([f64; 2], f64, f64)> {
    let [width, height] = picture.size_px().map(f64::from);
    let reach = seed.radius_px + 2.5;
    let first = |axis: usize| (seed.middle_px[axis] - reach).floor();
    let last = |axis: usize| (seed.middle_px[axis] + reach).ceil();
    if first(0) < 1.0 || first(1) < 1.0 || last(0) > width - 2.0 || last(1) > height - 2.0 {
        return None;
    }
    let columns = first(0) as u32..=last(0) as u32;
    let rows = first(1) as u32..=last(1) as u32;
    let distance = |x: u32, y: u32| {
        libm::hypot(
            f64::from(x) - seed.middle_px[0],
            f64::from(y) - seed.middle_px[1],
        )
    };
    let pixels = || {
        let columns = columns.clone();
        rows.clone()
            .flat_map(move |y| columns.clone().map(move |x| (x, y)))
    };
    let around = pixels().filter(|(x, y)| distance(*x, *y) > seed.radius_px + 1.2);
    let mut around: Vec<[f64; 3]> = around.filter_map(|(x, y)| picture.pixel(x, y)).collect();
    let outside = middle_colour(&mut around)?;
    let shares = Shares::between(&seed.colour, &outside)?;
    let noise: f64 = around
        .iter()
        .map(|colour| shares.share(colour) * shares.share(colour))
        .sum::<f64>()
        / around.len() as f64;
    let (mut weight, mut x_sum, mut y_sum, mut arms) = (0.0, 0.0, 0.0, 0.0);
    for (x, y) in pixels().filter(|(x, y)| distance(*x, *y) <= reach) {
        let share = shares.share(&picture.pixel(x, y)?);
        if share < 0.1 {
            continue;
        }
        weight += share;
        x_sum += share * f64::from(x);
        y_sum += share * f64::from(y);
        arms += distance(x, y) * distance(x, y);
    }
    if weight <= 0.0 {
        return None;
    }
    let radius = (weight / std::f64::consts::PI).sqrt();
    // Independent noise of a share moves the mean by its distance from the middle over the total weight.
    let sigma = (0.5 * noise * arms).sqrt() / weight;
    Some(([x_sum / weight, y_sum / weight], radius, sigma))
}

/// Median of each channel.
fn middle_colour(colours: &mut [[f64; 3]]) -> Option<[f64; 3]> {
    let half = colours.len() / 2;
    let mut found = [0.0; 3];
    for (channel, value) in found.iter_mut().enumerate() {
        colours.sort_by(|a, b| a[channel].total_cmp(&b[channel]));
        *value = colours.get(half)?[channel];
    }
    Some(found)
}
