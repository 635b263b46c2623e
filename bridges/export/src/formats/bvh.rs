//! BVH: a skeleton and its motion as text.
//!
//! Centimetres, y up, unless a preset is given. Rotations are Z-X-Y (R = Rz Rx Ry) in degrees and
//! unwrapped: they continue beyond 180 instead of jumping. The hips' offset is zero, so it does not
//! matter whether a reader adds it to the position. With [`Lengths::Measured`] every bone has a
//! position relative to its parent, like the offset.

use std::io::{self, Write};

use nalgebra::Vector3;

use crate::axes::{Axes, Orientation, Unit};
use crate::options::Lengths;
use crate::run::Sample;
use crate::skeleton::{Bone, N_BONES, Rig, zxy};
use crate::subject::{HoldLast, Subject};
use crate::timeline::Frame;

const DEFAULT_AXES: Axes = Axes {
    unit: Unit::Centimetre,
    orientation: Orientation::YUp,
};
const ROTATIONS: &str = "Zrotation Xrotation Yrotation";
const POSITIONS: &str = "Xposition Yposition Zposition";

/// Writes one person.
#[derive(Debug)]
pub struct BvhWriter<'a, W> {
    out: W,
    subject: Subject<'a>,
    axes: Axes,
    hold: HoldLast,
    /// The previous angles, radians; the next ones are the nearest to them.
    before: Option<[[f64; 3]; N_BONES]>,
}

impl<'a, W: Write> BvhWriter<'a, W> {
    /// Writes the skeleton and the header of its motion.
    ///
    /// # Errors
    /// Errors of `out`.
    pub fn new(mut out: W, subject: Subject<'a>) -> io::Result<Self> {
        let axes = subject.options.preset.map_or(DEFAULT_AXES, Axes::of_bvh);
        out.write_all(b"HIERARCHY\n")?;
        write_bone(&mut out, Bone::Hips, 0, &subject, &subject.rig(), axes)?;
        let clock = subject.clock;
        let (n_frames, frame_s) = (clock.n_frames(), 1.0 / clock.rate_hz);
        write!(
            out,
            "MOTION\nFrames: {n_frames}\nFrame Time: {frame_s:.9}\n"
        )?;
        Ok(Self {
            out,
            subject,
            axes,
            hold: HoldLast::default(),
            before: None,
        })
    }

    /// Writes a frame.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(&mut self, frame: &Frame) -> io::Result<()> {
        let Self {
            out,
            subject,
            axes,
            hold,
            before,
        } = self;
        hold.push(frame, |sample| {
            let row = row(sample, subject, *axes, before);
            out.write_all(row.as_bytes())
        })
    }
}

fn write_bone(
    out: &mut impl Write,
    bone: Bone,
    depth: usize,
    subject: &Subject<'_>,
    rig: &Rig,
    axes: Axes,
) -> io::Result<()> {
    let indent = "\t".repeat(depth);
    let name = subject.options.names.name(bone);
    let keyword = if depth == 0 { "ROOT" } else { "JOINT" };
    let offset = numbers(&axes.point(&rig.offset_m[bone.index()]));
    let channels = if depth == 0 || subject.options.lengths == Lengths::Measured {
        format!("6 {POSITIONS} {ROTATIONS}")
    } else {
        format!("3 {ROTATIONS}")
    };
    write!(
        out,
        "{indent}{keyword} {name}\n{indent}{{\n{indent}\tOFFSET {offset}\n"
    )?;
    writeln!(out, "{indent}\tCHANNELS {channels}")?;
    for child in bone.children() {
        write_bone(out, child, depth + 1, subject, rig, axes)?;
    }
    if let Some(tip_m) = rig.tip_m[bone.index()] {
        let tip = numbers(&axes.point(&tip_m));
        write!(
            out,
            "{indent}\tEnd Site\n{indent}\t{{\n{indent}\t\tOFFSET {tip}\n{indent}\t}}\n"
        )?;
    }
    writeln!(out, "{indent}}}")
}

fn row(
    sample: &Sample,
    subject: &Subject<'_>,
    axes: Axes,
    before: &mut Option<[[f64; 3]; N_BONES]>,
) -> String {
    let measured = subject.options.lengths == Lengths::Measured;
    let rig = measured.then(|| subject.rig_at(&sample.offsets));
    let mut angles = [[0.0; 3]; N_BONES];
    let mut text = String::new();
    for bone in Bone::ALL {
        let i = bone.index();
        let position = match (&rig, bone) {
            (_, Bone::Hips) => Some(sample.motion.root_m),
            (Some(rig), _) => Some(rig.offset_m[i]),
            (None, _) => None,
        };
        if let Some(at_m) = position {
            text += &numbers(&axes.point(&at_m));
            text.push(' ');
        }
        let rotation = axes
            .rotation(&sample.motion.rotations[i])
            .to_rotation_matrix();
        let found = zxy(rotation.matrix());
        angles[i] = before
            .as_ref()
            .map_or(found, |before| nearest(found, before[i]));
        text += &numbers(&Vector3::from(angles[i]).map(f64::to_degrees));
        text.push(if i + 1 < N_BONES { ' ' } else { '\n' });
    }
    *before = Some(angles);
    text
}

/// The angles of the rotation Rz(a) Rx(b) Ry(c) that are nearest to `before`, radians.
fn nearest([a, b, c]: [f64; 3], before: [f64; 3]) -> [f64; 3] {
    use std::f64::consts::{PI, TAU};
    let next_to = |angles: [f64; 3]| {
        let mut near = angles;
        for (angle, before) in near.iter_mut().zip(before) {
            *angle -= TAU * ((*angle - before) / TAU).round();
        }
        near
    };
    let far = |angles: [f64; 3]| {
        angles
            .iter()
            .zip(before)
            .map(|(a, b)| (a - b).abs())
            .sum::<f64>()
    };
    let (one, other) = (next_to([a, b, c]), next_to([a + PI, PI - b, c + PI]));
    if far(one) <= far(other) { one } else { other }
}

/// Six decimals: 10 nm, or 2e-8 rad.
fn numbers(v: &Vector3<f64>) -> String {
    // Adding 0 removes the sign of a zero.
    let numbers: Vec<String> = v
        .iter()
        .map(|v| format!("{:.6}", (v * 1e6).round() / 1e6 + 0.0))
        .collect();
    numbers.join(" ")
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;
    use crate::skeleton::zxy_rotation;

    proptest! {
        #[test]
        fn unwrapped_angles_keep_the_rotation_and_are_nearest(
            turn in prop::array::uniform3(-3.0f64..3.0), before in prop::array::uniform3(-20.0f64..20.0),
        ) {
            let rotation = Rotation3::from_scaled_axis(Vector3::from(turn)).into_inner();
            let found = zxy(&rotation);
            let near = nearest(found, before);
            prop_assert!((zxy_rotation(near) - rotation).norm() < 1e-9);
            let far: f64 = near.iter().zip(before).map(|(a, b)| (a - b).abs()).sum();
            prop_assert!(far <= 3.0 * std::f64::consts::PI);
        }
    }

    #[test]
    fn negative_zero_is_written_without_sign() {
        assert_eq!(
            numbers(&Vector3::new(-0.0, -1e-9, 2.5)),
            "0.000000 0.000000 2.500000"
        );
    }
}
