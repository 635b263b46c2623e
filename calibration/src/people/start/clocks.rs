//! Clocks of cameras that were started manually, from the people that they saw.
//!
//! Whole ticks come from feet: the lag at which the floors of two cameras match best. The adjustment gives the rest: a late
//! camera sees everyone a little behind along their path.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};
use rayon::prelude::*;

use super::floor_match::{Effort, Feet, motions, shared_ticks};
use super::pair::Walkers;
use crate::people::adjust::Adjusted;
use crate::people::view::{Clock, View, velocity_px};

/// Step between the lags of the first search, at ten ticks per second.
const COARSE_TICKS: i64 = 3;
/// Least share of the shorter recording that overlaps at a lag.
const LEAST_COMMON_SHARE: f64 = 0.35;
/// Least overlap, ticks.
const LEAST_COMMON_TICKS: f64 = 80.0;
/// Length of the busiest part of the shorter recording that is searched in the longer one, ticks.
const WINDOW_TICKS: i64 = 1500;
/// Most lags of the first search; an hour and a half needs so many.
const MOST_LAGS: i64 = 20_000;
/// Number of best lags whose neighbours are tried.
const MOST_KEPT: usize = 3;
/// Relative standard deviation of given rates.
const RATE_SIGMA: f64 = 2e-4;
/// Standard deviation of the time before it is measured, seconds; it only prevents singular sums.
const TIME_SIGMA_S: f64 = 1.0;
/// Residuals beyond this many standard deviations are not used for time.
const MOST_SIGMAS: f64 = 4.0;

/// The delay of the second camera relative to the first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Lag {
    first: usize,
    second: usize,
    ticks: i64,
    score: f64,
}

/// Per camera, the ticks to add to its own so that all agree, from the pairs that agree best; zero without such a pair.
///
/// # Errors
/// Two cameras whose recordings are so long that there are too many lags to try.
pub(in crate::people) fn lags(
    walkers: &[Option<Walkers<'_>>],
    seed: u64,
) -> Result<Vec<i64>, (usize, usize)> {
    let indices: Vec<(usize, usize)> = (0..walkers.len())
        .flat_map(|i| (i + 1..walkers.len()).map(move |j| (i, j)))
        .collect();
    for (first, second) in &indices {
        if let (Some(a), Some(b)) = (&walkers[*first], &walkers[*second])
            && Search::new(&a.feet, &b.feet).is_some_and(|it| it.count() > MOST_LAGS)
        {
            return Err((*first, *second));
        }
    }
    let found: Vec<Lag> = indices
        .into_par_iter()
        .filter_map(|(first, second)| {
            let (a, b) = (walkers[first].as_ref()?, walkers[second].as_ref()?);
            let (ticks, score) = lag(&a.feet, &b.feet, seed)?;
            Some(Lag {
                first,
                second,
                ticks,
                score,
            })
        })
        .collect();
    Ok(spread(walkers.len(), &found))
}

/// Prim's tree over the pairs, the best first.
fn spread(count: usize, lags: &[Lag]) -> Vec<i64> {
    let mut ticks: Vec<Option<i64>> = vec![None; count];
    let root = lags.iter().max_by(|a, b| a.score.total_cmp(&b.score));
    if let Some(root) = root {
        ticks[root.first] = Some(0);
    }
    loop {
        let open = lags
            .iter()
            .filter(|it| ticks[it.first].is_some() != ticks[it.second].is_some());
        let Some(next) = open.max_by(|a, b| a.score.total_cmp(&b.score)) else {
            break;
        };
        if let Some(first) = ticks[next.first] {
            ticks[next.second] = Some(first + next.ticks);
        } else if let Some(second) = ticks[next.second] {
            ticks[next.first] = Some(second - next.ticks);
        }
    }
    ticks.into_iter().map(|it| it.unwrap_or(0)).collect()
}

/// The search range for the lag of two recordings.
struct Search<'a> {
    a: Cow<'a, Feet>,
    b: Cow<'a, Feet>,
    /// Ticks of the shorter recording.
    shorter: f64,
    /// The smallest and largest lag.
    least: i64,
    most: i64,
}

impl<'a> Search<'a> {
    fn new(a: &'a Feet, b: &'a Feet) -> Option<Self> {
        let ends = |feet: &Feet| Some((*feet.keys().next()?, *feet.keys().next_back()?));
        let length = |feet: &Feet| ends(feet).map(|(from, to)| to - from);
        let (a, b) = if length(b)? <= length(a)? {
            (Cow::Borrowed(a), busiest(b))
        } else {
            (busiest(a), Cow::Borrowed(b))
        };
        let ((from_a, to_a), (from_b, to_b)) = (ends(&a)?, ends(&b)?);
        let shorter = (to_a - from_a).min(to_b - from_b) as f64;
        let common = (LEAST_COMMON_SHARE * shorter).max(LEAST_COMMON_TICKS) as i64;
        Some(Self {
            a,
            b,
            shorter,
            least: from_a + common - to_b,
            most: to_a - common - from_b,
        })
    }

    /// The number of lags of the first search.
    fn count(&self) -> i64 {
        (self.most - self.least) / COARSE_TICKS
    }
}

/// The part of [`WINDOW_TICKS`] with the most feet.
fn busiest(feet: &Feet) -> Cow<'_, Feet> {
    let each: Vec<(i64, usize)> = feet.iter().map(|(tick, own)| (*tick, own.len())).collect();
    let is_short = each
        .first()
        .zip(each.last())
        .is_none_or(|(first, last)| last.0 - first.0 < WINDOW_TICKS);
    if is_short {
        return Cow::Borrowed(feet);
    }
    let (mut start, mut count) = (0, 0);
    let (mut most, mut best) = (0, 0);
    for (tick, own) in &each {
        count += own;
        while let Some((first, gone)) = each.get(start)
            && tick - first >= WINDOW_TICKS
        {
            count -= gone;
            start += 1;
        }
        if count > most {
            most = count;
            best = each.get(start).map_or(0, |it| it.0);
        }
    }
    let window = feet.range(best..best + WINDOW_TICKS);
    Cow::Owned(window.map(|(tick, own)| (*tick, own.clone())).collect())
}

/// The ticks to add to those of `b`, and the score of the match of feet.
fn lag(a: &Feet, b: &Feet, seed: u64) -> Option<(i64, f64)> {
    let search = Search::new(a, b)?;
    let (a, b) = (search.a.as_ref(), search.b.as_ref());
    let score = |ticks: i64, effort: Effort| {
        let best = motions(a, b, ticks, effort, seed)
            .first()
            .map(|it| it.score)?;
        // A few common ticks can agree by chance.
        let shared = shared_ticks(a, b, ticks).len();
        Some(best * (shared as f64 / search.shorter.max(1.0)).min(1.0).sqrt())
    };
    let mut coarse: Vec<(i64, f64)> = Vec::new();
    let mut ticks = search.least;
    while ticks <= search.most {
        coarse.extend(score(ticks, Effort::QUICK).map(|score| (ticks, score)));
        ticks += COARSE_TICKS;
    }
    coarse.sort_by(|x, y| y.1.total_cmp(&x.1));
    let near = coarse.iter().take(MOST_KEPT).flat_map(|(ticks, _)| {
        let ticks = *ticks;
        (-COARSE_TICKS..=COARSE_TICKS).map(move |by| ticks + by)
    });
    let fine = near.filter_map(|ticks| Some((ticks, score(ticks, Effort::FULL)?)));
    fine.max_by(|x, y| x.1.total_cmp(&y.1))
}

/// Corrects the clock of each posed camera by how far its keypoints are behind or ahead along their path. Returns the largest
/// change, seconds. The clocks keep their mean.
pub(in crate::people) fn refine(clocks: &mut [Clock], views: &[View], adjusted: &Adjusted) -> f64 {
    let mut sums: BTreeMap<usize, (Matrix2<f64>, Vector2<f64>)> = BTreeMap::new();
    let problem = &adjusted.problem;
    let middle_s = {
        let ticks = adjusted.persons.iter().map(|it| it.tick as f64);
        let count = adjusted.persons.len().max(1) as f64;
        ticks.sum::<f64>() / count / clocks.first().and_then(|it| it.ticks_hz).unwrap_or(1.0)
    };
    let folds: Vec<f64> = problem
        .cameras
        .iter()
        .map(|c| c.state.fold_radius())
        .collect();
    for observation in &problem.observations {
        let column = observation.camera;
        let (Some(of), Some(point)) = (
            adjusted.points.get(observation.point),
            problem.path.nodes().get(observation.point),
        ) else {
            continue;
        };
        let (Some(index), Some(camera)) = (adjusted.posed.get(column), problem.cameras.get(column))
        else {
            continue;
        };
        let Some(person) = adjusted.persons.get(of.person) else {
            continue;
        };
        let Some(ticks_hz) = clocks.get(*index).and_then(|it| it.ticks_hz) else {
            continue;
        };
        let member = person.members.iter().find(|(camera, _)| camera == index);
        let Some(velocity) = member.and_then(|(_, body)| {
            velocity_px(views.get(*index)?, person.tick, *body, of.keypoint, 1)
        }) else {
            continue;
        };
        let velocity = velocity * ticks_hz;
        let Some(drawn) = camera.state.project(point, folds[column]) else {
            continue;
        };
        let ahead = Vector2::from(observation.px) - drawn;
        let weight = 1.0 / (observation.sigma_px * observation.sigma_px);
        if ahead.norm_squared() * weight > MOST_SIGMAS * MOST_SIGMAS {
            continue;
        }
        let since_s = person.tick as f64 / ticks_hz - middle_s;
        let by = Vector2::new(1.0, since_s);
        let entry = sums
            .entry(*index)
            .or_insert((Matrix2::zeros(), Vector2::zeros()));
        entry.0 += by * by.transpose() * (velocity.norm_squared() * weight);
        entry.1 += by * (velocity.dot(&ahead) * weight);
    }
    let steps: BTreeMap<usize, Vector2<f64>> = sums
        .into_iter()
        .filter_map(|(index, (mut matrix, right))| {
            matrix[(0, 0)] += 1.0 / (TIME_SIGMA_S * TIME_SIGMA_S);
            matrix[(1, 1)] += 1.0 / (RATE_SIGMA * RATE_SIGMA);
            Some((index, matrix.cholesky()?.solve(&right)))
        })
        .collect();
    let count = steps.len().max(1) as f64;
    let mean = steps
        .values()
        .fold(Vector2::zeros(), |sum, step| sum + step)
        / count;
    let mut most_s: f64 = 0.0;
    for (index, step) in steps {
        let Some(clock) = clocks.get_mut(index) else {
            continue;
        };
        // A keypoint that is ahead was taken later than its clock states.
        let step = step - mean;
        clock.offset_s += step.x - step.y * middle_s + clock.offset_s * step.y;
        clock.rate_hz /= 1.0 + step.y;
        most_s = most_s.max(step.x.abs());
    }
    most_s
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three people on curves at ten ticks per second, as seen from one place.
    fn feet(ticks: std::ops::Range<i64>, since: i64) -> Feet {
        let at = |tick: i64| {
            let t = tick as f64 * 0.1;
            let each = (0..3).map(|person: usize| {
                let phase = 1.7 * person as f64;
                // Paths differ between people and never repeat.
                let at = Vector2::new(
                    3.0 * libm::sin(0.5 * t + phase) + libm::sin(0.0113 * t * t / 10.0 + phase),
                    2.0 * libm::cos(0.37 * t + 2.0 * phase) + libm::cos(0.171 * t),
                );
                (person + 10 * (tick / 100) as usize, at)
            });
            each.collect()
        };
        ticks.map(|tick| (tick - since, at(tick))).collect()
    }

    #[test]
    fn the_busiest_part_of_a_recording_is_found_in_a_longer_one() {
        let (long, short) = (feet(0..5000, 0), feet(1000..3600, 700));
        let search = Search::new(&long, &short).unwrap();
        assert!(search.b.len() <= 1500 && search.a.len() == 5000);
        assert_eq!(lag(&long, &short, 1).unwrap().0, 700);
        assert_eq!(lag(&short, &long, 1).unwrap().0, -700);
    }

    #[test]
    fn the_busiest_part_has_the_most_feet() {
        let mut feet: Feet = (0..10_000).map(|tick| (tick, Vec::new())).collect();
        for tick in 6000..6400 {
            feet.insert(tick, vec![(0, Vector2::zeros())]);
        }
        let found = busiest(&feet);
        assert!(found.len() <= 1500);
        assert_eq!(found.values().map(Vec::len).sum::<usize>(), 400);
    }
}
