//! What cameras saw in pictures of a recording: no body twice, and when it was.

use farfield_calibration::people::{DetectedFrame, Detection};

/// How far two bodies of one picture may be from each other to be the same, as a share of how large they are.
const SAME_SHARE: f64 = 0.2;

/// What one camera saw at a tick.
pub(super) struct SeenFrame {
    pub(super) tick: f64,
    /// When the picture was taken, seconds after its tick; `None` where only sightings are of it, which do not say.
    pub(super) offset_s: Option<f64>,
    pub(super) bodies: Vec<Detection>,
}

/// Frames whose numbers are their ticks.
pub(super) fn by_tick(frames: Vec<SeenFrame>) -> Vec<DetectedFrame> {
    let each = frames.into_iter().map(|it| DetectedFrame {
        frame: it.tick,
        bodies: it.bodies,
    });
    each.collect()
}

/// Frames whose numbers are when their pictures were taken, in ticks. What says nothing of that is as far from its tick as the
/// nearest picture of the same camera that does.
pub(super) fn by_capture(frames: Vec<SeenFrame>, rate_hz: f64) -> Vec<DetectedFrame> {
    let known = frames.iter().filter_map(|it| Some((it.tick, it.offset_s?)));
    let known: Vec<(f64, f64)> = known.collect();
    let nearest_s = |tick: f64| {
        let after = known.partition_point(|(it, _)| *it < tick);
        let around = [after.checked_sub(1), Some(after)];
        let around = around.into_iter().filter_map(|it| known.get(it?));
        let nearest = around.min_by(|(a, _), (b, _)| (a - tick).abs().total_cmp(&(b - tick).abs()));
        nearest.map_or(0.0, |(_, offset_s)| *offset_s)
    };
    let mut last = f64::NEG_INFINITY;
    let each = frames.into_iter().filter_map(|it| {
        let frame = it.tick + it.offset_s.unwrap_or_else(|| nearest_s(it.tick)) * rate_hz;
        // Two pictures of one moment: a clock that jumped.
        let is_later = frame > last;
        last = last.max(frame);
        is_later.then_some(DetectedFrame {
            frame,
            bodies: it.bodies,
        })
    });
    each.collect()
}

/// From the least of some offsets to the most.
pub(super) fn apart_s<'a>(offsets_s: impl Iterator<Item = &'a f64>) -> f64 {
    let none = (f64::INFINITY, f64::NEG_INFINITY);
    let (least, most) = offsets_s.fold(none, |(least, most), it| (least.min(*it), most.max(*it)));
    (most - least).max(0.0)
}

/// Adds a body, if anything of it was seen, and it is none of those that are there.
pub(super) fn push_new(bodies: &mut Vec<Detection>, body: Detection) {
    let is_somebody = body.keypoints.iter().any(Option::is_some);
    if is_somebody && bodies.iter().all(|other| !is_same(other, &body)) {
        bodies.push(body);
    }
}

/// Whether two bodies of one picture are one: half of the keypoints that both have are at about the same place.
fn is_same(a: &Detection, b: &Detection) -> bool {
    let both = a.keypoints.iter().zip(&b.keypoints);
    let both = both.filter_map(|(a, b)| Some((a.as_ref()?.px, b.as_ref()?.px)));
    let mut apart_px: Vec<f64> = both
        .map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1]))
        .collect();
    apart_px.sort_by(f64::total_cmp);
    let middle = apart_px.get(apart_px.len() / 2);
    middle.is_some_and(|apart_px| *apart_px < SAME_SHARE * height_px(a).max(height_px(b)))
}

/// From the uppermost keypoint to the lowest.
fn height_px(body: &Detection) -> f64 {
    let rows = body.keypoints.iter().flatten().map(|it| it.px[1]);
    let least = rows.clone().fold(f64::INFINITY, f64::min);
    (rows.fold(f64::NEG_INFINITY, f64::max) - least).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_calibration::people::Keypoint;

    fn body(left_px: f64) -> Detection {
        let keypoints = (0..17).map(|i| {
            Some(Keypoint {
                px: [left_px, 10.0 * f64::from(i)],
                score: 0.9,
            })
        });
        Detection {
            keypoints: keypoints.collect(),
        }
    }

    #[test]
    fn a_body_that_was_sighted_and_followed_is_one() {
        assert!(is_same(&body(100.0), &body(110.0)));
        assert!(!is_same(&body(100.0), &body(150.0)));
        assert!(!is_same(&Detection::default(), &body(100.0)));
    }

    #[test]
    fn a_body_that_two_tracks_are_on_is_there_once() {
        let mut bodies = Vec::new();
        for left_px in [100.0, 103.0, 200.0] {
            push_new(&mut bodies, body(left_px));
        }
        push_new(&mut bodies, Detection::default());
        assert_eq!(bodies, [body(100.0), body(200.0)]);
    }

    #[test]
    fn pictures_are_of_when_they_were_taken_each_by_itself() {
        let frame = |tick: f64, offset_s: Option<f64>| SeenFrame {
            tick,
            offset_s,
            bodies: vec![body(tick)],
        };
        // A free-running camera: what it is off by goes from one half of a tick to the other, and is zero on average.
        let frames = vec![
            frame(10.0, None),
            frame(11.0, Some(0.01)),
            frame(12.0, Some(0.02)),
            frame(13.0, Some(-0.02)),
            frame(14.0, Some(-0.01)),
            frame(16.0, None),
        ];
        let numbers: Vec<f64> = by_capture(frames, 20.0).iter().map(|it| it.frame).collect();
        let expected = [10.2, 11.2, 12.4, 12.6, 13.8, 15.8];
        assert_eq!(numbers.len(), expected.len());
        for (found, expected) in numbers.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{numbers:?}");
        }
        // A clock that jumped takes no picture before the one that came first.
        let jumped = vec![frame(1.0, Some(0.09)), frame(2.0, Some(-0.09))];
        assert_eq!(by_capture(jumped, 20.0).len(), 1);
        assert!((apart_s([0.02, -0.02, 0.0].iter()) - 0.04).abs() < 1e-12);
        assert!(apart_s([].iter()) <= 0.0);
    }
}
