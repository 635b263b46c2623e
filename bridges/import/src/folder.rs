//! Finds the keypoint files of each camera in a folder, and the frame numbers in file names. Pure:
//! names in, names out.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Pose2Sim's folders of raw and of synchronised keypoints.
const POSE: &str = "pose";
const POSE_SYNC: &str = "pose-sync";

/// File names that do not identify a camera; the folder's name does.
const NAMELESS: [&str; 6] = [
    "alphapose-results",
    "predictions",
    "results",
    "keypoints",
    "person_keypoints",
    "annotations",
];

/// Files that may hold keypoints.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Candidates {
    /// JSON files by folder; a file may hold all frames or one.
    pub(crate) json: BTreeMap<PathBuf, Vec<PathBuf>>,
    /// Tables and arrays.
    pub(crate) single: Vec<PathBuf>,
    /// Raw keypoints in `pose` of cameras that `pose-sync` lacks. They are left out and reported.
    pub(crate) unsynchronised: BTreeSet<PathBuf>,
}

/// Finds the files that may hold keypoints.
///
/// Of Pose2Sim's folders, the synchronised one is used. The associated one holds only one person
/// and is never used.
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

/// The file or folder of one camera that contains `path`, if `path` is in the folder `name` inside
/// `folder`.
fn place_in(path: &Path, folder: &Path, name: &str) -> Option<PathBuf> {
    let relative = path.strip_prefix(folder).unwrap_or(path);
    let mut parts = relative.iter();
    parts.find(|part| part.eq_ignore_ascii_case(name))?;
    parts.next()?;
    path.ancestors().nth(parts.count()).map(Path::to_owned)
}

/// Identifies the same camera in two folders.
fn key(place: &Path) -> String {
    let name = place.file_name().unwrap_or_default();
    name.to_string_lossy().to_lowercase()
}

/// Name of the camera of a file, or of a folder with one file per frame.
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
    // DeepLabCut appends its network's name to the video's name.
    let stem = stem.split("DLC_").next().unwrap_or_default();
    if NAMELESS.contains(&stem.to_lowercase().as_str()) {
        return path.parent().map(part).unwrap_or_default();
    }
    stem.to_owned()
}

/// File extension in lower case.
pub(crate) fn ending(path: &Path) -> String {
    let ending = path.extension().unwrap_or_default();
    ending.to_string_lossy().to_lowercase()
}

/// Largest frame number; larger numbers are times, not counts.
pub(crate) const MAX_FRAME: i64 = 1 << 40;

/// Returns the last number in a file's name without folder and extension; `None` if absent or too
/// large.
///
/// Both `cam01_000000000123_keypoints.json` and `123.jpg` give 123.
pub(crate) fn frame_of_name(name: &str) -> Option<i64> {
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let stem = match name.rsplit_once('.') {
        Some((stem, ending)) if !stem.is_empty() && !ending.bytes().all(|c| c.is_ascii_digit()) => {
            stem
        }
        _ => name,
    };
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let head = stem.get(..end)?;
    let start = head.rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        // Start after the last character that is not a digit.
        at + head[at..].chars().next().map_or(1, char::len_utf8)
    });
    let number = head.get(start..)?.parse().ok()?;
    (number <= MAX_FRAME).then_some(number)
}

/// Name of the folder that contains the image, from a path such as COCO's `file_name`.
pub(crate) fn folder_of_name(name: &str) -> Option<&str> {
    let (folder, _) = name.rsplit_once(['/', '\\'])?;
    let last = folder.rsplit(['/', '\\']).find(|it| !it.is_empty())?;
    (last != "." && last != "..").then_some(last)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn paths(names: &[&str]) -> Vec<PathBuf> {
        names
            .iter()
            .map(|name| Path::new("/take").join(name))
            .collect()
    }

    #[test]
    fn synchronised_pose2sim_folder_is_preferred() {
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
    fn cameras_without_synchronised_keypoints_are_reported() {
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
    fn only_two_dimensional_arrays_are_candidates() {
        let files = paths(&[
            "output_data/raw_data/mediapipe_2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy",
            "output_data/raw_data/mediapipe_3dData_numFrames_numTrackedPoints_spatialXYZ.npy",
            "calibration/xy.csv",
        ]);
        assert_eq!(candidates(&files, Path::new("/take")).single, files[..1]);
    }

    #[test]
    fn camera_name_falls_back_to_the_folder() {
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

    #[test]
    fn frame_is_the_last_number_of_the_name() {
        for (name, frame) in [
            ("cam01_000000000123_keypoints.json", Some(123)),
            ("cam01_000042.json", Some(42)),
            ("00012.json", Some(12)),
            ("frame_7.json", Some(7)),
            ("0.jpg", Some(0)),
            ("labeled-data/video2/img0012.png", Some(12)),
            ("123", Some(123)),
            ("take2_é34é.jpg", Some(34)),
            ("keypoints.json", None),
            ("99999999999999999999.json", None),
            ("", None),
        ] {
            assert_eq!(frame_of_name(name), frame, "{name}");
        }
        assert_eq!(folder_of_name("images/cam1/0001.jpg"), Some("cam1"));
        assert_eq!(folder_of_name("0001.jpg"), None);
    }

    proptest! {
        #[test]
        fn no_name_panics(name in ".{0,40}") {
            frame_of_name(&name);
            folder_of_name(&name);
        }

        #[test]
        fn frame_numbers_round_trip(prefix in "[a-z_é]{0,6}", frame in 0i64..=MAX_FRAME, width in 0usize..13) {
            let name = format!("{prefix}{frame:0width$}_keypoints.json");
            prop_assert_eq!(frame_of_name(&name), Some(frame));
        }
    }
}
