//! Finds calibrations among many files by their content.

use std::collections::BTreeMap;
use std::path::PathBuf;

use farfield_proto::toml_file::FileError;

use super::opencv::{DISTORTION, MATRIX};
use super::{Format, ImportOptions, Imported, TextFile, colmap, import};

/// The beginning of every calibration contains one of these.
const MARKS: [&str; 9] = [
    "<calibration",
    "<Cameras",
    "atrix",
    "\"K\"",
    "K:",
    "K_",
    "Rot_",
    "mtx",
    "camera_model",
];

/// One calibration among the files of a folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidate {
    /// Its files.
    pub files: Vec<TextFile>,
    /// The cameras, at least one of them with a pose; otherwise the reason why the files are not usable.
    pub read: Result<Imported, FileError>,
}

/// Whether a file with this beginning may be a calibration, or a part of one: a cheap test for every file.
pub fn may_be_calibration(beginning: &str) -> bool {
    MARKS.iter().any(|mark| beginning.contains(mark))
        || colmap::is_cameras(beginning)
        || colmap::is_images(beginning)
}

/// The calibrations among `files`, in their order. File names do not matter, but all files of one calibration must be in one
/// folder.
pub fn candidates(files: Vec<TextFile>) -> Vec<Candidate> {
    let mut found = Vec::new();
    let mut parts: BTreeMap<(PathBuf, Format), Vec<TextFile>> = BTreeMap::new();
    for file in files {
        match recognised(&file.text) {
            Some(Part::Whole) => found.push(candidate(vec![file])),
            Some(Part::Of(format)) => {
                let folder = file.path.parent().map(PathBuf::from);
                let key = (folder.unwrap_or_default(), format);
                parts.entry(key).or_default().push(file);
            }
            None => {}
        }
    }
    let is_whole = |format: Format, group: &[TextFile]| match format {
        Format::Colmap => group.iter().any(|it| colmap::is_cameras(&it.text)),
        _ => true,
    };
    for ((_, format), group) in parts {
        // A file with several cameras is a calibration of its own; files with one camera each form one calibration.
        let (all, each): (Vec<TextFile>, Vec<TextFile>) = match format {
            Format::OpenCvYaml | Format::OpenCvJson => {
                group.into_iter().partition(|file| cameras_in(file) > 1)
            }
            _ => (Vec::new(), group),
        };
        found.extend(all.into_iter().map(|file| candidate(vec![file])));
        if !each.is_empty() && is_whole(format, &each) {
            found.push(candidate(each));
        }
    }
    found.sort_by(|a, b| {
        a.files
            .first()
            .map(|it| &it.path)
            .cmp(&b.files.first().map(|it| &it.path))
    });
    found
}

/// The role of a file in a calibration.
enum Part {
    /// The whole calibration.
    Whole,
    /// One of several files.
    Of(Format),
}

fn recognised(text: &str) -> Option<Part> {
    let text = text.trim_start_matches('\u{feff}').trim_start();
    if text.starts_with('<') {
        let is_one = text.contains("<calibration") || text.contains("<Cameras");
        return is_one.then_some(Part::Whole);
    }
    if text.starts_with('{') {
        let has = |names: &[&str]| names.iter().any(|it| text.contains(&format!("\"{it}\"")));
        return (has(&MATRIX) && has(&DISTORTION)).then_some(Part::Of(Format::OpenCvJson));
    }
    if colmap::is_cameras(text) || colmap::is_images(text) {
        return Some(Part::Of(Format::Colmap));
    }
    let starts = |prefix: &str| text.lines().any(|line| line.starts_with(prefix));
    let has_field = |names: &[&str], sign: char| {
        text.lines().any(|line| {
            let field = line.split_once(sign).map(|(field, _)| field.trim());
            field.is_some_and(|field| names.contains(&field))
        })
    };
    if has_field(&["matrix"], '=') && has_field(&["distortions"], '=') {
        return Some(Part::Whole);
    }
    if starts("cam0:") && text.contains("camera_model") {
        return Some(Part::Whole);
    }
    if starts("K_") || starts("Rot_") {
        return Some(Part::Of(Format::EasyMocap));
    }
    (has_field(&MATRIX, ':') && has_field(&DISTORTION, ':')).then_some(Part::Of(Format::OpenCvYaml))
}

fn cameras_in(file: &TextFile) -> usize {
    let read = import(std::slice::from_ref(file), &ImportOptions::default());
    read.map_or(0, |imported| imported.cameras.len())
}

fn candidate(files: Vec<TextFile>) -> Candidate {
    let read = import(&files, &ImportOptions::default()).and_then(|imported| {
        let is_placed = imported
            .cameras
            .iter()
            .any(|it| it.camera_from_world.is_some());
        let first = files.first().map(|it| it.path.clone()).unwrap_or_default();
        let problem = "it has lenses, but no poses of cameras";
        is_placed
            .then_some(imported)
            .ok_or_else(|| FileError::new(first, problem))
    });
    Candidate { files, read }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{file, ring};
    use super::super::{LensModel, export};
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn formats_are_recognised_under_any_name_and_other_files_are_not() {
        let cameras = ring(Vector3::z(), LensModel::ideal());
        for format in Format::ALL {
            let mut written = export(&cameras, format).unwrap();
            // COLMAP itself needs this file; it is empty.
            written.retain(|it| !it.path.ends_with("points3D.txt"));
            let count = written.len();
            let mut files: Vec<TextFile> = written
                .into_iter()
                .enumerate()
                .map(|(i, it)| file(&format!("a/whatever_{i}.dat"), it.text))
                .collect();
            assert!(
                files.iter().all(|it| may_be_calibration(&it.text)),
                "{format}"
            );
            files.push(file("a/Config.toml", "[project]\nframe_rate = 60\n"));
            files.push(file("a/frame.json", r#"{"version": 1.3, "people": []}"#));
            files.push(file("a/notes.txt", "matrix of what was filmed\n"));
            files.push(file(
                "a/venue.toml",
                "calibration = \"c.toml\"\n[field]\nmin_m = [0, 0, 0]\n",
            ));
            let found = candidates(files);
            let [only] = found.as_slice() else {
                panic!("{format}: {found:#?}")
            };
            assert_eq!(only.files.len(), count, "{format}");
            let read = only.read.as_ref().unwrap();
            assert_eq!(read.cameras.len(), cameras.len(), "{format}");
        }
    }

    #[test]
    fn broken_files_and_lenses_without_poses_are_returned_with_the_reason() {
        let cameras = ring(Vector3::z(), LensModel::ideal());
        let whole = export(&cameras, Format::Farfield).unwrap().remove(0).text;
        let cut = &whole[..whole.len() - 70];
        let lens = whole.replace("rotation", "#").replace("translation", "#");
        let found = candidates(vec![file("cut.toml", cut), file("lens.toml", lens)]);
        let reasons: Vec<String> = found
            .iter()
            .map(|it| it.read.as_ref().unwrap_err().to_string())
            .collect();
        assert!(reasons[0].starts_with("cut.toml:"), "{reasons:?}");
        assert!(reasons[1].contains("no poses of cameras"), "{reasons:?}");
    }
}
