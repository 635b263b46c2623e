//! Whether the people given by hand can be borne: anyone who cannot is refused before the run begins,
//! and is not missing from its results without a word.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use farfield_proto::keypoints::COCO17;
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::{FileError, Place, unknown_name};
use farfield_proto::venue::{GivenPerson, Venue};

use crate::body::fit::fit;
use crate::body::observed::ObservedJoints;

/// Refuses a person given by hand with a keypoint that the network of `card` does not know (`None`:
/// the 17 COCO keypoints), or to whom no body can be fitted.
///
/// # Errors
/// Names the venue file, which is at `path`, and the field.
pub fn check_given_keypoints(
    venue: &Venue,
    path: &Path,
    card: Option<&HeatmapCard>,
) -> Result<(), FileError> {
    let known = card.map_or_else(
        || COCO17.to_vec(),
        |card| {
            let names = card.output.keypoints.names().iter();
            names.map(String::as_str).collect()
        },
    );
    for (place, person) in places(&venue.given_persons) {
        let place = place.key("keypoints_m");
        check_names(path, &place, &person.keypoints_m, &known)?;
        let named = person.keypoints_m.iter();
        let body = ObservedJoints::from_named(named.map(|(name, at)| (name.as_str(), *at)));
        // The bounds of the joints move the fit, but do not decide whether there is one.
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

/// Refuses a person given by hand at a tick outside `ticks`, those of the run.
///
/// # Errors
/// Names the venue file, which is at `path`, and the field.
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

fn check_names(
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

#[cfg(test)]
#[path = "given_tests.rs"]
mod tests;
