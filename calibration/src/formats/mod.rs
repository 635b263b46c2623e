//! Calibrations of other tools, read and written: `farfield calibrate convert`.
//!
//! [`import`] reads the files of one calibration and recognises their format. [`export`] writes cameras in another format.
//! In between every camera is a [`CameraRecord`]: metres, a right-handed world, pixels from the centre of the first one,
//! OpenCV's axes. Facts that a file lacks or has in another unit are reported as [`Remark`]s. Certain facts are corrected;
//! the caller can state the others in [`ImportOptions`]. [`losses`] reports facts that the output format cannot store.

mod axes;
mod camera;
mod colmap;
mod compare;
mod easymocap;
mod kalibr;
mod losses;
mod opencv;
mod qualisys;
mod recognise;
mod toml_tables;
mod tree;
mod vicon;
mod xml;

use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

use farfield_proto::calibration::FORMATS_READ;
use farfield_proto::toml_file::FileError;
use nalgebra::Isometry3;

pub use self::axes::{CameraAxes, Origin, PoseMeaning, WorldAxis};
pub use self::camera::{CameraRecord, LensModel, Remark, RemarkKind};
pub use self::compare::difference;
pub use self::losses::losses;
pub use self::recognise::{Candidate, candidates, may_be_calibration};
use self::tree::{Node, Source};

/// Longest text that is read, bytes: no calibration has a hundredth of it.
const MAX_TEXT_BYTES: usize = 32 << 20;
/// Most cameras of one calibration.
const MAX_CAMERAS: usize = 4096;

/// The format of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// TOML with one table per camera, metres: ours, aniposelib's, Pose2Sim's.
    Farfield,
    /// The same in millimetres, as `FreeMoCap` writes it.
    FreeMoCap,
    /// Caliscope's `camera_array.toml`.
    Caliscope,
    /// YAML of `cv::FileStorage`, or ROS, one file a camera.
    OpenCvYaml,
    /// JSON of `cv::FileStorage`, one file a camera.
    OpenCvJson,
    /// Qualisys' `.qca.txt`.
    Qualisys,
    /// Theia's calibration file.
    Theia,
    /// `EasyMocap`'s `intri.yml` and `extri.yml`.
    EasyMocap,
    /// Vicon's `.xcp`.
    Vicon,
    /// COLMAP's `cameras.txt` and `images.txt`.
    Colmap,
    /// Kalibr's `camchain.yaml`.
    Kalibr,
}

impl Format {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Farfield,
        Self::FreeMoCap,
        Self::Caliscope,
        Self::OpenCvYaml,
        Self::OpenCvJson,
        Self::Qualisys,
        Self::Theia,
        Self::EasyMocap,
        Self::Vicon,
        Self::Colmap,
        Self::Kalibr,
    ];

    /// As the command line has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Farfield => "farfield",
            Self::FreeMoCap => "freemocap",
            Self::Caliscope => "caliscope",
            Self::OpenCvYaml => "opencv-yaml",
            Self::OpenCvJson => "opencv-json",
            Self::Qualisys => "qualisys",
            Self::Theia => "theia",
            Self::EasyMocap => "easymocap",
            Self::Vicon => "vicon",
            Self::Colmap => "colmap",
            Self::Kalibr => "kalibr",
        }
    }

    /// The format with this name; `aniposelib`, `anipose` and `pose2sim` also mean [`Format::Farfield`].
    pub fn from_name(name: &str) -> Option<Self> {
        if matches!(name, "aniposelib" | "anipose" | "pose2sim") {
            return Some(Self::Farfield);
        }
        Self::ALL.into_iter().find(|format| format.name() == name)
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A file and its name: one that the caller has read, or one to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextFile {
    /// Its name; for a file to write, without a folder.
    pub path: PathBuf,
    /// The whole content.
    pub text: String,
}

/// Facts that the caller states because the file lacks them or has them wrong. By default the file is trusted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ImportOptions {
    /// The format; `None`: recognised by content.
    pub format: Option<Format>,
    /// Metres in one unit of length of the file; `None`: derived from format and numbers.
    pub metres_per_unit: Option<f64>,
    /// The axis of the file's world that points up; it becomes z. `None`: the world is not rotated.
    pub up: Option<WorldAxis>,
    /// The point of the file's world that becomes the origin; `None`: the origin does not move.
    pub origin: Option<Origin>,
    /// The axis of a left-handed world that is reversed.
    pub mirrored: Option<WorldAxis>,
    /// The direction of the poses in the file.
    pub pose: PoseMeaning,
    /// The axes of the cameras in the file.
    pub camera_axes: CameraAxes,
    /// Whether four distortion coefficients belong to a fisheye lens if the file does not state the model.
    pub four_are_fisheye: bool,
    /// Width and height of videos that are cropped to the middle of the sensor (Vicon), pixels.
    pub video_px: Option<[u32; 2]>,
    /// Whether only lenses are read: poses and remarks about them are left out.
    pub only_lenses: bool,
}

/// The result of [`import`].
#[derive(Debug, Clone, PartialEq)]
pub struct Imported {
    /// The format of the files.
    pub format: Format,
    /// The cameras in the order of the files; at least one, all names different.
    pub cameras: Vec<CameraRecord>,
    /// The point of the file's world that is the origin of these cameras, metres; `None`: the file's own origin.
    pub origin_m: Option<[f64; 3]>,
    /// Facts that were assumed or corrected, and warnings.
    pub remarks: Vec<Remark>,
}

/// Reads the files of one calibration.
///
/// # Errors
/// [`FileError`] with file, line and field: an unknown format, wrong syntax, a missing or unusable field, a mirrored world
/// without the option that states the axis, no camera, two cameras of one name.
pub fn import(files: &[TextFile], options: &ImportOptions) -> Result<Imported, FileError> {
    let sources: Vec<Source<'_>> = files
        .iter()
        .map(|file| Source {
            path: &file.path,
            text: &file.text,
        })
        .collect();
    let Some(first) = sources.first() else {
        return Err(FileError::new("", "no file was given"));
    };
    if let Some(long) = sources
        .iter()
        .find(|source| source.text.len() > MAX_TEXT_BYTES)
    {
        return Err(long.error(format!(
            "found {} bytes, expected a calibration of at most {MAX_TEXT_BYTES}",
            long.text.len()
        )));
    }
    if let Some(metres) = options
        .metres_per_unit
        .filter(|m| !(m.is_finite() && *m > 0.0))
    {
        return Err(first.error(format!(
            "{metres} metres per unit: expected a number above 0"
        )));
    }
    let format = match options.format {
        Some(format) => format,
        None => guess(&sources)?,
    };
    if let (true, Some(second)) = (is_one_file(format), sources.get(1)) {
        return Err(second.error(format!(
            "the format `{format}` is one file, and {} were given",
            sources.len()
        )));
    }
    let raw = match format {
        Format::Farfield | Format::FreeMoCap | Format::Caliscope => {
            toml_tables::read(first, format, options)
        }
        Format::OpenCvYaml | Format::OpenCvJson => opencv::read(&sources, options),
        Format::Qualisys | Format::Theia => qualisys::read(first, format),
        Format::EasyMocap => easymocap::read(&sources, options),
        Format::Vicon => vicon::read(first, options),
        Format::Colmap => read_colmap(&sources),
        Format::Kalibr => kalibr::read(first),
    }?;
    if raw.cameras.is_empty() {
        return Err(first.error(format!(
            "no camera was found, expected a calibration of the format `{format}` (the calibration of a venue is the file that \
             its field `calibration` names)"
        )));
    }
    if raw.cameras.len() > MAX_CAMERAS {
        return Err(first.error(format!(
            "found {} cameras, expected at most {MAX_CAMERAS}",
            raw.cameras.len()
        )));
    }
    let mut names = BTreeSet::new();
    if let Some(twice) = raw
        .cameras
        .iter()
        .find(|camera| !names.insert(&camera.name))
    {
        return Err(first.error(format!("two cameras are called `{}`", twice.name)));
    }
    let settled = axes::settle(raw, options, first)?;
    Ok(Imported {
        format,
        cameras: settled.cameras,
        origin_m: settled.origin_m,
        remarks: settled.remarks,
    })
}

fn is_one_file(format: Format) -> bool {
    !matches!(
        format,
        Format::OpenCvYaml | Format::OpenCvJson | Format::EasyMocap | Format::Colmap
    )
}

fn read_colmap(sources: &[Source<'_>]) -> Result<camera::RawSet, FileError> {
    let cameras = sources
        .iter()
        .find(|source| colmap::is_cameras(source.text));
    let images = sources.iter().find(|source| colmap::is_images(source.text));
    match (cameras, images, sources) {
        (Some(cameras), images, _) => colmap::read(cameras, images),
        (None, _, [first, ..]) => {
            Err(first.error("found no `cameras.txt` (CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS)"))
        }
        (None, _, []) => Err(FileError::new("", "no file was given")),
    }
}

/// Recognises the format by content.
///
/// # Errors
/// [`FileError`] for the first file if its format is unknown.
fn guess(sources: &[Source<'_>]) -> Result<Format, FileError> {
    let Some(first) = sources.first() else {
        return Err(FileError::new("", "no file was given"));
    };
    let text = first.text.trim_start_matches('\u{feff}').trim_start();
    if text.starts_with('<') {
        let found =
            qualisys::guess(first).or_else(|| text.contains("<Cameras").then_some(Format::Vicon));
        return match found {
            Some(format) => Ok(format),
            // Broken XML is reported with its line, other XML as an unknown format.
            None => Err(xml::parse(first).err().unwrap_or_else(|| {
                first.error(
                    "found XML, expected <calibration> of Qualisys or Theia, or <Cameras> of Vicon",
                )
            })),
        };
    }
    if text.starts_with('{') {
        return Ok(Format::OpenCvJson);
    }
    if sources.iter().any(|source| colmap::is_cameras(source.text)) {
        return Ok(Format::Colmap);
    }
    if let Ok(value) = toml_tables::value(first) {
        let caliscope = toml_tables::is_caliscope(&Node::root(*first, &value));
        return Ok(if caliscope {
            Format::Caliscope
        } else {
            Format::Farfield
        });
    }
    if text
        .lines()
        .any(|line| line.trim_start().starts_with("cam0:"))
        && text.contains("camera_model")
    {
        return Ok(Format::Kalibr);
    }
    let starts = |prefix: &str| {
        sources
            .iter()
            .any(|s| s.text.lines().any(|line| line.starts_with(prefix)))
    };
    if starts("K_") && (starts("dist_") || starts("D_")) {
        return Ok(Format::EasyMocap);
    }
    if text.starts_with("%YAML") || opencv::value(first).is_ok_and(|value| value.is_object()) {
        return Ok(Format::OpenCvYaml);
    }
    Err(first.error(format!(
        "its content is of no known format, expected one of {FORMATS_READ}; if it is one of these, name the format to see its syntax error"
    )))
}

/// The reason why cameras cannot be written in a format.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ExportError {
    /// A camera has no pose, and the format needs one.
    #[error(
        "camera `{camera}` has no pose, and the format `{format}` needs one: only opencv-yaml and opencv-json do without"
    )]
    NoPose {
        /// The camera.
        camera: String,
        /// The format.
        format: Format,
    },
    /// The format does not support the lens.
    #[error("camera `{camera}`: the format `{format}` cannot store its lens; it has {has}")]
    Lens {
        /// The camera.
        camera: String,
        /// The format.
        format: Format,
        /// The lens that the format supports.
        has: &'static str,
    },
    /// Two cameras would be written to one file.
    #[error(
        "two cameras would both be written to `{}`, expected names that differ in letters or digits other than in case", path.display()
    )]
    SameFile {
        /// The file.
        path: PathBuf,
    },
    /// The format does not support the name.
    #[error("camera `{camera}`: the format `{format}` cannot have this name, expected {expected}")]
    Name {
        /// The camera.
        camera: String,
        /// The format.
        format: Format,
        /// The names that the format supports.
        expected: &'static str,
    },
    /// There is nothing to write.
    #[error("no camera was given")]
    NoCamera,
}

/// The files of `cameras` in `format`.
///
/// Kalibr uses the first camera as the world, COLMAP has no unit of length, Caliscope and Kalibr number the cameras: see
/// [`losses`].
///
/// # Errors
/// [`ExportError`] for a camera without a pose, or with a lens or a name that the format does not support.
pub fn export(cameras: &[CameraRecord], format: Format) -> Result<Vec<TextFile>, ExportError> {
    if cameras.is_empty() {
        return Err(ExportError::NoCamera);
    }
    let one = |path: &str, text: String| {
        vec![TextFile {
            path: path.into(),
            text,
        }]
    };
    let files: Vec<TextFile> = match format {
        Format::Farfield | Format::FreeMoCap => {
            one("calibration.toml", toml_tables::write(cameras, format)?)
        }
        Format::Caliscope => one("camera_array.toml", toml_tables::write(cameras, format)?),
        Format::OpenCvYaml | Format::OpenCvJson => cameras
            .iter()
            .map(|camera| opencv::write(camera, format))
            .collect(),
        Format::Qualisys => one("calibration.qca.txt", qualisys::write(cameras, format)?),
        Format::Theia => one("calibration.txt", qualisys::write(cameras, format)?),
        Format::EasyMocap => easymocap::write(cameras)?,
        Format::Vicon => one("calibration.xcp", vicon::write(cameras)?),
        Format::Colmap => colmap::write(cameras)?,
        Format::Kalibr => one("camchain.yaml", kalibr::write(cameras)?),
    };
    // Some file systems ignore case.
    let mut seen = BTreeSet::new();
    for file in &files {
        if !seen.insert(file.path.to_string_lossy().to_lowercase()) {
            let path = file.path.clone();
            return Err(ExportError::SameFile { path });
        }
    }
    Ok(files)
}

/// The pose of `camera`, which `format` needs.
fn placed(camera: &CameraRecord, format: Format) -> Result<Isometry3<f64>, ExportError> {
    camera.camera_from_world.ok_or_else(|| ExportError::NoPose {
        camera: camera.name.clone(),
        format,
    })
}

/// A file name that cannot lead out of a folder.
fn file_name(camera: &str, extension: &str) -> PathBuf {
    let safe = |c: char| {
        if c.is_alphanumeric() || "-_ ".contains(c) {
            c
        } else {
            '_'
        }
    };
    let stem: String = camera.chars().map(safe).collect();
    PathBuf::from(format!("{stem}.{extension}"))
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod traps;
