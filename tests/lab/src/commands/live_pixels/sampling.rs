//! The error due to ticks that edges skipped.

use std::collections::BTreeSet;

use farfield_proto::tick::Tick;
use farfield_score::lines::PoseLines;
use farfield_score::points::ScoredBody;

/// Mean error at `ticks` of a predictor that knows the truth at the `seen` ticks and extrapolates with the velocity between
/// the last two, millimetres. No tracker does much better from the same ticks.
pub(super) fn sampling_mm(
    truth: &PoseLines,
    seen: &BTreeSet<Tick>,
    ticks: impl Iterator<Item = Tick>,
) -> f64 {
    let (mut sum_m, mut n) = (0.0, 0.0);
    for tick in ticks {
        let mut newest_first = seen.range(..=tick).rev();
        let (Some(last), Some(before)) = (newest_first.next(), newest_first.next()) else {
            continue;
        };
        let share = (tick - *last) as f64 / (*last - *before) as f64;
        let [Some(now), Some(last), Some(before)] =
            [tick, *last, *before].map(|tick| truth.people_at(tick))
        else {
            continue;
        };
        for (person, body) in now {
            let expected = last.get(person).zip(before.get(person));
            let expected = expected.map(|(last, before)| moved_on(last, before, share));
            if let Some(distance_m) = expected.and_then(|it| it.mean_distance_m(body)) {
                sum_m += distance_m;
                n += 1.0;
            }
        }
    }
    1e3 * sum_m / f64::max(n, 1.0)
}

/// `last`, extrapolated by `share` of the step from `before`.
fn moved_on(last: &ScoredBody, before: &ScoredBody, share: f64) -> ScoredBody {
    let mut body = last.clone();
    for (point, before) in body.points_m.iter_mut().zip(&before.points_m) {
        *point = point.zip(*before).map(|(at, was)| at + (at - was) * share);
    }
    body
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_score::lines::LinesRole;
    use farfield_score::points::PointSet;

    use super::*;

    /// A person whose left shoulder has these x at ticks 0, 1, 2 ..., metres.
    fn truth(places_m: &[f64]) -> PoseLines {
        let line = |(tick, x_m): (usize, &f64)| {
            format!(
                "{{\"tick\": {tick}, \"person\": 1, \"joints\": {{\"left_shoulder\": [{x_m}, 0, 1]}}}}\n"
            )
        };
        let text: String = places_m.iter().enumerate().map(line).collect();
        let path = Path::new("truth.jsonl");
        let role = LinesRole::Truth;
        PoseLines::read(text.as_bytes(), path, role, PointSet::Joints, None).unwrap()
    }

    fn cost_mm(places_m: &[f64], seen: &[i64]) -> f64 {
        let seen = seen.iter().map(|tick| Tick(*tick)).collect();
        let ticks = (0..).map(Tick).take(places_m.len());
        sampling_mm(&truth(places_m), &seen, ticks)
    }

    #[test]
    fn every_tick_or_a_steady_walk_costs_nothing() {
        assert!(cost_mm(&[0.0, 0.1, 0.5, 0.2], &[0, 1, 2, 3]) < 1e-9);
        assert!(cost_mm(&[0.0, 0.1, 0.2, 0.3, 0.4], &[0, 2]) < 1e-9);
    }

    #[test]
    fn every_other_tick_costs_what_changes_between() {
        // The person moves 0.1 m per tick and stops at tick 2. The error is 0 at tick 2 and 100 mm at tick 3.
        assert!((cost_mm(&[0.0, 0.1, 0.2, 0.2], &[0, 2]) - 50.0).abs() < 1e-6);
    }
}
