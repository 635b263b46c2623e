//! Which keypoint of another program is which of ours: by the model's name, by how many there are, or by their names.
//!
//! A keypoint file of ours has the 17 of COCO. What a model has beyond these (feet, hands, faces, necks) is left out, and
//! said.

mod models;
mod names;

use farfield_proto::keypoints::COCO17;

use crate::person::{Candidate, Person};

pub use self::models::Model;
pub use self::names::coco_name;

/// Most keypoints that one person may have in a file: the largest sets have a few hundred.
pub(crate) const MAX_KEYPOINTS: usize = 4096;

/// Where in a person of a file our keypoints stand.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mapping {
    /// What it is called in reports: a model's name, or that the file names its keypoints.
    pub name: String,
    /// Keypoints of one person in the file.
    pub count: usize,
    /// The place of each of [`COCO17`] in the file.
    pub places: [Option<usize>; COCO17.len()],
    /// What else the file has, in words.
    pub left_out: Vec<String>,
}

impl Mapping {
    /// The mapping of names that a file gives its keypoints.
    ///
    /// # Errors
    /// When none of the names is one of ours, or two are the same one.
    pub fn of_names(names: &[String]) -> Result<Self, String> {
        let mut places = [None; COCO17.len()];
        let mut left_out = Vec::new();
        for (place, name) in names.iter().enumerate() {
            let Some(coco) = coco_name(name).and_then(|it| COCO17.iter().position(|k| *k == it))
            else {
                left_out.push(name.clone());
                continue;
            };
            if let Some(Some(other)) = places.get(coco) {
                let other: &str = names.get(*other).map_or("", String::as_str);
                return Err(format!(
                    "`{other}` and `{name}` both read as {}, expected one of them",
                    COCO17[coco]
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

    /// The person of which `candidate` gives each keypoint by its place in the file.
    ///
    /// # Errors
    /// What `candidate` refuses.
    pub(crate) fn person<E>(
        &self,
        mut candidate: impl FnMut(usize) -> Result<Option<Candidate>, E>,
    ) -> Result<Person, E> {
        let mut person = [None; COCO17.len()];
        for (keypoint, place) in person.iter_mut().zip(self.places) {
            if let Some(place) = place {
                *keypoint = candidate(place)?;
            }
        }
        Ok(person)
    }

    /// Which of ours the file has not.
    pub fn missing(&self) -> Vec<&'static str> {
        let pairs = COCO17.iter().zip(self.places);
        pairs
            .filter(|(_, place)| place.is_none())
            .map(|(name, _)| *name)
            .collect()
    }
}

/// The first of many names.
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

/// What is known of a file's keypoints beforehand, and the mapping that its first person settled.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Keypoints {
    /// What the user has said.
    asked: Option<Model>,
    /// What settings beside the files say; weaker than their content.
    hinted: Option<Model>,
    settled: Option<Mapping>,
}

impl Keypoints {
    pub(crate) fn new(asked: Option<Model>, hinted: Option<Model>) -> Self {
        Self {
            asked,
            hinted,
            settled: None,
        }
    }

    /// The mapping of a person with so many keypoints.
    ///
    /// # Errors
    /// When no model has so many, or the people before had another number.
    pub(crate) fn by_count(&mut self, count: usize) -> Result<&Mapping, String> {
        if let Some(settled) = self.settled.as_ref().filter(|it| it.count != count) {
            return Err(format!(
                "found {count} keypoints, expected {} as of the people before ({})",
                settled.count, settled.name
            ));
        }
        let model = match (self.asked, self.hinted) {
            (Some(asked), _) if asked.count() != count => {
                return Err(format!(
                    "found {count} keypoints, expected {} of {}",
                    asked.count(),
                    asked.name()
                ));
            }
            (Some(asked), _) => asked,
            (None, Some(hinted)) if hinted.count() == count => hinted,
            (None, _) => Model::of_count(count).ok_or_else(|| {
                format!(
                    "found {count} keypoints, expected those of a known model: {}",
                    Model::list()
                )
            })?,
        };
        Ok(self.settled.get_or_insert_with(|| model.mapping()))
    }

    /// The mapping of keypoints that a file names.
    ///
    /// # Errors
    /// As [`Mapping::of_names`]; and when a model of another number was asked for.
    pub(crate) fn by_names(&mut self, names: &[String]) -> Result<&Mapping, String> {
        if self.asked.is_some() {
            return self.by_count(names.len());
        }
        let mapping = Mapping::of_names(names)?;
        if let Some(settled) = self.settled.as_ref().filter(|it| **it != mapping) {
            return Err(format!(
                "found keypoints {}, expected those of the people before ({})",
                shown(names),
                settled.name
            ));
        }
        Ok(self.settled.get_or_insert(mapping))
    }

    /// The model that was asked for; else the one that settings say, where it has a keypoint of the number `largest`.
    pub(crate) fn said(&self, largest: i64) -> Option<Model> {
        let has_it = |it: &Model| largest < it.count().cast_signed() as i64;
        self.asked.or(self.hinted.filter(has_it))
    }

    /// What the first person settled.
    pub(crate) fn settled(&self) -> Option<&Mapping> {
        self.settled.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(of: &[&str]) -> Vec<String> {
        of.iter().map(|it| (*it).to_owned()).collect()
    }

    #[test]
    fn names_find_their_keypoints_and_what_is_no_body_is_left_out() {
        let mapping = Mapping::of_names(&names(&["tail", "LKnee", "right_wrist", "nose"])).unwrap();
        let at = |name: &str| mapping.places[COCO17.iter().position(|k| *k == name).unwrap()];
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
    fn two_names_of_one_keypoint_and_names_of_none_are_refused() {
        let said = Mapping::of_names(&names(&["LKnee", "knee_left"])).unwrap_err();
        assert!(said.contains("both read as left_knee"), "{said}");
        let said = Mapping::of_names(&names(&["snout", "tailbase"])).unwrap_err();
        assert!(said.contains("`snout`, `tailbase`"), "{said}");
    }

    #[test]
    fn a_count_that_changes_or_contradicts_what_was_asked_is_refused() {
        let mut keypoints = Keypoints::default();
        assert_eq!(keypoints.by_count(25).unwrap().name, "BODY_25");
        let said = keypoints.by_count(26).unwrap_err();
        assert!(said.contains("found 26 keypoints, expected 25"), "{said}");
        let mut asked = Keypoints::new(Some(Model::Body25B), None);
        assert_eq!(asked.by_count(25).unwrap().name, "BODY_25B");
        assert!(asked.by_count(17).unwrap_err().contains("BODY_25B"));
        let said = Keypoints::default().by_count(42).unwrap_err();
        assert!(said.contains("HALPE_26"), "{said}");
    }

    #[test]
    fn a_hint_decides_between_models_of_one_count_and_else_does_not() {
        let hinted = |count| {
            let mut keypoints = Keypoints::new(None, Some(Model::Body25B));
            keypoints.by_count(count).unwrap().name.clone()
        };
        assert_eq!(hinted(25), "BODY_25B");
        assert_eq!(hinted(26), "HALPE_26");
    }
}
