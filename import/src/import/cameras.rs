//! Whose keypoints are which camera's of the calibration.

use std::collections::{BTreeMap, BTreeSet};

use farfield_calibration::formats::{CameraRecord, Imported, RemarkKind};
use farfield_proto::toml_file::unknown_name;

use crate::assemble::CameraFrames;
use crate::error::ImportError;
use crate::matching::named_by;
use crate::person::{CameraKey, Frames};
use crate::report::RemarkReport;

use super::sources::Source;

/// What one camera of a source saw.
struct Seen {
    /// What names it; its place where nothing does.
    name: Name,
    /// For reports.
    from: String,
    frames: Frames,
}

enum Name {
    /// The calibration's: the user has said so.
    Certain(String),
    Like(String),
    Nth(usize),
}

/// The frames of every camera that has some, in the order of the calibration.
pub(super) fn matched(
    sources: Vec<Source>,
    calibration: &Imported,
    remarks: &mut Vec<RemarkReport>,
) -> Result<Vec<CameraFrames>, ImportError> {
    let seen = seen(sources)?;
    let records = &calibration.cameras;
    let places = places(&seen, records, remarks)?;
    let mut taken: BTreeMap<usize, Seen> = BTreeMap::new();
    for (place, seen) in places.into_iter().zip(seen) {
        if let Some(other) = taken.get(&place) {
            let name = records.get(place).map_or("", |it| it.name.as_str());
            return Err(ImportError::refused(format!(
                "`{}` and `{}` are both of camera `{name}`: say whose they are with `--camera NAME=FOLDER`, or import a \
                 folder of one recording",
                other.from, seen.from
            )));
        }
        taken.insert(place, seen);
    }
    let mut cameras = Vec::new();
    for (place, record) in records.iter().enumerate() {
        let Some(seen) = taken.remove(&place) else {
            let text = "it has no keypoints, and is left out of the venue";
            remarks.push(RemarkReport::of_camera(
                RemarkKind::Assumed,
                &record.name,
                text,
            ));
            continue;
        };
        cameras.push(CameraFrames {
            name: record.name.clone(),
            size_px: record.size_px,
            source: seen.from,
            frames: seen.frames,
        });
    }
    Ok(cameras)
}

/// Every camera of every source.
fn seen(sources: Vec<Source>) -> Result<Vec<Seen>, ImportError> {
    let mut all = Vec::new();
    for source in sources {
        let from = source.from.display().to_string();
        let cameras = source.parsed.detections.cameras;
        if let (Some(camera), true) = (&source.camera, cameras.len() > 1) {
            return Err(ImportError::refused(format!(
                "{from}: found {} cameras in it, expected one for `--camera {camera}=...`: import its folder instead",
                cameras.len()
            )));
        }
        for (key, frames) in cameras {
            let (name, from) = match (&source.camera, key) {
                (Some(camera), _) => (Name::Certain(camera.clone()), from.clone()),
                (None, CameraKey::OfFile) => (Name::Like(source.name.clone()), from.clone()),
                (None, CameraKey::Named(name)) => {
                    let from = format!("{from}, {name}");
                    (Name::Like(name), from)
                }
                (None, CameraKey::Nth(place)) => {
                    (Name::Nth(place), format!("{from}, camera {place}"))
                }
            };
            all.push(Seen { name, from, frames });
        }
    }
    Ok(all)
}

/// The place in the calibration of each of `seen`.
fn places(
    seen: &[Seen],
    records: &[CameraRecord],
    remarks: &mut Vec<RemarkReport>,
) -> Result<Vec<usize>, ImportError> {
    let names: Vec<&str> = records.iter().map(|it| it.name.as_str()).collect();
    let mut found = Vec::new();
    for seen in seen {
        found.push(match &seen.name {
            Name::Certain(name) => {
                let place = names.iter().position(|it| it == name);
                Some(place.ok_or_else(|| {
                    let text = unknown_name("camera of the calibration", name, &names);
                    ImportError::refused(format!("`--camera`: {text}"))
                })?)
            }
            Name::Like(name) => like(name, &names),
            Name::Nth(place) if *place < names.len() => Some(*place),
            Name::Nth(place) => {
                return Err(ImportError::refused(format!(
                    "{}: the calibration has {} cameras, expected at least {}",
                    seen.from,
                    names.len(),
                    place + 1
                )));
            }
        });
    }
    if seen.iter().any(|it| matches!(it.name, Name::Nth(_))) {
        let text = "the keypoints' cameras have no names: they were taken in the order of the calibration's";
        remarks.push(RemarkReport::of_all(RemarkKind::Assumed, text));
    }
    let all: Option<Vec<usize>> = found.iter().copied().collect();
    let distinct: BTreeSet<usize> = found.iter().flatten().copied().collect();
    if let Some(all) = all {
        said(seen, &names, &all, remarks);
        return Ok(all);
    }
    if distinct.is_empty() && seen.len() == names.len() {
        remarks.push(RemarkReport::of_all(
            RemarkKind::Doubtful,
            format!(
                "no name of a camera is like one of the keypoints': they were taken in their order, as Pose2Sim does: {}; \
                 where that is wrong nobody will be found: say `--camera NAME=FOLDER`",
                pairs(seen, &names, &(0..names.len()).collect::<Vec<_>>())
            ),
        ));
        return Ok((0..names.len()).collect());
    }
    let unknown: Vec<&str> = seen
        .iter()
        .zip(&found)
        .filter(|(_, place)| place.is_none())
        .map(|(seen, _)| seen.from.as_str())
        .collect();
    Err(ImportError::refused(format!(
        "{} is of no camera, or may be of several\ncameras of the calibration: {}\nsay whose it is with `--camera \
         NAME=FOLDER`",
        unknown.join(", "),
        names.join(", ")
    )))
}

/// The only camera whose name stands in `name`, or in whose name it stands.
fn like(name: &str, names: &[&str]) -> Option<usize> {
    let place = |camera: &str| names.iter().position(|it| *it == camera);
    match named_by(names, name)[..] {
        [camera] => return place(camera),
        [] => {}
        _ => return None,
    }
    let mut around = names
        .iter()
        .filter(|camera| !named_by(&[name], camera).is_empty());
    match (around.next(), around.next()) {
        (Some(camera), None) => place(camera),
        _ => None,
    }
}

/// Says which keypoints were taken for a camera of another name.
fn said(seen: &[Seen], names: &[&str], places: &[usize], remarks: &mut Vec<RemarkReport>) {
    for (seen, place) in seen.iter().zip(places) {
        if let (Name::Like(name), Some(camera)) = (&seen.name, names.get(*place))
            && name != camera
        {
            let text = format!("`{name}` was taken for it, by the name");
            remarks.push(RemarkReport::of_camera(RemarkKind::Assumed, camera, text));
        }
    }
}

fn pairs(seen: &[Seen], names: &[&str], places: &[usize]) -> String {
    let pairs: Vec<String> = seen
        .iter()
        .zip(places)
        .map(|(seen, place)| format!("{} = {}", names.get(*place).unwrap_or(&""), seen.from))
        .collect();
    pairs.join(", ")
}
