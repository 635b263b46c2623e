//! Visibility of people per viewpoint: people behind glass, and people who are hidden for a while.
//!
//! A person may be visible to some viewpoints only, permanently (`seen_by`) or for a time
//! (`[[lost]]`). Cameras of the other viewpoints show nothing of the person: no peak, no sighting,
//! no reflection. A person who is never visible to two viewpoints cannot be located and is not in
//! the truth.

use std::collections::BTreeMap;

use farfield_proto::toml_file::{FileError, Place, TomlFile, unknown_name};

use super::SceneViewpoint;
use super::file::{PersonEntry, SceneFile};

/// Viewpoints as bits: viewpoint n of the scene is bit n.
pub type ViewpointMask = u64;

/// An interval in which a person is visible to some viewpoints only.
#[derive(Debug, Clone, PartialEq)]
pub struct LostInterval {
    /// Index of the person in the scene.
    pub person: usize,
    /// Start, seconds.
    pub from_s: f64,
    /// End, seconds; at this time the person is visible again.
    pub until_s: f64,
    /// The viewpoints that still see the person.
    pub seen_by: ViewpointMask,
}

/// The visibility of all people.
#[derive(Debug, Clone, Default)]
pub(super) struct Sight {
    /// Permanent visibility, per person.
    seen_by: Vec<ViewpointMask>,
    pub(super) lost: Vec<LostInterval>,
}

impl Sight {
    /// The visibility rules of `file` for the viewpoints of its scene.
    ///
    /// # Errors
    /// [`FileError`] for an unknown person or viewpoint.
    pub(super) fn new(
        file: &SceneFile,
        viewpoints: &[SceneViewpoint],
        toml: &TomlFile<'_>,
    ) -> Result<Self, FileError> {
        let places: BTreeMap<&str, usize> = viewpoints
            .iter()
            .enumerate()
            .map(|(index, viewpoint)| (viewpoint.name.as_str(), index))
            .collect();
        let mask_of = |names: &[String], place: &Place| {
            let mut mask = 0;
            for (i, name) in names.iter().enumerate() {
                let Some(&viewpoint) = places.get(name.as_str()) else {
                    let known: Vec<&str> = places.keys().copied().collect();
                    let problem = unknown_name("viewpoint", name, &known);
                    return Err(toml.error(&place.index(i), problem));
                };
                mask |= 1 << viewpoint;
            }
            Ok(mask)
        };
        let mut sight = Self::default();
        for (i, person) in file.people.iter().enumerate() {
            let place = Place::field("person").index(i).key("seen_by");
            let seen_by = person.seen_by.as_deref();
            let seen_by = seen_by.map_or(Ok(ViewpointMask::MAX), |names| mask_of(names, &place))?;
            sight.seen_by.push(seen_by);
        }
        for (i, entry) in file.lost.iter().enumerate() {
            let place = Place::field("lost").index(i);
            let named = |p: &PersonEntry| entry.person.as_ref().is_none_or(|name| *name == p.name);
            let people = file.people.iter().enumerate();
            let people: Vec<usize> = people.filter(|(_, p)| named(p)).map(|(i, _)| i).collect();
            if let (Some(name), []) = (&entry.person, people.as_slice()) {
                let known: Vec<&str> = file.people.iter().map(|p| p.name.as_str()).collect();
                let problem = unknown_name("person", name, &known);
                return Err(toml.error(&place.key("person"), problem));
            }
            let seen_by = mask_of(&entry.except, &place.key("except"))?;
            sight
                .lost
                .extend(people.into_iter().map(|person| LostInterval {
                    person,
                    from_s: entry.from_s,
                    until_s: entry.until_s,
                    seen_by,
                }));
        }
        Ok(sight)
    }

    /// The viewpoints that see `person` at `time_s`, unless something blocks the view.
    pub(super) fn seen_by(&self, person: usize, time_s: f64) -> ViewpointMask {
        let for_good = self.seen_by.get(person).copied().unwrap_or(0);
        let lost = self
            .lost
            .iter()
            .filter(|lost| lost.person == person && (lost.from_s..lost.until_s).contains(&time_s));
        lost.fold(for_good, |mask, lost| mask & lost.seen_by)
    }

    /// Whether at least two viewpoints see `person`, as triangulation needs.
    pub(super) fn can_be_found(&self, person: usize) -> bool {
        self.seen_by
            .get(person)
            .is_some_and(|mask| mask.count_ones() > 1)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use farfield_proto::toml_file::FileError;

    use super::super::Scene;
    use crate::embedded::CLIPS;
    use crate::motion::Clip;

    fn refusal(added: &str) -> FileError {
        let text = format!(
            "rate_hz = 60\nseconds = 4\nsize_m = [7, 5]\n\
             [cameras]\nviewpoints = 4\nper_viewpoint = 1\n\
             [[person]]\nname = \"1\"\nclips = [\"walk.bvh\"]\nheight_m = 1.8\n{added}"
        );
        let clip = &mut |path: &Path| Ok(Arc::new(Clip::parse(CLIPS[0].1, path)?));
        let refused = Scene::parse(&text, Path::new("a.toml"), clip);
        refused.unwrap_err()
    }

    #[test]
    fn an_unknown_name_is_refused_with_the_nearest_name() {
        let error = refusal("seen_by = [\"north-west\", \"nort-east\"]\n");
        assert_eq!(error.field.as_deref(), Some("person[0].seen_by[1]"));
        assert!(error.problem.contains("`north-east`"), "{error}");
        let lost = "[[lost]]\nfrom_s = 1\nuntil_s = 2\n";
        let error = refusal(&format!("{lost}person = \"2\"\n"));
        assert_eq!(error.field.as_deref(), Some("lost[0].person"));
        for (text, nearest) in [
            (format!("{lost}person = \"1\"\nexept = []\n"), "`except`"),
            (
                "[[mirror]]\nfrom_m = [0, 0]\nto_m = [0, 1]\nhight_m = 2\n".to_owned(),
                "`height_m`",
            ),
            ("[[poster]]\nat = [0, 0]\n".to_owned(), "`at_m`"),
        ] {
            let error = refusal(&text);
            assert!(error.problem.contains(nearest), "{error}");
        }
    }

    #[test]
    fn a_lost_entry_without_a_name_applies_to_all_people() {
        let text = crate::embedded::SCENES
            .iter()
            .find(|s| s.0 == "court")
            .unwrap()
            .1;
        let text = format!("{text}\n[[lost]]\nfrom_s = 1.0\nuntil_s = 2.0\n");
        let scene = crate::embedded::with_clips(&text, Path::new("scenes/court.toml")).unwrap();
        for person in 0..scene.people().len() {
            let seen = [0.9, 1.5, 2.0].map(|time_s| scene.seen_by(person, time_s) != 0);
            assert_eq!(seen, [true, false, true]);
        }
    }

    #[test]
    fn a_number_out_of_its_range_is_refused_with_its_field() {
        for (wrong, field) in [
            (
                "[[lost]]\nperson = \"1\"\nfrom_s = 2\nuntil_s = 1\n",
                "lost[0].until_s",
            ),
            (
                "[[mirror]]\nfrom_m = [1, 1]\nto_m = [1, 1]\nheight_m = 2\n",
                "mirror[0].to_m",
            ),
            (
                "[[poster]]\nat_m = [0, 0]\nheading_rad = 0\nheight_m = 9\nclip = \"a\"\n",
                "poster[0].height_m",
            ),
        ] {
            assert_eq!(refusal(wrong).field.as_deref(), Some(field));
        }
    }
}
