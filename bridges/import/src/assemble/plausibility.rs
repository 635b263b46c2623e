//! Warns about implausible keypoints of a camera: outside the image, not in pixels, or people lying
//! or upside down. Changes nothing.

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::keypoints::COCO17;
use farfield_proto::order_statistics::reached_by;

use super::CameraFrames;
use crate::person::{Candidate, Person};

/// Minimum number of people for a judgement about a camera.
const FEWEST_PEOPLE: usize = 10;
/// If nearly all keypoints are within this distance of the corner, they are fractions of the image
/// size, not pixels.
///
/// This constant and [`FEWEST_POINTS`] match `edge/src/source/keypoints.rs`, so that every import
/// is accepted by a run.
const SHARE_OF_PICTURE: f64 = 1.5;
/// Minimum number of keypoints for that judgement: those of two people.
const FEWEST_POINTS: usize = 2 * COCO17.len();
/// Share of the outermost keypoints that the extent ignores.
const REACHING_SHARE: f64 = 0.01;
/// Networks guess slightly beyond the edges; this share of a side is tolerated.
const EDGE: f64 = 0.05;
/// Share of keypoints outside the image above which a warning is given.
const MANY_OUTSIDE: f64 = 0.02;
/// If keypoints cover less than this share of both sides, the images may have been scaled down.
const SMALL: f64 = 0.55;
/// Share of people above which a posture counts as that of most people.
const MOST: f64 = 0.8;

/// Checks one camera.
///
/// # Errors
/// If its keypoints are fractions of the image size, since a run would find no people.
pub(super) fn check(camera: &CameraFrames, remarks: &mut Vec<Remark>) -> Result<(), String> {
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
            let text = "no people were detected in any of its frames";
            remarks.push(Remark::of_camera(RemarkKind::Doubtful, &camera.name, text));
        }
        return Ok(());
    }
    let least = |side: fn(&Candidate) -> f64| -reached(points().map(|it| -side(it)));
    let most = |side: fn(&Candidate) -> f64| reached(points().map(side));
    let (left, top) = (least(|it| it.x_px), least(|it| it.y_px));
    let (right, bottom) = (most(|it| it.x_px), most(|it| it.y_px));
    let mut warn = |text: String| {
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
        warn(format!(
            "all its {n_people} people are in one frame: does each image have its own number (COCO: `image_id`)?"
        ));
    }
    let share = outside(width, height);
    if share > MANY_OUTSIDE {
        let turned = if outside(height, width) <= MANY_OUTSIDE {
            "; they would fit pictures that are turned by a quarter: was the camera calibrated as it was recorded?"
        } else {
            ": is the calibration of pictures of this size?"
        };
        warn(format!(
            "{:.0} percent of its keypoints lie outside the {width} x {height} pixels of the calibration, from ({left:.0}, {top:.0}) \
             to ({right:.0}, {bottom:.0}){turned}",
            100.0 * share
        ));
    } else if right < SMALL * width && bottom < SMALL * height {
        warn(format!(
            "its keypoints reach only to ({right:.0}, {bottom:.0}) of {width} x {height} pixels: were the pictures made smaller \
             after the calibration?"
        ));
    }
    // In a camera that is calibrated as lying on its side, people appear so too.
    let as_calibrated = posture(people(), camera.down);
    if let Some(text) = posture(people(), [0.0, 1.0]).filter(|_| as_calibrated.is_some()) {
        warn(text.to_owned());
    }
    Ok(())
}

/// The extent of `values`, without a few outliers.
fn reached(values: impl Iterator<Item = f64>) -> f64 {
    reached_by(values, REACHING_SHARE).unwrap_or(0.0)
}

/// Describes an implausible posture of most people, relative to the direction `down` in the image.
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

/// Vector from the middle of the shoulders to the middle of the ankles, pixels.
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

    /// Twenty people who stand at x = 400 px with heads at 100 px and feet at 500 px, transformed
    /// by `moved`.
    fn camera(size_px: [u32; 2], moved: impl Fn(f64, f64) -> (f64, f64)) -> CameraFrames {
        let person: Person = std::array::from_fn(|i| {
            let (x_px, y_px) = moved(400.0, 100.0 + 400.0 / 22.0 * i as f64);
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

    fn warnings(camera: &CameraFrames) -> String {
        let mut remarks = Vec::new();
        check(camera, &mut remarks).unwrap();
        let texts: Vec<String> = remarks.into_iter().map(|it| it.text).collect();
        texts.join("\n")
    }

    #[test]
    fn standing_people_inside_the_image_give_no_warning() {
        assert_eq!(warnings(&camera([640, 640], |x, y| (x, y))), "");
    }

    #[test]
    fn images_of_another_size_give_a_warning() {
        let outside = warnings(&camera([640, 360], |x, y| (x, y)));
        assert!(outside.contains("outside the 640 x 360"), "{outside}");
        let turned = warnings(&camera([640, 360], |x, y| (x * 0.8, y * 1.2)));
        assert!(turned.contains("turned by a quarter"), "{turned}");
        let small = warnings(&camera([1920, 1080], |x, y| (x, y)));
        assert!(small.contains("made smaller"), "{small}");
        let mut with_one_far = camera([1920, 1080], |x, y| (x, y));
        let far = Candidate {
            x_px: 1900.0,
            y_px: 1000.0,
            score: 0.9,
        };
        with_one_far.frames.get_mut(&3).unwrap()[0][0] = Some(far);
        assert!(warnings(&with_one_far).contains("made smaller"));
    }

    #[test]
    fn swapped_axes_and_inverted_people_give_a_warning() {
        let swapped = warnings(&camera([640, 640], |x, y| (y, x)));
        assert!(swapped.contains("swapped"), "{swapped}");
        let upside_down = warnings(&camera([640, 640], |x, y| (x, 640.0 - y)));
        assert!(upside_down.contains("on their heads"), "{upside_down}");
    }

    #[test]
    fn all_people_in_one_frame_give_a_warning() {
        let mut camera = camera([640, 640], |x, y| (x, y));
        let people: Vec<Person> = std::mem::take(&mut camera.frames)
            .into_values()
            .flatten()
            .collect();
        camera.frames.insert(0, people);
        assert!(warnings(&camera).contains("all its 20 people are in one frame"));
        camera.frames.entry(0).or_default().truncate(9);
        assert_eq!(warnings(&camera), "");
    }

    #[test]
    fn fractions_of_the_image_size_are_refused() {
        let camera = camera([640, 640], |x, y| (x / 640.0, y / 640.0));
        let refused = check(&camera, &mut Vec::new()).unwrap_err();
        assert!(refused.contains("shares of a picture"), "{refused}");
        let mut with_one_far = camera.clone();
        let far = Candidate {
            x_px: 5000.0,
            y_px: 5000.0,
            score: 0.9,
        };
        with_one_far.frames.get_mut(&3).unwrap()[0][0] = Some(far);
        let refused = check(&with_one_far, &mut Vec::new()).unwrap_err();
        assert!(refused.contains("within 0.78 pixels"), "{refused}");
        // Two people are enough, as for the edge; one is not.
        let mut few = camera;
        few.frames.retain(|at, _| *at < 2);
        assert!(check(&few, &mut Vec::new()).is_err());
        few.frames.retain(|at, _| *at < 1);
        assert!(check(&few, &mut Vec::new()).is_ok());
    }
}
