//! One line of `poses.jsonl`: one person at one tick, as JSON.

use std::io;

use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;
use serde::ser::{Serialize, SerializeMap as _, Serializer};

use super::{AngleColumn, Layout};

/// Decimals of positions, metres.
pub(super) const POSITION_DECIMALS: u32 = 5;
/// Decimals of standard deviations, metres.
const SIGMA_DECIMALS: u32 = 4;
/// Decimals of angles, radians.
pub(super) const ANGLE_DECIMALS: u32 = 6;

/// A person at a tick, ready to be serialised: positions in world metres with 5 decimals, standard
/// deviations in metres with 4, angles in radians with 6, rounded inward at a bound of their range.
/// Fields and points come in the order of the model, so that equal poses are equal bytes.
#[derive(Debug, Clone, Copy)]
pub struct PoseLine<'a> {
    /// The tick.
    pub tick: Tick,
    /// The person.
    pub pose: &'a PersonPose,
    /// Names of the pose's numbers.
    pub layout: &'a Layout,
}

impl PoseLine<'_> {
    /// Writes the line with its line break.
    ///
    /// # Errors
    /// Those of `writer`.
    pub fn write_to(&self, mut writer: impl io::Write) -> io::Result<()> {
        serde_json::to_writer(&mut writer, self)?;
        writer.write_all(b"\n")
    }
}

impl Serialize for PoseLine<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (pose, layout) = (self.pose, self.layout);
        let unobserved: Vec<&str> = layout
            .angles
            .iter()
            .take(64)
            .enumerate()
            .filter(|(i, _)| pose.unobserved >> i & 1 == 1)
            .map(|(_, angle)| angle.name.as_str())
            .collect();
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("tick", &self.tick)?;
        map.serialize_entry("person", &pose.person)?;
        map.serialize_entry("state", &pose.state)?;
        let joints = layout.joints.iter().zip(&pose.joints_m);
        map.serialize_entry("joints", &Points(joints))?;
        let keypoints = layout.keypoints.iter().filter_map(|keypoint| {
            let at_m = pose.keypoints_m.get(keypoint.index)?;
            Some((&keypoint.name, at_m))
        });
        map.serialize_entry("keypoints", &Points(keypoints))?;
        if !pose.sigma_m.is_empty() {
            map.serialize_entry("sigma_m", &Sigmas(&layout.joints, &pose.sigma_m))?;
        }
        map.serialize_entry("angles", &Angles(&layout.angles, &pose.angles))?;
        map.serialize_entry("unobserved", &unobserved)?;
        map.serialize_entry("views", &pose.views)?;
        map.end()
    }
}

/// Names with their world metres.
struct Points<I>(I);

impl<'a, I> Serialize for Points<I>
where
    I: Iterator<Item = (&'a String, &'a [f32; 3])> + Clone,
{
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let rounded = |p: &[f32; 3]| p.map(|v| round(f64::from(v), POSITION_DECIMALS));
        serializer.collect_map(self.0.clone().map(|(name, at_m)| (name, rounded(at_m))))
    }
}

struct Sigmas<'a>(&'a [String], &'a [f32]);

impl Serialize for Sigmas<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let rounded = |s: &f32| round(f64::from(*s), SIGMA_DECIMALS);
        serializer.collect_map(self.0.iter().zip(self.1.iter().map(rounded)))
    }
}

struct Angles<'a>(&'a [AngleColumn], &'a [f32]);

impl Serialize for Angles<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let columns = self.0.iter().zip(self.1);
        serializer.collect_map(columns.map(|(angle, &value)| (&angle.name, angle.rounded(value))))
    }
}

impl AngleColumn {
    /// `value` (radians, or metres of a translation) with the decimals of `poses.jsonl`.
    pub(super) fn rounded(&self, value: f32) -> f64 {
        let value = f64::from(value);
        match self.range_rad {
            Some(range) => round_inward(draw_in(value, range), ANGLE_DECIMALS, range),
            None => round(value, ANGLE_DECIMALS),
        }
    }
}

/// Distance beyond a bound at which an angle still counts as at the bound, radians: an f32 of an
/// angle in its range is off by at most 2^-24 of itself, below 4e-7 up to 2 pi.
const BEYOND_BOUND: f64 = 1e-6;

/// Rounds to the nearest multiple of 10^-decimals; never -0.
///
/// A value that is too large for such decimals, or not finite, is returned unchanged.
pub fn round(value: f64, decimals: u32) -> f64 {
    let scale = 10f64.powi(decimals.cast_signed());
    let scaled = (value * scale).round();
    if scaled.abs() < MAX_EXACT {
        scaled / scale + 0.0
    } else {
        value
    }
}

/// Every integer up to here is an f64.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;

/// Moves `value` to the bound of `range` if it is slightly beyond it.
///
/// A value beyond by more than the error of f32 is returned unchanged: moving it would hide a
/// fault.
pub fn draw_in(value: f64, range: [f64; 2]) -> f64 {
    let [low, high] = range;
    if value < low - BEYOND_BOUND || value > high + BEYOND_BOUND {
        return value;
    }
    value.clamp(low, high)
}

/// Rounds a value inside `range` like [`round`], but inward if the nearest multiple is beyond a
/// bound. A value outside is rounded like any other.
pub fn round_inward(value: f64, decimals: u32, range: [f64; 2]) -> f64 {
    let [low, high] = range;
    if !(low..=high).contains(&value) {
        return round(value, decimals);
    }
    let scale = 10f64.powi(decimals.cast_signed());
    let mut steps = (value * scale).round();
    // A reader of the decimals gets this quotient, so it is the one to compare.
    if steps / scale > high {
        steps -= 1.0;
    } else if steps / scale < low {
        steps += 1.0;
    }
    steps / scale + 0.0
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::PersonState;

    use super::super::fixture;
    use super::*;

    fn json(line: PoseLine<'_>) -> String {
        let mut bytes = Vec::new();
        line.write_to(&mut bytes).unwrap();
        String::from_utf8(bytes).unwrap()
    }

    #[test]
    fn a_line_has_names_and_rounded_values() {
        let layout = fixture::layout();
        let pose = fixture::pose(1, PersonState::Tracked);
        let line = PoseLine {
            tick: Tick(300),
            pose: &pose,
            layout: &layout,
        };
        assert_eq!(
            json(line),
            "{\"tick\":300,\"person\":1,\"state\":\"tracked\",\
             \"joints\":{\"pelvis\":[1.0,2.0,0.9],\"left_knee\":[1.25,-2.0,0.5]},\
             \"keypoints\":{\"left_knee\":[1.26,-2.0,0.5]},\
             \"sigma_m\":{\"pelvis\":0.012,\"left_knee\":0.0235},\
             \"angles\":{\"pelvis_tilt\":0.523599,\"pelvis_tx\":2.5,\"knee_angle_l\":0.41},\
             \"unobserved\":[\"knee_angle_l\"],\"views\":4}\n"
        );
    }

    #[test]
    fn a_pose_without_sigmas_has_no_sigma_field() {
        let layout = fixture::layout();
        let mut pose = fixture::pose(1, PersonState::Tentative);
        pose.sigma_m.clear();
        let line = PoseLine {
            tick: Tick(300),
            pose: &pose,
            layout: &layout,
        };
        assert!(!json(line).contains("sigma_m"));
    }

    #[test]
    fn an_angle_at_its_bound_stays_inside() {
        let knee = &fixture::layout().angles[2];
        // The nearest f32 to the bound 2.268928 is above it.
        assert!(f64::from(2.268_928_f32) > 2.268_928);
        assert!(knee.rounded(2.268_928) <= 2.268_928);
        assert!(knee.rounded(-0.0) >= 0.0);
    }

    #[test]
    fn lengths_survive_the_wire_and_the_file() {
        // A link of 0.42 m in many orientations, far out in the field: f32 and 5 decimals move it
        // by less than 5e-5 m.
        let layout = fixture::layout();
        let mut pose = fixture::pose(1, PersonState::Tracked);
        for step in 0..1000 {
            let (a, b) = (f64::from(step) * 0.7, f64::from(step) * 0.3);
            let pelvis = [61.234_567, -40.765_432, 0.954_321];
            let along = [a.cos() * b.cos(), a.sin() * b.cos(), b.sin()];
            let knee: Vec<f64> = (0..3).map(|i| pelvis[i] + 0.42 * along[i]).collect();
            pose.joints_m = vec![
                pelvis.map(|v| v as f32),
                [knee[0] as f32, knee[1] as f32, knee[2] as f32],
            ];
            let json = json(PoseLine {
                tick: Tick(0),
                pose: &pose,
                layout: &layout,
            });
            let read: serde_json::Value = serde_json::from_str(&json).unwrap();
            let at = |name: &str, i: usize| read["joints"][name][i].as_f64().unwrap();
            let length = (0..3)
                .map(|i| (at("pelvis", i) - at("left_knee", i)).powi(2))
                .sum::<f64>()
                .sqrt();
            assert!((length - 0.42).abs() < 2.5e-5, "{length}");
        }
    }
}

#[cfg(test)]
mod rounding_tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn minus_zero_is_zero() {
        assert_eq!(round(-1e-9, 5).to_string(), "0");
        assert_eq!(
            round_inward(draw_in(1e-9, [-1.0, 0.0]), 6, [-1.0, 0.0]).to_string(),
            "0"
        );
    }

    #[test]
    fn rounding_does_not_leave_a_bound_between_decimals() {
        let high = 145.0f64.to_radians(); // 2.530727415...
        assert_eq!(round_inward(high, 6, [0.0, high]).to_string(), "2.530727");
        let low = (-20.0f64).to_radians(); // -0.3490658503...
        assert_eq!(round_inward(low, 6, [low, 1.0]).to_string(), "-0.349065");
    }

    #[test]
    fn a_value_outside_its_range_is_unchanged() {
        assert_eq!(
            round_inward(draw_in(1.01, [0.0, 1.0]), 6, [0.0, 1.0]).to_string(),
            "1.01"
        );
    }

    proptest! {
        #[test]
        fn values_inside_before_f32_are_inside_after_writing(
            low in -3.2f64..0.0, width in 0.01f64..3.0, part in 0.0f64..=1.0, pick in 0u8..4,
        ) {
            let range = [low, low + width];
            let exact = match pick { 0 => range[0], 1 => range[1], _ => low + part * width };
            let written = format!("{:.6}", round_inward(draw_in(f64::from(exact as f32), range), 6, range));
            let read: f64 = written.parse().unwrap();
            prop_assert!(range[0] <= read && read <= range[1], "{} not in {:?}", read, range);
            prop_assert!((read - exact).abs() < 2e-6);
        }
    }
}
