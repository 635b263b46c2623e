//! Assigns keypoints to the cameras of the calibration.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use farfield_calibration::formats::{CameraRecord, Imported, Remark, RemarkKind};
use farfield_proto::toml_file::unknown_name;

use crate::assemble::CameraFrames;
use crate::error::ImportError;
use crate::folder;
use crate::matching::{NaturalKey, by_last_number, named_by};
use crate::person::{CameraKey, Frames};

use super::sources::Source;

/// The keypoints of one camera of a source.
struct Seen {
    /// How the camera is identified.
    name: Name,
    /// Source for reports.
    from: String,
    frames: Frames,
}

enum Name {
    /// A name of the calibration, given by the user.
    Certain(String),
    /// Candidate names in order of preference.
    Like(Vec<String>),
    /// Index and number of cameras, for sources without names.
    Nth(usize, usize),
}

impl Name {
    /// Sort key: the last number as in Pose2Sim, then all names; names without numbers come last.
    fn order(&self) -> Vec<(bool, NaturalKey)> {
        let Self::Like(names) = self else {
            return Vec::new();
        };
        names.iter().map(|name| by_last_number(name)).collect()
    }
}

/// Returns the frames of every camera that has some, in the order of the calibration.
/// `unsynchronised` lists keypoints that were skipped because Pose2Sim synchronised only other
/// cameras.
pub(super) fn matched(
    sources: Vec<Source>,
    unsynchronised: &BTreeSet<PathBuf>,
    calibration: &Imported,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<CameraFrames>, ImportError> {
    let mut seen = seen(sources)?;
    seen.sort_by_cached_key(|it| it.name.order());
    let records = &calibration.cameras;
    let left = Unsynchronised::new(unsynchronised, records);
    let places = places(&seen, records, &left, remarks)?;
    let mut taken: BTreeMap<usize, Seen> = BTreeMap::new();
    for (place, seen) in places.into_iter().zip(seen) {
        if let Some(other) = taken.get(&place) {
            let name = records.get(place).map_or("", |it| it.name.as_str());
            return Err(ImportError::refused(format!(
                "`{}` and `{}` both match camera `{name}`: assign them with `--camera NAME=FOLDER`, or import a folder that \
                 holds one recording",
                other.from, seen.from
            )));
        }
        taken.insert(place, seen);
    }
    let mut cameras = Vec::new();
    for (place, record) in records.iter().enumerate() {
        let Some(seen) = taken.remove(&place) else {
            let (kind, text) = left.omission_reason(place);
            remarks.push(Remark::of_camera(kind, &record.name, text));
            continue;
        };
        cameras.push(CameraFrames {
            name: record.name.clone(),
            size_px: record.size_px,
            down: down(record),
            source: seen.from,
            frames: seen.frames,
        });
    }
    Ok(cameras)
}

/// Direction of the world's -z in the image; (0, 1) if the camera looks along it or has no pose.
fn down(record: &CameraRecord) -> [f64; 2] {
    /// Minimum length of the projected direction: more than 20 degrees from the optical axis.
    const SHOWN: f64 = 0.34;
    let Some(pose) = record.camera_from_world else {
        return [0.0, 1.0];
    };
    // The third column of the rotation is the world's z in camera axes.
    let up = pose.rotation.to_rotation_matrix();
    let (x, y) = (-up[(0, 2)], -up[(1, 2)]);
    let length = x.hypot(y);
    if length < SHOWN {
        [0.0, 1.0]
    } else {
        [x / length, y / length]
    }
}

/// Keypoints that were skipped because Pose2Sim synchronised only other cameras.
struct Unsynchronised {
    /// All that may be keypoints, for reports.
    all: Vec<String>,
    /// Those that match a camera, by its index in the calibration.
    of_cameras: BTreeMap<usize, String>,
}

impl Unsynchronised {
    fn new(paths: &BTreeSet<PathBuf>, records: &[CameraRecord]) -> Self {
        let names: Vec<&str> = records.iter().map(|it| it.name.as_str()).collect();
        let mut left = Self {
            all: Vec::new(),
            of_cameras: BTreeMap::new(),
        };
        for path in paths {
            let is_folder = folder::ending(path) != "json";
            let shown = path.display().to_string();
            let name = folder::camera_name(path, is_folder);
            let likeness = like(&name, &names);
            // Settings and lists of images may lie in the same folder.
            if is_folder || !matches!(likeness, Likeness::None) {
                left.all.push(shown.clone());
            }
            if let Likeness::One(place, _) = likeness {
                left.of_cameras.insert(place, shown);
            }
        }
        left
    }

    /// Why the camera at index `place` of the calibration has no keypoints.
    fn omission_reason(&self, place: usize) -> (RemarkKind, String) {
        match self.of_cameras.get(&place) {
            Some(path) => (
                RemarkKind::Doubtful,
                format!(
                    "it is left out of the venue: its keypoints in {path} are not synchronised, and `pose-sync` has only \
                     those of other cameras; {SYNCHRONISE}"
                ),
            ),
            None => (
                RemarkKind::Assumed,
                "it has no keypoints, and is left out of the venue".to_owned(),
            ),
        }
    }

    /// Addition to the error if names match no camera.
    fn hint(&self) -> String {
        if self.all.is_empty() {
            return String::new();
        }
        format!(
            "\n`pose-sync` lacks {}, which `pose` has: {SYNCHRONISE}",
            self.all.join(", ")
        )
    }
}

/// Remedy if only some of the cameras are synchronised.
const SYNCHRONISE: &str = "synchronise all cameras again, or move `pose-sync` away to use all of `pose`, if these cameras \
                           recorded in step";

/// Lists every camera of every source.
fn seen(sources: Vec<Source>) -> Result<Vec<Seen>, ImportError> {
    let mut all = Vec::new();
    for source in sources {
        let from = source.from.display().to_string();
        let cameras = source.parsed.detections.cameras;
        let count = cameras.len();
        let is_nth = |key: &CameraKey| matches!(key, CameraKey::Nth(_));
        let assigned = &source.cameras;
        let is_in_order = assigned.len() == 1 || cameras.keys().all(is_nth);
        let is_as_assigned = assigned.len() == count && is_in_order;
        if !(assigned.is_empty() || is_as_assigned) {
            return Err(ImportError::refused(format!(
                "{from}: found {count} cameras in it, expected {} for `--camera {}=...`: import its folder instead, or, if \
                 they have no names, give `--camera NAME={from}` once for each, in their order",
                assigned.len(),
                assigned.join("` and `")
            )));
        }
        for (nth, (key, frames)) in cameras.into_iter().enumerate() {
            let (name, from) = match (assigned.get(nth), key) {
                (Some(camera), _) => (Name::Certain(camera.clone()), from.clone()),
                (None, CameraKey::OfFile) => (Name::Like(vec![source.name.clone()]), from.clone()),
                (None, CameraKey::Named(name)) => {
                    let from = format!("{from}, {name}");
                    // A single image folder may just be called `images`; then the file's name
                    // counts.
                    let other = (count == 1).then(|| source.name.clone());
                    (Name::Like([name].into_iter().chain(other).collect()), from)
                }
                (None, CameraKey::Nth(place)) => {
                    (Name::Nth(place, count), format!("{from}, camera {place}"))
                }
            };
            all.push(Seen { name, from, frames });
        }
    }
    Ok(all)
}

/// Index in the calibration of each of `seen`.
fn places(
    seen: &[Seen],
    records: &[CameraRecord],
    left: &Unsynchronised,
    remarks: &mut Vec<Remark>,
) -> Result<Vec<usize>, ImportError> {
    let names: Vec<&str> = records.iter().map(|it| it.name.as_str()).collect();
    let mut found = Vec::new();
    for seen in seen {
        found.push(likeness(seen, &names)?);
    }
    if seen.iter().any(|it| matches!(it.name, Name::Nth(..))) {
        let text = "the keypoints' cameras have no names: they were taken in the order of the calibration's";
        remarks.push(Remark::of_all(RemarkKind::Assumed, text));
    }
    let place = |it: &Likeness<'_>| match it {
        Likeness::One(place, _) => Some(*place),
        Likeness::Several | Likeness::None => None,
    };
    if let Some(all) = found.iter().map(place).collect::<Option<Vec<usize>>>() {
        report_name_matches(&found, &names, remarks);
        return Ok(all);
    }
    let is_none = |it: &Likeness<'_>| matches!(it, Likeness::None);
    if found.iter().all(is_none) && seen.len() == names.len() {
        remarks.push(Remark::of_all(
            RemarkKind::Doubtful,
            format!(
                "no camera name resembles the names of the keypoints: they were assigned in order, as Pose2Sim does: {}; if \
                 that is wrong, no people or wrong skeletons are found: assign them with `--camera NAME=FOLDER`",
                pairs(seen, &names)
            ),
        ));
        return Ok((0..names.len()).collect());
    }
    let unknown: Vec<&str> = seen
        .iter()
        .zip(&found)
        .filter(|(_, found)| place(found).is_none())
        .map(|(seen, _)| seen.from.as_str())
        .collect();
    Err(ImportError::refused(format!(
        "{} is of no camera, or may be of several\ncameras of the calibration: {}{}\nassign it with `--camera \
         NAME=FOLDER`",
        unknown.join(", "),
        names.join(", "),
        left.hint()
    )))
}

/// The cameras of the calibration that a name may refer to.
enum Likeness<'a> {
    /// Index of the only one, and the name that matched.
    One(usize, Option<&'a str>),
    Several,
    None,
}

fn likeness<'a>(seen: &'a Seen, names: &[&str]) -> Result<Likeness<'a>, ImportError> {
    match &seen.name {
        Name::Certain(name) => {
            let place = names.iter().position(|it| it == name);
            let place = place.ok_or_else(|| {
                let text = unknown_name("camera of the calibration", name, names);
                ImportError::refused(format!("`--camera`: {text}"))
            })?;
            Ok(Likeness::One(place, None))
        }
        Name::Like(of) => {
            let mut found = Likeness::None;
            for name in of {
                match like(name, names) {
                    one @ Likeness::One(..) => return Ok(one),
                    Likeness::Several => found = Likeness::Several,
                    Likeness::None => {}
                }
            }
            Ok(found)
        }
        // With fewer cameras it is unknown which one is missing.
        Name::Nth(place, count) if *count == names.len() => Ok(Likeness::One(*place, None)),
        Name::Nth(_, count) => Err(ImportError::refused(format!(
            "{}: its {count} cameras have no names, and the calibration has {}, expected as many: assign them with \
             `--camera NAME=FILE`, once for each in the order of the file",
            seen.from,
            names.len()
        ))),
    }
}

/// The only camera whose name occurs in `name`, or contains it.
fn like<'a>(name: &'a str, names: &[&str]) -> Likeness<'a> {
    let place = |camera: &str| match names.iter().position(|it| *it == camera) {
        Some(place) => Likeness::One(place, Some(name)),
        None => Likeness::None,
    };
    match named_by(names, name)[..] {
        [camera] => return place(camera),
        [] => {}
        _ => return Likeness::Several,
    }
    let mut around = names
        .iter()
        .filter(|camera| !named_by(&[name], camera).is_empty());
    match (around.next(), around.next()) {
        (Some(camera), None) => place(camera),
        (Some(_), Some(_)) => Likeness::Several,
        (None, _) => Likeness::None,
    }
}

/// Reports keypoints that were assigned to a camera of another name.
fn report_name_matches(found: &[Likeness<'_>], names: &[&str], remarks: &mut Vec<Remark>) {
    for found in found {
        if let Likeness::One(place, Some(name)) = found
            && let Some(camera) = names.get(*place)
            && name != camera
        {
            let text = format!("`{name}` was assigned to it by name");
            remarks.push(Remark::of_camera(RemarkKind::Assumed, camera, text));
        }
    }
}

fn pairs(seen: &[Seen], names: &[&str]) -> String {
    let pairs: Vec<String> = seen
        .iter()
        .zip(names)
        .map(|(seen, name)| format!("{name} = {}", seen.from))
        .collect();
    pairs.join(", ")
}
