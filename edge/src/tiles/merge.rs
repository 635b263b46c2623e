//! Merging of the detections of overlapping windows into one list.

use crate::inference::{Detection, DetectorWindow};

/// Overlap (intersection over union) from which two boxes are one person; YOLOX's default.
const SAME_PERSON: f32 = 0.45;

/// Distance to an edge of its window within which a box counts as cut, input pixels: the accuracy
/// of detectors' boxes.
const AT_EDGE_INPUT_PX: f64 = 3.0;

/// Two boxes are one person under three conditions. At least [`INSIDE`] of the smaller box is
/// inside the larger one. Its area is at least [`ALIKE`] of the larger one's (a more distant person
/// is smaller). Their upper edges differ by at most [`AT_TOP`] of the larger one's height: head and
/// trunk belong to the person, a person who sits in front does not.
const INSIDE: f32 = 0.8;
const ALIKE: f32 = 1.0 / 3.0;
const AT_TOP: f32 = 0.2;

/// Share of a cut box inside a complete one from which it is a part of that person.
const PART_OF: f32 = 0.6;

/// The detections of the windows of a picture of `picture_px` (width and height) as one list,
/// highest score first.
///
/// A box cut by the edge of its window is dropped in two cases. Either another window of the same
/// or finer scale contains its place completely, whatever it detected there. Or the box is a part
/// of a complete box in another window. Of overlapping boxes the one with the highest score stays.
pub fn merged(
    found: &[(DetectorWindow, Vec<Detection>)],
    input_px: [u32; 2],
    picture_px: [u32; 2],
) -> Vec<Detection> {
    let is_whole = |window: &DetectorWindow, d: &Detection| {
        window.holds(
            outer(d),
            AT_EDGE_INPUT_PX / window.scale(input_px),
            picture_px,
        )
    };
    let all = || {
        found
            .iter()
            .flat_map(|(w, list)| list.iter().map(move |d| (w, d)))
    };
    let mut kept: Vec<Detection> = Vec::new();
    for (window, detection) in all() {
        if !is_whole(window, detection) {
            let is_covered = found.iter().any(|(other, _)| {
                other != window
                    && other.size_px[0] <= window.size_px[0]
                    && is_whole(other, detection)
            });
            let is_part = all().any(|(other, whole)| {
                other != window && is_whole(other, whole) && part(detection, whole) > PART_OF
            });
            if is_covered || is_part {
                continue;
            }
        }
        kept.push(*detection);
    }
    // Stable, so that equal pictures give equal lists.
    kept.sort_by(|a, b| b.score.total_cmp(&a.score));
    thinned_out(kept)
}

/// Non-maximum suppression of boxes sorted by score, highest first.
pub fn thinned_out(found: Vec<Detection>) -> Vec<Detection> {
    let mut kept: Vec<Detection> = Vec::new();
    for candidate in found {
        if !kept.iter().any(|other| is_same_person(other, &candidate)) {
            kept.push(candidate);
        }
    }
    kept
}

fn is_same_person(a: &Detection, b: &Detection) -> bool {
    let [small, large] = if area(size(a)) < area(size(b)) {
        [a, b]
    } else {
        [b, a]
    };
    let is_alike = area(size(small)) > ALIKE * area(size(large));
    let lower_px = (small.min_px[1] - large.min_px[1]).abs();
    let is_upper_part = lower_px < AT_TOP * size(large)[1] && part(small, large) > INSIDE;
    overlap(a, b) >= SAME_PERSON || is_alike && is_upper_part
}

/// Left, top, right and bottom, from the picture's outer corner.
fn outer(d: &Detection) -> [f64; 4] {
    let [l, t] = d.min_px.map(|v| f64::from(v) + 0.5);
    let [r, b] = d.max_px.map(|v| f64::from(v) + 0.5);
    [l, t, r, b]
}

fn area(size: [f32; 2]) -> f32 {
    size[0].max(0.0) * size[1].max(0.0)
}

fn size(d: &Detection) -> [f32; 2] {
    [0, 1].map(|i| d.max_px[i] - d.min_px[i])
}

fn shared(a: &Detection, b: &Detection) -> f32 {
    area([0, 1].map(|i| a.max_px[i].min(b.max_px[i]) - a.min_px[i].max(b.min_px[i])))
}

/// Intersection over union.
fn overlap(a: &Detection, b: &Detection) -> f32 {
    let both = shared(a, b);
    both / (area(size(a)) + area(size(b)) - both).max(f32::MIN_POSITIVE)
}

/// Share of `a` inside `b`.
fn part(a: &Detection, b: &Detection) -> f32 {
    shared(a, b) / area(size(a)).max(f32::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    const INPUT_PX: [u32; 2] = [400, 250];
    const PICTURE_PX: [u32; 2] = [1600, 1000];

    fn at([l, t, r, b]: [f32; 4], score: f32) -> Detection {
        Detection {
            min_px: [l, t],
            max_px: [r, b],
            score,
        }
    }

    fn window(min_px: [f64; 2], size_px: [f64; 2]) -> DetectorWindow {
        DetectorWindow { min_px, size_px }
    }

    fn whole() -> DetectorWindow {
        window([0.0; 2], [1600.0, 1000.0])
    }

    #[test]
    fn a_person_in_two_windows_keeps_the_box_of_highest_score() {
        let (a, b) = (
            at([380.0, 100.0, 400.0, 150.0], 0.6),
            at([381.0, 101.0, 401.0, 151.0], 0.8),
        );
        let tiles = [
            (window([0.0; 2], [500.0, 312.5]), vec![a]),
            (window([300.0, 0.0], [500.0, 312.5]), vec![b]),
        ];
        assert_eq!(merged(&tiles, INPUT_PX, PICTURE_PX), [b]);
    }

    #[test]
    fn a_cut_box_is_dropped_if_another_window_contains_its_place() {
        let cut = at([480.0, 100.0, 499.5, 150.0], 0.9);
        let all = at([480.0, 98.0, 530.0, 152.0], 0.5);
        let left = window([0.0; 2], [500.0, 312.5]);
        let right = window([300.0, 0.0], [500.0, 312.5]);
        let both = [(left, vec![cut]), (right, vec![all])];
        assert_eq!(merged(&both, INPUT_PX, PICTURE_PX), [all]);
        // The other window contains the place and detects no person there.
        let denied = [(left, vec![cut]), (right, vec![])];
        assert_eq!(merged(&denied, INPUT_PX, PICTURE_PX), []);
        // No other window is as fine there.
        let alone = [(whole(), vec![]), (left, vec![cut])];
        assert_eq!(merged(&alone, INPUT_PX, PICTURE_PX), [cut]);
    }

    #[test]
    fn a_leg_in_a_tile_is_a_part_of_a_near_person() {
        let person = at([450.0, 50.0, 700.0, 900.0], 0.7);
        let leg = at([480.0, 250.0, 560.0, 312.0], 0.8);
        let found = [
            (whole(), vec![person]),
            (window([300.0, 0.0], [500.0, 312.5]), vec![leg]),
        ];
        assert_eq!(merged(&found, INPUT_PX, PICTURE_PX), [person]);
    }

    #[test]
    fn a_person_at_the_edge_of_the_picture_is_not_cut_by_a_window() {
        let leaving = at([-0.5, 400.0, 40.0, 600.0], 0.7);
        let found = [
            (whole(), vec![leaving]),
            (window([0.0, 350.0], [500.0, 312.5]), vec![]),
        ];
        assert_eq!(merged(&found, INPUT_PX, PICTURE_PX), [leaving]);
    }

    #[test]
    fn of_overlapping_boxes_the_one_of_highest_score_stays() {
        let at = |x: f32, score| at([x, 0.0, x + 10.0, 20.0], score);
        let kept = thinned_out(vec![at(1.0, 0.9), at(0.0, 0.5), at(30.0, 0.4)]);
        assert_eq!(kept, [at(1.0, 0.9), at(30.0, 0.4)]);
    }

    #[test]
    fn a_person_half_hidden_by_another_stays() {
        let front = at([0.0, 0.0, 40.0, 100.0], 0.8);
        for hidden in [0.5, 0.55, 0.6] {
            let offset = 40.0 * (1.0 - hidden);
            let behind = at([offset, 1.0, offset + 40.0, 99.0], 0.5);
            assert_eq!(thinned_out(vec![front, behind]), [front, behind]);
        }
    }

    #[test]
    fn a_person_crouching_in_front_of_another_stays() {
        let standing = at([0.0, 0.0, 36.0, 100.0], 0.8);
        let crouching = at([-6.0, 45.0, 44.0, 103.0], 0.6);
        let sitting = at([2.0, 50.0, 34.0, 100.0], 0.6);
        for low in [crouching, sitting] {
            assert_eq!(thinned_out(vec![standing, low]), [standing, low]);
        }
    }

    #[test]
    fn head_and_trunk_are_no_second_person() {
        let person = at([0.0, 0.0, 40.0, 100.0], 0.8);
        let upper = at([3.0, 0.0, 40.0, 45.0], 0.5);
        let far_away = at([10.0, 60.0, 22.0, 95.0], 0.4);
        assert_eq!(
            thinned_out(vec![person, upper, far_away]),
            [person, far_away]
        );
    }
}
