//! Selects the candidates over many frames that are one moving thing.

use std::collections::BTreeSet;

use farfield_proto::order_statistics::upper_median;

use super::candidate::Candidate;
use super::colour::hsv;

/// Frames that a link may skip.
const MOST_GAP: u64 = 10;
/// Greatest distance from the prediction in the next frame if the speed is known: diameters, plus pixels.
const NEAR: [f64; 2] = [1.5, 6.0];
/// The same if the speed is unknown.
const FIRST: [f64; 2] = [4.0, 10.0];
/// Share of the speed that is added to both.
const SPEED_SHARE: f64 = 0.5;
/// The greatest distance grows with each skipped frame, up to this factor.
const MOST_GROWTH: f64 = 3.0;
/// Greatest change of the logarithm of the diameter from frame to frame.
const SIZE_CHANGE: f64 = 0.3;
/// Greatest change of the colour from frame to frame, levels.
const COLOUR_CHANGE: f64 = 70.0;
/// Least number of frames of a track.
const LEAST_FRAMES: usize = 4;
/// Least extent of the path of a moving thing: diameters, and pixels.
const MOVED: [f64; 2] = [0.8, 4.0];
/// Exponent of the score relative to the number of frames.
const ROUNDNESS_POWER: i32 = 8;
/// Least median score of another track of the same thing, as a share of the best one's.
const SCORE_SHARE: f64 = 0.75;
/// Greatest difference of their colours, levels.
const SAME_COLOUR: f64 = 60.0;
/// Least median score of a track.
const LEAST_SCORE: f64 = 0.6;
/// Frames that a track may share with those chosen before it, if it is the same thing.
const MOST_SHARED: usize = 2;

/// What decides between things that are there at the same time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Choice {
    Roundest,
    /// Roundest, weighted by the saturation of its colour.
    MostSaturated,
}

/// A thing followed over frames.
#[derive(Debug, Clone)]
struct Track {
    /// Indices of its candidates.
    own: Vec<usize>,
    frame: u64,
    px: [f64; 2],
    /// Pixels per frame; `None` for a track with one candidate.
    speed: Option<[f64; 2]>,
    diameter_px: f64,
    colour: [f64; 3],
}

/// Indices of the candidates of the moving thing, at most one per frame, in order. `kept` is in the order of frames.
pub(super) fn choose(kept: &[(u64, Candidate)], choice: Choice) -> Vec<usize> {
    let mut summaries: Vec<(f64, Summary)> = tracks(kept)
        .iter()
        .filter_map(|track| summary(kept, track))
        .map(|it| (it.weight(choice), it))
        .collect();
    summaries.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.own.cmp(&b.1.own)));
    let Some((_, best)) = summaries.first() else {
        return Vec::new();
    };
    let (score, colour) = (best.score, best.colour);
    let mut taken: Vec<usize> = Vec::new();
    let mut taken_frames: BTreeSet<u64> = BTreeSet::new();
    for (_, it) in summaries {
        let is_same = it.score >= SCORE_SHARE * score && apart(&it.colour, &colour) <= SAME_COLOUR;
        if !is_same {
            continue;
        }
        let own = it.own.iter();
        let own = own.filter_map(|index| Some((*index, kept.get(*index)?.0)));
        let own: Vec<(usize, u64)> = own.collect();
        let is_taken = |frame: &u64| taken_frames.contains(frame);
        let shared = own.iter().filter(|(_, frame)| is_taken(frame)).count();
        // A track at the same time is another thing.
        if shared > MOST_SHARED {
            continue;
        }
        for (index, frame) in own {
            if taken_frames.insert(frame) {
                taken.push(index);
            }
        }
    }
    taken.sort_unstable();
    taken
}

/// Summary of a track.
struct Summary {
    own: Vec<usize>,
    score: f64,
    colour: [f64; 3],
}

impl Summary {
    fn weight(&self, choice: Choice) -> f64 {
        let roundness = libm::pow(self.score, f64::from(ROUNDNESS_POWER));
        let [_, saturation, _] = hsv(self.colour.map(|c| c as u8));
        let colour = match choice {
            Choice::Roundest => 1.0,
            Choice::MostSaturated => saturation * saturation,
        };
        self.own.len() as f64 * roundness * colour
    }
}

/// The summary of a track; `None` if it did not move or is not round.
fn summary(kept: &[(u64, Candidate)], track: &Track) -> Option<Summary> {
    let own: Vec<&Candidate> = track
        .own
        .iter()
        .filter_map(|i| Some(&kept.get(*i)?.1))
        .collect();
    let median =
        |of: &dyn Fn(&Candidate) -> f64| upper_median(own.iter().map(|it| of(it)).collect());
    let diameter_px = median(&|it| it.diameter_px)?;
    let span = |axis: usize| {
        let least = own
            .iter()
            .map(|it| it.px[axis])
            .fold(f64::INFINITY, f64::min);
        let most = own
            .iter()
            .map(|it| it.px[axis])
            .fold(f64::NEG_INFINITY, f64::max);
        most - least
    };
    let extent_px = libm::hypot(span(0), span(1));
    if extent_px < (MOVED[0] * diameter_px).max(MOVED[1]) {
        return None;
    }
    let score = median(&|it| it.score).filter(|score| *score >= LEAST_SCORE)?;
    Some(Summary {
        own: track.own.clone(),
        score,
        colour: [
            median(&|it| it.colour[0])?,
            median(&|it| it.colour[1])?,
            median(&|it| it.colour[2])?,
        ],
    })
}

/// Links candidates from frame to frame, those nearest to the prediction first. Drops tracks of too few frames.
fn tracks(kept: &[(u64, Candidate)]) -> Vec<Track> {
    let mut ended: Vec<Track> = Vec::new();
    let mut open: Vec<Track> = Vec::new();
    let mut start = 0;
    while let Some((frame, _)) = kept.get(start) {
        let end = kept.partition_point(|(other, _)| other <= frame);
        let (going, done) = open
            .into_iter()
            .partition::<Vec<Track>, _>(|t| frame - t.frame <= MOST_GAP);
        open = going;
        ended.extend(done.into_iter().filter(Track::is_long));
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (index, (_, candidate)) in kept.iter().enumerate().take(end).skip(start) {
            for (number, track) in open.iter().enumerate() {
                if let Some(cost) = track.cost(*frame, candidate) {
                    pairs.push((cost, number, index));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
        let mut is_linked = vec![false; end - start];
        let mut is_moved = vec![false; open.len()];
        for (_, number, index) in pairs {
            if is_moved[number] || is_linked[index - start] {
                continue;
            }
            is_moved[number] = true;
            is_linked[index - start] = true;
            open[number].extend(*frame, index, &kept[index].1);
        }
        for index in start..end {
            if !is_linked[index - start] {
                open.push(Track::new(*frame, index, &kept[index].1));
            }
        }
        start = end;
    }
    ended.extend(open.into_iter().filter(Track::is_long));
    ended
}

impl Track {
    fn new(frame: u64, index: usize, candidate: &Candidate) -> Self {
        Self {
            own: vec![index],
            frame,
            px: candidate.px,
            speed: None,
            diameter_px: candidate.diameter_px,
            colour: candidate.colour,
        }
    }

    fn is_long(&self) -> bool {
        self.own.len() >= LEAST_FRAMES
    }

    fn extend(&mut self, frame: u64, index: usize, candidate: &Candidate) {
        let gap = (frame - self.frame).max(1) as f64;
        let now = [0, 1].map(|axis| (candidate.px[axis] - self.px[axis]) / gap);
        self.speed = Some(now);
        self.own.push(index);
        self.frame = frame;
        self.px = candidate.px;
        self.diameter_px = candidate.diameter_px;
        self.colour = candidate.colour;
    }

    /// Distance of `candidate` from the prediction for `frame`, as a share of the allowed one; `None` if it is larger.
    fn cost(&self, frame: u64, candidate: &Candidate) -> Option<f64> {
        let gap = (frame - self.frame).max(1) as f64;
        let [vx, vy] = self.speed.unwrap_or([0.0; 2]);
        let off = libm::hypot(
            candidate.px[0] - self.px[0] - gap * vx,
            candidate.px[1] - self.px[1] - gap * vy,
        );
        let [diameters, px] = if self.speed.is_some() { NEAR } else { FIRST };
        let reach = diameters * self.diameter_px + px + SPEED_SHARE * libm::hypot(vx, vy);
        let place = off / (reach * gap.min(MOST_GROWTH));
        let size = libm::log(candidate.diameter_px / self.diameter_px).abs()
            / (SIZE_CHANGE * gap.min(MOST_GROWTH));
        let colour = apart(&candidate.colour, &self.colour) / COLOUR_CHANGE;
        (place <= 1.0 && size <= 1.0 && colour <= 1.0).then_some(place + 0.5 * size + 0.5 * colour)
    }
}

fn apart(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (0..3)
        .map(|c| (a[c] - b[c]) * (a[c] - b[c]))
        .sum::<f64>()
        .sqrt()
}
