//! Unknown point names of a file. Their points are not compared, so the reader of a score must see them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::LazyLock;

use farfield_fusion::body::skeleton::{Joint, sites_of};
use farfield_proto::keypoints::KeypointSet;
use serde::Serialize;

use super::points::HEAD_POINTS;

/// Most names that are stored per file; it bounds the memory for a file with a new name on each line.
const MAX_NAMES: usize = 64;
/// Most characters that are stored of a name, which may be as long as its file.
const MAX_NAME_CHARACTERS: usize = 40;
/// Most names in a message.
const MAX_SHOWN_NAMES: usize = 8;

/// The part of a line that contains a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NameGroup {
    /// `joints`.
    Joints,
    /// `keypoints`.
    Keypoints,
    /// `sigma_m`.
    Sigmas,
}

impl NameGroup {
    fn field(self) -> &'static str {
        match self {
            Self::Joints => "joints",
            Self::Keypoints => "keypoints",
            Self::Sigmas => "sigma_m",
        }
    }

    /// Whether the name is known. A network may have keypoints that are no joints.
    fn knows(self, name: &str) -> bool {
        let has_site = || {
            let alone = KeypointSet::new(vec![name.to_owned()]);
            let sites = sites_of(&alone, &BTreeMap::new());
            sites.first().is_some_and(Option::is_some)
        };
        KNOWN.contains(name) || (self == Self::Keypoints && has_site())
    }

    /// Whether one of `names` is known.
    pub(super) fn knows_any<'a>(self, mut names: impl Iterator<Item = &'a str>) -> bool {
        names.any(|name| self.knows(name))
    }
}

/// Joints and head points, for fast lookup.
static KNOWN: LazyLock<BTreeSet<&str>> = LazyLock::new(|| {
    let joints = Joint::ALL.into_iter().map(Joint::name);
    joints.chain(HEAD_POINTS).collect()
});

/// The first 64 unknown names of a file, each with its part of the line (`joints.hip_l`) and cut off after 40 characters.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
#[serde(transparent)]
pub struct UnknownNames(BTreeSet<String>);

impl UnknownNames {
    /// Stores the unknown ones of `names`.
    pub(super) fn note<'a>(&mut self, group: NameGroup, names: impl Iterator<Item = &'a str>) {
        for name in names {
            if self.0.len() < MAX_NAMES && !group.knows(name) {
                let name: String = name.chars().take(MAX_NAME_CHARACTERS).collect();
                let name = name.escape_debug();
                self.0.insert(format!("{}.{name}", group.field()));
            }
        }
    }

    /// Whether all names are known.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl fmt::Display for UnknownNames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.0.iter().map(String::as_str);
        let shown: Vec<&str> = names.take(MAX_SHOWN_NAMES).collect();
        write!(f, "`{}`", shown.join("`, `"))?;
        match self.0.len() - shown.len() {
            0 => Ok(()),
            _ if self.0.len() == MAX_NAMES => write!(f, " and many more"),
            more => write!(f, " and {more} more"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noted(group: NameGroup, names: &[&str]) -> UnknownNames {
        let mut unknown = UnknownNames::default();
        unknown.note(group, names.iter().copied());
        unknown
    }

    #[test]
    fn joints_head_points_and_toe_keypoints_are_known() {
        let joints = noted(NameGroup::Joints, &["left_toe", "nose", "head_top"]);
        assert!(joints.is_empty(), "{joints}");
        let keypoints = noted(NameGroup::Keypoints, &["left_big_toe", "mid_hip", "nose"]);
        assert!(keypoints.is_empty(), "{keypoints}");
    }

    #[test]
    fn an_unknown_name_is_shown_once_with_its_part_of_the_line() {
        let mut unknown = noted(NameGroup::Joints, &["hip_l", "left_hip", "hip_l"]);
        unknown.note(NameGroup::Sigmas, ["LHip"].into_iter());
        assert_eq!(unknown.to_string(), "`joints.hip_l`, `sigma_m.LHip`");
        // A network's name for a toe is no name of a joint.
        let toe = noted(NameGroup::Joints, &["left_big_toe"]);
        assert_eq!(toe.to_string(), "`joints.left_big_toe`");
    }

    #[test]
    fn a_long_name_is_cut_off_and_control_characters_are_escaped() {
        let endless = noted(NameGroup::Joints, &[&"é".repeat(100_000)]);
        assert_eq!(endless.to_string(), format!("`joints.{}`", "é".repeat(40)));
        let coloured = noted(NameGroup::Joints, &["\u{1b}[31mhip\n"]);
        assert_eq!(coloured.to_string(), r"`joints.\u{1b}[31mhip\n`");
    }

    #[test]
    fn many_names_are_limited_in_memory_and_in_messages() {
        let names: Vec<String> = (0..12).map(|i| format!("p{i:05}")).collect();
        let few = noted(
            NameGroup::Keypoints,
            &names.iter().map(String::as_str).collect::<Vec<_>>(),
        );
        assert!(
            few.to_string().ends_with("`keypoints.p00007` and 4 more"),
            "{few}"
        );
        let names: Vec<String> = (0..10_000).map(|i| format!("p{i:05}")).collect();
        let many = noted(
            NameGroup::Keypoints,
            &names.iter().map(String::as_str).collect::<Vec<_>>(),
        );
        assert_eq!(many.0.len(), MAX_NAMES);
        assert!(many.to_string().ends_with("and many more"), "{many}");
    }
}
