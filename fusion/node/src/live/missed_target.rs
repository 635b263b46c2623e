//! Sentences about late edges and a missed target latency: printed when it begins and ends, and contained in the status.

use farfield_node::process::say;

use farfield_fusion::live::target_latency::{KEPT_SHARE, LEFT_OUT_SHARE, RecentTicks};

/// One sentence for each problem that exists.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct MissedTarget {
    target_ms: Option<u64>,
    /// Poses are late.
    late: Option<String>,
    /// At some ticks no edge's patches come in time.
    no_edge: Option<String>,
    /// The patches of some edges come too late.
    too_slow: Option<String>,
}

impl MissedTarget {
    /// Describes how the `recent` ticks missed the target, if there is one, and which edges are late. `names` are those of the
    /// viewpoints, `longest` describes the largest delays.
    pub(super) fn new(
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
        let is_no_edge = target_ms.is_some() && recent.all_late > LEFT_OUT_SHARE;
        let too_slow = recent.too_slow.iter().filter_map(|(index, share)| {
            let name = names.get(*index)?;
            Some(format!("{name} ({} of the ticks)", percent(*share)))
        });
        let too_slow: Vec<String> = too_slow.collect();
        Self {
            target_ms: target_ms.map(|ms| ms as u64),
            late: is_late.map(|share| {
                let share = percent(share);
                format!("{share} of the poses are sent within {target}; {longest}")
            }),
            no_edge: is_no_edge.then(|| {
                let share = percent(recent.all_late);
                format!(
                    "at {share} of the ticks no viewpoint's patches arrive within {target}, so that no one is tracked; {longest}"
                )
            }),
            too_slow: (!too_slow.is_empty()).then(|| {
                let too_slow = too_slow.join(", ");
                format!("patches arrive too late for {target}, and are left out, from viewpoint {too_slow}; recordings and smoothed poses contain them")
            }),
        }
    }

    /// All sentences.
    pub(super) fn words(&self) -> impl Iterator<Item = &String> {
        [&self.late, &self.no_edge, &self.too_slow]
            .into_iter()
            .flatten()
    }

    /// Prints the problems that did not exist `before`, late edges if `is_news`, and the end of all problems.
    pub(super) fn report(&self, before: &Self, is_news: bool) {
        for words in self.new_words(before, is_news) {
            say(format_args!("{words}"));
        }
    }

    fn new_words(&self, before: &Self, is_news: bool) -> Vec<String> {
        let begins = [
            (&self.late, before.late.is_none()),
            (&self.no_edge, before.no_edge.is_none()),
            (&self.too_slow, is_news),
        ];
        let begins = begins.into_iter().filter(|(_, is_new)| *is_new);
        let mut new: Vec<String> = begins.filter_map(|(words, _)| words.clone()).collect();
        if self.words().next().is_none() && before.words().next().is_some() {
            new.push(match self.target_ms {
                Some(ms) => format!(
                    "poses are sent within the {ms} ms of `target_latency_ms` again, with all viewpoints"
                ),
                None => "no viewpoint is late any more".to_owned(),
            });
        }
        new
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn missed(recent: &RecentTicks) -> MissedTarget {
        MissedTarget::new(Some(60.0), recent, &["near", "far"], "fusion takes 9 ms")
    }

    fn on_time() -> RecentTicks {
        RecentTicks {
            in_time: Some(1.0),
            too_slow: Vec::new(),
            is_news: false,
            all_late: 0.0,
        }
    }

    #[test]
    fn a_late_edge_is_reported_once_and_stays_in_the_status() {
        let far = RecentTicks {
            too_slow: vec![(1, 0.97)],
            ..on_time()
        };
        let (before, now) = (missed(&on_time()), missed(&far));
        let new = now.new_words(&before, true);
        let expected = "patches arrive too late for the 60 ms of `target_latency_ms`, and are left out, from viewpoint far (97 % of the ticks); recordings and smoothed poses contain them";
        assert_eq!(new, [expected]);
        assert!(now.new_words(&now, false).is_empty());
        assert_eq!(now.words().collect::<Vec<_>>(), [expected]);
        let over = before.new_words(&now, false);
        assert!(
            over[0].starts_with("poses are sent within the 60 ms"),
            "{over:?}"
        );
        assert!(before.new_words(&before, false).is_empty());
    }

    #[test]
    fn without_a_target_an_edge_is_late_relative_to_the_others() {
        let far = RecentTicks {
            in_time: None,
            too_slow: vec![(1, 0.97)],
            ..on_time()
        };
        let [late, none] = [&far, &on_time()]
            .map(|recent| MissedTarget::new(None, recent, &["near", "far"], "fusion takes 9 ms"));
        let [words] = &late.new_words(&none, true)[..] else {
            panic!("{late:?}");
        };
        assert!(words.contains("the other viewpoints"), "{words}");
        assert!(words.contains("far (97 %"), "{words}");
        assert_eq!(
            none.new_words(&late, false),
            ["no viewpoint is late any more"]
        );
    }

    #[test]
    fn a_tick_without_any_edge_is_reported_with_the_late_edges() {
        let all = RecentTicks {
            in_time: None,
            too_slow: vec![(0, 0.97), (1, 0.97)],
            all_late: 0.97,
            is_news: true,
        };
        let new = missed(&all).new_words(&missed(&on_time()), true);
        assert_eq!(new.len(), 2, "{new:?}");
        assert!(
            new[0].starts_with("at 97 % of the ticks no viewpoint's patches arrive within"),
            "{new:?}"
        );
        assert!(
            new[1].contains("near (97 % of the ticks), far (97 %"),
            "{new:?}"
        );
    }
}
