//! Cameras side by side on one count of frames: which frames there are, on which scale scores are, what is doubtful; and the
//! lines of our keypoint files.

mod doubts;
mod scores;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::ops::Range;

use farfield_calibration::formats::{Remark, RemarkKind};
use farfield_proto::order_statistics::{FEWEST_REACHING, reached_by};

use crate::person::{Frames, Person, span};

pub use self::scores::ScoreScale;

/// What one camera saw, under its name in the calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraFrames {
    /// As the calibration has it.
    pub name: String,
    /// Width and height of the calibration's pictures, pixels.
    pub size_px: [u32; 2],
    /// Where the calibration has the world's -z point in the pictures, a unit vector: (0, 1) of a camera that is not rolled.
    pub down: [f64; 2],
    /// Where the keypoints came from.
    pub source: String,
    /// They.
    pub frames: Frames,
}

/// What all cameras have in common.
#[derive(Debug, Clone, PartialEq)]
pub struct Assembled {
    /// Ticks of every keypoint file.
    pub ticks: Range<i64>,
    /// What the scores of each camera are divided by.
    pub scales: Vec<ScoreScale>,
    /// What was assumed, and what is doubtful.
    pub remarks: Vec<Remark>,
}

/// Frames outside what [`FRAMES_SHARE`] of all reach are strays from so many frames on, or its whole length where that
/// is more: a file of another recording, a number that is a date.
const STRAY_FRAMES: f64 = 1000.0;
const FRAMES_SHARE: f64 = 0.01;
/// Of fewer frames none is a stray.
const FEWEST_FRAMES: usize = 2 * FEWEST_REACHING;

/// Looks at all cameras together, and leaves out frames far from all others.
///
/// # Errors
/// A sentence where nobody was found, where frames are too many, where keypoints are no pixels.
pub fn assemble(cameras: &mut [CameraFrames]) -> Result<Assembled, String> {
    let mut remarks = Vec::new();
    leave_out_strays(cameras, &mut remarks);
    let ticks = ticks(cameras)?;
    frames_said(cameras, &ticks, &mut remarks);
    let scales = ScoreScale::of(cameras, &mut remarks);
    for camera in cameras.iter() {
        doubts::look(camera, &mut remarks)?;
    }
    Ok(Assembled {
        ticks,
        scales,
        remarks,
    })
}

/// Takes out frames whose numbers are far from those of all others, so that one number does not decide how long a run is.
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
            "{} frames were left out: frame {stray} is far from nearly all others, which are from about {first} to {last}",
            before - camera.frames.len()
        );
        remarks.push(Remark::of_camera(RemarkKind::Doubtful, &camera.name, text));
    }
}

/// From the first frame of any camera to the last of any.
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
        return Err("found nobody in any frame of any camera".to_owned());
    }
    Ok(ticks)
}

/// Frames that do not begin at 0, that cameras do not share, that are missing.
fn frames_said(cameras: &[CameraFrames], ticks: &Range<i64>, remarks: &mut Vec<Remark>) {
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
                    "its frames go from {first} to {last}, those of all cameras from {} to {}: cameras were put side by side \
                     by these numbers, as if they had counted together",
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
                    "{missing} frames between its first and last are missing: nobody is in them"
                ),
            ));
        }
    }
}

/// Writes the keypoint file of one camera: a line per tick.
///
/// # Errors
/// What `out` refuses.
pub fn write_lines(
    frames: &Frames,
    ticks: &Range<i64>,
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
            write_person(person, scale, out)?;
        }
        out.write_all(b"]}\n")?;
    }
    Ok(())
}

fn write_person(person: &Person, scale: ScoreScale, out: &mut impl Write) -> io::Result<()> {
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

/// The shortest digits that are read as the same number, without the hundreds of zeros that a tiny one begins with.
fn write_number(number: f64, out: &mut impl Write) -> io::Result<()> {
    const TINY: f64 = 1e-5;
    if number != 0.0 && number.abs() < TINY {
        write!(out, "{number:e}")
    } else {
        write!(out, "{number}")
    }
}

/// How many people there are in how many frames of one camera: mean and largest.
pub(crate) fn people_per_frame(frames: &BTreeMap<i64, Vec<Person>>) -> (f64, usize) {
    let all: usize = frames.values().map(Vec::len).sum();
    let most = frames.values().map(Vec::len).max().unwrap_or(0);
    (all as f64 / frames.len().max(1) as f64, most)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::person::{Candidate, MAX_PEOPLE_OF_FRAME};

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
                .map(|at| (*at, vec![[Some(seen); 17]]))
                .collect(),
        }
    }

    #[test]
    fn cameras_share_one_range_and_what_is_missing_is_empty_and_said() {
        let mut cameras = [camera("a", &[5, 6, 8]), camera("b", &[4, 5, 6, 7, 8])];
        let assembled = assemble(&mut cameras).unwrap();
        assert_eq!(assembled.ticks, 4..9);
        let said: Vec<String> = assembled.remarks.iter().map(|it| it.text.clone()).collect();
        let said = said.join("\n");
        assert!(said.contains("the first frame is 4"), "{said}");
        assert!(said.contains("its frames go from 5 to 8"), "{said}");
        assert!(said.contains("1 frames between"), "{said}");
        let mut lines = Vec::new();
        write_lines(
            &cameras[0].frames,
            &assembled.ticks,
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
    fn a_frame_of_as_many_people_as_it_may_have_is_a_line_that_a_run_reads() {
        /// The edge refuses longer ones: `MAX_LINE_BYTES` of its `source/keypoints.rs`.
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
            let people = vec![[Some(seen); 17]; MAX_PEOPLE_OF_FRAME];
            let mut camera = camera("a", &[]);
            camera.frames.insert(0, people);
            let mut line = Vec::new();
            let scale = ScoreScale::of(std::slice::from_ref(&camera), &mut Vec::new());
            write_lines(&camera.frames, &(0..1), scale[0], &mut line).unwrap();
            assert!(line.len() < LONGEST_LINE_BYTES, "{}", line.len());
            let read: serde_json::Value = serde_json::from_slice(&line).unwrap();
            let x_px = read["persons"][7]["keypoints"][3][0].as_f64().unwrap();
            assert!((x_px - number).abs() <= 1e-15 * number.abs(), "{x_px}");
        }
    }

    #[test]
    fn one_number_far_from_all_others_does_not_make_a_run_longer() {
        let count: Vec<i64> = (0..40).collect();
        for stray in [100_000, -5000] {
            let with_stray: Vec<i64> = count.iter().copied().chain([stray]).collect();
            let mut cameras = [camera("a", &count), camera("b", &with_stray)];
            let assembled = assemble(&mut cameras).unwrap();
            assert_eq!(assembled.ticks, 0..40);
            let remark = &assembled.remarks[0];
            assert_eq!(remark.camera.as_deref(), Some("b"));
            assert!(remark.text.contains(&format!("frame {stray} is far")));
        }
        // A camera that began earlier, and a pause, are no strays.
        let mut cameras = [camera("a", &count), camera("b", &[-600, -599, 0, 900])];
        assert_eq!(assemble(&mut cameras).unwrap().ticks, -600..901);
    }

    #[test]
    fn numbers_that_count_no_frames_are_refused() {
        let said = assemble(&mut [camera("a", &[0, 20_240_501_120_000])]).unwrap_err();
        assert!(said.contains("something else than frames"), "{said}");
        let said = assemble(&mut [camera("a", &[i64::MIN, i64::MAX])]).unwrap_err();
        assert!(said.contains("something else than frames"), "{said}");
        let mut empty = camera("a", &[0]);
        empty.frames.insert(0, Vec::new());
        assert!(assemble(&mut [empty]).unwrap_err().contains("nobody"));
        assert!(assemble(&mut []).is_err());
    }
}
