//! Joins bodies of one camera over time where the match is clear: a tracklet ends rather than join two people.

use nalgebra::Vector3;

/// A tracklet ends after this time without a sight, seconds.
const MOST_GAP_S: f64 = 0.5;
/// Largest mean step of the keypoints, in sizes of the body.
const STEP: f64 = 0.12;
/// Additional step per second (3 m/s of a 1.5 m body).
const STEP_PER_S: f64 = 2.0;
/// A match is clear if the second best step is this many times larger.
const CLEAR: f64 = 1.6;
/// Least number of keypoints seen both before and after.
const LEAST_SHARED: usize = 4;

/// One keypoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Joint {
    pub(super) px: [f64; 2],
    /// Unit vector in the camera's axes.
    pub(super) bearing: Vector3<f64>,
    pub(super) score: f64,
}

/// One body in one picture.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Body {
    pub(super) joints: Vec<Option<Joint>>,
    /// Number of its tracklet in its camera.
    pub(super) tracklet: usize,
}

impl Body {
    /// The mean bearing of the visible keypoints among `indices`; `None` if none is visible.
    pub(super) fn bearing(&self, indices: &[usize]) -> Option<Vector3<f64>> {
        let seen = indices.iter().filter_map(|i| self.joints.get(*i)?.as_ref());
        let sum = seen.fold(Vector3::zeros(), |sum, joint| sum + joint.bearing);
        sum.try_normalize(0.1)
    }

    /// As [`Self::bearing`]; `None` unless all of them are visible.
    pub(super) fn bearing_of_all(&self, indices: &[usize]) -> Option<Vector3<f64>> {
        let has = |i: &usize| self.joints.get(*i).is_some_and(Option::is_some);
        indices
            .iter()
            .all(has)
            .then(|| self.bearing(indices))
            .flatten()
    }
}

/// A body in a frame.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tracked {
    pub(super) frame: f64,
    pub(super) body: Body,
}

/// Tracklets of `frames` (number, bodies), ordered by their beginning.
pub(super) fn tracklets(frames: Vec<(f64, Vec<Body>)>, rate_hz: f64) -> Vec<Vec<Tracked>> {
    let mut tracks: Vec<Vec<Tracked>> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    for (frame, bodies) in frames {
        let is_recent = |index: &usize| {
            let last = tracks.get(*index).and_then(|track| track.last());
            last.is_some_and(|it| (frame - it.frame) / rate_hz <= MOST_GAP_S)
        };
        open.retain(is_recent);
        let follows = followers(&tracks, &open, frame, &bodies, rate_hz);
        for (body, follows) in bodies.into_iter().zip(follows) {
            let tracked = Tracked { frame, body };
            if let Some(track) = follows.and_then(|index| tracks.get_mut(index)) {
                track.push(tracked);
            } else {
                open.push(tracks.len());
                tracks.push(vec![tracked]);
            }
        }
    }
    tracks
}

/// Per body, the tracklet that it clearly continues.
fn followers(
    tracks: &[Vec<Tracked>],
    open: &[usize],
    frame: f64,
    bodies: &[Body],
    rate_hz: f64,
) -> Vec<Option<usize>> {
    let steps = |index: usize, body: &Body| {
        let last = tracks.get(index)?.last()?;
        let gap_s = (frame - last.frame) / rate_hz;
        let step = step(&last.body, body)?;
        (step < STEP + STEP_PER_S * gap_s).then_some(step)
    };
    let table: Vec<Vec<Option<f64>>> = bodies
        .iter()
        .map(|body| open.iter().map(|index| steps(*index, body)).collect())
        .collect();
    let two_least = |each: &mut dyn Iterator<Item = (usize, f64)>| {
        let mut best: Option<(usize, f64)> = None;
        let mut second = f64::INFINITY;
        for (index, step) in each {
            if best.is_none_or(|(_, least)| step < least) {
                second = best.map_or(second, |(_, least)| least);
                best = Some((index, step));
            } else {
                second = second.min(step);
            }
        }
        best.filter(|(_, least)| second > CLEAR * least)
    };
    let each = table.iter().enumerate().map(|(body, row)| {
        let own = row.iter().enumerate();
        let (column, _) = two_least(&mut own.filter_map(|(i, step)| Some((i, (*step)?))))?;
        let rows = table.iter().enumerate();
        let back = rows.filter_map(|(i, row)| Some((i, (*row.get(column)?)?)));
        let (row, _) = two_least(&mut { back })?;
        (row == body).then(|| open.get(column).copied())?
    });
    each.collect()
}

/// Median step of shared keypoints, in sizes of the body (angles); `None` if too few are shared.
fn step(a: &Body, b: &Body) -> Option<f64> {
    let both = a.joints.iter().zip(&b.joints);
    let both = both.filter_map(|(a, b)| Some((a.as_ref()?.bearing, b.as_ref()?.bearing)));
    let steps: Vec<f64> = both.map(|(a, b)| (a - b).norm()).collect();
    let size = size(a).max(size(b));
    let mut sorted = steps;
    if sorted.len() < LEAST_SHARED || size <= 0.0 {
        return None;
    }
    // The median ignores single keypoints that jump.
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).map(|median| median / size)
}

/// The angular size of a body, from the spread of its keypoints.
fn size(body: &Body) -> f64 {
    let seen = body.joints.iter().flatten();
    let count = seen.clone().count().max(1) as f64;
    let middle = seen
        .clone()
        .fold(nalgebra::Vector3::zeros(), |sum, it| sum + it.bearing)
        / count;
    let squares: f64 = seen.map(|it| (it.bearing - middle).norm_squared()).sum();
    // Keypoints of a standing body are about uniform over its height: variance height^2 / 12.
    (12.0 * squares / count).sqrt()
}
