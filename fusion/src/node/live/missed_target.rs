//! Which edges are late, and how a target latency is not kept, in words: for the terminal when it begins and when it is over, and for the status.

use farfield_node::process::say;

use crate::live::target_latency::{KEPT_SHARE, LEFT_OUT_SHARE, RecentTicks};

/// Each in words where it is so.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct MissedTarget {
    target_ms: Option<u64>,
    /// Poses are out too late.
    late: Option<String>,
    /// No edge's patches come in time.
    nobody: Option<String>,
    /// Those of some do not.
    too_slow: Option<String>,
}

impl MissedTarget {
    /// What of a target, where there is one, the `recent` ticks have not kept; `names` are those of the viewpoints, `longest` what takes the time.
    pub(super) fn of(
        target_ms: Option<f64>,
        recent: &RecentTicks,
        names: &[&str],
        longest: &str,
    ) -> Self {
        let target = target_ms.map_or_else(
            || "the other viewpoints".to_owned(),
            |ms| format!("the {ms:.0} ms of `target_latency_ms`"),
        );
        let percent = |share: f64| format!("{:.0} %", 100.0 * share);
        let is_late = recent.in_time.filter(|share| *share < KEPT_SHARE);
        let is_nobody = target_ms.is_some() && recent.nobody > LEFT_OUT_SHARE;
        let too_slow = recent.too_slow.iter().filter_map(|(index, share)| {
            let name = names.get(*index)?;
            Some(format!("{name} ({} of the ticks)", percent(*share)))
        });
        let too_slow: Vec<String> = too_slow.collect();
        Self {
            target_ms: target_ms.map(|ms| ms as u64),
            late: is_late.map(|share| {
                let share = percent(share);
                format!("{share} of the poses are out within {target}; {longest}")
            }),
            nobody: is_nobody.then(|| {
                let share = percent(recent.nobody);
                format!(
                    "at {share} of the ticks no viewpoint's patches come within {target}, and nobody is followed; {longest}"
                )
            }),
            too_slow: (!too_slow.is_empty()).then(|| {
                let too_slow = too_slow.join(", ");
                format!("patches come too late for {target}, and are left out, of viewpoint {too_slow}; recordings and smoothed poses have them")
            }),
        }
    }

    /// All of it.
    pub(super) fn words(&self) -> impl Iterator<Item = &String> {
        [&self.late, &self.nobody, &self.too_slow]
            .into_iter()
            .flatten()
    }

    /// Says what was not so `before`, where an edge `is_news` that too, and when all is over.
    pub(super) fn tell(&self, before: &Self, is_news: bool) {
        for words in self.to_tell(before, is_news) {
            say(format_args!("{words}"));
        }
    }

    fn to_tell(&self, before: &Self, is_news: bool) -> Vec<String> {
        let begins = [
            (&self.late, before.late.is_none()),
            (&self.nobody, before.nobody.is_none()),
            (&self.too_slow, is_news),
        ];
        let begins = begins.into_iter().filter(|(_, is_new)| *is_new);
        let mut told: Vec<String> = begins.filter_map(|(words, _)| words.clone()).collect();
        if self.words().next().is_none() && before.words().next().is_some() {
            told.push(match self.target_ms {
                Some(ms) => format!(
                    "poses are out within the {ms} ms of `target_latency_ms` again, with all viewpoints"
                ),
                None => "no viewpoint is late any more".to_owned(),
            });
        }
        told
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn missed(recent: &RecentTicks) -> MissedTarget {
        MissedTarget::of(Some(60.0), recent, &["near", "far"], "fusion takes 9 ms")
    }

    fn kept() -> RecentTicks {
        RecentTicks {
            in_time: Some(1.0),
            too_slow: Vec::new(),
            is_news: false,
            nobody: 0.0,
        }
    }

    #[test]
    fn a_far_edge_is_named_when_it_begins_and_in_the_status_all_the_time() {
        let far = RecentTicks {
            too_slow: vec![(1, 0.97)],
            ..kept()
        };
        let (before, now) = (missed(&kept()), missed(&far));
        let told = now.to_tell(&before, true);
        let expected = "patches come too late for the 60 ms of `target_latency_ms`, and are left out, of viewpoint far (97 % of the ticks); recordings and smoothed poses have them";
        assert_eq!(told, [expected]);
        assert!(now.to_tell(&now, false).is_empty());
        assert_eq!(now.words().collect::<Vec<_>>(), [expected]);
        let over = before.to_tell(&now, false);
        assert!(
            over[0].starts_with("poses are out within the 60 ms"),
            "{over:?}"
        );
        assert!(before.to_tell(&before, false).is_empty());
    }

    #[test]
    fn without_a_target_an_edge_is_late_against_the_others() {
        let far = RecentTicks {
            in_time: None,
            too_slow: vec![(1, 0.97)],
            ..kept()
        };
        let [late, none] = [&far, &kept()]
            .map(|recent| MissedTarget::of(None, recent, &["near", "far"], "fusion takes 9 ms"));
        let told = late.to_tell(&none, true);
        assert!(
            told[0].contains("too late for the other viewpoints") && told[0].contains("far (97 %"),
            "{told:?}"
        );
        assert_eq!(
            none.to_tell(&late, false),
            ["no viewpoint is late any more"]
        );
    }

    #[test]
    fn that_no_edge_makes_it_is_told_beside_who_they_are() {
        let all = RecentTicks {
            in_time: None,
            too_slow: vec![(0, 0.97), (1, 0.97)],
            nobody: 0.97,
            is_news: true,
        };
        let told = missed(&all).to_tell(&missed(&kept()), true);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(
            told[0].starts_with("at 97 % of the ticks no viewpoint's patches come within"),
            "{told:?}"
        );
        assert!(
            told[1].contains("near (97 % of the ticks), far (97 %"),
            "{told:?}"
        );
    }
}
