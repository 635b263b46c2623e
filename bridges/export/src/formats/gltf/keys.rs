//! The keys of one person's animation.

use std::io;

use gltf_json as json;
use json::animation::Property;
use nalgebra::UnitQuaternion;

use super::bytes::{Bytes, Shape};
use super::{AXES, push_channel, single};
use crate::options::Lengths;
use crate::run::Sample;
use crate::skeleton::{Bone, N_BONES};
use crate::subject::Subject;
use crate::timeline::{Frame, Origin};

/// Keys, one track per bone.
#[derive(Debug)]
pub(super) struct Keys {
    times_s: Vec<f32>,
    root_m: Vec<f32>,
    rotations: [Vec<f32>; N_BONES],
    /// Offsets of the bones from their parents, if lengths change.
    offsets_m: Option<[Vec<f32>; N_BONES]>,
    /// The previous quaternions, for consistent signs.
    before: [UnitQuaternion<f64>; N_BONES],
    last: Option<Sample>,
    /// Times when the person is absent, first and last frame.
    pub(super) absent_s: Vec<[f64; 2]>,
    /// Times when the person is filled.
    pub(super) filled_s: Vec<[f64; 2]>,
    previous: Presence,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Presence {
    Absent,
    Seen,
    Filled,
}

impl Keys {
    pub(super) fn new(lengths: Lengths) -> Self {
        let measured = lengths == Lengths::Measured;
        Self {
            times_s: Vec::new(),
            root_m: Vec::new(),
            rotations: Default::default(),
            offsets_m: measured.then(Default::default),
            before: [UnitQuaternion::identity(); N_BONES],
            last: None,
            absent_s: Vec::new(),
            filled_s: Vec::new(),
            previous: Presence::Seen,
        }
    }

    pub(super) fn push(&mut self, frame: &Frame, subject: &Subject<'_>) {
        // Relative to the first exported tick: f32 is precise near 0.
        let time_s = frame.index as f64 / subject.clock.rate_hz;
        let presence = match &frame.pose {
            None => Presence::Absent,
            Some((_, Origin::Seen)) => Presence::Seen,
            Some((_, Origin::Filled)) => Presence::Filled,
        };
        let spans = match presence {
            Presence::Seen => None,
            Presence::Absent => Some(&mut self.absent_s),
            Presence::Filled => Some(&mut self.filled_s),
        };
        if let Some(spans) = spans {
            match spans.last_mut().filter(|_| presence == self.previous) {
                Some(span) => span[1] = time_s,
                None => spans.push([time_s; 2]),
            }
        }
        if let Some((sample, _)) = &frame.pose {
            if self.previous == Presence::Absent
                && let (Some(held), Some(span)) = (self.last.take(), self.absent_s.last().copied())
            {
                // The last pose is held until the last frame of the gap.
                self.push_key(&held, span[1], subject);
            }
            self.push_key(sample, time_s, subject);
            self.last = Some(sample.clone());
        }
        self.previous = presence;
    }

    fn push_key(&mut self, sample: &Sample, time_s: f64, subject: &Subject<'_>) {
        self.times_s.push(time_s as f32);
        self.root_m.extend(single(&sample.motion.root_m));
        for (i, (track, before)) in self.rotations.iter_mut().zip(&mut self.before).enumerate() {
            let mut turned = AXES.rotation(&sample.motion.rotations[i]);
            // q and -q are the same rotation; keep the sign consistent.
            if turned.coords.dot(&before.coords) < 0.0 {
                turned = UnitQuaternion::new_unchecked(-turned.into_inner());
            }
            *before = turned;
            track.extend(turned.coords.iter().map(|v| *v as f32 + 0.0));
        }
        if let Some(tracks) = &mut self.offsets_m {
            let rig = subject.rig_at(&sample.offsets);
            for (track, offset_m) in tracks.iter_mut().zip(&rig.offset_m) {
                track.extend(single(offset_m));
            }
        }
    }

    /// Adds the channels that move `joints`.
    pub(super) fn push_channels(
        self,
        root: &mut json::Root,
        bytes: &mut Bytes,
        animation: &mut json::Animation,
        joints: &[json::Index<json::Node>],
    ) -> io::Result<()> {
        if self.times_s.is_empty() {
            return Ok(());
        }
        let apart = self.times_s.windows(2).find_map(|pair| match pair {
            [before, after] if after <= before => Some(*before),
            _ => None,
        });
        if let Some(time_s) = apart {
            return Err(io::Error::other(format!(
                "frames at {time_s} s are too late to be distinguished in glTF: export fewer ticks"
            )));
        }
        let times = bytes.push_floats(root, &self.times_s, Shape::Times);
        for (bone, node) in Bone::ALL.into_iter().zip(joints) {
            let i = bone.index();
            let moved = match (&self.offsets_m, bone) {
                (_, Bone::Hips) => Some(&self.root_m),
                (Some(tracks), _) => Some(&tracks[i]),
                (None, _) => None,
            };
            if let Some(track) = moved {
                let output = bytes.push_floats(root, track, Shape::Vec3);
                push_channel(animation, *node, Property::Translation, times, output);
            }
            if !bone.is_static() {
                let output = bytes.push_floats(root, &self.rotations[i], Shape::Vec4);
                push_channel(animation, *node, Property::Rotation, times, output);
            }
        }
        Ok(())
    }
}
