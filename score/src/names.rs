//! Names of points that a file has and nobody here knows: what stands under them is compared with nothing, and whoever
//! reads a score must be told so.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::LazyLock;

use farfield_fusion::body::skeleton::{Joint, sites_of};
use farfield_proto::keypoints::KeypointSet;
use serde::Serialize;

use super::points::HEAD_POINTS;

/// Most names that are kept of one file: whoever invents one for each line does not fill the memory.
const MOST_KEPT: usize = 64;
/// Most characters that are kept of a name: it may be as long as its file.
const MOST_CHARACTERS: usize = 40;
/// Most names that are shown in a sentence.
const MOST_SHOWN: usize = 8;

/// Which part of a line a name stands in.
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

    /// Whether somebody here knows the name. A network may know keypoints that are no joints.
    fn knows(self, name: &str) -> bool {
        let has_site = || {
            let alone = KeypointSet::new(vec![name.to_owned()]);
            let sites = sites_of(&alone, &BTreeMap::new());
            sites.first().is_some_and(Option::is_some)
        };
        KNOWN.contains(name) || (self == Self::Keypoints && has_site())
    }

    /// Whether somebody here knows one of `names`.
    pub(super) fn knows_any<'a>(self, mut names: impl Iterator<Item = &'a str>) -> bool {
        names.any(|name| self.knows(name))
    }
}

/// Joints and head points: looked up for every point of every line.
static KNOWN: LazyLock<BTreeSet<&str>> = LazyLock::new(|| {
    let joints = Joint::ALL.into_iter().map(Joint::name);
    joints.chain(HEAD_POINTS).collect()
});

/// The names of a file that nobody here knows, each with its part of the line (`joints.hip_l`), the first 64 that were
/// met, each cut off after 40 characters.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
#[serde(transparent)]
pub struct UnknownNames(BTreeSet<String>);

impl UnknownNames {
    /// Notes those of `names` that nobody knows.
    pub(super) fn note<'a>(&mut self, group: NameGroup, names: impl Iterator<Item = &'a str>) {
        for name in names {
            if self.0.len() < MOST_KEPT && !group.knows(name) {
                let kept: String = name.chars().take(MOST_CHARACTERS).collect();
                let kept = kept.escape_debug();
                self.0.insert(format!("{}.{kept}", group.field()));
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
        let shown: Vec<&str> = self.0.iter().map(String::as_str).take(MOST_SHOWN).collect();
        write!(f, "`{}`", shown.join("`, `"))?;
        match self.0.len() - shown.len() {
            0 => Ok(()),
            _ if self.0.len() == MOST_KEPT => write!(f, " and many more"),
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
    fn joints_heads_and_what_networks_call_feet_are_known() {
        let joints = noted(NameGroup::Joints, &["left_toe", "nose", "head_top"]);
        assert!(joints.is_empty(), "{joints}");
        let keypoints = noted(NameGroup::Keypoints, &["left_big_toe", "mid_hip", "nose"]);
        assert!(keypoints.is_empty(), "{keypoints}");
    }

    #[test]
    fn what_nobody_knows_is_shown_once_with_its_part_of_the_line() {
        let mut unknown = noted(NameGroup::Joints, &["hip_l", "left_hip", "hip_l"]);
        unknown.note(NameGroup::Sigmas, ["LHip"].into_iter());
        assert_eq!(unknown.to_string(), "`joints.hip_l`, `sigma_m.LHip`");
        // A network's name for a toe is no joint's.
        let toe = noted(NameGroup::Joints, &["left_big_toe"]);
        assert_eq!(toe.to_string(), "`joints.left_big_toe`");
    }

    #[test]
    fn of_a_name_that_has_no_end_the_beginning_is_kept_and_nothing_in_it_moves_the_cursor() {
        let endless = noted(NameGroup::Joints, &[&"é".repeat(100_000)]);
        assert_eq!(endless.to_string(), format!("`joints.{}`", "é".repeat(40)));
        let coloured = noted(NameGroup::Joints, &["\u{1b}[31mhip\n"]);
        assert_eq!(coloured.to_string(), r"`joints.\u{1b}[31mhip\n`");
    }

    #[test]
    fn a_new_name_in_each_line_fills_neither_the_memory_nor_the_screen() {
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
        assert_eq!(many.0.len(), MOST_KEPT);
        assert!(many.to_string().ends_with("and many more"), "{many}");
    }
}
