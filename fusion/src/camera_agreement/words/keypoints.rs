//! Sentences about keypoints: exchanged, in other pictures, or with low scores.

use super::super::report::{KeypointExchange, PictureOfAll};
use super::super::samples::MIN_SCORE;

pub(super) fn exchanged(exchange: KeypointExchange) -> (String, String) {
    (
        exchange.words(),
        "write them in the order of the network's card (COCO: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles, the \
         person's left before the right), or convert another program's files with `farfield import`"
            .to_owned(),
    )
}

pub(super) fn picture_of_all(change: PictureOfAll) -> (String, String) {
    (
        format!(
            "the keypoints of all cameras do not fit the calibrated pictures, all in the same way: {}",
            difference(change)
        ),
        "give keypoints in pixels of the calibrated pictures, from their top left corner, or calibrate with pictures like those in which \
         the keypoints were found"
            .to_owned(),
    )
}

pub(super) fn other_picture(camera: &str, change: PictureOfAll) -> (String, String) {
    (
        format!(
            "the keypoints of camera {camera} do not fit its calibrated pictures: {}",
            difference(change)
        ),
        "give its video or keypoints in the size and orientation of the calibrated pictures, in pixels from the top left corner (a turned \
         video: `ffmpeg -vf transpose`), or check whether its `matrix` is for pictures of another size"
            .to_owned(),
    )
}

fn difference(change: PictureOfAll) -> String {
    match change {
        PictureOfAll::Mirrored => "left and right of the pictures are exchanged".to_owned(),
        PictureOfAll::FromBelow => "y is counted from below".to_owned(),
        PictureOfAll::HalfTurned => "the pictures are upside down".to_owned(),
        PictureOfAll::XAndYExchanged => "x and y are exchanged".to_owned(),
        PictureOfAll::QuarterTurned => "the pictures are turned by 90 degrees".to_owned(),
        PictureOfAll::Resized { scale, shift } => resized(scale, shift),
    }
}

fn resized([x, y]: [f64; 2], [right, down]: [f64; 2]) -> String {
    let mut words = Vec::new();
    if (x - y).abs() < 0.05 * x.max(y) && (x - 1.0).abs() > 0.04 {
        words.push(format!("multiplied by {:.2}", 0.5 * (x + y)));
    } else if (x - 1.0).abs() > 0.04 || (y - 1.0).abs() > 0.04 {
        words.push(format!("multiplied by {x:.2} in x and {y:.2} in y"));
    }
    let moved = |(share, side): (f64, &str)| {
        let percent = (100.0 * share).round();
        (percent != 0.0).then(|| format!("{percent:+} % of the {side}"))
    };
    let moved = [(right, "width"), (down, "height")]
        .into_iter()
        .filter_map(moved);
    let why = if words.is_empty() {
        "so they were found in cropped pictures, or the principal points (cx, cy of `matrix`) are wrong by as much"
    } else {
        "so they were found in pictures that were scaled or cropped"
    };
    if right.abs() > 0.01 || down.abs() > 0.01 {
        let moved: Vec<String> = moved.collect();
        words.push(format!("moved by {}", moved.join(" and ")));
    }
    format!("they agree if they are {}, {why}", words.join(", "))
}

pub(super) fn low_scores(cameras: &[String], share: f64) -> (String, String) {
    let of = match cameras {
        [] => "all cameras".to_owned(),
        [camera] => format!("camera {camera}"),
        several => format!("cameras {}", several.join(", ")),
    };
    (
        format!(
            "the keypoints of {of} are where people are, but {:.0} % of them have scores below {MIN_SCORE} and do not count",
            100.0 * share
        ),
        "check the program that wrote them: a score is 0 to 1, and 1 is sure; is it 1 - score, or in another unit? If the network itself is \
         so unsure, people are too small or too dark for it"
            .to_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::{low_scores, resized};

    #[test]
    fn low_scores_name_the_cameras_and_the_share_of_keypoints() {
        for (cameras, of) in [
            (vec![], "of all cameras are"),
            (vec!["a"], "of camera a are"),
            (vec!["a", "b"], "of cameras a, b are"),
        ] {
            let cameras: Vec<String> = cameras.into_iter().map(str::to_owned).collect();
            let (found, _) = low_scores(&cameras, 0.86);
            assert!(found.contains(of) && found.contains("86 %"), "{found}");
        }
    }

    #[test]
    fn a_shift_is_reported_only_along_the_sides_that_it_has() {
        let message = resized([1.0; 2], [0.021, -0.002]);
        assert!(
            message.contains("+2 % of the width,") && !message.contains("height"),
            "{message}"
        );
        let message = resized([1.0; 2], [0.021, -0.034]);
        assert!(
            message.contains("+2 % of the width and -3 % of the height"),
            "{message}"
        );
    }
}
