//! Where the outline of a thing lies, below the pixel, along rays from its middle.

use super::picture::Picture;

/// Pixels of the outline from ray to ray, and how many rays there are.
const PX_PER_RAY: f64 = 1.5;
const RAYS: [usize; 2] = [16, 72];
/// From sample to sample along a ray.
const STEP_PX: f64 = 0.5;
/// Least difference of inside and outside, levels (root of the summed squares of three channels).
const LEAST_CONTRAST: f64 = 18.0;
/// How far to either side an edge is looked for: pixels, and share of the radius; where it is soft that share of the width over
/// which it falls; and at most.
const REACH_PX: f64 = 2.0;
const REACH: f64 = 0.1;
const REACH_OF_WIDTH: f64 = 0.75;
const MOST_REACH: f64 = 0.6;
/// Distance to a known radius within which an edge is believed, share of it.
const NEAR_KNOWN: f64 = 0.2;
/// Most samples of a ray.
const MOST_SAMPLES: usize = 64;

/// Where a thing is about, and what it looks like.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seed {
    pub(super) middle_px: [f64; 2],
    pub(super) radius_px: f64,
    /// Its mean colour.
    pub(super) colour: [f64; 3],
}

/// Rays that a thing of `radius_px` is looked at along.
pub(super) fn rays(radius_px: f64) -> usize {
    let around = std::f64::consts::TAU * radius_px / PX_PER_RAY;
    (around as usize).clamp(RAYS[0], RAYS[1])
}

/// Finds the outline of `seed` along rays from its middle, in the pixels of this picture (not the whole one's), into `found`.
///
/// Along each ray the colour of the seed gives way to what is around it: for the first time, or, where the radius is known
/// from a first look, nearest to it. About there it is looked for more closely, the farther around the softer it is.
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
            // Shade may hide it from the one colour of the seed, and not from those on either side of it.
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

/// Where the shares fall below a half, in samples: the first time, or nearest to `expected`; and over how many samples they fall
/// from four fifths to one.
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

fn along_rays(radius_px: f64, mut look: impl FnMut([f64; 2]) -> Option<()>) {
    let count = rays(radius_px);
    for index in 0..count {
        let turn = std::f64::consts::TAU * index as f64 / count as f64;
        // A ray without an edge says nothing.
        look([libm::cos(turn), libm::sin(turn)]);
    }
}

/// The place at which, about `about_px` along a ray, the colours inside pass over into those outside by half; of several the
/// nearest.
///
/// Inside and outside are what stands there, just before and just behind: so that shade on a ball, and a background that is
/// another one on every side, do not move it.
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

/// The share of what is inside at a sample, its neighbours counting half each.
fn smooth(samples: &[[f64; 3]], index: usize, shares: &Shares) -> Option<f64> {
    let here = shares.of(samples.get(index)?);
    let of = |neighbour: Option<&[f64; 3]>| neighbour.map_or(here, |colour| shares.of(colour));
    let before = of(index.checked_sub(1).and_then(|i| samples.get(i)));
    let after = of(samples.get(index + 1));
    Some(0.5 * here + 0.25 * (before + after))
}

/// How much of a colour is one and not the other: 1 and 0 at these.
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

    fn of(&self, colour: &[f64; 3]) -> f64 {
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

/// A part of a ray, pixels from where it starts.
#[derive(Clone, Copy)]
struct Stretch {
    near: f64,
    step: f64,
    far: f64,
}

/// Samples of a stretch, up to the picture's edge; how many there are.
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

/// The middle of a thing too small for an outline, its radius and the noise of the middle, pixels: each pixel counts by how much
/// of it the thing covers, told by its colour between that of the brightest-covered pixel and that around.
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
        .map(|colour| shares.of(colour) * shares.of(colour))
        .sum::<f64>()
        / around.len() as f64;
    let (mut weight, mut x_sum, mut y_sum, mut arms) = (0.0, 0.0, 0.0, 0.0);
    for (x, y) in pixels().filter(|(x, y)| distance(*x, *y) <= reach) {
        let share = shares.of(&picture.pixel(x, y)?);
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
    // Independent noise of each share moves the mean by its arm over the weight.
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
