//! Aligns cameras by frame number, rescales scores, warns about suspect data, and writes the lines
//! of our keypoint files.

mod plausibility;
mod scores;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::Range;

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::keypoints::{COCO17, COCO23};
use farfield_proto::order_statistics::{FEWEST_REACHING, reached_by};

use crate::person::{Candidate, Frames, Person, span};

pub use self::scores::ScoreScale;

/// The keypoints of one camera, named as in the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFrames {
    /// Name in the calibration.
    pub name: String,
    /// Image width and height of the calibration, pixels.
    pub size_px: [u32; 2],
    /// Direction of the world's -z in the image, a unit vector; (0, 1) for a camera without roll.
    pub down: [f64; 2],
    /// Source of the keypoints.
    pub source: String,
    /// The keypoints.
    pub frames: Frames,
}

/// What all cameras share.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// Ticks of every keypoint file.
    pub ticks: Range<i64>,
    /// The set of the files: the smallest that has every keypoint of any person.
    pub keypoints: &'static [&'static str],
    /// Score scale of each camera.
    pub scales: Vec<ScoreScale>,
    /// What was assumed or is suspect.
    pub remarks: Vec<Remark>,
}

/// A frame is a stray if it is this many frames, or the length of the recording if that is more,
/// outside the frames that all but [`FRAMES_SHARE`] cover. Strays come from files of another
/// recording or from dates in names.
const STRAY_FRAMES: f64 = 1000.0;
const FRAMES_SHARE: f64 = 0.01;
/// With fewer frames, none is treated as a stray.
const FEWEST_FRAMES: usize = 2 * FEWEST_REACHING;

/// Checks all cameras together and drops stray frames.
///
/// # Errors
/// If no people were detected, there are too many frames, or keypoints are not pixels.
pub fn assemble(cameras: &mut [CameraFrames]) -> Result<Assembled, String> {
    let mut remarks = Vec::new();
    leave_out_strays(cameras, &mut remarks);
    let ticks = ticks(cameras)?;
    report_frames(cameras, &ticks, &mut remarks);
    let scales = ScoreScale::per_camera(cameras, &mut remarks);
    for camera in cameras.iter() {
        plausibility::check(camera, &mut remarks)?;
    }
    Ok(Assembled {
        ticks,
        keypoints: keypoint_set(cameras),
        scales,
        remarks,
    })
}

/// COCO's 17, or those with feet if any person has one.
fn keypoint_set(cameras: &[CameraFrames]) -> &'static [&'static str] {
    let mut people = cameras.iter().flat_map(|it| it.frames.values().flatten());
    let has_feet = people.any(|person| person[COCO17.len()..].iter().any(Option::is_some));
    if has_feet { &COCO23 } else { &COCO17 }
}

/// Drops frames whose numbers are far from all others, so that one number cannot extend the run.
fn leave_out_strays(cameras: &mut [CameraFrames], remarks: &mut Vec<Remark>) {
    let numbers = || {
        let frames = cameras.iter().flat_map(|it| it.frames.keys());
        frames.map(|frame| *frame as f64)
    };
    let last = reached_by(numbers(), FRAMES_SHARE);
    let first = reached_by(numbers().map(|it| -it), FRAMES_SHARE);
    let (Some(first), Some(last)) = (first.map(|it| -it), last) else {
        return;
    };
    if numbers().count() < FEWEST_FRAMES {
        return;
    }
    let beyond = STRAY_FRAMES.max(last - first);
    let is_near = |frame: i64| (first - beyond..=last + beyond).contains(&(frame as f64));
    for camera in cameras {
        let Some(stray) = camera.frames.keys().copied().find(|it| !is_near(*it)) else {
            continue;
        };
        let before = camera.frames.len();
        camera.frames.retain(|frame, _| is_near(*frame));
        let text = format!(
            "dropped {} frames: frame {stray} is far from nearly all others, which run from about {first} to {last}",
            before - camera.frames.len()
        );
        remarks.push(Remark::of_camera(RemarkKind::Doubtful, &camera.name, text));
    }
}

/// From the first frame of any camera to the last frame of any camera.
fn ticks(cameras: &[CameraFrames]) -> Result<Range<i64>, String> {
    if let Some(empty) = cameras.iter().find(|it| it.frames.is_empty()) {
        return Err(format!(
            "camera `{}` ({}) has no frames",
            empty.name, empty.source
        ));
    }
    let first = cameras
        .iter()
        .filter_map(|it| it.frames.keys().next())
        .min();
    let last = cameras
        .iter()
        .filter_map(|it| it.frames.keys().next_back())
        .max();
    let (Some(first), Some(last)) = (first, last) else {
        return Err("found no keypoints of any camera".to_owned());
    };
    let ticks = span(*first, *last)?;
    if cameras
        .iter()
        .all(|it| it.frames.values().all(Vec::is_empty))
    {
        return Err("found no people in any frame of any camera".to_owned());
    }
    Ok(ticks)
}

/// Reports a first frame other than 0, different frame ranges of cameras, and missing frames.
fn report_frames(cameras: &[CameraFrames], ticks: &Range<i64>, remarks: &mut Vec<Remark>) {
    if ticks.start != 0 {
        remarks.push(Remark::of_all(
            RemarkKind::Assumed,
            format!(
                "the first frame is {}, and so is the first tick",
                ticks.start
            ),
        ));
    }
    for camera in cameras {
        let (Some((first, _)), Some((last, _))) = (
            camera.frames.first_key_value(),
            camera.frames.last_key_value(),
        ) else {
            continue;
        };
        if (*first, last + 1) != (ticks.start, ticks.end) {
            remarks.push(Remark::of_camera(
                RemarkKind::Doubtful,
                &camera.name,
                format!(
                    "its frames go from {first} to {last}, those of all cameras from {} to {}: cameras were aligned by frame \
                     number, as if all of them had started to count together",
                    ticks.start,
                    ticks.end - 1
                ),
            ));
        }
        let missing = last - first + 1 - camera.frames.len().cast_signed() as i64;
        if missing > 0 {
            remarks.push(Remark::of_camera(
                RemarkKind::Assumed,
                &camera.name,
                format!(
                    "{missing} frames between its first and last are missing: they are written without people"
                ),
            ));
        }
    }
}

/// Writes the keypoint file of one camera, one line per tick; of each person the first `n_keypoints`.
///
/// # Errors
/// Errors of `out`.
pub fn write_lines(
    frames: &Frames,
    ticks: &Range<i64>,
    n_keypoints: usize,
    scale: ScoreScale,
    out: &mut impl Write,
) -> io::Result<()> {
    for tick in ticks.clone() {
        write!(out, "{{\"tick\":{tick},\"persons\":[")?;
        let people = frames.get(&tick).map_or(&[][..], Vec::as_slice);
        for (i, person) in people.iter().enumerate() {
            if i > 0 {
                out.write_all(b",")?;
            }
            write_person(&person[..n_keypoints], scale, out)?;
        }
        out.write_all(b"]}\n")?;
    }
    Ok(())
}

fn write_person(
    person: &[Option<Candidate>],
    scale: ScoreScale,
    out: &mut impl Write,
) -> io::Result<()> {
    out.write_all(b"{\"keypoints\":[")?;
    for (i, keypoint) in person.iter().enumerate() {
        if i > 0 {
            out.write_all(b",")?;
        }
        match keypoint {
            Some(it) => {
                let score = scale.applied(it.score);
                for (before, number) in [("[", it.x_px), (",", it.y_px), (",", score)] {
                    out.write_all(before.as_bytes())?;
                    write_number(number, out)?;
                }
                out.write_all(b"]")?;
            }
            None => out.write_all(b"null")?,
        }
    }
    out.write_all(b"]}")
}

/// Writes the shortest digits that read back as the same number. Tiny numbers use an exponent
/// instead of hundreds of zeros.
fn write_number(number: f64, out: &mut impl Write) -> io::Result<()> {
    const TINY: f64 = 1e-5;
    if number != 0.0 && number.abs() < TINY {
        write!(out, "{number:e}")
    } else {
        write!(out, "{number}")
    }
}

/// Mean and largest number of people per frame of one camera.
pub(crate) fn people_per_frame(frames: &BTreeMap<i64, Vec<Person>>) -> (f64, usize) {
    let all: usize = frames.values().map(Vec::len).sum();
    let most = frames.values().map(Vec::len).max().unwrap_or(0);
    (all as f64 / frames.len().max(1) as f64, most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::person::MAX_PEOPLE_OF_FRAME;

    fn camera(name: &str, frames: &[i64]) -> CameraFrames {
        let seen = Candidate {
            x_px: 300.0,
            y_px: 400.5,
            score: 0.75,
        };
        CameraFrames {
            name: name.to_owned(),
            size_px: [1920, 1080],
            down: [0.0, 1.0],
            source: name.to_owned(),
            frames: frames
                .iter()
                .map(|at| (*at, vec![[Some(seen); COCO23.len()]]))
                .collect(),
        }
    }

    #[test]
    fn cameras_share_one_range_and_missing_frames_are_reported() {
        let mut cameras = [camera("a", &[5, 6, 8]), camera("b", &[4, 5, 6, 7, 8])];
        let assembled = assemble(&mut cameras).unwrap();
        assert_eq!(assembled.ticks, 4..9);
        let texts: Vec<String> = assembled.remarks.iter().map(|it| it.text.clone()).collect();
        let texts = texts.join("\n");
        assert!(texts.contains("the first frame is 4"), "{texts}");
        assert!(texts.contains("its frames go from 5 to 8"), "{texts}");
        assert!(texts.contains("1 frames between"), "{texts}");
        let mut lines = Vec::new();
        write_lines(
            &cameras[0].frames,
            &assembled.ticks,
            assembled.keypoints.len(),
            assembled.scales[0],
            &mut lines,
        )
        .unwrap();
        let lines = String::from_utf8(lines).unwrap();
        let lines: Vec<&str> = lines.lines().collect();
        assert_eq!(lines.len(), 5);
        assert_eq!(lines[0], r#"{"tick":4,"persons":[]}"#);
        assert!(lines[1].starts_with(r#"{"tick":5,"persons":[{"keypoints":[[300,400.5,0.75],"#));
        assert_eq!(lines[3], r#"{"tick":7,"persons":[]}"#);
    }

    #[test]
    fn largest_allowed_frame_fits_the_edge_line_limit() {
        /// The edge refuses longer lines: `MAX_LINE_BYTES` of `edge/src/source/keypoints.rs`.
        const LONGEST_LINE_BYTES: usize = 4 << 20;
        for number in [
            -1.234_567_890_123_456_7e-300,
            -999_999.123_456_789_1,
            1e-5 / 3.0,
        ] {
            let seen = Candidate {
                x_px: number,
                y_px: number,
                score: number.abs().min(1.0),
            };
            let people = vec![[Some(seen); COCO23.len()]; MAX_PEOPLE_OF_FRAME];
            let mut camera = camera("a", &[]);
            camera.frames.insert(0, people);
            let mut line = Vec::new();
            let scale = ScoreScale::per_camera(std::slice::from_ref(&camera), &mut Vec::new());
            write_lines(&camera.frames, &(0..1), COCO23.len(), scale[0], &mut line).unwrap();
            assert!(line.len() < LONGEST_LINE_BYTES, "{}", line.len());
            let read: serde_json::Value = serde_json::from_slice(&line).unwrap();
            let x_px = read["persons"][7]["keypoints"][3][0].as_f64().unwrap();
            assert!((x_px - number).abs() <= 1e-15 * number.abs(), "{x_px}");
        }
    }

    #[test]
    fn a_stray_frame_number_does_not_extend_the_run() {
        let count: Vec<i64> = (0..40).collect();
        for stray in [100_000, -5000] {
            let with_stray: Vec<i64> = count.iter().copied().chain([stray]).collect();
            let mut cameras = [camera("a", &count), camera("b", &with_stray)];
            let assembled = assemble(&mut cameras).unwrap();
            assert_eq!(assembled.ticks, 0..40);
            let remark = &assembled.remarks[0];
            assert_eq!(remark.camera.as_deref(), Some("b"));
            assert!(remark.text.contains(&format!("frame {stray} ")));
        }
        // A camera that started earlier, and a pause, are not strays.
        let mut cameras = [camera("a", &count), camera("b", &[-600, -599, 0, 900])];
        assert_eq!(assemble(&mut cameras).unwrap().ticks, -600..901);
    }

    #[test]
    fn frame_numbers_that_are_not_counts_are_refused() {
        let error = assemble(&mut [camera("a", &[0, 20_240_501_120_000])]).unwrap_err();
        assert!(error.contains("20240501120000"), "{error}");
        let error = assemble(&mut [camera("a", &[i64::MIN, i64::MAX])]).unwrap_err();
        assert!(error.contains(&i64::MAX.to_string()), "{error}");
        let mut empty = camera("a", &[0]);
        empty.frames.insert(0, Vec::new());
        assert!(assemble(&mut [empty]).unwrap_err().contains("no people"));
        assert!(assemble(&mut []).is_err());
    }
}
