//! Whether a truth that is far from the poses would be near them if it were read in another way.

use farfield_proto::tick::Tick;

use super::comparison::{
    Apart, BodyPair, Comparison, Names, PARTS, Reading, TickMap, kinds, nearest, points_of,
};
use super::similarity::{Freedom, Handedness, Similarity};
use crate::lines::PoseLines;
use crate::pairing::GATE_M;

/// How far ticks are looked for, either way.
const MOST_TICKS_APART: i64 = 10;
/// The same where a file began later than the other: four seconds at 30 Hz.
const FAR_TICKS_APART: i64 = 120;
/// What a reading must leave at most of the distance without it: no noise, and no bias of single joints, goes that far.
const LEFT: f64 = 0.5;
/// A reading that leaves more is none, metres: poses of the people of this truth are nearer. With two changes or more it is to
/// leave less: what is bent so far fits somebody else's truth, too.
const MOST_REST_M: f64 = 0.1;
const MOST_REST_OF_SEVERAL_M: f64 = 0.06;
/// Most things that a reading changes.
const MOST_CHANGES: usize = 3;
/// Least joints or keypoints by which a place is told: with fewer, a bias of one of them passes for another place.
const LEAST_KINDS: usize = 6;
/// Readings that leave as much as the best, or this much more, do as well: the one that changes least is told.
const ALIKE: f64 = 1.25;
const ALIKE_M: f64 = 0.003;
/// Most readings that are told where several do as well.
const MOST_TOLD: usize = 2;
/// Times that bodies are paired and the place is found anew.
const ROUNDS: usize = 4;

/// What would mend a truth.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Misfit {
    /// How it is to be read: one way, or two that do as well. Never empty.
    pub(super) readings: Vec<Reading>,
    /// Mean distance that is left, metres.
    pub(super) rest_m: f64,
}

/// What would mend `truth`, if anything would.
///
/// Cost: some 315 to 565 matchings of at most 200 ticks, whatever the length of the files.
pub(super) fn misfit(poses: &PoseLines, truth: &PoseLines) -> Option<Misfit> {
    Search::new(Comparison::of(poses, truth)?)?.found()
}

/// By how many ticks a truth is off.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TicksApart {
    /// Ticks, of the poses after the truth.
    pub(super) ticks: i64,
    /// Mean distance that is left with them, metres.
    pub(super) rest_m: f64,
}

/// By how many ticks the truth of a part of the time is off, if that alone mends it.
pub(super) fn ticks_apart(part: Comparison<'_>) -> Option<TicksApart> {
    let search = Search::new(part)?;
    let best = search.in_time()?;
    let TickMap::After(ticks) = best.reading.ticks else {
        return None;
    };
    let rest_m = best
        .apart
        .near_m
        .filter(|_| best.apart.most_m < LEFT * search.as_it_is.most_m)?;
    // As little as of several changes: that it is of a part is one more.
    (rest_m <= MOST_REST_OF_SEVERAL_M).then_some(TicksApart { ticks, rest_m })
}

/// A reading, and what it comes to.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    reading: Reading,
    /// How many things it changes.
    changes: usize,
    apart: Apart,
}

impl Candidate {
    /// By how many ticks it is later or earlier, if it changes just these.
    fn ticks_apart(&self) -> Option<u64> {
        match self.reading.ticks {
            TickMap::After(0) | TickMap::TwoToOne(_) | TickMap::OneToTwo(_) => None,
            TickMap::After(ticks) => Some(ticks.unsigned_abs()),
        }
    }

    fn is_near_in_time(&self) -> bool {
        let ticks = self.ticks_apart();
        ticks.is_some_and(|ticks| ticks <= MOST_TICKS_APART.unsigned_abs())
    }

    fn is_far_in_time(&self) -> bool {
        self.ticks_apart().is_some() && !self.is_near_in_time()
    }
}

/// Whether so many changes may be told of a truth, by what they leave, metres.
fn is_mended(changes: usize, near_m: Option<f64>) -> bool {
    let most_m = match changes {
        0 | 1 => MOST_REST_M,
        2..=MOST_CHANGES => MOST_REST_OF_SEVERAL_M,
        _ => return false,
    };
    near_m.is_some_and(|near_m| near_m <= most_m)
}

struct Search<'a> {
    comparison: Comparison<'a>,
    as_it_is: Apart,
    /// Pairs of bodies that may be right, from which a place is found.
    seeds: Vec<Vec<BodyPair<'a>>>,
}

impl<'a> Search<'a> {
    fn new(comparison: Comparison<'a>) -> Option<Self> {
        let pairs = comparison.pairs(&Reading::as_it_is());
        let as_it_is = Apart::of(&pairs)?;
        let mut seeds = vec![nearest(pairs)];
        // Where all is far, whoever is nearest is anybody.
        if as_it_is.most_m > GATE_M / 2.0 {
            seeds.extend(comparison.tracks());
        }
        Some(Self {
            comparison,
            as_it_is,
            seeds,
        })
    }

    fn found(&self) -> Option<Misfit> {
        let mut read: Vec<Candidate> = self.in_time().into_iter().collect();
        read.extend(self.far_in_time());
        read.extend(self.in_parts());
        for names in [Names::AsTheyAre, Names::SidesExchanged] {
            for hand in [Handedness::Kept, Handedness::Mirrored] {
                read.extend(self.in_space(names, hand));
            }
        }
        read.retain(|it| it.apart.most_m < LEFT * self.as_it_is.most_m);
        let left_m = read.iter().map(|it| it.apart.most_m);
        let alike_m = ALIKE * left_m.min_by(f64::total_cmp)? + ALIKE_M;
        read.retain(|it| it.apart.most_m <= alike_m);
        read.retain(|it| is_mended(it.changes, it.apart.near_m));
        let fewest = read.iter().map(|it| it.changes).min()?;
        read.retain(|it| it.changes == fewest);
        // What recurs is as near many ticks later as it is a few ticks earlier.
        if read.iter().any(Candidate::is_near_in_time) {
            read.retain(|it| !it.is_far_in_time());
        }
        read.sort_by(|a, b| a.apart.most_m.total_cmp(&b.apart.most_m));
        read.truncate(MOST_TOLD);
        Some(Misfit {
            rest_m: read.first()?.apart.near_m?,
            readings: read.into_iter().map(|it| it.reading).collect(),
        })
    }

    /// The best of those with other ticks.
    fn in_time(&self) -> Option<Candidate> {
        let apart = -MOST_TICKS_APART..=MOST_TICKS_APART;
        let shifts = apart.filter(|&ticks| ticks != 0).map(TickMap::After);
        let starts = [Some([Tick(0); 2]), self.comparison.first_ticks()];
        let rates = starts
            .into_iter()
            .flatten()
            .flat_map(|from| [TickMap::TwoToOne(from), TickMap::OneToTwo(from)]);
        let read = shifts.chain(rates).filter_map(|ticks| {
            let reading = Reading {
                ticks,
                ..Reading::as_it_is()
            };
            self.judged(reading, 1)
        });
        read.min_by(|a, b| a.apart.most_m.total_cmp(&b.apart.most_m))
    }

    /// Of those that are many ticks later or earlier, and as near as any of them, the one with the fewest ticks.
    fn far_in_time(&self) -> Option<Candidate> {
        let of_side = |side: i64| {
            let ticks = MOST_TICKS_APART + 1..=FAR_TICKS_APART;
            let judged = ticks.map(|ticks| {
                let reading = Reading {
                    ticks: TickMap::After(side * ticks),
                    ..Reading::as_it_is()
                };
                self.judged(reading, 1)
            });
            let judged: Vec<Option<Candidate>> = judged.collect();
            let most_m = |i: usize| judged.get(i)?.map(|it| it.apart.most_m);
            // On both sides of the right tick people are farther off, as they are a few ticks beside a wrong one that is better
            // than its neighbours.
            let is_lowest = |i: &usize| {
                let beside = [i.checked_sub(1), Some(i + 1)].into_iter().flatten();
                let mut beside_m = beside.filter_map(most_m);
                most_m(*i).is_some_and(|own_m| beside_m.all(|m| own_m < m))
            };
            let lowest = (0..judged.len()).filter(is_lowest);
            lowest.filter_map(|i| judged[i]).collect::<Vec<_>>()
        };
        let mut found = [of_side(-1), of_side(1)].concat();
        found.retain(|it| self.is_of_same_ticks(it));
        let best_m = found.iter().map(|it| it.apart.most_m);
        let alike_m = ALIKE * best_m.min_by(f64::total_cmp)? + ALIKE_M;
        found.retain(|it| it.apart.most_m <= alike_m);
        found.into_iter().min_by_key(Candidate::ticks_apart)
    }

    /// Whether a reading at other ticks is better than the truth as it stands at the same ticks of the one file and of the other,
    /// too: those that it leaves out may be the bad ones.
    fn is_of_same_ticks(&self, candidate: &Candidate) -> bool {
        let of_both = self.comparison.as_it_is_where(candidate.reading.ticks);
        of_both.iter().all(|as_it_is| {
            let apart = Apart::of(as_it_is);
            apart.is_some_and(|it| candidate.apart.most_m < LEFT * it.most_m)
        })
    }

    /// Those with two parts of the body exchanged.
    fn in_parts(&self) -> impl Iterator<Item = Candidate> {
        let pairs = (0..PARTS.len()).flat_map(|one| (0..one).map(move |other| [other, one]));
        let known = |names| kinds(&self.seeds[0], names);
        let n_known = known(Names::AsTheyAre);
        pairs.filter_map(move |parts| {
            let names = Names::PartsExchanged(parts);
            // What a reading leaves out cannot be far off.
            if n_known < LEAST_KINDS || known(names) < n_known {
                return None;
            }
            let reading = Reading {
                names,
                ..Reading::as_it_is()
            };
            self.judged(reading, 1)
        })
    }

    /// Those with the sides and the hand, for every choice of parts.
    fn in_space(&self, names: Names, hand: Handedness) -> Vec<Candidate> {
        let settled = self
            .seeds
            .iter()
            .filter_map(|seed| self.settled(seed, names, hand))
            .filter(|(pairs, _)| kinds(pairs, names) >= LEAST_KINDS);
        let best = settled.min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((pairs, _)) = best else {
            return Vec::new();
        };
        let points = points_of(&pairs, names);
        let is_mirrored = hand == Handedness::Mirrored;
        let more = usize::from(names == Names::SidesExchanged) + usize::from(is_mirrored);
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
            self.judged(reading, changes)
        };
        Freedom::choices()
            .into_iter()
            .filter_map(of_parts)
            .collect()
    }

    /// The pairs to which a seed leads when place and pairs are found in turn, and how far most of them are apart, metres.
    fn settled(
        &self,
        seed: &[BodyPair<'a>],
        names: Names,
        hand: Handedness,
    ) -> Option<(Vec<BodyPair<'a>>, f64)> {
        let (mut pairs, mut most_m) = (seed.to_vec(), f64::INFINITY);
        for _ in 0..ROUNDS {
            let reading = Reading {
                ticks: TickMap::After(0),
                names,
                place: Similarity::between(&points_of(&pairs, names), Freedom::ALL, hand)?,
            };
            let found = self.comparison.pairs(&reading);
            most_m = Apart::of(&found)?.most_m;
            pairs = nearest(found);
        }
        Some((pairs, most_m))
    }

    /// What a reading comes to; `None` where it leaves too little to compare.
    fn judged(&self, reading: Reading, changes: usize) -> Option<Candidate> {
        let apart = Apart::of(&self.comparison.pairs(&reading))?;
        (2 * apart.n >= self.as_it_is.n).then_some(Candidate {
            reading,
            changes,
            apart,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_more_is_changed_the_less_it_must_leave() {
        for (changes, near_m) in [(1, 0.1), (2, 0.06), (3, 0.06)] {
            assert!(is_mended(changes, Some(near_m)));
            assert!(!is_mended(changes, Some(near_m + 0.001)));
            assert!(!is_mended(changes, None));
        }
        assert!(!is_mended(4, Some(0.001)));
    }
}
