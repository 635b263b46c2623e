//! What of a folder is a recording: videos, keypoint files, folders of numbered pictures.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use farfield_node::process::say;

/// What videos' names end in.
pub(crate) const VIDEOS: [&str; 10] = [
    "mp4", "mov", "mkv", "avi", "m4v", "webm", "mts", "m2ts", "mxf", "mpg",
];
/// What pictures' names end in.
const PICTURES: [&str; 3] = ["png", "jpg", "jpeg"];
/// What helps where no recordings are in a folder that alone says where they are.
pub(crate) const OTHER_FOLDER: &str = "give the folder that they are in";
/// So much is looked at in a folder.
const MAX_ENTRIES: usize = 100_000;

/// What a recording is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecordingKind {
    /// A video file.
    Video,
    /// Numbered pictures.
    Images,
    /// 2D keypoints, one line per tick.
    Keypoints,
}

/// One camera's recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Recording {
    /// What it is.
    pub(crate) kind: RecordingKind,
    /// The file, or the pattern of the pictures' names.
    pub(crate) path: PathBuf,
    /// What names the camera: the file's name without its ending, or the folder's.
    pub(crate) name: String,
}

impl Recording {
    /// As it is written in a venue file.
    pub(crate) fn kind_name(&self) -> &'static str {
        match self.kind {
            RecordingKind::Video => "video",
            RecordingKind::Images => "images",
            RecordingKind::Keypoints => "keypoints",
        }
    }

    /// Whether a network has to look at it.
    pub(super) fn gives_pictures(&self) -> bool {
        self.kind != RecordingKind::Keypoints
    }
}

/// The recordings in `videos`; if that is not said, in `folder`, or in `videos` in it.
///
/// # Errors
/// What cannot be read; where there are none, with the caller's `remedy`.
pub(crate) fn find(
    folder: &Path,
    videos: Option<&Path>,
    remedy: &str,
) -> anyhow::Result<Vec<Recording>> {
    let places = match videos {
        Some(videos) => vec![videos.to_owned()],
        None => vec![folder.to_owned(), folder.join("videos")],
    };
    for place in places.iter().filter(|it| videos.is_some() || it.is_dir()) {
        let mut found = Vec::new();
        for path in entries(place)? {
            found.extend(recording(&path)?);
        }
        if !found.is_empty() {
            return Ok(found);
        }
    }
    let names: Vec<String> = places.iter().map(|it| it.display().to_string()).collect();
    anyhow::bail!(
        "no recordings are in {}: expected videos ({}), folders of numbered pictures, or keypoint files (jsonl); \
         {remedy}",
        names.join(" or "),
        VIDEOS.join(", ")
    )
}

/// Every byte of a recording is in these files.
///
/// # Errors
/// When its folder cannot be read.
pub(crate) fn files_of(recording: &Recording) -> anyhow::Result<Vec<PathBuf>> {
    if recording.kind != RecordingKind::Images {
        return Ok(vec![recording.path.clone()]);
    }
    let folder = recording.path.parent().unwrap_or(Path::new("."));
    let files = entries(folder)?.into_iter();
    Ok(files.filter(|path| path.is_file()).collect())
}

/// Refuses two recordings of one name: each would write the file of the other.
///
/// # Errors
/// The two.
pub(crate) fn refuse_same_names(recordings: &[Recording]) -> anyhow::Result<()> {
    let mut named: BTreeMap<&str, &Recording> = BTreeMap::new();
    for recording in recordings {
        if let Some(first) = named.insert(&recording.name, recording) {
            bail!(
                "{} and {}: both are of camera `{}`: leave one in the folder, or give it another name",
                first.path.display(),
                recording.path.display(),
                recording.name
            );
        }
    }
    Ok(())
}

/// What is in a folder, by name.
pub(crate) fn entries(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let read = std::fs::read_dir(folder)
        .with_context(|| format!("reading the folder {}", folder.display()))?;
    let mut entries: Vec<PathBuf> = read.flatten().map(|entry| entry.path()).collect();
    entries.sort();
    ensure!(
        entries.len() < MAX_ENTRIES,
        "{}: found {} files in this folder, expected fewer than {MAX_ENTRIES}: make a video of so many pictures, or move \
         away what is no recording",
        folder.display(),
        entries.len()
    );
    Ok(entries)
}

/// Whether a file is called as videos are.
pub(crate) fn is_video(path: &Path) -> bool {
    VIDEOS.contains(&ending(path).as_str())
}

/// Whether a file is called as pictures are.
pub(crate) fn is_picture(path: &Path) -> bool {
    PICTURES.contains(&ending(path).as_str())
}

fn ending(path: &Path) -> String {
    path.extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase()
}

/// What is at `path`, if it is a recording.
///
/// # Errors
/// When a folder cannot be read.
pub(crate) fn recording(path: &Path) -> anyhow::Result<Option<Recording>> {
    let name = path.file_name().and_then(|name| name.to_str());
    match name.filter(|name| !name.starts_with('.')) {
        Some(name) if path.is_dir() => pictures(path, name),
        Some(_) => Ok(file(path)),
        None => Ok(None),
    }
}

/// The folder at `path`, if it has numbered pictures.
fn pictures(path: &Path, name: &str) -> anyhow::Result<Option<Recording>> {
    let files = match entries(path) {
        // Every disk has such folders, of others.
        Err(error) if is_denied(&error) => {
            say(format_args!("passed over: {error:#}"));
            return Ok(None);
        }
        files => files?,
    };
    Ok(pattern(&files).map(|pattern| Recording {
        kind: RecordingKind::Images,
        path: path.join(pattern),
        name: name.to_owned(),
    }))
}

fn is_denied(error: &anyhow::Error) -> bool {
    let error = error.downcast_ref::<io::Error>();
    error.is_some_and(|error| error.kind() == ErrorKind::PermissionDenied)
}

fn file(path: &Path) -> Option<Recording> {
    let name = path.file_stem()?.to_str()?.to_owned();
    let kind = if is_video(path) {
        RecordingKind::Video
    } else if ending(path) == "jsonl" && name != "truth" && name != "poses" {
        // What simulated venues and data sets call what is to be found.
        RecordingKind::Keypoints
    } else {
        return None;
    };
    Some(Recording {
        kind,
        path: path.to_owned(),
        name,
    })
}

/// The number pattern of the pictures among `files`; `None` where no two have one.
fn pattern(files: &[PathBuf]) -> Option<String> {
    let names = files.iter().filter(|path| is_picture(path));
    let names: Vec<&str> = names
        .filter_map(|path| path.file_name()?.to_str())
        .collect();
    let [first, .., last] = names[..] else {
        return None;
    };
    let (stem, ending) = first.rsplit_once('.')?;
    let prefix = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    let digits = stem.len() - prefix.len();
    if digits == 0 || prefix.contains('%') {
        return None;
    }
    let fixed = last.len() == first.len();
    let number = if fixed && digits > 1 {
        format!("%0{digits}d")
    } else {
        "%d".to_owned()
    };
    Some(format!("{prefix}{number}.{ending}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_recordings_of_one_camera_are_refused() {
        let recording = |path: &str, name: &str| Recording {
            kind: RecordingKind::Video,
            path: path.into(),
            name: name.to_owned(),
        };
        let [mp4, mov] = [
            recording("a/north.mp4", "north"),
            recording("a/north.mov", "north"),
        ];
        let south = recording("a/south.mp4", "south");
        assert!(refuse_same_names(&[mp4.clone(), south]).is_ok());
        let said = refuse_same_names(&[mp4, mov]).unwrap_err().to_string();
        assert!(
            said.contains("north.mp4 and a/north.mov") && said.contains("`north`"),
            "{said}"
        );
    }

    #[test]
    fn videos_keypoints_and_folders_of_pictures_are_recordings_and_others_are_not() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        for name in [
            "a.MP4",
            "b.jsonl",
            "truth.jsonl",
            "notes.txt",
            ".hidden.mp4",
        ] {
            std::fs::write(at(name), "").unwrap();
        }
        for name in [
            "c/000001.png",
            "c/000002.png",
            "d/f1.jpg",
            "d/f10.jpg",
            "empty/readme.md",
        ] {
            std::fs::create_dir_all(at(name).parent().unwrap()).unwrap();
            std::fs::write(at(name), "").unwrap();
        }
        let found = find(folder.path(), None, OTHER_FOLDER).unwrap();
        let said: Vec<_> = found
            .iter()
            .map(|it| (it.name.as_str(), it.kind_name(), it.path.clone()))
            .collect();
        assert_eq!(
            said,
            [
                ("a", "video", at("a.MP4")),
                ("b", "keypoints", at("b.jsonl")),
                ("c", "images", at("c/%06d.png")),
                ("d", "images", at("d/f%d.jpg")),
            ]
        );
        let said = find(&at("empty"), None, OTHER_FOLDER).unwrap_err();
        assert!(
            said.to_string()
                .ends_with("give the folder that they are in"),
            "{said}"
        );
    }
}
