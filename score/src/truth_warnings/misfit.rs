//! Searches for a reading of the truth that brings it near the poses.

use farfield_proto::tick::Tick;

use super::comparison::{
    BodyPair, Comparison, NameMap, PARTS, PairDistances, Reading, TickMap, n_shared_kinds, nearest,
    shared_points,
};
use super::similarity::{Freedom, Handedness, Similarity};
use crate::lines::PoseLines;
use crate::pairing::GATE_M;

/// Largest shift in ticks that is tried in either direction.
const MAX_TICK_SHIFT: i64 = 10;
/// The same for a file that began later than the other: four seconds at 30 Hz.
const MAX_FAR_TICK_SHIFT: i64 = 120;
/// A reading must leave less than this share of the original distance. Neither noise nor a bias of single joints explains
/// such a reduction.
const MAX_REST_SHARE: f64 = 0.5;
/// A reading that leaves more is rejected, metres: poses of the people in this truth are nearer. A reading with two or more
/// changes must leave less, because so many changes also fit the truth of another person.
const MAX_REST_M: f64 = 0.1;
const MAX_REST_OF_SEVERAL_M: f64 = 0.06;
/// Most changes in one reading.
const MAX_CHANGES: usize = 3;
/// Fewest joints or keypoints that determine a place: with fewer, the bias of one of them looks like another place.
const MIN_KINDS: usize = 6;
/// Readings are equivalent if they leave at most this multiple of the best, plus [`ALIKE_M`]. Of these, the one with the
/// fewest changes is reported.
const ALIKE: f64 = 1.25;
const ALIKE_M: f64 = 0.003;
/// Most equivalent readings that are reported.
const MAX_READINGS: usize = 2;
/// Rounds in which bodies are paired and the place is estimated in turn.
const ROUNDS: usize = 4;

/// The readings that correct a truth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Misfit {
    /// One reading, or two equivalent ones. Never empty.
    pub(super) readings: Vec<Reading>,
    /// Mean distance that remains, metres.
    pub(super) rest_m: f64,
}

/// Finds the readings that correct `truth`, if there are any.
///
/// Cost: some 315 to 565 matchings of at most 200 ticks, whatever the length of the files.
pub(super) fn misfit(poses: &PoseLines, truth: &PoseLines) -> Option<Misfit> {
    Search::new(Comparison::new(poses, truth)?)?.best()
}

/// A shift of the truth in time.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TickShift {
    /// Ticks by which the poses are after the truth.
    ticks: i64,
    /// Mean distance that remains, metres.
    rest_m: f64,
}

/// Reports a truth that is shifted in time in one half of the recording only, or differently in the two halves. One of the
/// two files lost frames, or counts at another rate. Call it if no reading corrects the whole truth.
///
/// `None` if no half is corrected by a shift, or both by the same.
pub(super) fn shift_in_part(poses: &PoseLines, truth: &PoseLines) -> Option<String> {
    let halves = Comparison::new(poses, truth)?.halves()?;
    let ends = halves.each_ref().map(Comparison::ends);
    let shifts = halves.map(tick_shift);
    let [before, after] = shifts.map(|it| it.map_or(0, |it| it.ticks));
    if before == after {
        return None;
    }
    let halves = ends.into_iter().zip(shifts).filter_map(|(ends, shift)| {
        let ([from, to], TickShift { ticks, rest_m }) = (ends?, shift?);
        let direction = if ticks < 0 { "later" } else { "earlier" };
        let n = ticks.unsigned_abs();
        let s = if n == 1 { "" } else { "s" };
        Some(format!(
            "{n} tick{s} {direction} at ticks {from} to {to} (after correction joints are {:.0} mm off there)",
            1000.0 * rest_m
        ))
    });
    let halves: Vec<String> = halves.collect();
    Some(format!(
        "compared with the poses, the truth seems to be {}, but not all the time; one of the two files lost frames in between, \
         or counts at another rate",
        halves.join(", and ")
    ))
}

/// The shift in ticks that alone corrects the truth in a part of the recording.
fn tick_shift(part: Comparison<'_>) -> Option<TickShift> {
    let search = Search::new(part)?;
    let best = search.in_time()?;
    let TickMap::After(ticks) = best.reading.ticks else {
        return None;
    };
    let rest_m = best
        .distances
        .near_m
        .filter(|_| best.distances.most_m < MAX_REST_SHARE * search.unchanged.most_m)?;
    // The limit of several changes applies: the restriction to a part is one more.
    (rest_m <= MAX_REST_OF_SEVERAL_M).then_some(TickShift { ticks, rest_m })
}

/// A reading and its distances.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    reading: Reading,
    /// Number of changes in the reading.
    changes: usize,
    distances: PairDistances,
}

impl Candidate {
    /// The absolute shift in ticks, if the reading changes nothing else in time.
    fn ticks_apart(&self) -> Option<u64> {
        match self.reading.ticks {
            TickMap::After(0) | TickMap::TwoToOne(_) | TickMap::OneToTwo(_) => None,
            TickMap::After(ticks) => Some(ticks.unsigned_abs()),
        }
    }

    fn is_near_in_time(&self) -> bool {
        let ticks = self.ticks_apart();
        ticks.is_some_and(|ticks| ticks <= MAX_TICK_SHIFT.unsigned_abs())
    }

    fn is_far_in_time(&self) -> bool {
        self.ticks_apart().is_some() && !self.is_near_in_time()
    }
}

/// Whether a reading with this number of changes is accepted, given the distance that it leaves, metres.
fn is_corrected(changes: usize, near_m: Option<f64>) -> bool {
    let most_m = match changes {
        0 | 1 => MAX_REST_M,
        2..=MAX_CHANGES => MAX_REST_OF_SEVERAL_M,
        _ => return false,
    };
    near_m.is_some_and(|near_m| near_m <= most_m)
}

struct Search<'a> {
    comparison: Comparison<'a>,
    unchanged: PairDistances,
    /// Sets of pairs that may be correct, each a start for estimating the place.
    seeds: Vec<Vec<BodyPair<'a>>>,
}

impl<'a> Search<'a> {
    fn new(comparison: Comparison<'a>) -> Option<Self> {
        let pairs = comparison.pairs(&Reading::unchanged());
        let unchanged = PairDistances::from_pairs(&pairs)?;
        let mut seeds = vec![nearest(pairs)];
        // If everything is far away, the nearest pose is no evidence.
        if unchanged.most_m > GATE_M / 2.0 {
            seeds.extend(comparison.tracks());
        }
        Some(Self {
            comparison,
            unchanged,
            seeds,
        })
    }

    fn best(&self) -> Option<Misfit> {
        let mut read: Vec<Candidate> = self.in_time().into_iter().collect();
        read.extend(self.far_in_time());
        read.extend(self.in_parts());
        for names in [NameMap::Unchanged, NameMap::SidesExchanged] {
            for hand in [Handedness::Unchanged, Handedness::Mirrored] {
                read.extend(self.in_space(names, hand));
            }
        }
        read.retain(|it| it.distances.most_m < MAX_REST_SHARE * self.unchanged.most_m);
        let rests_m = read.iter().map(|it| it.distances.most_m);
        let alike_m = ALIKE * rests_m.min_by(f64::total_cmp)? + ALIKE_M;
        read.retain(|it| it.distances.most_m <= alike_m);
        read.retain(|it| is_corrected(it.changes, it.distances.near_m));
        let fewest = read.iter().map(|it| it.changes).min()?;
        read.retain(|it| it.changes == fewest);
        // Periodic motion fits many ticks later as well as a few ticks earlier.
        if read.iter().any(Candidate::is_near_in_time) {
            read.retain(|it| !it.is_far_in_time());
        }
        read.sort_by(|a, b| a.distances.most_m.total_cmp(&b.distances.most_m));
        read.truncate(MAX_READINGS);
        Some(Misfit {
            rest_m: read.first()?.distances.near_m?,
            readings: read.into_iter().map(|it| it.reading).collect(),
        })
    }

    /// The best reading at other ticks.
    fn in_time(&self) -> Option<Candidate> {
        let apart = -MAX_TICK_SHIFT..=MAX_TICK_SHIFT;
        let shifts = apart.filter(|&ticks| ticks != 0).map(TickMap::After);
        let starts = [Some([Tick(0); 2]), self.comparison.first_ticks()];
        let rates = starts
            .into_iter()
            .flatten()
            .flat_map(|from| [TickMap::TwoToOne(from), TickMap::OneToTwo(from)]);
        let read = shifts.chain(rates).filter_map(|ticks| {
            let reading = Reading {
                ticks,
                ..Reading::unchanged()
            };
            self.evaluated(reading, 1)
        });
        read.min_by(|a, b| a.distances.most_m.total_cmp(&b.distances.most_m))
    }

    /// Of the equivalent readings with a large shift, the one with the smallest shift.
    fn far_in_time(&self) -> Option<Candidate> {
        let of_side = |side: i64| {
            let ticks = MAX_TICK_SHIFT + 1..=MAX_FAR_TICK_SHIFT;
            let evaluated = ticks.map(|ticks| {
                let reading = Reading {
                    ticks: TickMap::After(side * ticks),
                    ..Reading::unchanged()
                };
                self.evaluated(reading, 1)
            });
            let evaluated: Vec<Option<Candidate>> = evaluated.collect();
            let most_m = |i: usize| evaluated.get(i)?.map(|it| it.distances.most_m);
            // On both sides of the correct shift the distance grows. A wrong shift that is better than its neighbours is also
            // a minimum.
            let is_minimum = |i: &usize| {
                let neighbours = [i.checked_sub(1), Some(i + 1)].into_iter().flatten();
                let mut neighbours_m = neighbours.filter_map(most_m);
                most_m(*i).is_some_and(|own_m| neighbours_m.all(|m| own_m < m))
            };
            let minima = (0..evaluated.len()).filter(is_minimum);
            minima.filter_map(|i| evaluated[i]).collect::<Vec<_>>()
        };
        let mut candidates = [of_side(-1), of_side(1)].concat();
        candidates.retain(|it| self.is_better_at_same_ticks(it));
        let best_m = candidates.iter().map(|it| it.distances.most_m);
        let alike_m = ALIKE * best_m.min_by(f64::total_cmp)? + ALIKE_M;
        candidates.retain(|it| it.distances.most_m <= alike_m);
        candidates.into_iter().min_by_key(Candidate::ticks_apart)
    }

    /// Whether a shifted reading beats the unchanged truth also at the ticks that it compares, in either file. The ticks that it
    /// leaves out may be the bad ones.
    fn is_better_at_same_ticks(&self, candidate: &Candidate) -> bool {
        let of_both = self.comparison.unchanged_pairs_at(candidate.reading.ticks);
        of_both.iter().all(|pairs| {
            let unchanged = PairDistances::from_pairs(pairs);
            unchanged.is_some_and(|it| candidate.distances.most_m < MAX_REST_SHARE * it.most_m)
        })
    }

    /// Readings with two body parts exchanged.
    fn in_parts(&self) -> impl Iterator<Item = Candidate> {
        let pairs = (0..PARTS.len()).flat_map(|one| (0..one).map(move |other| [other, one]));
        let known = |names| n_shared_kinds(&self.seeds[0], names);
        let n_known = known(NameMap::Unchanged);
        pairs.filter_map(move |parts| {
            let names = NameMap::PartsExchanged(parts);
            // A reading that drops points would look nearer than it is.
            if n_known < MIN_KINDS || known(names) < n_known {
                return None;
            }
            let reading = Reading {
                names,
                ..Reading::unchanged()
            };
            self.evaluated(reading, 1)
        })
    }

    /// Readings with these sides and this hand, for every choice of free parts.
    fn in_space(&self, names: NameMap, hand: Handedness) -> Vec<Candidate> {
        let settled = self
            .seeds
            .iter()
            .filter_map(|seed| self.settled(seed, names, hand))
            .filter(|(pairs, _)| n_shared_kinds(pairs, names) >= MIN_KINDS);
        let best = settled.min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((pairs, _)) = best else {
            return Vec::new();
        };
        let points = shared_points(&pairs, names);
        let is_mirrored = hand == Handedness::Mirrored;
        let more = usize::from(names == NameMap::SidesExchanged) + usize::from(is_mirrored);
        let of_parts = |free: Freedom| {
            let changes = free.count() + more;
            if changes == 0 || is_mirrored && !free.turn {
                return None;
            }
            let reading = Reading {
                ticks: TickMap::After(0),
                names,
                place: Similarity::between(&points, free, hand)?,
            };
            self.evaluated(reading, changes)
        };
        Freedom::choices()
            .into_iter()
            .filter_map(of_parts)
            .collect()
    }

    /// Estimates place and pairs in turn from a seed: the final pairs and their `most_m`, metres.
    fn settled(
        &self,
        seed: &[BodyPair<'a>],
        names: NameMap,
        hand: Handedness,
    ) -> Option<(Vec<BodyPair<'a>>, f64)> {
        let (mut pairs, mut most_m) = (seed.to_vec(), f64::INFINITY);
        for _ in 0..ROUNDS {
            let reading = Reading {
                ticks: TickMap::After(0),
                names,
                place: Similarity::between(&shared_points(&pairs, names), Freedom::ALL, hand)?,
            };
            let next = self.comparison.pairs(&reading);
            most_m = PairDistances::from_pairs(&next)?.most_m;
            pairs = nearest(next);
        }
        Some((pairs, most_m))
    }

    /// `None` if the reading leaves fewer than half of the pairs to compare.
    fn evaluated(&self, reading: Reading, changes: usize) -> Option<Candidate> {
        let distances = PairDistances::from_pairs(&self.comparison.pairs(&reading))?;
        (2 * distances.n >= self.unchanged.n).then_some(Candidate {
            reading,
            changes,
            distances,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_with_more_changes_must_leave_a_smaller_distance() {
        for (changes, near_m) in [(1, 0.1), (2, 0.06), (3, 0.06)] {
            assert!(is_corrected(changes, Some(near_m)));
            assert!(!is_corrected(changes, Some(near_m + 0.001)));
            assert!(!is_corrected(changes, None));
        }
        assert!(!is_corrected(4, Some(0.001)));
    }
}
