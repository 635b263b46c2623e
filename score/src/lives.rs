//! Initiations and returns: the time until a person has a pose, and whether a person who leaves and returns has the old id.
//!
//! Poses are matched as for the accuracy ([`super::matches_at`]). An actor *returns* when the truth contains it again after an
//! absence of more than half a second; shorter gaps, at the edge of the volume, are no absence. A partial truth leaves out
//! people who are present; its returns are those of the annotation.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use farfield_proto::order_statistics::mean_median;
use farfield_proto::tick::Tick;
use serde::{Serialize, Serializer};

use super::lines::PoseLines;
use super::matches_at;

/// An actor that is out of the truth for longer has been away, seconds.
const MIN_AWAY_S: f64 = 0.5;
/// The same in ticks, for an unknown rate.
const MIN_AWAY_TICKS: i64 = 2;

/// Initiations and returns of all actors.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Lives {
    /// Per actor, ticks from its first line of the truth to its first pose, including poses written after confirmation;
    /// `None` if it never had one.
    pub time_to_birth_ticks: BTreeMap<u32, Option<i64>>,
    /// The median over the actors with a pose, seconds; absent without a rate.
    pub time_to_birth_median_s: Option<f64>,
    /// The longest, seconds; absent without a rate.
    pub time_to_birth_worst_s: Option<f64>,
    /// The same for a live client: to the first pose that was published at its tick.
    pub time_to_birth_live_ticks: BTreeMap<u32, Option<i64>>,
    /// The median of these, seconds; absent without a rate.
    pub time_to_birth_live_median_s: Option<f64>,
    /// The longest of these, seconds; absent without a rate.
    pub time_to_birth_live_worst_s: Option<f64>,
    /// Actors that never had a pose.
    pub never_born: u64,
    /// Times that an actor with an earlier pose returned.
    pub returns: u64,
    /// Of these, with the old id.
    pub returns_same_id: u64,
    /// Of these, with another id.
    pub returns_other_id: u64,
    /// The longest time from a return to the next pose, seconds; absent without a rate. An actor that is never found again
    /// counts for as long as the truth contains it.
    pub return_worst_s: Option<f64>,
    /// The ticks and actors without a pose between a return and the next pose; in JSON, their number.
    #[serde(serialize_with = "number_of")]
    pub return_gaps: BTreeSet<(Tick, u32)>,
}

fn number_of<S: Serializer>(gaps: &BTreeSet<(Tick, u32)>, to: S) -> Result<S::Ok, S::Error> {
    gaps.len().serialize(to)
}

fn min_away_ticks(rate_hz: Option<f64>) -> i64 {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "half the rate of cameras; beyond the range it saturates"
    )]
    rate_hz.map_or(MIN_AWAY_TICKS, |rate_hz| {
        (MIN_AWAY_S * rate_hz).ceil().max(1.0) as i64
    })
}

/// The state of one actor.
#[derive(Debug, Clone, Default)]
struct ActorLife {
    /// Its first tick in the truth.
    since: Option<Tick>,
    initiated: Option<Tick>,
    /// The first tick whose pose was published at once.
    published: Option<Tick>,
    /// Its last tick in the truth, and its last id.
    seen: Option<Tick>,
    id: Option<u32>,
    /// The tick of its return, until it has a pose again.
    back: Option<Tick>,
}

impl Lives {
    /// Initiations and returns of the actors of `truth` in `poses`.
    pub fn of(poses: &PoseLines, truth: &PoseLines, rate_hz: Option<f64>) -> Self {
        let mut all: BTreeMap<u32, ActorLife> = BTreeMap::new();
        let mut lives = Self::default();
        let mut longest_return = None;
        let min_away = min_away_ticks(rate_hz);
        for tick in truth.ticks() {
            let matches = matches_at(tick, poses, truth);
            for &actor in truth.people_at(tick).into_iter().flat_map(BTreeMap::keys) {
                let life = all.entry(actor).or_default();
                life.since.get_or_insert(tick);
                lives.returns += u64::from(life.note_presence(tick, min_away));
                let Some(&id) = matches.get(&actor) else {
                    if let Some(back) = life.back {
                        longest_return = longest_return.max(Some(tick + 1 - back));
                        lives.return_gaps.insert((tick, actor));
                    }
                    continue;
                };
                let pose = poses.people_at(tick).and_then(|people| people.get(&id));
                if pose.is_some_and(|pose| !pose.is_tentative) {
                    life.published.get_or_insert(tick);
                }
                if let Some((ticks, before)) = life.note_pose(tick, id) {
                    longest_return = longest_return.max(Some(ticks));
                    lives.returns_same_id += u64::from(before == id);
                    lives.returns_other_id += u64::from(before != id);
                }
            }
        }
        lives.finish(&all, longest_return, rate_hz)
    }

    fn finish(
        mut self,
        all: &BTreeMap<u32, ActorLife>,
        longest_return: Option<i64>,
        rate_hz: Option<f64>,
    ) -> Self {
        let rate = |ticks: f64| rate_hz.map(|rate| ticks / rate);
        let waits = |until: fn(&ActorLife) -> Option<Tick>| {
            let after = |life: &ActorLife| Some(until(life)? - life.since?);
            let each: BTreeMap<u32, Option<i64>> =
                all.iter().map(|(id, life)| (*id, after(life))).collect();
            let mut taken: Vec<f64> = each.values().flatten().map(|&t| t as f64).collect();
            taken.sort_by(f64::total_cmp);
            (each, taken)
        };
        let (each, taken) = waits(|life| life.initiated);
        self.never_born = (all.len() - taken.len()) as u64;
        self.time_to_birth_ticks = each;
        self.time_to_birth_median_s = mean_median(&taken).and_then(rate);
        self.time_to_birth_worst_s = taken.last().copied().and_then(rate);
        let (each, taken) = waits(|life| life.published);
        self.time_to_birth_live_ticks = each;
        self.time_to_birth_live_median_s = mean_median(&taken).and_then(rate);
        self.time_to_birth_live_worst_s = taken.last().copied().and_then(rate);
        self.return_worst_s = longest_return.and_then(|ticks| rate(ticks as f64));
        self
    }
}

impl ActorLife {
    /// Records that the truth contains the actor at `tick`. Returns whether it returned: it had an id, and was away for more
    /// than `min_away` ticks.
    fn note_presence(&mut self, tick: Tick, min_away: i64) -> bool {
        let last = self.seen.replace(tick);
        let back = self.id.is_some() && last.is_some_and(|last| tick - last > min_away);
        if back {
            self.back = Some(tick);
        }
        back
    }

    /// Records a pose at `tick`. For the first pose since a return: the ticks since the return, and the previous id.
    fn note_pose(&mut self, tick: Tick, id: u32) -> Option<(i64, u32)> {
        self.initiated.get_or_insert(tick);
        let before = self.id.replace(id);
        let back = self.back.take()?;
        Some((tick - back, before?))
    }
}

impl fmt::Display for Lives {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let seconds = |s: Option<f64>| s.map_or_else(|| "-".to_owned(), |s| format!("{s:.2} s"));
        write!(
            f,
            "lives: first pose after {} (median) and {} (worst) as written, {} and {} live; never born {}, returns {}",
            seconds(self.time_to_birth_median_s),
            seconds(self.time_to_birth_worst_s),
            seconds(self.time_to_birth_live_median_s),
            seconds(self.time_to_birth_live_worst_s),
            self.never_born,
            self.returns
        )?;
        if self.returns > 0 {
            write!(
                f,
                " (old id {}, another id {}, found after {} at worst)",
                self.returns_same_id,
                self.returns_other_id,
                seconds(self.return_worst_s)
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::path::Path;

    use super::super::lines::LinesRole;
    use super::super::points::PointSet;
    use super::*;

    /// Lines of (tick, person, x).
    fn recording(lines: &[(i64, u32, f64)]) -> PoseLines {
        let mut text = String::new();
        for (tick, person, x) in lines {
            let hip = format!("{{\"left_hip\": [{x}, 0, 1]}}");
            writeln!(
                text,
                "{{\"tick\": {tick}, \"person\": {person}, \"joints\": {hip}}}"
            )
            .unwrap();
        }
        let path = Path::new("x.jsonl");
        PoseLines::read(
            text.as_bytes(),
            path,
            LinesRole::Truth,
            PointSet::Joints,
            None,
        )
        .unwrap()
    }

    fn lives(poses: &[(i64, u32, f64)], truth: &[(i64, u32, f64)]) -> Lives {
        Lives::of(&recording(poses), &recording(truth), Some(10.0))
    }

    #[test]
    fn the_time_to_birth_counts_from_the_first_line_of_the_truth() {
        let mut truth: Vec<_> = (0..10).flat_map(|t| [(t, 1, 0.0), (t, 3, 9.0)]).collect();
        truth.extend((4..10).map(|t| (t, 2, 5.0)));
        let poses: Vec<_> = (3..10).map(|t| (t, 7, 0.0)).chain([(6, 8, 5.0)]).collect();
        let lives = lives(&poses, &truth);
        let expected = [(1, Some(3)), (2, Some(2)), (3, None)];
        assert_eq!(lives.time_to_birth_ticks, BTreeMap::from(expected));
        assert_eq!(lives.never_born, 1);
        assert!((lives.time_to_birth_median_s.unwrap() - 0.25).abs() < 1e-12);
        assert!((lives.time_to_birth_worst_s.unwrap() - 0.3).abs() < 1e-12);
    }

    #[test]
    fn a_live_client_waits_until_the_person_is_confirmed() {
        let truth: Vec<_> = (0..10).map(|t| (t, 1, 0.0)).collect();
        let line = |tick: i64, state: &str| {
            let joints = "{\"left_hip\": [0, 0, 1]}";
            format!(
                "{{\"tick\": {tick}, \"person\": 7, \"state\": \"{state}\", \"joints\": {joints}}}\n"
            )
        };
        let text: String = (2..10)
            .map(|tick| line(tick, if tick < 6 { "tentative" } else { "tracked" }))
            .collect();
        let (path, role) = (Path::new("x.jsonl"), LinesRole::Poses);
        let poses = PoseLines::read(text.as_bytes(), path, role, PointSet::Joints, None).unwrap();
        let lives = Lives::of(&poses, &recording(&truth), Some(10.0));
        assert_eq!(lives.time_to_birth_ticks[&1], Some(2));
        assert_eq!(lives.time_to_birth_live_ticks[&1], Some(6));
        assert!((lives.time_to_birth_live_worst_s.unwrap() - 0.6).abs() < 1e-12);
        assert!(
            lives
                .to_string()
                .contains("as written, 0.60 s and 0.60 s live"),
            "{lives}"
        );
    }

    #[test]
    fn a_returning_person_has_the_old_id_or_another() {
        let truth: Vec<_> = [0, 1, 10, 11, 12, 20, 21]
            .into_iter()
            .map(|t| (t, 1, 0.0))
            .collect();
        let poses = [(0, 7, 0.0), (12, 7, 0.0), (20, 8, 0.0)];
        let lives = lives(&poses, &truth);
        let counts = (lives.returns, lives.returns_same_id, lives.returns_other_id);
        assert_eq!(counts, (2, 1, 1));
        let gaps = BTreeSet::from([(Tick(10), 1), (Tick(11), 1)]);
        assert_eq!(lives.return_gaps, gaps);
        let json = serde_json::to_value(&lives).unwrap();
        assert_eq!(json["return_gaps"], 2);
        assert!((lives.return_worst_s.unwrap() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_gap_of_less_than_half_a_second_is_no_absence() {
        let returns = |back: i64, rate_hz: Option<f64>| {
            let truth = [(0, 1, 0.0), (back, 1, 0.0)];
            let poses = [(0, 7, 0.0)];
            let lives = Lives::of(&recording(&poses), &recording(&truth), rate_hz);
            assert_eq!(lives.return_gaps.len() as u64, lives.returns);
            lives.returns
        };
        assert_eq!((returns(30, Some(60.0)), returns(31, Some(60.0))), (0, 1));
        assert_eq!((returns(1, Some(1.0)), returns(2, Some(1.0))), (0, 1));
        assert_eq!((returns(2, None), returns(3, None)), (0, 1));
    }

    #[test]
    fn a_return_without_a_pose_is_counted() {
        let truth: Vec<_> = [0, 1, 10, 11].into_iter().map(|t| (t, 1, 0.0)).collect();
        let lives = lives(&[(0, 7, 0.0)], &truth);
        let counts = (lives.returns, lives.returns_same_id, lives.returns_other_id);
        assert_eq!(counts, (1, 0, 0));
        let never_s = lives.return_worst_s.unwrap();
        assert!((never_s - 0.2).abs() < 1e-12, "{never_s} s");
        assert!(lives.to_string().contains("returns 1 (old id 0"), "{lives}");
    }
}
