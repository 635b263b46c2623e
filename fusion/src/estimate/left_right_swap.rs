//! Detects and undoes left-right swaps of a network in a single view.
//!
//! A network that sees a person from an unusual side may report the left side as the right one. The
//! prediction is more reliable, as long as it has not been misled itself. If both maps of a pair
//! fit the prediction clearly better crosswise than straight, the view has swapped them. A *second*
//! peak at the opposite limb is different: then the straight peak is also in its place, and the
//! maps stay ([`crate::estimate::peak_assignment`] assigns the second peak). If most views are
//! crosswise, the prediction is wrong, and no view is changed.
//!
//! Compares maps with predictions within one view only, cells with cells.

use crate::estimate::evidence::View;
use farfield_proto::keypoints::KeypointSet;

/// Keypoints with a left and a right one.
const PAIRED: [&str; 8] = [
    "eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle",
];
/// Least distance of the two predictions in the view, in sigmas of a peak: closer ones are one
/// peak.
const LEAST_APART_SIGMAS: f64 = 2.5;
/// Search range of a peak around a prediction, along both axes, in sigmas of a peak...
const REACH_SIGMAS: f64 = 2.0;
/// ...and at most, in distances of the two predictions: the two windows never overlap.
const REACH_OF_APART: f64 = 0.35;
/// Least swapped pairs in one view for the whole body to be swapped...
const WHOLE_BODY_PAIRS: usize = 3;
/// ...if there are at least this many of them for each that is not.
const WHOLE_BODY_RATIO: usize = 3;

/// The decision of a view on one pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum SwapDecision {
    /// Too close together, not seen, or ambiguous.
    #[default]
    Unclear,
    Straight,
    Crosswise,
}

/// A view's decisions on all pairs.
type Verdicts = [SwapDecision; PAIRED.len()];

/// The left and right keypoints of a network, and the decisions of a tick.
#[derive(Debug, Clone)]
pub(crate) struct LeftRightSwaps {
    pairs: [Option<(usize, usize)>; PAIRED.len()],
    decisions: Vec<Verdicts>,
}

impl LeftRightSwaps {
    pub(crate) fn new(keypoints: &KeypointSet) -> Self {
        let index = |side: &str, joint: &str| keypoints.index_of(&format!("{side}_{joint}"));
        Self {
            pairs: PAIRED.map(|joint| Some((index("left", joint)?, index("right", joint)?))),
            decisions: Vec::new(),
        }
    }

    /// Undoes the swaps in the `views` of one person; their predictions are set. `margin` is how
    /// much higher, 0 to 1, each of the two maps must be crosswise than straight. Returns how many
    /// pairs were swapped back, over all views.
    pub(crate) fn undo(&mut self, views: &mut [View], margin: f64) -> usize {
        self.decisions.clear();
        for view in &*views {
            let verdict = |pair: &Option<(usize, usize)>| {
                pair.map_or(SwapDecision::Unclear, |pair| judge(view, pair, margin))
            };
            self.decisions.push(self.pairs.each_ref().map(verdict));
        }
        if !self
            .decisions
            .iter()
            .flatten()
            .any(|v| *v == SwapDecision::Crosswise)
        {
            return 0;
        }
        let bodies = self.count(whole_body);
        let mut undone = 0;
        for (i, pair) in self.pairs.iter().enumerate() {
            let Some((left, right)) = *pair else { continue };
            let counts = self.count(|decisions| decisions[i]);
            for (view, decisions) in views.iter_mut().zip(&self.decisions) {
                let body = whole_body(*decisions) == SwapDecision::Crosswise && is_minority(bodies);
                let swapped = match decisions[i] {
                    SwapDecision::Crosswise => body || is_minority(counts),
                    SwapDecision::Unclear => body,
                    SwapDecision::Straight => false,
                };
                if swapped {
                    view.swap(left, right);
                    undone += 1;
                }
            }
        }
        undone
    }

    /// How many views are crosswise and straight.
    fn count(&self, of: impl Fn(Verdicts) -> SwapDecision) -> (usize, usize) {
        let n = |wanted| self.decisions.iter().filter(|v| of(**v) == wanted).count();
        (n(SwapDecision::Crosswise), n(SwapDecision::Straight))
    }
}

/// Whether the crosswise views are the wrong ones: the model has a vote too.
fn is_minority((crosswise, straight): (usize, usize)) -> bool {
    crosswise <= straight
}

fn whole_body(decisions: Verdicts) -> SwapDecision {
    let n = |wanted| decisions.iter().filter(|v| **v == wanted).count();
    let (crosswise, straight) = (n(SwapDecision::Crosswise), n(SwapDecision::Straight));
    if crosswise >= WHOLE_BODY_PAIRS && crosswise >= WHOLE_BODY_RATIO * straight {
        SwapDecision::Crosswise
    } else if straight >= WHOLE_BODY_PAIRS && straight >= WHOLE_BODY_RATIO * crosswise {
        SwapDecision::Straight
    } else {
        SwapDecision::Unclear
    }
}

/// Decides from the two maps of a pair.
fn judge(view: &View, (left, right): (usize, usize), margin: f64) -> SwapDecision {
    let cells = [left, right].map(|k| view.expected(k).map(|expected| expected.cell));
    let [Some(at_left), Some(at_right)] = cells else {
        return SwapDecision::Unclear;
    };
    let (apart, sigma) = ((at_left - at_right).norm(), view.peak_sigma_cells());
    if apart < LEAST_APART_SIGMAS * sigma || !view.share_a_crop(left, right) {
        return SwapDecision::Unclear;
    }
    let reach = (REACH_SIGMAS * sigma).min(REACH_OF_APART * apart);
    // How much higher a map is at the place of the other side.
    let crosswise = |keypoint, straight, across| {
        view.highest_near(keypoint, across, reach) - view.highest_near(keypoint, straight, reach)
    };
    let of_left = crosswise(left, at_left, at_right);
    if of_left.abs() < margin {
        return SwapDecision::Unclear;
    }
    let of_right = crosswise(right, at_right, at_left);
    if of_left >= margin && of_right >= margin {
        SwapDecision::Crosswise
    } else if of_left <= -margin && of_right <= -margin {
        SwapDecision::Straight
    } else {
        SwapDecision::Unclear
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::keypoints::COCO17;

    use super::super::meeting_fixture::{
        Drawn, LEFT_ELBOW, LEFT_WRIST, MeetingFixture, RIGHT_WRIST,
    };
    use super::*;

    const MARGIN: f64 = 0.25;

    /// One person in all views of the hall; `change` edits the drawing of a view.
    fn seen(change: impl Fn(usize, Vec<Drawn>) -> Vec<Drawn>) -> MeetingFixture {
        let mut meeting = MeetingFixture::at(&[[0.3, -0.2, 0.0]]);
        meeting.begin();
        for camera in 0..meeting.hall.cameras.len() {
            let drawn = change(camera, meeting.true_peaks(0));
            meeting.show(0, camera, &drawn);
        }
        meeting.place();
        meeting
    }

    fn other_side(keypoint: usize) -> usize {
        let name = COCO17[keypoint];
        let other = match name.split_once('_') {
            Some(("left", joint)) => format!("right_{joint}"),
            Some(("right", joint)) => format!("left_{joint}"),
            _ => name.to_owned(),
        };
        KeypointSet::coco17().index_of(&other).unwrap()
    }

    fn swapped(drawn: Vec<Drawn>, which: impl Fn(usize) -> bool) -> Vec<Drawn> {
        let change = |(k, at_m, height): Drawn| {
            let k = if which(k) { other_side(k) } else { k };
            (k, at_m, height)
        };
        drawn.into_iter().map(change).collect()
    }

    fn undo(meeting: &mut MeetingFixture) -> usize {
        let mut swaps = LeftRightSwaps::new(&meeting.method.keypoints);
        swaps.undo(meeting.tracks[0].views_mut(), MARGIN)
    }

    fn is_unswapped(meeting: &MeetingFixture, view: usize) -> bool {
        let truth = meeting.tracks[0].keypoints_m();
        let mut keypoints = truth.iter().enumerate();
        keypoints.all(|(k, &at_m)| meeting.value(0, view, k, at_m) > 0.7)
    }

    #[test]
    fn wrists_swapped_in_one_view_are_restored() {
        let is_wrist = |k| k == LEFT_WRIST || k == RIGHT_WRIST;
        let mut meeting = seen(|camera, drawn| swapped(drawn, |k| camera == 1 && is_wrist(k)));
        assert!(!is_unswapped(&meeting, 1));
        assert_eq!(undo(&mut meeting), 1);
        assert!((0..4).all(|view| is_unswapped(&meeting, view)));
    }

    #[test]
    fn a_body_swapped_in_one_view_is_restored_as_a_whole() {
        let mut meeting = seen(|camera, drawn| swapped(drawn, |_| camera == 2));
        // The eyes are too close together for a decision, and follow the rest.
        assert_eq!(undo(&mut meeting), PAIRED.len());
        assert!((0..4).all(|view| is_unswapped(&meeting, view)));
    }

    #[test]
    fn two_of_four_swapped_views_are_restored() {
        let mut meeting = seen(|camera, drawn| swapped(drawn, |_| camera < 2));
        undo(&mut meeting);
        assert!((0..4).all(|view| is_unswapped(&meeting, view)));
    }

    #[test]
    fn with_most_views_crosswise_no_view_is_changed() {
        let mut meeting = seen(|camera, drawn| swapped(drawn, |_| camera < 3));
        assert_eq!(undo(&mut meeting), 0);
        assert!(is_unswapped(&meeting, 3) && !is_unswapped(&meeting, 0));
    }

    #[test]
    fn a_second_peak_at_the_opposite_limb_is_no_swap() {
        let mut meeting = seen(|camera, mut drawn| {
            if camera == 1 {
                let (left, right) = (drawn[LEFT_WRIST].1, drawn[RIGHT_WRIST].1);
                drawn.push((LEFT_WRIST, right, 0.99));
                drawn.push((RIGHT_WRIST, left, 0.99));
            }
            drawn
        });
        assert_eq!(undo(&mut meeting), 0);
    }

    #[test]
    fn one_wrist_shown_for_both_is_no_swap() {
        let mut meeting = seen(|camera, mut drawn| {
            if camera == 1 {
                drawn[LEFT_WRIST].1 = drawn[RIGHT_WRIST].1;
            }
            drawn
        });
        assert_eq!(undo(&mut meeting), 0);
    }

    #[test]
    fn an_unseen_limb_is_no_swap() {
        let mut meeting = seen(|camera, mut drawn| {
            drawn.retain(|(k, _, _)| camera != 1 || *k != LEFT_ELBOW);
            drawn
        });
        assert_eq!(undo(&mut meeting), 0);
    }

    #[test]
    fn undoing_two_swapped_views_corrects_the_search() {
        let worst_m = |undone: bool| {
            let mut meeting = seen(|camera, drawn| swapped(drawn, |_| camera < 2));
            if undone {
                undo(&mut meeting);
            }
            let truth = meeting.tracks[0].keypoints_m();
            meeting.tracks[0].search(&meeting.method);
            let estimates = meeting.tracks[0].estimates().iter().zip(&truth);
            let weak = estimates.clone().map(|(e, _)| e.weight).fold(1.0, f64::min);
            let errors_m = estimates.map(|(e, at_m)| (e.position_m - at_m).norm());
            (errors_m.fold(0.0, f64::max), weak)
        };
        let (misled, undone) = (worst_m(false), worst_m(true));
        println!("worst error in metres, least weight: {misled:?}, undone {undone:?}");
        assert!(undone.0 < 0.01 && undone.1 > 0.8, "{undone:?}");
        assert!(misled.1 < 0.6 * undone.1, "{misled:?}");
    }
}
