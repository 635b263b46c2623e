//! MOT, OpenSim's motion file: the reported angles over time.
//!
//! Degrees, the root's translations metres, in the frame of the TRC file (y up). Time starts at 0 with
//! the file's first tick. A tick without a pose has no row: OpenSim's `Storage` stops reading at a
//! `NaN`, and interpolates over time that is missing.

use std::fmt::Write as _;
use std::iter;

use farfield_proto::message::PersonPose;

use super::rounding::{draw_in, round, round_inward};
use super::trc::TIME_DECIMALS;
use super::{AngleColumn, AngleUnit, Layout};

/// Decimals of angles in degrees, and of translations in metres.
const DECIMALS: u32 = 6;

/// The header up to the row of names.
pub fn header(layout: &Layout, n_rows: u64) -> String {
    let columns = layout.angles.iter().map(|angle| angle.name.as_str());
    let names = iter::once("time")
        .chain(columns)
        .collect::<Vec<_>>()
        .join("	");
    format!(
        "Coordinates\n\
         version=1\n\
         nRows={n_rows}\n\
         nColumns={}\n\
         inDegrees=yes\n\
         \n\
         Units are S.I. units (second, meters, Newtons, ...)\n\
         If the header above contains a line with 'inDegrees', this indicates whether rotational values \
         are in degrees (yes) or radians (no).\n\
         \n\
         endheader\n\
         {names}\n",
        layout.angles.len() + 1
    )
}

/// One row.
pub fn row(layout: &Layout, time_s: f64, pose: &PersonPose) -> String {
    let mut text = format!("{time_s:.TIME_DECIMALS$}");
    for (angle, &value) in layout.angles.iter().zip(&pose.angles) {
        write!(text, "\t{:.*}", DECIMALS as usize, angle.printed(value))
            .expect("a string takes all that is written to it");
    }
    text.push('\n');
    text
}

impl AngleColumn {
    /// Degrees (or metres), rounded inward at a bound.
    fn printed(&self, value: f32) -> f64 {
        let value = f64::from(value);
        match (self.unit, self.range_rad) {
            (AngleUnit::Metre, _) => round(value, DECIMALS),
            (AngleUnit::Radian, None) => round(value.to_degrees(), DECIMALS),
            (AngleUnit::Radian, Some(range)) => {
                // In radians first: only there is it known how far f32 can have carried the angle.
                let inside = draw_in(value, range);
                round_inward(inside.to_degrees(), DECIMALS, range.map(f64::to_degrees))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::PersonState;

    use super::super::fixture;
    use super::*;

    #[test]
    fn a_file_is_as_opensim_reads_it() {
        let layout = fixture::layout();
        let pose = fixture::pose(1, PersonState::Tracked);
        let text = header(&layout, 1) + &row(&layout, 0.05, &pose);
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
