//! Checks of a venue before a run: people can be detected, every `[[person]]` fits, and all sources share one time.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use anyhow::ensure;
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::plausibility::{self, Finding};
use farfield_proto::tick::{Micros, Tick};
use farfield_proto::toml_file::{FileError, Place, unknown_name};
use farfield_proto::venue::{GivenPerson, Venue, Viewpoint};

use farfield_fusion::body::fit::fit;
use farfield_fusion::body::observed::ObservedJoints;
use farfield_fusion::live::tick_time::TickTime;

/// Viewpoints needed to detect a person.
const MIN_VIEWPOINTS: usize = 2;

/// Refuses a venue with one viewpoint and no `[[person]]`.
///
/// # Errors
/// Names the venue file at `path` and the field.
pub fn check_viewpoints(venue: &Venue, path: &Path) -> Result<(), FileError> {
    let finding = plausibility::of_viewpoints(venue);
    let wrong = finding.filter(Finding::is_wrong);
    wrong.map_or(Ok(()), |finding| {
        Err(FileError::new(path, finding.to_string()).at_field("viewpoint"))
    })
}

/// Refuses a venue without a detector and without a `[[person]]`, if too few viewpoints have cameras that need no detector:
/// files of keypoints or maps, and simulated cameras that make maps.
///
/// # Errors
/// Names the venue file at `path` and the field.
pub fn check_detector(venue: &Venue, path: &Path) -> Result<(), FileError> {
    if venue.detector.is_some() || !venue.given_persons.is_empty() {
        return Ok(());
    }
    let knows_people = |viewpoint: &&Viewpoint| {
        let mut cameras = viewpoint.cameras.iter().filter_map(|&it| venue.camera(it));
        cameras.any(|camera| !camera.source.gives_pictures())
    };
    // A single viewpoint is another fault than a missing detector.
    let needed = MIN_VIEWPOINTS.min(venue.viewpoints.len());
    if venue.viewpoints.iter().filter(knows_people).count() >= needed {
        return Ok(());
    }
    let problem = "the field is missing, and there is no `[[person]]`, so no people can be found in pictures; expected the card of a network that detects people, such as detector = \"models/CARD.toml\"";
    Err(FileError::new(path, problem).at_field("detector"))
}

/// Refuses a `[[person]]` with a keypoint that the network of `card` does not have (`None`: the venue has no pictures), or without
/// enough keypoints to fit a body.
///
/// # Errors
/// Names the venue file at `path` and the field.
pub fn check_given_keypoints(
    venue: &Venue,
    path: &Path,
    card: Option<&HeatmapCard>,
) -> Result<(), FileError> {
    let set = card.map_or(&venue.keypoints, |card| &card.output.keypoints);
    let known: Vec<&str> = set.names().iter().map(String::as_str).collect();
    for (place, person) in places(&venue.given_persons) {
        let place = place.key("keypoints_m");
        check_keypoint_names(path, &place, &person.keypoints_m, &known)?;
        let named = person.keypoints_m.iter();
        let body = ObservedJoints::from_named(named.map(|(name, at)| (name.as_str(), *at)));
        // The bounds of the joints change the fit, but not whether it exists.
        fit(&[body], &venue.parameters.ik, None).map_err(|error| {
            refusal(
                path,
                &place,
                format!("no body can be fitted to them: {error}"),
            )
        })?;
    }
    Ok(())
}

/// Refuses a `[[person]]` at a tick outside `ticks`, those of the run.
///
/// # Errors
/// Names the venue file at `path` and the field.
pub fn check_given_ticks(venue: &Venue, path: &Path, ticks: &Range<Tick>) -> Result<(), FileError> {
    let outside = places(&venue.given_persons).find(|(_, person)| !ticks.contains(&person.tick));
    outside.map_or(Ok(()), |(place, person)| {
        let problem = format!(
            "found {}, which is outside the ticks of the run, {}..{}",
            person.tick, ticks.start, ticks.end
        );
        Err(refusal(path, &place.key("tick"), problem))
    })
}

fn check_keypoint_names(
    path: &Path,
    place: &Place,
    keypoints_m: &BTreeMap<String, [f64; 3]>,
    known: &[&str],
) -> Result<(), FileError> {
    let unknown = keypoints_m
        .keys()
        .find(|name| !known.contains(&name.as_str()));
    unknown.map_or(Ok(()), |name| {
        let problem = unknown_name("keypoint of the network", name, known);
        Err(refusal(path, &place.key(name), problem))
    })
}

fn places(persons: &[GivenPerson]) -> impl Iterator<Item = (Place, &GivenPerson)> {
    let all = Place::field("person");
    let place = move |(i, person)| (all.index(i), person);
    persons.iter().enumerate().map(place)
}

fn refusal(path: &Path, place: &Place, problem: String) -> FileError {
    FileError::new(path, problem).at_field(place.to_string())
}

/// Whether all sources are recorded or simulated: they are then played from a tick that fusion sets.
pub(super) fn is_recorded(venue: &Venue) -> bool {
    !venue.cameras.iter().any(|camera| camera.source.is_live())
}

/// Refuses a live run of a venue that mixes live cameras and recordings: tick 0 of live cameras was in 1970, so the recordings
/// are over.
///
/// # Errors
/// Names the venue file at `path` and the first recording.
pub fn check_live_or_recorded(venue: &Venue, path: &Path) -> Result<(), FileError> {
    let first = |is_live: bool| {
        let mut cameras = venue.cameras.iter();
        cameras.find(move |camera| camera.source.is_live() == is_live)
    };
    let (Some(live), Some(recorded)) = (first(true), first(false)) else {
        return Ok(());
    };
    let viewpoint = usize::from(recorded.viewpoint.0);
    let own = venue.viewpoints[viewpoint].cameras.iter();
    let mut own = own.filter_map(|&index| venue.camera(index));
    let at = own.position(|camera| camera.model.name() == recorded.model.name());
    let place = Place::field("viewpoint").index(viewpoint);
    let place = place.key("camera").index(at.unwrap_or(0)).key("source");
    let problem = format!(
        "found a recording (camera {}) together with the live camera {}: live cameras follow the clock and recordings their own ticks, so they never match; run the recordings alone, or replace them",
        recorded.model.name(),
        live.model.name()
    );
    Err(FileError::new(path, problem).at_field(place.to_string()))
}

/// Refuses `ticks` of live cameras that are over at `now_us`.
///
/// # Errors
/// Names the current tick.
pub(super) fn check_ticks_to_come(
    venue: &Venue,
    ticks: &Range<Tick>,
    now_us: Micros,
) -> anyhow::Result<()> {
    let now = TickTime::new(0, venue.rate_hz).first_from(now_us);
    ensure!(
        is_recorded(venue) || now < ticks.end,
        "`--ticks {}..{}`: these ticks are over, because ticks of live cameras count from 1970; expected an end after {now}. Or omit `--ticks`, and stop with Ctrl-C",
        ticks.start,
        ticks.end
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use farfield_proto::calibration::Calibration;
    use farfield_proto::camera::{CameraModel, Distortion, Intrinsics};
    use farfield_proto::frames::Transform;
    use farfield_proto::keypoints::COCO17;
    use farfield_proto::tick::SECOND_US;
    use farfield_proto::venue::{DeviceSettings, Source};
    use nalgebra::Isometry3;

    use super::super::live::tests::venue;
    use super::*;

    /// A venue with four viewpoints: the first `count` have videos, the others files of keypoints.
    fn with_videos(count: usize) -> Venue {
        let mut venue = venue();
        for camera in &mut venue.cameras[..count] {
            camera.source = Source::Video {
                path: "a.mp4".into(),
            };
        }
        venue
    }

    /// Adds a `[[person]]`.
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
    fn pictures_need_a_detector_if_too_few_viewpoints_have_keypoints() {
        let is_refused = |venue: &Venue| check_detector(venue, path()).is_err();
        let refused = [0, 1, 2, 3, 4].map(|count| is_refused(&with_videos(count)));
        assert_eq!(refused, [false, false, false, true, true]);
        assert!(!is_refused(&given(with_videos(4))));
        let mut detecting = with_videos(4);
        detecting.detector = Some("people.toml".into());
        assert!(!is_refused(&detecting));
    }

    #[test]
    fn a_missing_detector_is_reported_with_the_line_to_write() {
        let refused = check_detector(&with_videos(4), path()).unwrap_err();
        let refused = refused.to_string();
        for word in [
            "hall.toml: `detector`: the field is missing",
            "`[[person]]`",
            "detector = \"models/CARD.toml\"",
        ] {
            assert!(refused.contains(word), "{word:?} in {refused}");
        }
    }

    #[test]
    fn one_viewpoint_is_refused_unless_a_person_is_given() {
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

    const CARD: &str = r#"kind = "heatmap"
file = "net.onnx"
input = { name = "image", layout = "nchw", width = 192, height = 256, channels = "rgb" }
normalize = { scale = 0.004, mean = [0.485, 0.456, 0.406], std = [0.229, 0.224, 0.225] }
output = { name = "heatmaps", width = 48, height = 64, keypoints = [KEYPOINTS] }
cell_to_input = { scale = 4.0, offset = 0.0 }
box_margin = 1.25
"#;

    const SHOULDERS: &str = "left_shoulder = [0.1, 0.2, 1.4], right_shoulder = [-0.2, 0.2, 1.4]";
    const HIPS: &str = "left_hip = [0.05, 0.2, 0.95], right_hip = [-0.15, 0.2, 0.95]";

    /// A venue with two `[[person]]`: the first at tick 20 is complete, the second at tick 30 has `keypoints_m`.
    fn venue_with_persons(keypoints_m: &str) -> Venue {
        let text = format!(
            r#"name = "hall"
rate_hz = 20
calibration = "calibration.toml"
network = "net.toml"
[[viewpoint]]
name = "south"
[[viewpoint.camera]]
name = "south"
source = {{ kind = "keypoints", path = "south.jsonl" }}
[[person]]
tick = 20
keypoints_m = {{ {SHOULDERS}, {HIPS}, nose = [-0.05, 0.3, 1.65] }}
[[person]]
tick = 30
keypoints_m = {{ {keypoints_m} }}
"#
        );
        let intrinsics = Intrinsics {
            fx_px: 900.0,
            fy_px: 900.0,
            cx_px: 640.0,
            cy_px: 360.0,
        };
        let place = Transform::new(Isometry3::identity());
        let camera = CameraModel::new(
            "south",
            [1280, 720],
            intrinsics,
            Distortion::default(),
            place,
        );
        let calibration = Calibration {
            cameras: [("south".to_owned(), camera.unwrap())].into(),
            hash: "0123456789abcdef".to_owned(),
            rotation_lengths_rad: BTreeMap::new(),
        };
        Venue::parse(&text, path(), calibration).unwrap()
    }

    fn card(more: &[&str]) -> HeatmapCard {
        let names = COCO17.iter().chain(more).map(|name| format!("{name:?}"));
        let names: Vec<String> = names.collect();
        HeatmapCard::parse(
            &CARD.replace("KEYPOINTS", &names.join(", ")),
            Path::new("net.toml"),
        )
        .unwrap()
    }

    fn check_refusal(keypoints_m: &str, card: &HeatmapCard, expected: &str) {
        let refused = check_given_keypoints(&venue_with_persons(keypoints_m), path(), Some(card))
            .unwrap_err();
        assert_eq!(refused.to_string(), format!("hall.toml: {expected}"));
    }

    #[test]
    fn an_unknown_keypoint_is_refused_with_the_nearest_name() {
        let misspelt = format!("{SHOULDERS}, {HIPS}, nsoe = [0, 0, 1.6]");
        check_refusal(
            &misspelt,
            &card(&[]),
            "`person[1].keypoints_m.nsoe`: unknown keypoint of the network `nsoe`, did you mean `nose`?",
        );
        let with_heel =
            venue_with_persons(&format!("{SHOULDERS}, {HIPS}, left_heel = [0, 0.2, 0.05]"));
        check_given_keypoints(&with_heel, path(), Some(&card(&["left_heel"]))).unwrap();
        assert!(check_given_keypoints(&with_heel, path(), Some(&card(&[]))).is_err());
        assert!(check_given_keypoints(&with_heel, path(), None).is_err());
    }

    #[test]
    fn a_person_without_enough_keypoints_for_a_body_is_refused() {
        // Symptom to prevent: one of five known names is no joint of the skeleton, and the person was silently missing from the
        // results.
        let on_no_joint = format!("{SHOULDERS}, {HIPS}, racket = [0, 0, 1]");
        check_refusal(
            &on_no_joint,
            &card(&["racket"]),
            "`person[1].keypoints_m`: no body can be fitted to them: 4 keypoints are known, 5 are needed",
        );
    }

    #[test]
    fn a_person_outside_the_ticks_of_the_run_is_refused() {
        let venue = venue_with_persons(&format!("{SHOULDERS}, {HIPS}, nose = [0, 0, 1.6]"));
        check_given_ticks(&venue, path(), &(Tick(20)..Tick(31))).unwrap();
        let refused = check_given_ticks(&venue, path(), &(Tick(20)..Tick(30))).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "hall.toml: `person[1].tick`: found 30, which is outside the ticks of the run, 20..30"
        );
    }

    #[test]
    fn a_recording_together_with_a_live_camera_is_refused() {
        let mut venue = venue();
        let path = Path::new("hall.toml");
        check_live_or_recorded(&venue, path).unwrap();
        let live = Source::V4l {
            device: "/dev/video0".into(),
            settings: DeviceSettings::default(),
        };
        for i in [2, 0, 1] {
            venue.cameras[i].source = live.clone();
        }
        let refused = check_live_or_recorded(&venue, path)
            .unwrap_err()
            .to_string();
        assert!(
            refused.starts_with(
                "hall.toml: `viewpoint[3].camera[0].source`: found a recording (camera d)"
            ),
            "{refused}"
        );
        venue.cameras[3].source = live;
        check_live_or_recorded(&venue, path).unwrap();
    }

    #[test]
    fn past_ticks_of_live_cameras_are_refused() {
        let recorded = venue();
        let mut live = venue();
        live.rate_hz = 60.0;
        live.cameras[0].source = Source::V4l {
            device: "/dev/video0".into(),
            settings: DeviceSettings::default(),
        };
        let now_us = 1_000 * SECOND_US;
        let ticks = |end| Tick(0)..Tick(end);
        assert!(check_ticks_to_come(&recorded, &ticks(1_200), now_us).is_ok());
        assert!(check_ticks_to_come(&live, &ticks(60_001), now_us).is_ok());
        let refused = check_ticks_to_come(&live, &ticks(60_000), now_us).unwrap_err();
        assert!(refused.to_string().contains("after 60000"), "{refused}");
    }
}
