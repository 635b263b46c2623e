//! Maps keypoints of other programs to COCO's and those of feet: by model name, by count, or by
//! keypoint names.
//!
//! Other keypoints of a model (hands, faces, necks) are dropped and reported.

mod models;

use farfield_proto::keypoints::{COCO17, COCO23};

use crate::person::{Candidate, Person};

pub use self::models::Model;

/// Maximum number of keypoints per person in a file; the largest models have a few hundred.
pub(crate) const MAX_KEYPOINTS: usize = 4096;

/// Index of each of our keypoints among the keypoints of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mapping {
    /// Name in reports: a model, or a note that the file names its keypoints.
    pub name: String,
    /// Number of keypoints of one person in the file.
    pub count: usize,
    /// Index in the file of each of [`COCO23`].
    pub places: [Option<usize>; COCO23.len()],
    /// Descriptions of the other keypoints.
    pub left_out: Vec<String>,
}

impl Mapping {
    /// Maps the keypoint names of a file.
    ///
    /// # Errors
    /// If no name is one of our keypoints, or two names are the same one.
    pub fn of_names(names: &[String]) -> Result<Self, String> {
        let mut places = [None; COCO23.len()];
        let mut left_out = Vec::new();
        for (place, name) in names.iter().enumerate() {
            let Some(coco) = keypoint_named(name) else {
                left_out.push(name.clone());
                continue;
            };
            if let Some(Some(other_place)) = places.get(coco) {
                let other: &str = names.get(*other_place).map_or("", String::as_str);
                // Of a big toe and a tip of the foot, the big toe is used.
                let is_tip = |name: &str| {
                    COCO23[coco].ends_with("toe") && !name.to_ascii_lowercase().contains("big")
                };
                if is_tip(name) != is_tip(other) {
                    let tip = if is_tip(name) { name.as_str() } else { other };
                    left_out.push(tip.to_owned());
                    if !is_tip(name) {
                        places[coco] = Some(place);
                    }
                    continue;
                }
                return Err(format!(
                    "`{other}` and `{name}` both read as {}, expected one of them",
                    COCO23[coco]
                ));
            }
            places[coco] = Some(place);
        }
        if places.iter().all(Option::is_none) {
            return Err(format!(
                "none of the keypoints {} is one of a body, expected names such as left_knee or LKnee",
                shown(names)
            ));
        }
        Ok(Self {
            name: "names of the file".to_owned(),
            count: names.len(),
            places,
            left_out,
        })
    }

    /// Builds a person; `candidate` returns the keypoint at an index in the file.
    ///
    /// # Errors
    /// Errors of `candidate`.
    pub(crate) fn person<E>(
        &self,
        mut candidate: impl FnMut(usize) -> Result<Option<Candidate>, E>,
    ) -> Result<Person, E> {
        let mut person = [None; COCO23.len()];
        for (keypoint, place) in person.iter_mut().zip(self.places) {
            if let Some(place) = place {
                *keypoint = candidate(place)?;
            }
        }
        Ok(person)
    }

    /// Keypoints of COCO's 17 that the file lacks.
    pub fn missing(&self) -> Vec<&'static str> {
        let pairs = COCO17.iter().zip(self.places);
        pairs
            .filter(|(_, place)| place.is_none())
            .map(|(name, _)| *name)
            .collect()
    }
}

/// The first few of many names.
fn shown(names: &[String]) -> String {
    const SHOWN: usize = 8;
    let first: Vec<String> = names
        .iter()
        .take(SHOWN)
        .map(|it| format!("`{it}`"))
        .collect();
    let dots = if names.len() > SHOWN { ", ..." } else { "" };
    format!("{}{dots}", first.join(", "))
}

/// What is known about a file's keypoints, and the mapping chosen at its first person.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Keypoints {
    /// Requested by the user.
    requested: Option<Model>,
    /// From settings next to the files; weaker than their content.
    hint: Option<Model>,
    settled: Option<Mapping>,
}

impl Keypoints {
    pub(crate) fn new(requested: Option<Model>, hint: Option<Model>) -> Self {
        Self {
            requested,
            hint,
            settled: None,
        }
    }

    /// The mapping for a person with this many keypoints.
    ///
    /// # Errors
    /// If no model has this count, or earlier people had another.
    pub(crate) fn by_count(&mut self, count: usize) -> Result<&Mapping, String> {
        if let Some(settled) = self.settled.as_ref().filter(|it| it.count != count) {
            return Err(format!(
                "found {count} keypoints, expected {} as for earlier people ({})",
                settled.count, settled.name
            ));
        }
        let model = match (self.requested, self.hint) {
            (Some(requested), _) if requested.count() != count => {
                return Err(format!(
                    "found {count} keypoints, expected {} of {}",
                    requested.count(),
                    requested.name()
                ));
            }
            (Some(requested), _) => requested,
            (None, Some(hint)) if hint.count() == count => hint,
            (None, _) => Model::of_count(count).ok_or_else(|| {
                format!(
                    "found {count} keypoints, expected those of a known model: {}",
                    Model::list()
                )
            })?,
        };
        Ok(self.settled.get_or_insert_with(|| model.mapping()))
    }

    /// The mapping for keypoints with these names.
    ///
    /// # Errors
    /// As [`Mapping::of_names`]; also if a model with another count was requested.
    pub(crate) fn by_names(&mut self, names: &[String]) -> Result<&Mapping, String> {
        if self.requested.is_some() {
            return self.by_count(names.len());
        }
        let mapping = Mapping::of_names(names)?;
        if let Some(settled) = self.settled.as_ref().filter(|it| **it != mapping) {
            return Err(format!(
                "found keypoints {}, expected those of earlier people ({})",
                shown(names),
                settled.name
            ));
        }
        Ok(self.settled.get_or_insert(mapping))
    }

    /// The requested model, otherwise the model of the settings if it has a keypoint with index
    /// `largest`.
    pub(crate) fn given_model(&self, largest: i64) -> Option<Model> {
        let has_it = |it: &Model| largest < it.count().cast_signed() as i64;
        self.requested.or(self.hint.filter(has_it))
    }

    /// The mapping chosen at the first person.
    pub(crate) fn settled(&self) -> Option<&Mapping> {
        self.settled.as_ref()
    }
}

/// Body parts that have two sides, as in names of keypoints without their signs, and as in
/// [`COCO23`].
const PAIRED: [(&str, &str); 13] = [
    ("eye", "eye"),
    ("ear", "ear"),
    ("shoulder", "shoulder"),
    ("elbow", "elbow"),
    ("wrist", "wrist"),
    ("hip", "hip"),
    ("knee", "knee"),
    ("ankle", "ankle"),
    ("heel", "heel"),
    ("bigtoe", "big_toe"),
    ("footindex", "big_toe"),
    ("toe", "big_toe"),
    ("smalltoe", "small_toe"),
];

/// Index in [`COCO23`] of the keypoint with this name in another program.
///
/// Case, spaces, `-`, `_` and `.` do not count. The side is a word or letter before or after the
/// part.
fn keypoint_named(name: &str) -> Option<usize> {
    // Longer names are not keypoints.
    const MAX_CHARS: usize = 40;
    let letters = |c: &char| c.is_ascii_alphanumeric();
    if name.chars().count() > MAX_CHARS {
        return None;
    }
    let name: String = name
        .chars()
        .filter(letters)
        .map(|c| c.to_ascii_lowercase())
        .collect();
    let index = |known: &str| COCO23.iter().position(|it| *it == known);
    if name == "nose" {
        return index("nose");
    }
    PAIRED.iter().find_map(|(part, ours)| {
        let side = name
            .strip_suffix(part)
            .or_else(|| name.strip_prefix(part))?;
        match side {
            "left" | "l" => index(&format!("left_{ours}")),
            "right" | "r" => index(&format!("right_{ours}")),
            _ => None,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|it| (*it).to_owned()).collect()
    }

    #[test]
    fn names_map_to_keypoints_and_others_are_dropped() {
        let mapping = Mapping::of_names(&names(&["tail", "LKnee", "right_wrist", "nose"])).unwrap();
        let at = |name: &str| mapping.places[COCO23.iter().position(|k| *k == name).unwrap()];
        assert_eq!(
            (
                at("left_knee"),
                at("right_wrist"),
                at("nose"),
                at("left_hip")
            ),
            (Some(1), Some(2), Some(3), None)
        );
        assert_eq!(mapping.left_out, ["tail"]);
        assert_eq!(mapping.missing().len(), 14);
    }

    #[test]
    fn duplicate_and_unknown_names_are_refused() {
        let error = Mapping::of_names(&names(&["LKnee", "knee_left"])).unwrap_err();
        assert!(error.contains("both read as left_knee"), "{error}");
        let error = Mapping::of_names(&names(&["snout", "tailbase"])).unwrap_err();
        assert!(error.contains("`snout`, `tailbase`"), "{error}");
    }

    #[test]
    fn a_big_toe_is_used_and_not_the_tip_of_its_foot() {
        for order in [["left_toe", "LBigToe"], ["LBigToe", "left_toe"]] {
            let mapping = Mapping::of_names(&names(&order)).unwrap();
            let big_toe = order.iter().position(|it| *it == "LBigToe");
            assert_eq!(mapping.places[COCO17.len()], big_toe);
            assert_eq!(mapping.left_out, ["left_toe"]);
        }
    }

    #[test]
    fn a_changed_or_contradicting_count_is_refused() {
        let mut keypoints = Keypoints::default();
        assert_eq!(keypoints.by_count(25).unwrap().name, "BODY_25");
        let error = keypoints.by_count(26).unwrap_err();
        assert!(error.contains("found 26 keypoints, expected 25"), "{error}");
        let mut requested = Keypoints::new(Some(Model::Body25B), None);
        assert_eq!(requested.by_count(25).unwrap().name, "BODY_25B");
        assert!(requested.by_count(17).unwrap_err().contains("BODY_25B"));
        let error = Keypoints::default().by_count(42).unwrap_err();
        assert!(error.contains("HALPE_26"), "{error}");
    }

    #[test]
    fn a_hint_only_decides_between_models_of_equal_count() {
        let hint = |count| {
            let mut keypoints = Keypoints::new(None, Some(Model::Body25B));
            keypoints.by_count(count).unwrap().name.clone()
        };
        assert_eq!(hint(25), "BODY_25B");
        assert_eq!(hint(26), "HALPE_26");
    }

    #[test]
    fn sides_are_words_or_letters_before_or_after_the_part() {
        let found = |name: &str| keypoint_named(name).map(|it| COCO23[it]);
        for name in COCO23 {
            assert_eq!(found(name), Some(name));
        }
        for name in [
            "LKnee",
            "knee_L",
            "Left Knee",
            "left-knee",
            "kneeleft",
            "l.knee",
        ] {
            assert_eq!(found(name), Some("left_knee"), "{name}");
        }
        assert_eq!(found("REar"), Some("right_ear"));
        assert_eq!(found("LBigToe"), Some("left_big_toe"));
        assert_eq!(found("right_foot_index"), Some("right_big_toe"));
    }

    #[test]
    fn other_names_give_none() {
        for name in [
            "knee",
            "left_eye_inner",
            "MidHip",
            "toe",
            "head",
            "",
            "Lléft",
            "left_left_knee",
        ] {
            assert_eq!(keypoint_named(name), None, "{name}");
        }
    }
}
