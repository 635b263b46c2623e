//! Export of poses: `poses.jsonl`, TRC and MOT per person, `summary.json`.
//!
//! [`Layout`] has the names of a pose's numbers. [`mod@line`], [`trc`] and [`mot`] make text and
//! know no file. Only [`pose_files`] writes, each file under a temporary name until it is complete.
//! [`salvage`] completes the files of a killed process. [`summary`] describes a run.

pub mod disk_policy;
pub mod line;
pub mod marker_names;
pub mod mot;
mod part_file;
pub mod pose_files;
pub mod refusal;
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

/// Name of the file with names and edits of people, which other programs write, in the folder of a
/// run. Next to a recording, its name ends so in place of `mcap`.
pub const EDITS: &str = "edits.jsonl";

/// Rows that a head has room to count: years of them. It is written before the rows.
const MOST_ROWS: u64 = 9_999_999_999;

/// Names of the numbers of a [`PersonPose`](farfield_proto::message::PersonPose).
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Names of the joints, in the order of the skeletal model.
    pub joints: Vec<String>,
    /// Per joint whether the keypoints determine it: other joints are no markers.
    pub is_marker: Vec<bool>,
    /// The keypoints that have a place on the body, in the order of the network's card.
    pub keypoints: Vec<KeypointColumn>,
    /// The reported angles, in the model's order.
    pub angles: Vec<AngleColumn>,
}

/// One keypoint of the network.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct KeypointColumn {
    /// Its index in a pose, and on the card.
    pub index: usize,
    /// Its name on the card.
    pub name: String,
}

/// One reported angle, or one of the root's translations.
#[derive(Debug, Clone, PartialEq)]
pub struct AngleColumn {
    /// Its name, in OpenSim's full-body model if it is there.
    pub name: String,
    /// Unit of its numbers.
    pub unit: AngleUnit,
    /// The enforced range of motion, radians: written numbers do not leave it by rounding.
    pub range_rad: Option<[f64; 2]>,
    /// How it follows from the keypoints: an undetermined one has no column in a MOT file.
    pub evidence: AngleEvidence,
}

/// The unit of an [`AngleColumn`].
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
    /// The layout of poses of a network with these `keypoints`, and the enforced `range` of motion,
    /// if any.
    pub fn of(keypoints: &KeypointSet, range: Option<&RangeOfMotion>) -> Self {
        let sites = sites_of(keypoints, &BTreeMap::new());
        let determined = Determined::by(&sites);
        // A pose has the pelvis in place of a keypoint without a site.
        let keypoints = keypoints.names().iter().zip(&sites).enumerate();
        let keypoints = keypoints.filter_map(|(index, (name, site))| {
            let name = name.clone();
            site.map(|_| KeypointColumn { index, name })
        });
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
            keypoints: keypoints.collect(),
            angles: ANGLE_NAMES.iter().enumerate().map(angle).collect(),
        }
    }

    /// The markers of a TRC file: the determined joints, then the keypoints, with the names of
    /// [`marker_names`]. A joint and its keypoint differ if the network's point is not the
    /// anatomical centre.
    pub fn markers(&self) -> Vec<String> {
        let keypoints = self.keypoints.iter().map(|it| it.name.clone());
        let names = marker_names::point_names(&self.joints, &keypoints.collect::<Vec<_>>());
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

#[cfg(any(test, feature = "fixtures"))]
pub mod fixture;
