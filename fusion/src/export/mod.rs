//! Turns poses into the files that others read: `poses.jsonl`, TRC and MOT per person, `summary.json`.
//!
//! [`Layout`] names what a pose holds by position. [`mod@line`], [`trc`] and [`mot`] are text and know no
//! file; [`pose_files`] alone writes, each file under a temporary name until it is whole, and [`salvage`]
//! makes whole what a process has left that was killed. [`summary`] is what a run says of itself.

pub mod disk_policy;
#[cfg(test)]
pub(crate) mod failing_disk;
pub mod line;
pub mod marker_names;
pub mod mot;
mod part_file;
pub mod pose_files;
pub mod refusal;
pub mod rounding;
pub mod run_clock;
pub mod salvage;
pub mod summary;
pub mod trc;
pub mod unfinished;
mod whole;

use std::collections::BTreeMap;

use farfield_proto::keypoints::KeypointSet;

use crate::body::determined::{AngleEvidence, Determined};
use crate::body::skeleton::{ANGLE_NAMES, Joint, RangeOfMotion, sites_of};

/// The file of names and edits of people, which others write: in the folder of a run; beside a recording its name ends so, in the
/// place of `mcap`.
pub const EDITS: &str = "edits.jsonl";

/// Rows that a head has room to count: years of them. It is written before they come.
const MOST_ROWS: u64 = 9_999_999_999;

/// What the numbers of a [`PersonPose`](farfield_proto::message::PersonPose) are called.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Names of the joints, in the order of the skeletal model.
    pub joints: Vec<String>,
    /// Per joint whether the keypoints determine it: others are no markers.
    pub is_marker: Vec<bool>,
    /// Names of the keypoints, in the order of the network's card.
    pub keypoints: Vec<String>,
    /// The reported angles, in the model's order.
    pub angles: Vec<AngleColumn>,
}

/// One reported angle, or one of the root's translations.
#[derive(Debug, Clone, PartialEq)]
pub struct AngleColumn {
    /// Its name, as OpenSim's full-body model calls it where it has it.
    pub name: String,
    /// What its numbers are.
    pub unit: AngleUnit,
    /// The range of motion that was enforced, radians: written numbers do not leave it by rounding.
    pub range_rad: Option<[f64; 2]>,
    /// How it follows from the keypoints: what they say nothing of is no column of a MOT file.
    pub evidence: AngleEvidence,
}

/// What the numbers of an [`AngleColumn`] are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AngleUnit {
    /// An angle.
    Radian,
    /// A translation of the root.
    Metre,
}

impl AngleColumn {
    /// A column of this name without a range; `pelvis_tx`, `pelvis_ty` and `pelvis_tz` are metres.
    pub fn named(name: impl Into<String>) -> Self {
        let name = name.into();
        let unit = match name.as_str() {
            "pelvis_tx" | "pelvis_ty" | "pelvis_tz" => AngleUnit::Metre,
            _ => AngleUnit::Radian,
        };
        Self {
            name,
            unit,
            range_rad: None,
            evidence: AngleEvidence::Own,
        }
    }
}

impl Layout {
    /// The layout of poses of a network with these `keypoints`; `range` of motion where one was enforced.
    pub fn of(keypoints: &KeypointSet, range: Option<&RangeOfMotion>) -> Self {
        let determined = Determined::by(&sites_of(keypoints, &BTreeMap::new()));
        let angle = |(index, name): (usize, &&str)| {
            let mut column = AngleColumn::named(*name);
            column.evidence = determined.angles[index];
            if let (Some(range), AngleUnit::Radian) = (range, column.unit) {
                let (lo, hi) = range.reported_range(index);
                column.range_rad = (lo.is_finite() && hi.is_finite()).then_some([lo, hi]);
            }
            column
        };
        Self {
            joints: Joint::ALL
                .iter()
                .map(|joint| joint.name().to_owned())
                .collect(),
            is_marker: determined.joints.to_vec(),
            keypoints: keypoints.names().to_vec(),
            angles: ANGLE_NAMES.iter().enumerate().map(angle).collect(),
        }
    }

    /// The markers of a TRC file: the joints that are determined, then the keypoints, as [`marker_names`] call them. The
    /// two differ where the network means another point than the anatomical centre.
    pub fn markers(&self) -> Vec<String> {
        let names = marker_names::point_names(&self.joints, &self.keypoints);
        let is_marker = self.is_marker.iter().copied();
        let is_marker = is_marker.chain(std::iter::repeat(true));
        let markers = names.into_iter().zip(is_marker);
        markers
            .filter_map(|(name, is_marker)| is_marker.then_some(name))
            .collect()
    }

    /// The columns of a MOT file.
    fn columns(&self) -> impl Iterator<Item = &AngleColumn> {
        let columns = self.angles.iter();
        columns.filter(|angle| angle.evidence != AngleEvidence::Missing)
    }
}

#[cfg(test)]
pub(crate) mod fixture;
