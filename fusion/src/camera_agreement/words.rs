//! The sentences of each cause: what was found, and the remedy.

mod keypoints;
mod standing;

use self::keypoints::{exchanged, low_scores, other_picture, picture_of_all};
use self::standing::{floor_height, scale_of_subjects, world_scale, world_tilted};
use super::report::DisagreementCause;

/// What was found about these cameras, and the remedy.
pub(super) fn sentences(
    cameras: &[String],
    cause: DisagreementCause,
    rate_hz: f64,
) -> (String, String) {
    let first = cameras.first().map_or("", String::as_str);
    let second = cameras.get(1).map_or("", String::as_str);
    match cause {
        DisagreementCause::Late { ticks } => late(first, ticks, rate_hz),
        DisagreementCause::LateInPart {
            before_ticks,
            after_ticks,
            since_tick,
        } => late_in_part(first, [before_ticks, after_ticks], since_tick, rate_hz),
        DisagreementCause::Drifts { ticks_per_minute } => drifts(first, ticks_per_minute),
        DisagreementCause::Mirrored => mirrored(first),
        DisagreementCause::HalfTurned => half_turned(first),
        DisagreementCause::Swapped => {
            let pairs = cameras.chunks(2).map(|pair| pair.join(" and "));
            let pairs = pairs.collect::<Vec<String>>().join(", or else ");
            (
                format!("cameras {pairs} seem to be swapped: each fits the calibration of the other"),
                "exchange their sources in the venue file, or their names in the calibration".to_owned(),
            )
        }
        DisagreementCause::Permuted => permuted(cameras),
        DisagreementCause::SamePictures => same_pictures(first, second),
        DisagreementCause::OtherCalibration => other_calibration(first, second),
        DisagreementCause::KeypointOrder { .. } if cameras.is_empty() => (
            "left and right are exchanged in the keypoints of all cameras: noses are behind shoulders".to_owned(),
            "check the order of keypoints in the network's card, or in the files (COCO: the person's left before the right); if it is right, all pictures are mirrored, or the calibration is"
                .to_owned(),
        ),
        DisagreementCause::KeypointOrder { moved, sides } => (
            if sides {
                format!("left and right are exchanged in the keypoints of camera {first}")
            } else {
                format!(
                    "the keypoints of camera {first} are in another order than those of the others: {moved} are in the wrong place"
                )
            },
            "write them in the order of the network's card (COCO: nose, eyes, ears, shoulders, elbows, wrists, hips, knees, ankles, the person's left before the right)"
                .to_owned(),
        ),
        DisagreementCause::ExchangedKeypoints { exchange } => exchanged(exchange),
        DisagreementCause::LowScores { share } => low_scores(cameras, share),
        DisagreementCause::PictureOfAll { change } => picture_of_all(change),
        DisagreementCause::OtherPicture { change } => other_picture(first, change),
        DisagreementCause::FocalLength { factor } => focal_length(cameras, factor),
        DisagreementCause::Distortion { k1_over } => distortion(cameras, k1_over),
        DisagreementCause::Turned { degrees } => turned(first, degrees),
        DisagreementCause::Moved {
            distance_m,
            degrees,
        } => moved(first, distance_m, degrees),
        DisagreementCause::Frozen { since_tick } => frozen(first, since_tick, rate_hz),
        DisagreementCause::Silent { since_tick } => silent(first, since_tick, rate_hz),
        DisagreementCause::LensKind { .. } => lens_kind(cameras),
        DisagreementCause::WorldScale {
            stature_m,
            people,
            range_m,
            expected_m: None,
        } => world_scale(stature_m, people, range_m),
        DisagreementCause::WorldScale {
            stature_m,
            range_m,
            expected_m: Some(expected_m),
            ..
        } => scale_of_subjects(stature_m, range_m, expected_m),
        DisagreementCause::WorldTilted { degrees } => world_tilted(degrees),
        DisagreementCause::FloorHeight { above_m, floor_m } => floor_height(above_m, floor_m),
        DisagreementCause::Unexplained => unexplained(cameras),
    }
}

fn drifts(camera: &str, ticks_per_minute: f64) -> (String, String) {
    let change = ticks_per_minute.abs();
    let side = if ticks_per_minute > 0.0 {
        "later"
    } else {
        "earlier"
    };
    (
        format!("camera {camera} runs at another rate: it is {change:.1} ticks {side} every minute"),
        "check the true rate of its video: convert it to the rate of the venue, or record all cameras at one rate"
            .to_owned(),
    )
}

fn same_pictures(camera: &str, other: &str) -> (String, String) {
    (
        format!("cameras {camera} and {other} seem to show the same pictures"),
        "give each camera its own source in the venue file".to_owned(),
    )
}

fn other_calibration(camera: &str, other: &str) -> (String, String) {
    (
        format!(
            "the pictures of camera {camera} fit the calibration of camera {other} better than its own"
        ),
        "check that the sources in the venue file and the names in the calibration belong together"
            .to_owned(),
    )
}

fn permuted(cameras: &[String]) -> (String, String) {
    let fits = cameras.iter().zip(cameras.iter().cycle().skip(1));
    let fits = fits.map(|(camera, next)| format!("{camera} fits the calibration of {next}"));
    (
        format!(
            "cameras {} have each other's pictures: {}",
            cameras.join(", "),
            fits.collect::<Vec<String>>().join(", ")
        ),
        "exchange their sources in the venue file, or their names in the calibration, so that each has its own".to_owned(),
    )
}

fn mirrored(first: &str) -> (String, String) {
    (
        format!("the pictures of camera {first} seem to be mirrored"),
        "switch mirroring off in the camera, or flip the video back (ffmpeg -vf hflip)".to_owned(),
    )
}

fn half_turned(first: &str) -> (String, String) {
    (
            format!("the pictures of camera {first} seem to be upside down"),
            "turn the video by 180 degrees (ffmpeg -vf hflip,vflip), or calibrate the camera as it hangs"
                .to_owned(),
        )
}

fn turned(camera: &str, degrees: f64) -> (String, String) {
    (
        format!(
            "camera {camera} seems to have been turned by {degrees:.1} degrees since it was calibrated"
        ),
        "calibrate its position and direction again".to_owned(),
    )
}

fn moved(camera: &str, distance_m: f64, degrees: f64) -> (String, String) {
    (
        format!(
            "camera {camera} seems to have been moved by {distance_m:.2} m and turned by {degrees:.1} degrees since it was calibrated"
        ),
        "calibrate its position and direction again".to_owned(),
    )
}

fn lens_kind(cameras: &[String]) -> (String, String) {
    let lenses = match cameras {
        [camera] => format!("the lens of camera {camera} seems to be no fisheye"),
        _ => format!(
            "the lenses of cameras {} seem to be no fisheyes",
            cameras.join(", ")
        ),
    };
    (
        format!("{lenses}, but the calibration has `fisheye = true`"),
        "if the coefficients are of an ordinary lens (k1 k2 p1 p2 k3), set `fisheye = false`; otherwise calibrate again"
            .to_owned(),
    )
}

/// Largest change of a focal length, as a share, that a camera moved by a few decimetres explains as well.
const MAX_MOVED_CHANGE: f64 = 0.06;

fn focal_length(cameras: &[String], factor: f64) -> (String, String) {
    if let [camera] = cameras {
        // A camera that came nearer shows people larger, too: by a tenth if it came nearer by a tenth of their distance.
        let remedy = if (factor - 1.0).abs() < MAX_MOVED_CHANGE {
            "was it zoomed, calibrated at another resolution, or moved straight ahead or back? Calibrate its lens and its position again"
        } else {
            "was it zoomed, or calibrated at another resolution? Calibrate its lens again"
        };
        (
            format!(
                "the focal length of camera {camera} seems to be {factor:.2} times the calibrated one"
            ),
            remedy.to_owned(),
        )
    } else {
        let cameras = cameras.join(", ");
        (
            format!(
                "the focal lengths of cameras {cameras} seem to be {factor:.2} times the calibrated ones, all by one factor"
            ),
            "were they calibrated at another resolution or zoom, with another crop or stabilisation? Calibrate their lenses \
             again, with the settings of the recording"
                .to_owned(),
        )
    }
}

fn distortion(cameras: &[String], k1_over: f64) -> (String, String) {
    let (whose, are, moved) = match cameras {
        // A camera that was moved sees people at other places, as through another lens.
        [camera] => (
            format!("the lens distortion of camera {camera}"),
            "is",
            ", or was the camera moved since it was calibrated? Calibrate its lens and its position again",
        ),
        _ => (
            "the lens distortions of all cameras".to_owned(),
            "are",
            "? Calibrate their lenses again",
        ),
    };
    let direction = if k1_over > 0.0 { "less" } else { "more" };
    (
        format!(
            "{whose} {are} not as calibrated: lines of sight meet better with a k1 that is {:.2} {direction}",
            k1_over.abs()
        ),
        format!(
            "check `distortions` (k1 k2 p1 p2 k3, in this order, with OpenCV's signs): are they of {}, at this zoom{moved}",
            if cameras.len() == 1 {
                "this camera"
            } else {
                "these cameras"
            }
        ),
    )
}

fn frozen(camera: &str, since_tick: i64, rate_hz: f64) -> (String, String) {
    (
        format!(
            "the pictures of camera {camera} have not changed since tick {since_tick} ({:.1} s) at the latest, while people move in front of it",
            since_tick as f64 / rate_hz
        ),
        "check its recording: does it end before the others, or repeat its last picture? Live: restart the camera"
            .to_owned(),
    )
}

fn late_in_part(
    camera: &str,
    [before, after]: [f64; 2],
    tick: i64,
    rate_hz: f64,
) -> (String, String) {
    let word = |ticks: f64| {
        if ticks.abs() < 0.05 {
            return "on time".to_owned();
        }
        let side = if ticks > 0.0 { "late" } else { "early" };
        format!("{:.1} ticks {side}", ticks.abs())
    };
    let at = format!("about tick {tick} ({:.1} s)", tick as f64 / rate_hz);
    let found = if after.abs() < before.abs() {
        format!(
            "camera {camera} is {} until {at}, and {} from there on",
            word(before),
            word(after)
        )
    } else {
        format!(
            "camera {camera} is {} since {at}, and {} before",
            word(after),
            word(before)
        )
    };
    let change = (after - before).abs();
    // After lost frames a recording is early.
    let (why, fix) = if after < before {
        ("lost frames there", "insert")
    } else {
        ("paused there, or repeats frames", "remove")
    };
    (
        found,
        format!(
            "its recording {why}: {fix} about {change:.0} frames at that place, or record again without gaps; live: check the load of its computer"
        ),
    )
}

fn silent(camera: &str, since_tick: Option<i64>, rate_hz: f64) -> (String, String) {
    let found = match since_tick {
        Some(tick) => format!(
            "camera {camera} has shown no people since tick {tick} ({:.1} s), although people are in its view",
            tick as f64 / rate_hz
        ),
        None => {
            format!("camera {camera} has never shown any people, although people are in its view")
        }
    };
    (
        found,
        "is it covered, dark, out of focus or turned away? Check its recording; if it is a file of keypoints, check that it has people up to its end"
            .to_owned(),
    )
}

fn late(camera: &str, ticks: f64, rate_hz: f64) -> (String, String) {
    let (word, shortened, ticks) = if ticks > 0.0 {
        ("late", "this camera", ticks)
    } else {
        ("early", "all others", -ticks)
    };
    let seconds = ticks / rate_hz;
    let ms = seconds * 1000.0;
    (
        format!("camera {camera} is {ticks:.1} ticks ({ms:.0} ms) {word} relative to the others"),
        format!(
            "cut the videos so that all begin at the same instant (here the first {seconds:.3} s of {shortened}, ffmpeg -ss); live: check the clock of its computer"
        ),
    )
}

fn unexplained(cameras: &[String]) -> (String, String) {
    if let [camera] = cameras {
        (
            format!("camera {camera} does not agree with the others"),
            "check its picture and its calibration: it may be late or frozen, have been moved, have another lens, or belong to another venue"
                .to_owned(),
        )
    } else {
        (
            format!(
                "cameras {} do not agree with each other",
                cameras.join(", ")
            ),
            "check their pictures and the calibration: `--overlay` draws what fusion found"
                .to_owned(),
        )
    }
}
