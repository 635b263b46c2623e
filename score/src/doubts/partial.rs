//! Whether a truth that was taken for whole seems to have been annotated in part.

use crate::lines::PoseLines;

/// Share of the poses' ticks, or of their people, below which a truth has clearly fewer: every second tick, or two of three people,
/// but nobody who was away for a while, or a short-lived pose of nobody.
const CLEARLY_FEWER: f64 = 0.7;
/// Ticks below which nothing is said.
const LEAST_TICKS: usize = 10;
/// What it may be: nobody here knows which of the two it is.
const EITHER: &str = "either the truth was annotated in part (then say `--truth partial`), or the poses hold people who were \
                      not there";

/// What a truth leaves out, in a sentence.
pub(super) fn partial(poses: &PoseLines, truth: &PoseLines) -> Option<String> {
    let is_fewer = |part: usize, of: usize| (part as f64) < CLEARLY_FEWER * of as f64;
    let span = truth.ticks().next()?..=truth.ticks().last()?;
    let in_truth = truth.ticks().count();
    let in_poses = poses.ticks().filter(|tick| span.contains(tick)).count();
    if in_poses >= LEAST_TICKS && is_fewer(in_truth, in_poses) {
        return Some(format!(
            "from its first tick to its last the truth holds people at {in_truth} ticks, the poses do at {in_poses}: at the \
             others they count as poses of nobody; {EITHER}"
        ));
    }
    let (mut shared, mut true_people, mut found_people) = (0, 0, 0);
    for tick in truth.ticks() {
        if let Some((truths, found)) = truth.people_at(tick).zip(poses.people_at(tick)) {
            shared += 1;
            true_people += truths.len();
            found_people += found.len();
        }
    }
    (shared >= LEAST_TICKS && is_fewer(true_people, found_people)).then(|| {
        let mean = |people: usize| people as f64 / shared as f64;
        format!(
            "the truth holds {:.1} people on average where the poses hold {:.1}: the others count as poses of nobody; {EITHER}",
            mean(true_people),
            mean(found_people)
        )
    })
}
