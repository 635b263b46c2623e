//! Detects recordings in a folder: videos, keypoint files, folders of numbered images; and the frame rate of videos.

use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail, ensure};
use farfield_node::process::say;
use farfield_proto::plain_text::one_line;

/// File name extensions of videos.
pub(crate) const VIDEOS: [&str; 10] = [
    "mp4", "mov", "mkv", "avi", "m4v", "webm", "mts", "m2ts", "mxf", "mpg",
];
/// File name extensions of images.
const IMAGES: [&str; 3] = ["png", "jpg", "jpeg"];
/// Remedy for a folder without recordings if no option names another one.
pub(crate) const OTHER_FOLDER: &str = "give the folder that contains them";
/// Limit for the files of a folder.
const MAX_ENTRIES: usize = 100_000;

/// Kind of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecordingKind {
    /// A video file.
    Video,
    /// Numbered images.
    Images,
    /// 2D keypoints, one line per tick.
    Keypoints,
}

/// The recording of one camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Recording {
    pub(crate) kind: RecordingKind,
    /// The file, or the file name pattern of the images.
    pub(crate) path: PathBuf,
    /// Name of the camera: the name of the file without its extension, or of the folder.
    pub(crate) name: String,
}

impl Recording {
    /// Name of the kind in a venue file.
    pub(crate) fn kind_name(&self) -> &'static str {
        match self.kind {
            RecordingKind::Video => "video",
            RecordingKind::Images => "images",
            RecordingKind::Keypoints => "keypoints",
        }
    }

    /// Whether it needs a network.
    pub(super) fn has_images(&self) -> bool {
        self.kind != RecordingKind::Keypoints
    }
}

/// The recordings in `videos`; without it, in `folder` or in its subfolder `videos`.
///
/// # Errors
/// A file or folder that cannot be read; no recordings, with the caller's `remedy`.
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
        "found no recordings in {}: expected videos ({}), folders of numbered images, or keypoint files (jsonl); \
         {remedy}",
        names.join(" or "),
        VIDEOS.join(", ")
    )
}

/// The files that contain a recording.
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

/// Refuses two recordings of one name: each would overwrite the output of the other.
///
/// # Errors
/// Names the two.
pub(crate) fn refuse_same_names(recordings: &[Recording]) -> anyhow::Result<()> {
    let mut named: BTreeMap<&str, &Recording> = BTreeMap::new();
    for recording in recordings {
        if let Some(first) = named.insert(&recording.name, recording) {
            bail!(
                "{} and {}: both belong to camera `{}`: remove or rename one of them",
                first.path.display(),
                recording.path.display(),
                recording.name
            );
        }
    }
    Ok(())
}

/// The entries of a folder, sorted by name.
pub(crate) fn entries(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let read = std::fs::read_dir(folder)
        .with_context(|| format!("reading the folder {}", folder.display()))?;
    let mut entries: Vec<PathBuf> = read.flatten().map(|entry| entry.path()).collect();
    entries.sort();
    ensure!(
        entries.len() < MAX_ENTRIES,
        "{}: found {} files in this folder, expected fewer than {MAX_ENTRIES}: convert so many images to a video, or move \
         other files away",
        folder.display(),
        entries.len()
    );
    Ok(entries)
}

/// Whether a file has the extension of a video.
pub(crate) fn is_video(path: &Path) -> bool {
    VIDEOS.contains(&ending(path).as_str())
}

/// Whether a file has the extension of an image.
pub(crate) fn is_image(path: &Path) -> bool {
    IMAGES.contains(&ending(path).as_str())
}

fn ending(path: &Path) -> String {
    path.extension()
        .unwrap_or_default()
        .to_string_lossy()
        .to_lowercase()
}

/// The recording at `path`, if it is one.
///
/// # Errors
/// When a folder cannot be read.
pub(crate) fn recording(path: &Path) -> anyhow::Result<Option<Recording>> {
    let name = path.file_name().and_then(|name| name.to_str());
    match name.filter(|name| !name.starts_with('.')) {
        Some(name) if path.is_dir() => images(path, name),
        Some(_) => Ok(file(path)),
        None => Ok(None),
    }
}

/// The folder at `path`, if it contains numbered images.
fn images(path: &Path, name: &str) -> anyhow::Result<Option<Recording>> {
    let files = match entries(path) {
        // Every disk has such folders of other users.
        Err(error) if is_denied(&error) => {
            say(format_args!("skipped: {error:#}"));
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
        // truth.jsonl and poses.jsonl are the truth and the results of simulated venues and data sets, not recordings.
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

/// The number pattern of the images among `files`; `None` if no two have one.
fn pattern(files: &[PathBuf]) -> Option<String> {
    let names = files.iter().filter(|path| is_image(path));
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

/// The rate of the first video; `None` without videos. Whether the others have the same is checked later.
///
/// # Errors
/// When ffprobe is missing, or the file is no video.
pub(crate) fn rate_of_videos(recordings: &[Recording]) -> anyhow::Result<Option<f64>> {
    let Some(video) = recordings.iter().find(|it| it.kind == RecordingKind::Video) else {
        return Ok(None);
    };
    let path = &video.path;
    let (rates, complaint) = probed_rates(path)?;
    match rates.lines().next().and_then(fraction) {
        Some(rate_hz) => Ok(Some(rate_hz)),
        None => bail!("{} has no frame rate: {complaint}", path.display()),
    }
}

/// Plausible rates of videos; others are clamped.
const RATES_HZ: [f64; 2] = [1.0, 240.0];
/// Rate of a video without one.
const USUAL_HZ: f64 = 30.0;

/// A rate for sampling the frames of a video whose container states `stated_hz`; it need not be exact.
pub(crate) fn rough_rate(stated_hz: Option<f64>) -> f64 {
    let [least, most] = RATES_HZ;
    stated_hz.unwrap_or(USUAL_HZ).clamp(least, most)
}

/// The rates of the first video stream by ffprobe, and its error output.
fn probed_rates(path: &Path) -> anyhow::Result<(String, String)> {
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-select_streams", "v:0", "-show_entries", "stream=avg_frame_rate", "-of", "csv=p=0"])
        .arg(input)
        .stdin(Stdio::null())
        .output()
        .context("starting `ffprobe`, to read the videos: install ffmpeg (`apt install ffmpeg`), or set `--rate HZ`")?;
    let rates = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok((
        rates,
        one_line(String::from_utf8_lossy(&output.stderr).trim()),
    ))
}

/// Parses a fraction such as `60000/1001`, above 0.
fn fraction(text: &str) -> Option<f64> {
    let (above, below) = text.trim().trim_end_matches(',').split_once('/')?;
    let value = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
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
        let error = refuse_same_names(&[mp4, mov]).unwrap_err().to_string();
        assert!(
            error.contains("north.mp4 and a/north.mov") && error.contains("`north`"),
            "{error}"
        );
    }

    #[test]
    fn videos_keypoints_and_image_folders_are_recordings() {
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
        let recordings: Vec<_> = found
            .iter()
            .map(|it| (it.name.as_str(), it.kind_name(), it.path.clone()))
            .collect();
        assert_eq!(
            recordings,
            [
                ("a", "video", at("a.MP4")),
                ("b", "keypoints", at("b.jsonl")),
                ("c", "images", at("c/%06d.png")),
                ("d", "images", at("d/f%d.jpg")),
            ]
        );
        let error = find(&at("empty"), None, OTHER_FOLDER).unwrap_err();
        assert!(error.to_string().ends_with(OTHER_FOLDER), "{error}");
    }

    #[test]
    fn rates_are_fractions() {
        assert!(fraction("60000/1001").is_some_and(|hz| (hz - 59.94).abs() < 1e-3));
        assert_eq!(fraction("0/0"), None);
        assert_eq!(fraction("x"), None);
    }
}
