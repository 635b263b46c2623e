//! TRC, the marker file that OpenSim and Pose2Sim share.
//!
//! Metres, y up: TRC (x, y, z) = world (y, z, x). Markers are [`Layout::markers`]. `Frame#` is the
//! venue's tick, so that the files of several persons can be laid side by side; time starts at 0 with
//! the file's first tick. Every tick in between has a row: one without a pose holds `NaN`, which
//! OpenSim 4 reads as a missing marker (it refuses rows that end in empty cells).

use std::fmt::Write as _;

use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;

use super::Layout;
use super::line::POSITION_DECIMALS;
use super::rounding::round;

/// Decimals of the time column, seconds.
pub(super) const TIME_DECIMALS: usize = 6;

/// The five header lines. `file_name` is what the file calls itself.
pub fn header(layout: &Layout, file_name: &str, rate_hz: f64, first: Tick, n_rows: u64) -> String {
    let markers = layout.markers();
    let names = markers.join("			");
    let axes: Vec<String> = (1..=markers.len())
        .map(|i| format!("X{i}	Y{i}	Z{i}"))
        .collect();
    let axes = axes.join("	");
    format!(
        "PathFileType\t4\t(X/Y/Z)\t{file_name}\n\
         DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n\
         {rate_hz}\t{rate_hz}\t{n_rows}\t{}\tm\t{rate_hz}\t{first}\t{n_rows}\n\
         Frame#\tTime\t{names}\t\t\n\
         \t\t{axes}\n",
        markers.len()
    )
}

/// One row: a pose, or the row of a tick without one.
pub fn row(layout: &Layout, tick: Tick, time_s: f64, pose: Option<&PersonPose>) -> String {
    let mut text = format!("{tick}\t{time_s:.TIME_DECIMALS$}");
    let n_markers = layout.joints.len() + layout.keypoints.len();
    match pose {
        Some(pose) => {
            let joints = pose.joints_m.iter().take(layout.joints.len());
            for [x, y, z] in joints.chain(pose.keypoints_m.iter().take(layout.keypoints.len())) {
                for v in [y, z, x] {
                    let v = round(f64::from(*v), POSITION_DECIMALS);
                    write!(text, "\t{v:.*}", POSITION_DECIMALS as usize)
                        .expect("a string takes all that is written to it");
                }
            }
        }
        None => text.push_str(&"\tNaN".repeat(3 * n_markers)),
    }
    text.push('\n');
    text
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::PersonState;

    use super::super::fixture;
    use super::*;

    #[test]
    fn a_file_is_as_pose2sim_writes_it() {
        let layout = fixture::layout();
        let pose = fixture::pose(1, PersonState::Tracked);
        let text = header(&layout, "poses_1.trc", 60.0, Tick(300), 2)
            + &row(&layout, Tick(300), 0.0, Some(&pose))
            + &row(&layout, Tick(301), 1.0 / 60.0, None);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[0], "PathFileType\t4\t(X/Y/Z)\tposes_1.trc");
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
        assert_eq!(lines[6], format!("301\t0.016667{}", "\tNaN".repeat(9)));
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
