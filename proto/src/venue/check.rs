//! Converts the parsed file to a checked venue; limits of its ticks and coordinates.

use std::collections::BTreeSet;

use super::field::{court, field};
use super::inference::{Provider, providers};
use super::parameters::ParameterTables;
use super::people::{given_persons, subjects};
use super::raw::{RawFusion, RawSecurity, RawVenue, RawViewpoint};
use super::source::{Source, source, timing};
use super::stream::streams;
use super::{Endpoints, Parameters, Security, Venue, VenueCamera, VenueHash, Viewpoint};
use crate::calibration::Calibration;
use crate::id::{CameraIndex, ViewpointIndex};
use crate::key::is_key_chunk;
use crate::keypoints::KeypointSet;
use crate::tick::Tick;
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};
use crate::transport::endpoint::is_endpoint;
use crate::transport::{FUSION, READER, RECORDER};
use crate::wire::MAX_CAMERAS;

/// Largest rate, ticks per second.
const MAX_RATE_HZ: f64 = 1000.0;
/// Reserved names of viewpoints, with their owners.
const TAKEN_NAMES: [(&str, &str); 4] = [
    (FUSION, "the fusion node"),
    (READER, "readers"),
    (RECORDER, "the recorder node"),
    ("ca", "the venue's authority"),
];
/// Most viewpoints of a venue.
const MAX_VIEWPOINTS: usize = 256;

pub(super) fn venue(
    file: &TomlFile<'_>,
    raw: RawVenue,
    calibration: Calibration,
    hashes: VenueHash,
) -> Result<Venue, FileError> {
    check_key_chunk(file, &Place::field("name"), &raw.name)?;
    if !(raw.rate_hz > 0.0 && raw.rate_hz <= MAX_RATE_HZ) {
        let problem = format!(
            "found {:?}, expected a number above 0 and up to {MAX_RATE_HZ}",
            raw.rate_hz
        );
        return Err(file.error(&Place::field("rate_hz"), problem));
    }
    let for_all = raw.inference.checked(file)?;
    let (viewpoints, cameras) = viewpoints(file, raw.viewpoint, &for_all, calibration)?;
    if raw.network.is_none() {
        check_no_network(file, &viewpoints, &cameras)?;
    }
    let keypoints = keypoints(file, raw.keypoints.as_deref(), &cameras)?;
    let given = raw.network.is_none().then_some(&keypoints);
    let parameters = Parameters::from(ParameterTables {
        smoothing: raw.smoothing,
        range_of_motion: raw.range_of_motion,
        boxes: raw.boxes,
        births: raw.births,
        link: raw.link,
        recording: raw.recording,
        tuning: raw.tuning,
    });
    parameters.check(file)?;
    let tracked = field(file, raw.field.as_ref(), &cameras)?;
    let (people, margin_m) = (raw.person, parameters.births.outside_field_m);
    Ok(Venue {
        court: court(file, raw.field.as_ref())?,
        given_persons: given_persons(file, people, given, &tracked, margin_m)?,
        field: tracked,
        streams: streams(file, raw.stream)?,
        subjects: subjects(file, raw.subject)?,
        endpoints: endpoints(file, raw.fusion)?,
        security: security(file, raw.security)?,
        calibration_path: path(file, "calibration", &raw.calibration)?,
        network: raw
            .network
            .map(|name| path(file, "network", &name))
            .transpose()?,
        detector: raw
            .detector
            .map(|name| path(file, "detector", &name))
            .transpose()?,
        keypoints,
        name: raw.name,
        rate_hz: raw.rate_hz,
        first_tick: tick(file, &Place::field("first_tick"), raw.first_tick)?,
        viewpoints,
        cameras,
        parameters,
        hashes,
    })
}

fn path(file: &TomlFile<'_>, field: &str, name: &str) -> Result<std::path::PathBuf, FileError> {
    if name.is_empty() {
        return Err(file.error(
            &Place::field(field),
            "found \"\", expected the name of a file",
        ));
    }
    Ok(file.resolve(name))
}

fn check_key_chunk(file: &TomlFile<'_>, place: &Place, name: &str) -> Result<(), FileError> {
    if is_key_chunk(name) {
        return Ok(());
    }
    let problem =
        format!("found {name:?}, expected 1 to 64 ASCII letters, digits, `-`, `_` or `.`");
    Err(file.error(place, problem))
}

fn viewpoints(
    file: &TomlFile<'_>,
    raw: Vec<RawViewpoint>,
    for_all: &[Provider],
    calibration: Calibration,
) -> Result<(Vec<Viewpoint>, Vec<VenueCamera>), FileError> {
    let all = Place::field("viewpoint");
    if raw.is_empty() || raw.len() > MAX_VIEWPOINTS {
        return Err(file.error(
            &all,
            format!(
                "found {}, expected 1 to {MAX_VIEWPOINTS} viewpoints",
                raw.len()
            ),
        ));
    }
    let used: BTreeSet<String> = raw
        .iter()
        .flat_map(|viewpoint| viewpoint.camera.iter().map(|camera| camera.name.clone()))
        .collect();
    let names: Vec<String> = calibration.cameras.keys().cloned().collect();
    let mut unused = calibration.cameras;
    let mut viewpoints: Vec<Viewpoint> = Vec::new();
    let mut cameras = Vec::new();
    for (i, viewpoint) in raw.into_iter().enumerate() {
        let place = all.index(i);
        check_key_chunk(file, &place.key("name"), &viewpoint.name)?;
        if let Some((name, whose)) = TAKEN_NAMES.iter().find(|(name, _)| *name == viewpoint.name) {
            let problem = format!("found \"{name}\", which is the name of {whose}");
            return Err(file.error(&place.key("name"), problem));
        }
        if viewpoints.iter().any(|v| v.name == viewpoint.name) {
            let problem = format!(
                "a second viewpoint is called `{}`, expected names that differ",
                viewpoint.name
            );
            return Err(file.error(&place.key("name"), problem));
        }
        if viewpoint.camera.is_empty() || viewpoint.camera.len() > MAX_CAMERAS {
            let problem = format!(
                "found {}, expected 1 to {MAX_CAMERAS} cameras",
                viewpoint.camera.len()
            );
            return Err(file.error(&place.key("camera"), problem));
        }
        let mut indices = Vec::new();
        for (j, camera) in viewpoint.camera.into_iter().enumerate() {
            let place = place.key("camera").index(j);
            let model = unused.remove(&camera.name).ok_or_else(|| {
                let problem = no_camera(&camera.name, &names, &used);
                file.error(&place.key("name"), problem)
            })?;
            indices.push(CameraIndex(cameras.len() as u16));
            let source = source(file, &place.key("source"), camera.source)?;
            let (tick_from, capture_delay_s) = timing(
                file,
                &place,
                &source,
                camera.tick_from,
                camera.capture_delay_ms,
            )?;
            cameras.push(VenueCamera {
                viewpoint: ViewpointIndex(i as u16),
                model,
                source,
                tick_from,
                capture_delay_s,
            });
        }
        viewpoints.push(Viewpoint {
            name: viewpoint.name,
            cameras: indices,
            providers: match viewpoint.providers {
                Some(own) => providers(file, &place.key("providers"), &own)?,
                None => for_all.to_vec(),
            },
        });
    }
    Ok((viewpoints, cameras))
}

/// The error for camera `name`, which is not among the `known` cameras of the calibration.
fn no_camera(name: &String, known: &[String], used: &BTreeSet<String>) -> String {
    if known.contains(name) {
        return format!("camera `{name}` is used twice");
    }
    // A mistyped name does not mean a camera that the venue uses elsewhere.
    let free = known.iter().filter(|camera| !used.contains(*camera));
    let free: Vec<&str> = free.map(String::as_str).collect();
    unknown_name("camera of the calibration", name, &free)
}

/// Without a network no source may give pictures.
fn check_no_network(
    file: &TomlFile<'_>,
    viewpoints: &[Viewpoint],
    cameras: &[VenueCamera],
) -> Result<(), FileError> {
    let pictures = cameras.iter().find(|camera| camera.source.gives_pictures());
    pictures.map_or(Ok(()), |camera| {
        let viewpoint = &viewpoints[usize::from(camera.viewpoint.0)].name;
        let problem = format!(
            "the field is missing: camera `{}` of viewpoint `{viewpoint}` gives pictures, which need a network's card",
            camera.model.name()
        );
        Err(file.error(&Place::field("network"), problem))
    })
}

/// The set of keypoint files: COCO's 17 unless the venue names another.
fn keypoints(
    file: &TomlFile<'_>,
    name: Option<&str>,
    cameras: &[VenueCamera],
) -> Result<KeypointSet, FileError> {
    let Some(name) = name else {
        return Ok(KeypointSet::coco17());
    };
    let error = |problem| file.error(&Place::field("keypoints"), problem);
    let is_file = |camera: &VenueCamera| matches!(camera.source, Source::Keypoints { .. });
    let is_simulated = |camera: &VenueCamera| !is_file(camera) && camera.source.drawing().is_some();
    if !cameras.iter().any(is_file) || cameras.iter().any(is_simulated) {
        return Err(error(
            "found the field in a venue without keypoint files or with simulated maps, expected none: a network's card names its \
             keypoints, and simulated maps are of COCO's 17"
                .to_owned(),
        ));
    }
    match name {
        "coco17" | "coco23" => KeypointSet::named(name).map_err(error),
        other => Err(error(format!(
            "found \"{other}\", expected \"coco17\" or \"coco23\""
        ))),
    }
}

fn endpoints(file: &TomlFile<'_>, raw: RawFusion) -> Result<Endpoints, FileError> {
    for (field, list) in [("listen", &raw.listen), ("connect", &raw.connect)] {
        // Zenoh's own error for a bad endpoint names no file.
        if let Some(i) = list.iter().position(|text| !is_endpoint(text)) {
            let problem = format!(
                "found \"{}\", expected an endpoint such as \"tcp/127.0.0.1:7447\"",
                list[i]
            );
            return Err(file.error(&Place::field("fusion").key(field).index(i), problem));
        }
    }
    Ok(Endpoints {
        listen: raw.listen,
        connect: raw.connect,
    })
}

fn security(file: &TomlFile<'_>, raw: RawSecurity) -> Result<Security, FileError> {
    let folder = |name: String| {
        if name.is_empty() {
            let place = Place::field("security").key("certificates");
            return Err(file.error(&place, "found \"\", expected the name of a folder"));
        }
        Ok(file.resolve(&name))
    };
    if raw.pictures && raw.allow_plaintext {
        let place = Place::field("security").key("pictures");
        let problem = "pictures leave an edge over TLS only: remove `allow_plaintext`, or set `pictures = false`";
        return Err(file.error(&place, problem));
    }
    Ok(Security {
        certificates: raw.certificates.map(folder).transpose()?,
        allow_plaintext: raw.allow_plaintext,
        pictures: raw.pictures,
    })
}

/// Largest coordinate, world, metres.
pub(super) const MAX_COORDINATE_M: f64 = 1e4;
/// Ticks farther from zero have no exact time in seconds.
const MAX_TICK: i64 = 1 << 53;

/// The `tick` at `place`.
///
/// # Errors
/// [`FileError`] when it is too far from zero.
pub(super) fn tick(file: &TomlFile<'_>, place: &Place, tick: i64) -> Result<Tick, FileError> {
    if (-MAX_TICK..=MAX_TICK).contains(&tick) {
        return Ok(Tick(tick));
    }
    let problem = format!(
        "found {tick}, expected a tick from {} to {MAX_TICK}",
        -MAX_TICK
    );
    Err(file.error(place, problem))
}
