//! MOT, OpenSim's motion file: the reported angles over time.
//!
//! Degrees, the root's translations metres, in the frame of the TRC file (y up). Time starts at 0
//! with the run's first tick, as in all files of a run. A tick without a pose has no row, and
//! neither has a tick with an unknown place, after a long time unseen ([`has_row`]). The reason:
//! OpenSim's `Storage` stops reading at a `NaN`, and interpolates over missing time. Therefore an
//! undetermined angle also has no column. The head lists these angles, and those that are
//! determined only together. A person who keeps turning has pelvis angles beyond 180. All others
//! stay in their ranges, so that left and right compare: an arm that crosses the other side of the
//! circle jumps from one end of its range to the other.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::iter;

use farfield_proto::message::PersonPose;

use super::line::{draw_in, round, round_inward};
use super::trc::TIME_DECIMALS;
use super::{AngleColumn, AngleUnit, Layout, MOST_ROWS};
use crate::body::determined::{AngleEvidence, UNKNOWN_M};

/// Decimals of angles in degrees, and of translations in metres.
const DECIMALS: u32 = 6;
/// Prefix of the number of rows.
const ROWS: &str = "nRows=";
/// Prefix of the root's angles, which may accumulate turns.
const ROOT: &str = "pelvis_";

/// First word of a header.
pub(super) const FIRST_WORD: &str = "Coordinates";
/// Last line of the header; a line of names follows.
pub(super) const END_OF_HEAD: &str = "endheader";

/// The header up to the row of names, with no rows so far; [`with_rows`] sets the count in the same
/// number of bytes.
pub fn header(layout: &Layout) -> String {
    let columns: Vec<&str> = layout.columns().map(|angle| angle.name.as_str()).collect();
    let n_columns = columns.len() + 1;
    let names = iter::once("time").chain(columns);
    let names = names.collect::<Vec<_>>().join("\t");
    let [missing, shared] = [
        (
            "Left out, since the keypoints do not determine them",
            AngleEvidence::Missing,
        ),
        (
            "Determined only together with those that hang from them",
            AngleEvidence::Shared,
        ),
    ]
    .map(|(what, evidence)| note(layout, what, evidence));
    let longest = format!(
        "{FIRST_WORD}\n\
         version=1\n\
         {ROWS}{MOST_ROWS}\n\
         nColumns={n_columns}\n\
         inDegrees=yes\n\
         \n\
         Units are S.I. units (second, meters, Newtons, ...)\n\
         If the header above contains a line with 'inDegrees', this indicates whether rotational values \
         are in degrees (yes) or radians (no).\n\
         {missing}{shared}\
         \n\
         {END_OF_HEAD}\n\
         {names}\n"
    );
    with_rows(&longest, 0).unwrap_or(longest)
}

/// A line of the head that lists the angles with this evidence; empty if there are none.
fn note(layout: &Layout, what: &str, evidence: AngleEvidence) -> String {
    let angles = layout.angles.iter();
    let named = angles.filter(|angle| angle.evidence == evidence);
    let names: Vec<&str> = named.map(|angle| angle.name.as_str()).collect();
    if names.is_empty() {
        return String::new();
    }
    format!("{what}: {}\n", names.join(" "))
}

/// `head` with its number of rows; the length stays equal, by spaces in the empty line before its
/// end. `None` if it is not our header, or has no room for the number.
pub fn with_rows(head: &str, n_rows: u64) -> Option<String> {
    let mut lines: Vec<&str> = head.split('\n').collect();
    let count = format!("{ROWS}{n_rows}");
    let counted = lines.iter().position(|line| line.starts_with(ROWS))?;
    let padding = lines.iter().position(|line| *line == END_OF_HEAD)?;
    let padding = padding.checked_sub(1).filter(|&i| i > counted)?;
    if !lines[padding].trim_end_matches(' ').is_empty() {
        return None;
    }
    lines[counted] = &count;
    lines[padding] = "";
    let length: usize = lines.iter().map(|line| line.len() + 1).sum();
    let spaces = " ".repeat((head.len() + 1).checked_sub(length)?);
    lines[padding] = &spaces;
    Some(lines.join("\n"))
}

/// Whether the angles of a pose are known: at least one joint is known well enough to be a marker
/// of the TRC file. Otherwise the pose is only predicted, and a file of numbers could not express
/// that.
pub fn has_row(pose: &PersonPose) -> bool {
    let mut sigmas_m = pose.sigma_m.iter();
    pose.sigma_m.is_empty() || sigmas_m.any(|sigma_m| *sigma_m <= UNKNOWN_M)
}

/// The rows of one file, one after the other.
#[derive(Debug, Clone, Default)]
pub struct MotRows {
    /// Per angle, its value in the previous row.
    last: Vec<f64>,
}

impl MotRows {
    /// The next row. An angle of the pelvis continues from the previous row, also beyond 180
    /// degrees: OpenSim interpolates and differentiates between rows, and would read a wrapped
    /// angle as a turn in one tick. Other angles are written as reported, inside their range. The
    /// angles of an arm flip by half a turn where it passes their pole, and may flip the other way
    /// on the way back. Continued angles would keep false whole turns. So the arm of a swimmer, for
    /// example, jumps once per turn.
    pub fn row(&mut self, layout: &Layout, time_s: f64, pose: &PersonPose) -> String {
        let mut text = format!("{time_s:.TIME_DECIMALS$}");
        let is_first = self.last.is_empty();
        self.last.resize(layout.angles.len(), 0.0);
        let angles = layout.angles.iter().zip(&pose.angles);
        for ((angle, &value), last) in angles.zip(&mut self.last) {
            if angle.evidence == AngleEvidence::Missing {
                continue;
            }
            let printed = angle.printed(value);
            *last = if is_first || !angle.accumulates() || !last.is_finite() {
                printed
            } else {
                round(
                    printed + 360.0 * ((*last - printed) / 360.0).round(),
                    DECIMALS,
                )
            };
            write!(text, "\t{:.*}", DECIMALS as usize, last)
                .expect("a string takes all that is written to it");
        }
        text.push('\n');
        text
    }
}

impl AngleColumn {
    /// Whether it may accumulate turns: it is an angle of the root, and its range, if any, is the
    /// whole circle.
    fn accumulates(&self) -> bool {
        let is_circle = |[low, high]: [f64; 2]| high - low > 2.0 * PI - 1e-6;
        let is_root = self.unit == AngleUnit::Radian && self.name.starts_with(ROOT);
        is_root && self.range_rad.is_none_or(is_circle)
    }

    /// Degrees (or metres), rounded inward at a bound.
    fn printed(&self, value: f32) -> f64 {
        let value = f64::from(value);
        match (self.unit, self.range_rad) {
            (AngleUnit::Metre, _) => round(value, DECIMALS),
            (AngleUnit::Radian, None) => round(value.to_degrees(), DECIMALS),
            (AngleUnit::Radian, Some(range)) => {
                // In radians first: only there the error of f32 is known.
                let inside = draw_in(value, range);
                round_inward(inside.to_degrees(), DECIMALS, range.map(f64::to_degrees))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::keypoints::KeypointSet;
    use farfield_proto::message::PersonState;

    use super::super::fixture;
    use super::*;
    use crate::body::skeleton::RangeOfMotion;

    #[test]
    fn a_file_has_the_form_that_opensim_reads() {
        let layout = fixture::layout();
        let pose = fixture::pose(1, PersonState::Tracked);
        let row = MotRows::default().row(&layout, 0.05, &pose);
        let text = with_rows(&header(&layout), 1).unwrap() + &row;
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[..5],
            [
                "Coordinates",
                "version=1",
                "nRows=1",
                "nColumns=4",
                "inDegrees=yes"
            ]
        );
        let end = lines.iter().position(|&line| line == "endheader").unwrap();
        assert_eq!(lines[end + 1], "time\tpelvis_tilt\tpelvis_tx\tknee_angle_l");
        assert_eq!(lines[end + 2], "0.050000\t30.000001\t2.500000\t23.491269");
    }

    #[test]
    fn a_pose_without_known_joints_has_no_row() {
        let mut pose = fixture::pose(1, PersonState::Coasting);
        assert!(has_row(&pose));
        pose.sigma_m = vec![0.13, 0.09];
        assert!(has_row(&pose), "one joint is known");
        pose.sigma_m = vec![0.13, 0.2];
        assert!(!has_row(&pose));
        pose.sigma_m.clear();
        assert!(has_row(&pose), "a pose without sigmas");
    }

    #[test]
    fn an_undetermined_angle_is_listed_in_the_head_without_a_column() {
        let mut layout = fixture::layout();
        layout.angles[0].evidence = AngleEvidence::Shared;
        layout.angles[2].evidence = AngleEvidence::Missing;
        let head = header(&layout);
        for line in [
            "nColumns=3",
            "Left out, since the keypoints do not determine them: knee_angle_l",
            "Determined only together with those that hang from them: pelvis_tilt",
            "time\tpelvis_tilt\tpelvis_tx",
        ] {
            assert!(head.lines().any(|found| found == line), "{line}: {head}");
        }
        let counted = with_rows(&head, 12).unwrap();
        assert_eq!(counted.len(), head.len());
        let pose = fixture::pose(1, PersonState::Tracked);
        let row = MotRows::default().row(&layout, 0.05, &pose);
        assert_eq!(row, "0.050000\t30.000001\t2.500000\n");
    }

    #[test]
    fn pelvis_rotation_accumulates_turns() {
        let (mut layout, mut rows) = (fixture::layout(), MotRows::default());
        layout.angles[0].range_rad = Some([-PI, PI]);
        let mut pose = fixture::pose(1, PersonState::Tracked);
        // Two turns to the left and one back, 25 degrees a tick.
        let turns = (0..29).chain((14..29).rev()).map(|i| 25.0 * f64::from(i));
        for turned_deg in turns {
            let wrapped_deg = turned_deg - 360.0 * (turned_deg / 360.0f64).round();
            pose.angles[0] = wrapped_deg.to_radians() as f32;
            let row = rows.row(&layout, 0.0, &pose);
            let columns: Vec<&str> = row.trim_end().split('\t').collect();
            let written: f64 = columns[1].parse().unwrap();
            assert!(
                (written - turned_deg).abs() < 1e-4,
                "{written} {turned_deg}"
            );
            assert_eq!(columns[3], "23.491269", "a knee has bounds");
        }
    }

    #[test]
    fn an_arm_passing_the_pole_stays_in_its_range() {
        // Flexion of an arm that passes its pole on one side and returns on the other, three times.
        // Each time it has gone round the circle once, and hangs as before.
        let (mut layout, mut rows) = (fixture::layout(), MotRows::default());
        layout.angles[2] = AngleColumn {
            range_rad: Some([-PI, PI]),
            ..AngleColumn::named("arm_flex_r")
        };
        let mut pose = fixture::pose(1, PersonState::Tracked);
        for reported_deg in [10.0, 100.0, 179.0, -179.0, -100.0].repeat(3) {
            pose.angles[2] = f64::to_radians(reported_deg) as f32;
            let row = rows.row(&layout, 0.0, &pose);
            let written: f64 = row.trim_end().rsplit('\t').next().unwrap().parse().unwrap();
            assert!((written - reported_deg).abs() < 1e-4, "{written}");
        }
        // At the end of the range, where f32 is beyond it.
        for end in [PI, -PI] {
            pose.angles[2] = end as f32;
            let row = rows.row(&layout, 0.0, &pose);
            let written: f64 = row.trim_end().rsplit('\t').next().unwrap().parse().unwrap();
            assert!((179.9999..=180.0).contains(&written.abs()), "{written}");
        }
    }

    #[test]
    fn only_the_pelvis_accumulates_turns() {
        let keypoints = KeypointSet::coco17();
        let range = RangeOfMotion::default();
        let accumulates = |range: Option<&RangeOfMotion>| -> Vec<String> {
            let layout = Layout::of(&keypoints, range);
            let free = layout.angles.into_iter().filter(AngleColumn::accumulates);
            free.map(|angle| angle.name).collect()
        };
        assert_eq!(
            accumulates(Some(&range)),
            ["pelvis_tilt", "pelvis_rotation"]
        );
        // Without a range the pelvis' list is also free, but it reports at most a quarter of a
        // turn.
        let root = ["pelvis_tilt", "pelvis_list", "pelvis_rotation"];
        assert_eq!(accumulates(None), root);
    }

    #[test]
    fn the_length_of_a_head_does_not_depend_on_its_count() {
        let head = header(&fixture::layout());
        for n_rows in [1, 99_999_999, MOST_ROWS] {
            let counted = with_rows(&head, n_rows).unwrap();
            assert_eq!(counted.len(), head.len());
            assert!(counted.contains(&format!("\nnRows={n_rows}\nnColumns=4\n")));
            assert_eq!(with_rows(&counted, 0).unwrap(), head);
        }
        assert_eq!(with_rows(&head, u64::MAX), None);
        assert_eq!(with_rows("nRows=1\n", 1), None);
    }

    #[test]
    fn degrees_stay_inside_the_range_too() {
        let high = 130.0f64.to_radians();
        let knee = AngleColumn {
            range_rad: Some([0.0, high]),
            ..AngleColumn::named("knee_angle_r")
        };
        assert!(f64::from(high as f32) > high);
        let written: f64 = format!("{:.6}", knee.printed(high as f32)).parse().unwrap();
        assert!((129.9999..=130.0).contains(&written), "{written}");
    }
}
