//! Whether anybody can be found in a venue: where nobody ever can, that is said before the run and not asked about after it.

use std::path::Path;

use farfield_proto::plausibility::{self, Finding};
use farfield_proto::toml_file::FileError;
use farfield_proto::venue::{Venue, Viewpoint};

/// Viewpoints that must sight somebody who is to be found.
const MIN_VIEWPOINTS: usize = 2;

/// Refuses a venue of one viewpoint in which nobody is given by hand.
///
/// # Errors
/// Names the venue file, which is at `path`, and the field.
pub fn check_viewpoints(venue: &Venue, path: &Path) -> Result<(), FileError> {
    let finding = plausibility::of_viewpoints(venue);
    let wrong = finding.filter(Finding::is_wrong);
    wrong.map_or(Ok(()), |finding| {
        Err(FileError::new(path, finding.to_string()).at_field("viewpoint"))
    })
}

/// Refuses a venue without a detector in which nobody is given by hand, and too few viewpoints have cameras of which people
/// are known without one: files of keypoints and of maps, and simulated cameras that make maps.
///
/// # Errors
/// Names the venue file, which is at `path`, and the field.
pub fn check_detector(venue: &Venue, path: &Path) -> Result<(), FileError> {
    if venue.detector.is_some() || !venue.given_persons.is_empty() {
        return Ok(());
    }
    let knows_people = |viewpoint: &&Viewpoint| {
        let mut cameras = viewpoint.cameras.iter().filter_map(|&it| venue.camera(it));
        cameras.any(|camera| !camera.source.gives_pictures())
    };
    // That there is one viewpoint alone is not for want of a detector.
    let needed = MIN_VIEWPOINTS.min(venue.viewpoints.len());
    if venue.viewpoints.iter().filter(knows_people).count() >= needed {
        return Ok(());
    }
    let problem = "the field is missing, and no `[[person]]` is given: nobody will be found in pictures, expected the card of a network that finds people, such as detector = \"models/CARD.toml\"";
    Err(FileError::new(path, problem).at_field("detector"))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use farfield_proto::tick::Tick;
    use farfield_proto::venue::{GivenPerson, Source};

    use super::super::live::tests::venue;
    use super::*;

    /// A venue of four viewpoints, of which so many have videos and the others files of keypoints.
    fn with_videos(count: usize) -> Venue {
        let mut venue = venue();
        for camera in &mut venue.cameras[..count] {
            camera.source = Source::Video {
                path: "a.mp4".into(),
            };
        }
        venue
    }

    /// Somebody is given by hand.
    fn given(mut venue: Venue) -> Venue {
        venue.given_persons.push(GivenPerson {
            tick: Tick(0),
            keypoints_m: BTreeMap::new(),
        });
        venue
    }

    fn path() -> &'static Path {
        Path::new("hall.toml")
    }

    #[test]
    fn pictures_need_a_detector_where_too_few_viewpoints_know_people_without_one() {
        let is_refused = |venue: &Venue| check_detector(venue, path()).is_err();
        let refused = [0, 1, 2, 3, 4].map(|count| is_refused(&with_videos(count)));
        assert_eq!(refused, [false, false, false, true, true]);
        assert!(!is_refused(&given(with_videos(4))));
        let mut detecting = with_videos(4);
        detecting.detector = Some("people.toml".into());
        assert!(!is_refused(&detecting));
    }

    #[test]
    fn a_missing_detector_is_named_with_what_to_write() {
        let refused = check_detector(&with_videos(4), path()).unwrap_err();
        let refused = refused.to_string();
        for word in [
            "hall.toml: `detector`: the field is missing",
            "`[[person]]`",
            "nobody will be found in pictures",
            "detector = \"models/CARD.toml\"",
        ] {
            assert!(refused.contains(word), "{word:?} in {refused}");
        }
    }

    #[test]
    fn one_viewpoint_alone_is_refused_unless_somebody_is_given_and_not_for_want_of_a_detector() {
        let mut alone = venue();
        alone.viewpoints.truncate(1);
        alone.cameras.truncate(1);
        let refused = check_viewpoints(&alone, path()).unwrap_err().to_string();
        assert!(
            refused.starts_with("hall.toml: `viewpoint`: there is one viewpoint, expected two"),
            "{refused}"
        );
        check_detector(&alone, path()).unwrap();
        check_viewpoints(&given(alone), path()).unwrap();
        check_viewpoints(&venue(), path()).unwrap();
    }
}
