//! TRC, the marker file that OpenSim and Pose2Sim share.
//!
//! Metres, y up: TRC (x, y, z) = world (y, z, x). Markers are [`Layout::markers`]. `Frame#` is the
//! venue's tick, so that the files of several persons can be compared. Time starts at 0 with the
//! run's first tick, as in all files of a run. `Orig...` in the header give the ticks of the run
//! that the rows are made from: the same, or other ones in an export with another rate. Every tick
//! has a row. Unknown values are blank: the whole row of a tick without a pose, and markers without
//! a known place. OpenSim 4 reads blanks as missing markers, but refuses rows that end in one, so
//! the last cell of such a row is `NaN`.

use std::fmt::Write as _;

use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;

use super::line::{POSITION_DECIMALS, round};
use super::{Layout, MOST_ROWS};
use crate::body::determined::UNKNOWN_M;

/// Decimals of the time column, seconds.
pub(super) const TIME_DECIMALS: usize = 6;

/// First word of a header.
pub(super) const FIRST_WORD: &str = "PathFileType";
/// Lines of a header.
pub(super) const HEAD_LINES: usize = 5;

/// The ticks of a run that the rows of a file are made from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OriginalTicks {
    /// Ticks per second.
    pub rate_hz: f64,
    /// The first.
    pub first: Tick,
}

/// The five header lines, with no rows so far; [`with_rows`] sets the counts in the same number of
/// bytes. `file_name` is the name in the file, `rate_hz` the rows per second.
pub fn header(layout: &Layout, file_name: &str, rate_hz: f64, original: OriginalTicks) -> String {
    let OriginalTicks {
        rate_hz: original_hz,
        first,
    } = original;
    let markers = layout.markers();
    let names = markers.join("\t\t\t");
    let axes: Vec<String> = (1..=markers.len())
        .map(|i| format!("X{i}\tY{i}\tZ{i}"))
        .collect();
    let axes = axes.join("\t");
    let longest = format!(
        "{FIRST_WORD}\t4\t(X/Y/Z)\t{file_name}\n\
         DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         {rate_hz}\t{rate_hz}\t{MOST_ROWS}\t{}\tm\t{original_hz}\t{first}\t{MOST_ROWS}\n\
         Frame#\tTime\t{names}\t\t\n\
         \t\t{axes}\n",
        markers.len()
    );
    with_rows(&longest, 0).unwrap_or(longest)
}

/// `head` with its number of rows, one per tick; the length stays equal, by tabs at the end of the
/// first line, which readers take for empty cells. `None` if it is not our header, or has no room
/// for the number.
pub fn with_rows(head: &str, n_rows: u64) -> Option<String> {
    with_rows_of_ticks(head, n_rows, n_rows)
}

/// The same for a file whose rows are made from another number of ticks.
pub fn with_rows_of_ticks(head: &str, n_rows: u64, n_ticks: u64) -> Option<String> {
    let mut lines: Vec<&str> = head.split('\n').collect();
    let counts = [n_rows, n_ticks].map(|count| count.to_string());
    let mut values: Vec<&str> = lines.get(2)?.split('\t').collect();
    for (place, count) in [2, 7].into_iter().zip(&counts) {
        *values.get_mut(place)? = count;
    }
    let values = values.join("\t");
    *lines.get_mut(2)? = &values;
    let title = lines[0].trim_end_matches('\t');
    let rest = lines[1..].join("\n");
    let room = head.len().checked_sub(title.len() + 1 + rest.len())?;
    Some(format!("{title}{}\n{rest}", "\t".repeat(room)))
}

/// One row: a pose, or the row of a tick without one.
pub fn row(layout: &Layout, tick: Tick, time_s: f64, pose: Option<&PersonPose>) -> String {
    let mut text = format!("{tick}\t{time_s:.TIME_DECIMALS$}");
    if let Some(pose) = pose {
        let joints = (0..layout.joints.len()).filter(|&i| layout.is_marker[i]);
        for i in joints {
            push_marker(&mut text, pose.joints_m.get(i), pose.sigma_m.get(i));
        }
        for keypoint in &layout.keypoints {
            let joint = layout.joints.iter().position(|it| *it == keypoint.name);
            let sigma_m = joint.and_then(|joint| pose.sigma_m.get(joint));
            push_marker(&mut text, pose.keypoints_m.get(keypoint.index), sigma_m);
        }
    } else {
        let joints = layout.is_marker.iter().filter(|is_marker| **is_marker);
        text.push_str(&BLANK.repeat(joints.count() + layout.keypoints.len()));
    }
    if text.ends_with('\t') {
        text.push_str("NaN");
    }
    text.push('\n');
    text
}

/// The cells of an unknown marker.
const BLANK: &str = "\t\t\t";

/// Adds the cells of a point in world metres; `sigma_m` is its standard deviation, if known.
fn push_marker(text: &mut String, at_m: Option<&[f32; 3]>, sigma_m: Option<&f32>) {
    let is_unknown = sigma_m.is_some_and(|&sigma_m| sigma_m > UNKNOWN_M);
    let Some(&[x, y, z]) = at_m.filter(|_| !is_unknown) else {
        text.push_str(BLANK);
        return;
    };
    for v in [y, z, x] {
        let v = round(f64::from(v), POSITION_DECIMALS);
        write!(text, "\t{v:.*}", POSITION_DECIMALS as usize)
            .expect("a string takes all that is written to it");
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::keypoints::KeypointSet;
    use farfield_proto::message::PersonState;

    use super::super::fixture;
    use super::*;

    /// A header of a run at 60 Hz.
    fn head(layout: &Layout, first: i64) -> String {
        let original = OriginalTicks {
            rate_hz: 60.0,
            first: Tick(first),
        };
        header(layout, "poses_1.trc", 60.0, original)
    }

    #[test]
    fn a_file_has_the_form_of_pose2sim() {
        let layout = fixture::layout();
        let pose = fixture::pose(1, PersonState::Tracked);
        let head = head(&layout, 300);
        let text = with_rows(&head, 2).unwrap()
            + &row(&layout, Tick(300), 0.0, Some(&pose))
            + &row(&layout, Tick(301), 1.0 / 60.0, None);
        let lines: Vec<&str> = text.lines().collect();
        let title = lines[0].trim_end_matches('\t');
        assert_eq!(title, "PathFileType\t4\t(X/Y/Z)\tposes_1.trc");
        assert_eq!(lines[2], "60\t60\t2\t3\tm\t60\t300\t2");
        assert_eq!(
            lines[3],
            "Frame#\tTime\tpelvis\t\t\tleft_knee\t\t\tkeypoint_left_knee\t\t"
        );
        assert_eq!(lines[4], "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\tX3\tY3\tZ3");
        // World (1, 2, 0.9) is TRC (2, 0.9, 1).
        assert_eq!(
            lines[5],
            "300\t0.000000\t2.00000\t0.90000\t1.00000\t-2.00000\t0.50000\t1.25000\t-2.00000\t0.50000\t1.26000"
        );
        assert_eq!(lines[6], format!("301\t0.016667{}NaN", "\t".repeat(9)));
    }

    #[test]
    fn unknown_markers_are_blank_and_undetermined_ones_omitted() {
        let mut layout = fixture::layout();
        let mut pose = fixture::pose(1, PersonState::Coasting);
        pose.sigma_m = vec![0.02, 0.3];
        assert_eq!(
            row(&layout, Tick(7), 0.5, Some(&pose)),
            "7\t0.500000\t2.00000\t0.90000\t1.00000\t\t\t\t\t\tNaN\n"
        );
        pose.sigma_m.clear();
        layout.is_marker = vec![false, true];
        assert_eq!(layout.markers(), ["left_knee", "keypoint_left_knee"]);
        let row = row(&layout, Tick(7), 0.5, Some(&pose));
        assert!(row.starts_with("7\t0.500000\t-2.00000\t"), "{row}");
        let cells = head(&layout, 7);
        let cells = cells.lines().nth(4).unwrap().split('\t').count();
        assert_eq!(row.split('\t').count(), cells);
    }

    /// Symptom to prevent: thumbs and mouth of `BlazePose` were markers at the pelvis.
    #[test]
    fn keypoints_without_a_place_on_the_body_are_no_markers() {
        let names = ["left_thumb", "left_heel"].map(str::to_owned).to_vec();
        let layout = Layout::of(&KeypointSet::new(names), None);
        let markers = layout.markers();
        assert!(
            !markers.iter().any(|it| it.contains("thumb")),
            "{markers:?}"
        );
        let mut pose = fixture::pose(1, PersonState::Tracked);
        pose.keypoints_m = vec![[9.0; 3], [0.5, 0.25, 0.125]];
        let row = row(&layout, Tick(7), 0.5, Some(&pose));
        assert!(row.ends_with("\t0.25000\t0.12500\t0.50000\n"), "{row}");
    }

    #[test]
    fn the_length_of_a_head_does_not_depend_on_its_count() {
        let head = head(&fixture::layout(), 300);
        for n_rows in [1, 99_999_999, MOST_ROWS] {
            let counted = with_rows(&head, n_rows).unwrap();
            assert_eq!(counted.len(), head.len());
            assert!(counted.contains(&format!("60\t60\t{n_rows}\t3\tm\t60\t300\t{n_rows}\n")));
            assert_eq!(with_rows(&counted, 0).unwrap(), head);
        }
        assert_eq!(with_rows(&head, u64::MAX), None);
        assert_eq!(with_rows("Frame#\tTime\n", 1), None);
    }

    #[test]
    fn a_head_of_another_rate_has_the_original_ticks() {
        let original = OriginalTicks {
            rate_hz: 60.0,
            first: Tick(300),
        };
        let head = header(&fixture::layout(), "poses_1.trc", 120.0, original);
        let counted = with_rows_of_ticks(&head, 99, 50).unwrap();
        assert_eq!(counted.len(), head.len());
        assert!(counted.contains("\n120\t120\t99\t3\tm\t60\t300\t50\n"));
    }

    #[test]
    fn no_marker_has_the_name_of_another() {
        let mut markers = fixture::layout().markers();
        let n = markers.len();
        markers.sort();
        markers.dedup();
        assert_eq!(markers.len(), n);
    }
}
