//! What the keypoints of all cameras alike have that they should not.

use super::super::report::{KeypointExchange, PictureOfAll};
use super::super::samples::MIN_SCORE;

pub(super) fn exchanged(exchange: KeypointExchange) -> (String, String) {
    (
        exchange.words(),
        "write them in the order of the network's card (COCO: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles, the \
         person's left before the right), or bring another program's files in by `farfield import`"
            .to_owned(),
    )
}

pub(super) fn picture_of_all(change: PictureOfAll) -> (String, String) {
    (
        format!(
            "the keypoints of all cameras are not where the calibration has them, all alike: {}",
            where_they_are(change)
        ),
        "give keypoints in pixels of the pictures that were calibrated, from their top left corner, or calibrate in pictures as the \
         keypoints were found in"
            .to_owned(),
    )
}

pub(super) fn other_picture(camera: &str, change: PictureOfAll) -> (String, String) {
    (
        format!(
            "what camera {camera} shows is not where its calibration has it: {}",
            where_they_are(change)
        ),
        "give its video or keypoints as the pictures were that were calibrated, in their pixels from the top left corner (a turned video: \
         `ffmpeg -vf transpose`), or look whether its `matrix` is of pictures of another size"
            .to_owned(),
    )
}

fn where_they_are(change: PictureOfAll) -> String {
    match change {
        PictureOfAll::Mirrored => "left and right of the pictures are exchanged".to_owned(),
        PictureOfAll::FromBelow => "y is counted from below".to_owned(),
        PictureOfAll::HalfTurned => "the pictures stand on their heads".to_owned(),
        PictureOfAll::XAndYExchanged => "x and y are exchanged".to_owned(),
        PictureOfAll::QuarterTurned => "the pictures are turned by a quarter".to_owned(),
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
        "so they were found in pictures that were cut, or the principal points (cx, cy of `matrix`) are that far off"
    } else {
        "so they were found in pictures that were made smaller, larger, or cut"
    };
    if right.abs() > 0.01 || down.abs() > 0.01 {
        let moved: Vec<String> = moved.collect();
        words.push(format!("moved by {}", moved.join(" and ")));
    }
    format!("they agree once they are {}, {why}", words.join(", "))
}

pub(super) fn low_scores(cameras: &[String], share: f64) -> (String, String) {
    let of = match cameras {
        [] => "all cameras".to_owned(),
        [camera] => format!("camera {camera}"),
        several => format!("cameras {}", several.join(", ")),
    };
    (
        format!(
            "the keypoints of {of} are where people are, but {:.0} % of them have scores below {MIN_SCORE}, with which they do not count",
            100.0 * share
        ),
        "look at what wrote them: a score is 0 to 1, and 1 is sure; is it 1 - score, or in another unit? If a network is so unsure, people \
         are too small or too dark for it"
            .to_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::{low_scores, resized};

    #[test]
    fn of_which_cameras_scores_are_too_low_is_said_and_of_which_share_of_keypoints() {
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
    fn pictures_that_were_moved_are_told_along_the_sides_that_they_were_moved_along() {
        let told = resized([1.0; 2], [0.021, -0.002]);
        assert!(told.contains("moved by +2 % of the width, so"), "{told}");
        let told = resized([1.0; 2], [0.021, -0.034]);
        assert!(
            told.contains("+2 % of the width and -3 % of the height"),
            "{told}"
        );
    }
}
