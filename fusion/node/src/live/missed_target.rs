//! Late edges and a missed target latency, as conditions of the run.

use farfield_fusion::live::target_latency::{KEPT_SHARE, LEFT_OUT_SHARE, RecentTicks};

use super::conditions::Condition;

/// How the `recent` ticks missed the target, if there is one, and which edges are late. `names` are those of the viewpoints,
/// `longest` describes the largest delays.
pub(super) fn missed_target(
    target_ms: Option<f64>,
    recent: &RecentTicks,
    names: &[&str],
    longest: &str,
) -> Vec<Condition> {
    let target = target_ms.map_or_else(
        || "the other viewpoints".to_owned(),
        |ms| format!("the {ms:.0} ms of `target_latency_ms`"),
    );
    let over = target_ms.map_or_else(
        || "no viewpoint is late any more".to_owned(),
        |ms| format!("poses are sent within the {ms:.0} ms of `target_latency_ms` again, with all viewpoints"),
    );
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let mut missed = Vec::new();
    if let Some(share) = recent.in_time.filter(|share| *share < KEPT_SHARE) {
        let share = percent(share);
        let text = format!("{share} of the poses are sent within {target}; {longest}");
        missed.push(Condition::of("late poses").words(text));
    }
    if target_ms.is_some() && recent.all_late > LEFT_OUT_SHARE {
        let share = percent(recent.all_late);
        let text = format!(
            "at {share} of the ticks no viewpoint's patches arrive within {target}, so that no one is tracked; {longest}"
        );
        missed.push(Condition::of("no edge in time").words(text));
    }
    let slow = recent.too_slow.iter();
    let slow = slow.filter_map(|(index, share)| Some((*names.get(*index)?, percent(*share))));
    let (slow, shares): (Vec<&str>, Vec<String>) = slow
        .map(|(name, share)| (name, format!("{name} ({share} of the ticks)")))
        .unzip();
    if !slow.is_empty() {
        // Another set of viewpoints is printed again.
        let key = format!("late viewpoints {}", slow.join(" "));
        let text = format!(
            "patches arrive too late for {target}, and are left out, from viewpoint {}; recordings and smoothed poses contain them",
            shares.join(", ")
        );
        missed.push(Condition::of(key).words(text));
    }
    missed.into_iter().map(|it| it.ends(over.clone())).collect()
}

#[cfg(test)]
mod tests {
    use super::super::conditions::Conditions;
    use super::*;

    fn missed(target_ms: Option<f64>, recent: &RecentTicks) -> Vec<Condition> {
        missed_target(target_ms, recent, &["near", "far"], "fusion takes 9 ms")
    }

    fn on_time() -> RecentTicks {
        RecentTicks {
            in_time: Some(1.0),
            too_slow: Vec::new(),
            all_late: 0.0,
        }
    }

    #[test]
    fn a_late_edge_is_reported_once_and_stays_in_the_status() {
        let far = RecentTicks {
            too_slow: vec![(1, 0.97)],
            ..on_time()
        };
        let mut conditions = Conditions::default();
        let expected = "patches arrive too late for the 60 ms of `target_latency_ms`, and are left out, from viewpoint far (97 % of the ticks); recordings and smoothed poses contain them";
        let target = Some(60.0);
        assert_eq!(conditions.update(missed(target, &far)), [expected]);
        assert!(conditions.update(missed(target, &far)).is_empty());
        assert_eq!(conditions.notices().collect::<Vec<_>>(), [expected]);
        let over = conditions.update(missed(target, &on_time()));
        assert!(
            over[0].starts_with("poses are sent within the 60 ms"),
            "{over:?}"
        );
        assert!(conditions.update(missed(target, &on_time())).is_empty());
    }

    #[test]
    fn without_a_target_an_edge_is_late_relative_to_the_others() {
        let far = RecentTicks {
            in_time: None,
            too_slow: vec![(1, 0.97)],
            ..on_time()
        };
        let mut conditions = Conditions::default();
        let [words] = &conditions.update(missed(None, &far))[..] else {
            panic!("one line was expected");
        };
        assert!(words.contains("the other viewpoints"), "{words}");
        assert!(words.contains("far (97 %"), "{words}");
        assert_eq!(
            conditions.update(missed(None, &on_time())),
            ["no viewpoint is late any more"]
        );
    }

    #[test]
    fn a_tick_without_any_edge_is_reported_with_the_late_edges() {
        let all = RecentTicks {
            in_time: None,
            too_slow: vec![(0, 0.97), (1, 0.97)],
            all_late: 0.97,
        };
        let new = Conditions::default().update(missed(Some(60.0), &all));
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
