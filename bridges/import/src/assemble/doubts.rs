//! What speaks against the keypoints of a camera: they leave its pictures, they are no pixels, people in them lie or stand
//! on their heads. Nothing is changed; it is said.

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::keypoints::COCO17;
use farfield_proto::order_statistics::reached_by;

use super::CameraFrames;
use crate::person::{Candidate, Person};

/// Fewer people than this say nothing of a camera.
const FEWEST_PEOPLE: usize = 10;
/// Keypoints of which nearly none is farther from the corner than this are shares of a picture, not pixels ...
///
/// This and the next are those of the edge's `source/keypoints.rs`, so that what is imported is what a run takes.
const SHARE_OF_PICTURE: f64 = 1.5;
/// ... when there are as many as two people have.
const FEWEST_POINTS: usize = 2 * COCO17.len();
/// How far keypoints reach is how far this share of them does.
const REACHING_SHARE: f64 = 0.01;
/// Networks guess a little beyond the edges: this share of a side does not count.
const EDGE: f64 = 0.05;
/// More keypoints outside than this share are said.
const MANY_OUTSIDE: f64 = 0.02;
/// A picture of which keypoints reach less than this share of both sides may have been made smaller.
const SMALL: f64 = 0.55;
/// What this share of people do is not what some of them do.
const MOST: f64 = 0.8;

/// Looks at one camera.
///
/// # Errors
/// A sentence where its keypoints are shares of the picture: nobody would be found.
pub(super) fn look(camera: &CameraFrames, remarks: &mut Vec<Remark>) -> Result<(), String> {
    let people = || camera.frames.values().flatten();
    let points = || people().flatten().flatten();
    let [width, height] = camera.size_px.map(f64::from);
    let farthest_px = reached(points().map(|it| it.x_px.abs().max(it.y_px.abs())));
    if points().count() >= FEWEST_POINTS && farthest_px <= SHARE_OF_PICTURE {
        return Err(format!(
            "camera `{}` ({}): nearly all keypoints lie within {farthest_px:.2} pixels of the corner, as shares of a picture do; \
             expected pixels of {width} x {height}",
            camera.name, camera.source,
        ));
    }
    let n_people = people().count();
    if n_people < FEWEST_PEOPLE {
        if n_people == 0 {
            let text = "nobody was found in any of its frames";
            remarks.push(Remark::of_camera(RemarkKind::Doubtful, &camera.name, text));
        }
        return Ok(());
    }
    let least = |side: fn(&Candidate) -> f64| -reached(points().map(|it| -side(it)));
    let most = |side: fn(&Candidate) -> f64| reached(points().map(side));
    let (left, top) = (least(|it| it.x_px), least(|it| it.y_px));
    let (right, bottom) = (most(|it| it.x_px), most(|it| it.y_px));
    let mut doubt = |text: String| {
        remarks.push(Remark::of_camera(RemarkKind::Doubtful, &camera.name, text));
    };
    let outside = |width: f64, height: f64| {
        let is_outside = |it: &&Candidate| {
            let beyond =
                |value: f64, side: f64| value < -EDGE * side || value > (1.0 + EDGE) * side;
            beyond(it.x_px, width) || beyond(it.y_px, height)
        };
        points().filter(is_outside).count() as f64 / points().count().max(1) as f64
    };
    if camera.frames.len() == 1 {
        doubt(format!(
            "all its {n_people} people are in one frame: has each picture a number of its own (COCO: `image_id`)?"
        ));
    }
    let share = outside(width, height);
    if share > MANY_OUTSIDE {
        let turned = if outside(height, width) <= MANY_OUTSIDE {
            "; they would fit pictures that are turned by a quarter: was the camera calibrated as it was recorded?"
        } else {
            ": is the calibration of pictures of this size?"
        };
        doubt(format!(
            "{:.0} percent of its keypoints lie outside the {width} x {height} pixels of the calibration, from ({left:.0}, {top:.0}) \
             to ({right:.0}, {bottom:.0}){turned}",
            100.0 * share
        ));
    } else if right < SMALL * width && bottom < SMALL * height {
        doubt(format!(
            "its keypoints reach only to ({right:.0}, {bottom:.0}) of {width} x {height} pixels: were the pictures made smaller \
             after the calibration?"
        ));
    }
    // A camera that the calibration has on its side shows people so.
    let as_calibrated = posture(people(), camera.down);
    if let Some(text) = posture(people(), [0.0, 1.0]).filter(|_| as_calibrated.is_some()) {
        doubt(text.to_owned());
    }
    Ok(())
}

/// How far `values` reach; a few that are farther do not count.
fn reached(values: impl Iterator<Item = f64>) -> f64 {
    reached_by(values, REACHING_SHARE).unwrap_or(0.0)
}

/// Whether people stand as people do, where `down` is down in the picture.
fn posture<'a>(people: impl Iterator<Item = &'a Person>, down: [f64; 2]) -> Option<&'static str> {
    let (mut seen, mut lying, mut upside_down) = (0usize, 0usize, 0usize);
    for person in people {
        let Some((dx, dy)) = shoulders_to_ankles(person) else {
            continue;
        };
        let (dx, dy) = (dx * down[1] - dy * down[0], dx * down[0] + dy * down[1]);
        seen += 1;
        lying += usize::from(dx.abs() > 2.0 * dy.abs());
        upside_down += usize::from(dy < 0.0 && dy.abs() > 2.0 * dx.abs());
    }
    if seen < FEWEST_PEOPLE {
        return None;
    }
    let most = |count: usize| count as f64 > MOST * seen as f64;
    if most(lying) {
        Some(
            "most people lie on their side in its pictures: are x and y swapped, or the pictures turned by a quarter?",
        )
    } else if most(upside_down) {
        Some(
            "most people stand on their heads in its pictures: does y count from below, or is the camera mounted upside down?",
        )
    } else {
        None
    }
}

/// From the middle of the shoulders to the middle of the ankles, pixels.
fn shoulders_to_ankles(person: &Person) -> Option<(f64, f64)> {
    let middle = |name: &str| {
        let found = COCO17
            .iter()
            .zip(person)
            .filter(|(of, _)| of.ends_with(name));
        let found: Vec<&Candidate> = found.filter_map(|(_, point)| point.as_ref()).collect();
        let n = found.len() as f64;
        let sum = |side: fn(&Candidate) -> f64| found.iter().map(|it| side(it)).sum::<f64>();
        (n > 0.0).then(|| (sum(|it| it.x_px) / n, sum(|it| it.y_px) / n))
    };
    let (from, to) = (middle("shoulder")?, middle("ankle")?);
    Some((to.0 - from.0, to.1 - from.1))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty people who stand at x 400 px, heads at 100 px and feet at 500 px, after `moved`.
    fn camera(size_px: [u32; 2], moved: impl Fn(f64, f64) -> (f64, f64)) -> CameraFrames {
        let person: Person = std::array::from_fn(|i| {
            let (x_px, y_px) = moved(400.0, 100.0 + 25.0 * i as f64);
            Some(Candidate {
                x_px,
                y_px,
                score: 0.9,
            })
        });
        CameraFrames {
            name: "a".to_owned(),
            size_px,
            down: [0.0, 1.0],
            source: "folder".to_owned(),
            frames: (0..20).map(|at| (at, vec![person])).collect(),
        }
    }

    fn said(camera: &CameraFrames) -> String {
        let mut remarks = Vec::new();
        look(camera, &mut remarks).unwrap();
        let texts: Vec<String> = remarks.into_iter().map(|it| it.text).collect();
        texts.join("\n")
    }

    #[test]
    fn people_who_stand_in_the_picture_raise_no_doubt() {
        assert_eq!(said(&camera([640, 640], |x, y| (x, y))), "");
    }

    #[test]
    fn pictures_of_another_size_are_doubted() {
        let outside = said(&camera([640, 360], |x, y| (x, y)));
        assert!(outside.contains("outside the 640 x 360"), "{outside}");
        let turned = said(&camera([640, 360], |x, y| (x * 0.8, y * 1.2)));
        assert!(turned.contains("turned by a quarter"), "{turned}");
        let small = said(&camera([1920, 1080], |x, y| (x, y)));
        assert!(small.contains("made smaller"), "{small}");
        let mut with_one_far = camera([1920, 1080], |x, y| (x, y));
        let far = Candidate {
            x_px: 1900.0,
            y_px: 1000.0,
            score: 0.9,
        };
        with_one_far.frames.get_mut(&3).unwrap()[0][0] = Some(far);
        assert!(said(&with_one_far).contains("made smaller"));
    }

    #[test]
    fn swapped_axes_and_heads_below_feet_are_doubted() {
        let swapped = said(&camera([640, 640], |x, y| (y, x)));
        assert!(swapped.contains("swapped"), "{swapped}");
        let upside_down = said(&camera([640, 640], |x, y| (x, 640.0 - y)));
        assert!(upside_down.contains("on their heads"), "{upside_down}");
    }

    #[test]
    fn people_who_are_all_in_one_frame_are_doubted() {
        let mut camera = camera([640, 640], |x, y| (x, y));
        let people: Vec<Person> = std::mem::take(&mut camera.frames)
            .into_values()
            .flatten()
            .collect();
        camera.frames.insert(0, people);
        assert!(said(&camera).contains("all its 20 people are in one frame"));
        camera.frames.entry(0).or_default().truncate(9);
        assert_eq!(said(&camera), "");
    }

    #[test]
    fn shares_of_a_picture_are_refused() {
        let camera = camera([640, 640], |x, y| (x / 640.0, y / 640.0));
        let refused = look(&camera, &mut Vec::new()).unwrap_err();
        assert!(refused.contains("shares of a picture"), "{refused}");
        let mut with_one_far = camera.clone();
        let far = Candidate {
            x_px: 5000.0,
            y_px: 5000.0,
            score: 0.9,
        };
        with_one_far.frames.get_mut(&3).unwrap()[0][0] = Some(far);
        let refused = look(&with_one_far, &mut Vec::new()).unwrap_err();
        assert!(refused.contains("within 0.78 pixels"), "{refused}");
        // Two people are enough, as for the edge; one is not.
        let mut few = camera;
        few.frames.retain(|at, _| *at < 2);
        assert!(look(&few, &mut Vec::new()).is_err());
        few.frames.retain(|at, _| *at < 1);
        assert!(look(&few, &mut Vec::new()).is_ok());
    }
}
