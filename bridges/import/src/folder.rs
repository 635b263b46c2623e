//! What of a folder is what: which files are one camera's keypoints. Pure: names in, names out.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Where Pose2Sim keeps keypoints, and where it puts them when it has synchronised them.
const POSE: &str = "pose";
const POSE_SYNC: &str = "pose-sync";

/// Names of files that say nothing of their camera: the folder does.
const NAMELESS: [&str; 6] = [
    "alphapose-results",
    "predictions",
    "results",
    "keypoints",
    "person_keypoints",
    "annotations",
];

/// Files that may be keypoints, and where.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Candidates {
    /// JSON files by their folder: of all frames each, or of one frame each.
    pub(crate) json: BTreeMap<PathBuf, Vec<PathBuf>>,
    /// Tables and arrays.
    pub(crate) single: Vec<PathBuf>,
    /// What Pose2Sim has of cameras that it has not synchronised, where it has others: left out, and not to be forgotten.
    pub(crate) unsynchronised: BTreeSet<PathBuf>,
}

/// Which files may be keypoints.
///
/// Of Pose2Sim's folders the synchronised one is taken, and never the associated one, which has one person only.
pub(crate) fn candidates(files: &[PathBuf], folder: &Path) -> Candidates {
    let inside = |path: &Path, name: &str| {
        let relative = path.strip_prefix(folder).unwrap_or(path);
        let parent = relative.parent().unwrap_or(Path::new(""));
        parent.iter().any(|part| part.eq_ignore_ascii_case(name))
    };
    let json = files.iter().filter(|path| ending(path) == "json");
    let synchronised: BTreeSet<String> = json
        .filter_map(|path| place_in(path, folder, POSE_SYNC))
        .map(|place| key(&place))
        .collect();
    let mut found = Candidates::default();
    for path in files {
        let is_before = !synchronised.is_empty() && inside(path, POSE);
        if is_before
            && ending(path) == "json"
            && let Some(place) = place_in(path, folder, POSE)
            && !synchronised.contains(&key(&place))
        {
            found.unsynchronised.insert(place);
        }
        if is_before || inside(path, "pose-associated") || inside(path, "calibration") {
            continue;
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        match ending(path).as_str() {
            "json" => {
                let parent = path.parent().unwrap_or(Path::new("")).to_owned();
                found.json.entry(parent).or_default().push(path.clone());
            }
            "csv" => found.single.push(path.clone()),
            "npy" if stem.to_lowercase().contains("2ddata") => found.single.push(path.clone()),
            _ => {}
        }
    }
    found
}

/// What of one camera `path` is, or is in, where it lies in a folder `name` inside `folder`.
fn place_in(path: &Path, folder: &Path, name: &str) -> Option<PathBuf> {
    let relative = path.strip_prefix(folder).unwrap_or(path);
    let mut parts = relative.iter();
    parts.find(|part| part.eq_ignore_ascii_case(name))?;
    parts.next()?;
    path.ancestors().nth(parts.count()).map(Path::to_owned)
}

/// By what the same camera is known in two folders.
fn key(place: &Path) -> String {
    let name = place.file_name().unwrap_or_default();
    name.to_string_lossy().to_lowercase()
}

/// What names the camera of a file, or of a folder of a file per frame.
pub(crate) fn camera_name(path: &Path, is_folder: bool) -> String {
    let part = |path: &Path| {
        path.file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    };
    if is_folder {
        let name = part(path);
        return name.strip_suffix("_json").unwrap_or(&name).to_owned();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    // DeepLabCut writes its network behind the video's name.
    let stem = stem.split("DLC_").next().unwrap_or_default();
    if NAMELESS.contains(&stem.to_lowercase().as_str()) {
        return path.parent().map(part).unwrap_or_default();
    }
    stem.to_owned()
}

/// A file's ending, in lower case.
pub(crate) fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names
            .iter()
            .map(|name| Path::new("/take").join(name))
            .collect()
    }

    #[test]
    fn of_pose2sims_folders_the_synchronised_one_is_taken() {
        let files = paths(&[
            "pose/cam01_json/cam01_000000.json",
            "pose-sync/cam01_json/cam01_000000.json",
            "pose-associated/cam01_json/cam01_000000.json",
        ]);
        let found = candidates(&files, Path::new("/take"));
        let folders: Vec<&PathBuf> = found.json.keys().collect();
        assert_eq!(folders, [Path::new("/take/pose-sync/cam01_json")]);
        assert!(found.unsynchronised.is_empty());
        let found = candidates(&files[..1], Path::new("/take"));
        assert_eq!(found.json.len(), 1);
    }

    #[test]
    fn what_pose2sim_has_not_synchronised_is_left_out_and_not_forgotten() {
        let files = paths(&[
            "pose/cam01_json/cam01_000000.json",
            "pose/cam02_json/cam02_000000.json",
            "pose/cam02_json/cam02_000001.json",
            "pose/cam03.json",
            "pose/notes.txt",
            "pose-sync/Cam01_json/cam01_000000.json",
        ]);
        let found = candidates(&files, Path::new("/take"));
        let folders: Vec<&PathBuf> = found.json.keys().collect();
        assert_eq!(folders, [Path::new("/take/pose-sync/Cam01_json")]);
        let left: Vec<&PathBuf> = found.unsynchronised.iter().collect();
        let expected = ["/take/pose/cam02_json", "/take/pose/cam03.json"].map(Path::new);
        assert_eq!(left, expected);
        let found = candidates(&files[..5], Path::new("/take"));
        assert!(found.unsynchronised.is_empty());
    }

    #[test]
    fn arrays_of_two_dimensions_are_taken_and_others_are_not() {
        let files = paths(&[
            "output_data/raw_data/mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy",
            "output_data/raw_data/mediapipe_3dData_numFrames_numTrackedPoints_spatialXYZ.npy",
            "calibration/xy.csv",
        ]);
        assert_eq!(candidates(&files, Path::new("/take")).single, files[..1]);
    }

    #[test]
    fn folders_name_cameras_where_files_do_not() {
        for (path, is_folder, name) in [
            ("pose/cam01_json", true, "cam01"),
            ("left/alphapose-results.json", false, "left"),
            ("cam2.json", false, "cam2"),
            (
                "cam3DLC_resnet50_walkMay1shuffle1_500000.csv",
                false,
                "cam3",
            ),
        ] {
            assert_eq!(camera_name(Path::new(path), is_folder), name);
        }
    }
}
