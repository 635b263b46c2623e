//! The sources of a camera's pictures.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::Deserialize;

use super::TickFrom;
use crate::patch::MAX_SIDE;
use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// Cells of the maps drawn from keypoints: width, height.
const DEFAULT_GRID: [u16; 2] = [48, 64];
/// Sigma of a drawn peak, cells.
const DEFAULT_SIGMA_CELLS: f64 = 2.0;

/// The source of a camera's pictures, or of data detected in them.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A video file.
    Video {
        /// The file.
        path: PathBuf,
    },
    /// Numbered pictures.
    Images {
        /// The files, with a number pattern such as `%06d`.
        path: PathBuf,
    },
    /// A file of 2D keypoint candidates from which maps are drawn.
    Keypoints {
        /// The file.
        path: PathBuf,
        /// Cells of a drawn map: width, height. Default 48 x 64.
        grid: [u16; 2],
        /// Sigma of a drawn peak, cells. Default 2.
        sigma_cells: f64,
    },
    /// A camera of this machine.
    V4l {
        /// Its device file.
        device: PathBuf,
        /// Its settings before the first picture.
        settings: DeviceSettings,
    },
    /// Anything that ffmpeg opens.
    Ffmpeg {
        /// Its address.
        url: String,
        /// Options for reading it, by ffmpeg's names: `rtsp_transport`, `hwaccel`.
        options: BTreeMap<String, String>,
    },
    /// Precomputed maps of a simulated camera.
    Maps {
        /// The file.
        path: PathBuf,
        /// Cells of a map: width, height. Default 48 x 64.
        grid: [u16; 2],
        /// Sigma of a peak, cells. Default 2.
        sigma_cells: f64,
    },
    /// A camera of a simulated scene; the camera has the same name there.
    Simulated {
        /// The scene file.
        path: PathBuf,
        /// Whether pictures are rendered or maps are made from the truth.
        content: SimulatedContent,
        /// Cells of a map: width, height. Default 48 x 64. Unused for pictures.
        grid: [u16; 2],
        /// Sigma of a peak, cells. Default 2. Unused for pictures.
        sigma_cells: f64,
    },
}

/// Settings of a camera of this machine; its size is the calibration's, its rate the venue's.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct DeviceSettings {
    /// The four letters of the pixel format, as in the kernel; `None`: the best with this size and
    /// rate.
    pub format: Option<String>,
    /// Exposure, gain and other controls, by the names of `v4l2-ctl --list-ctrls`.
    pub controls: BTreeMap<String, ControlValue>,
}

/// The value of a camera's control.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ControlValue {
    /// On or off.
    Switch(bool),
    /// In the camera's own unit.
    Number(i64),
    /// An entry of a menu, by the camera's name.
    Choice(String),
}

/// The output of a simulated camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimulatedContent {
    /// Rendered pictures for a network.
    Pixels,
    /// Maps made from the truth with the scene's faults, without a network.
    Maps,
}

impl SimulatedContent {
    /// The name in a venue file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pixels => "pixels",
            Self::Maps => "maps",
        }
    }
}

impl Source {
    /// Whether the camera gives pictures, which need a network.
    pub fn gives_pictures(&self) -> bool {
        match self {
            Self::Keypoints { .. } | Self::Maps { .. } => false,
            Self::Simulated { content, .. } => *content == SimulatedContent::Pixels,
            Self::Video { .. } | Self::Images { .. } | Self::V4l { .. } | Self::Ffmpeg { .. } => {
                true
            }
        }
    }

    /// Whether it shows the present, not a recording or a simulation.
    pub fn is_live(&self) -> bool {
        matches!(self, Self::V4l { .. } | Self::Ffmpeg { .. })
    }

    /// Grid (width, height) and sigma of maps made without a network, in cells; `None` for
    /// pictures.
    pub fn drawing(&self) -> Option<([u16; 2], f64)> {
        match self {
            Self::Keypoints {
                grid, sigma_cells, ..
            }
            | Self::Maps {
                grid, sigma_cells, ..
            }
            | Self::Simulated {
                content: SimulatedContent::Maps,
                grid,
                sigma_cells,
                ..
            } => Some((*grid, *sigma_cells)),
            _ => None,
        }
    }
}

/// A source as parsed: the fields of all kinds, so that a wrong one can be named.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RawSource {
    kind: String,
    path: Option<String>,
    device: Option<String>,
    format: Option<String>,
    controls: Option<BTreeMap<String, toml::Value>>,
    url: Option<String>,
    options: Option<BTreeMap<String, String>>,
    grid: Option<[u16; 2]>,
    sigma_cells: Option<f64>,
    content: Option<String>,
}

const KINDS: [&str; 7] = [
    "video",
    "images",
    "keypoints",
    "v4l",
    "ffmpeg",
    "simulated",
    "maps",
];
/// The allowed options of ffmpeg for reading a stream or device.
const STREAM_OPTIONS: [&str; 20] = [
    "analyzeduration",
    "buffer_size",
    "f",
    "fflags",
    "flags",
    "framerate",
    "hwaccel",
    "hwaccel_device",
    "input_format",
    "max_delay",
    "pixel_format",
    "probesize",
    "reorder_queue_size",
    "rtsp_flags",
    "rtsp_transport",
    "threads",
    "timeout",
    "tls_verify",
    "vcodec",
    "video_size",
];
const CONTENTS: [SimulatedContent; 2] = [SimulatedContent::Pixels, SimulatedContent::Maps];

/// The fields of a source of `kind`; `None` for an unknown kind.
fn fields_of(kind: &str) -> Option<&'static [&'static str]> {
    Some(match kind {
        "video" | "images" => &["path"],
        "keypoints" | "maps" => &["path", "grid", "sigma_cells"],
        "v4l" => &["device", "format", "controls"],
        "ffmpeg" => &["url", "options"],
        "simulated" => &["path", "content", "grid", "sigma_cells"],
        _ => return None,
    })
}

/// Longest delay from a frame's capture to its arrival in a venue file, milliseconds.
const MAX_CAPTURE_DELAY_MS: f64 = 10_000.0;

/// The source of tick numbers, and the capture delay, seconds, of the camera at `place`.
pub(super) fn timing(
    file: &TomlFile<'_>,
    place: &Place,
    source: &Source,
    tick_from: Option<String>,
    delay_ms: Option<f64>,
) -> Result<(TickFrom, Option<f64>), FileError> {
    const ALL: [TickFrom; 3] = [TickFrom::Clock, TickFrom::Count, TickFrom::Timecode];
    let wrong = |field: &str, problem: String| file.error(&place.key(field), problem);
    let tick_from = tick_from.map_or(Ok(TickFrom::Clock), |name| {
        let found = ALL.into_iter().find(|known| known.name() == name);
        found.ok_or_else(|| {
            let problem = unknown_name("tick source", &name, &ALL.map(TickFrom::name));
            wrong("tick_from", problem)
        })
    })?;
    let fits = match tick_from {
        TickFrom::Clock => true,
        TickFrom::Count => source.is_live(),
        TickFrom::Timecode => matches!(source, Source::Video { .. }),
    };
    if !fits {
        let kinds = match tick_from {
            TickFrom::Timecode => "\"video\"",
            _ => "\"v4l\" or \"ffmpeg\"",
        };
        let problem = format!(
            "found \"{}\", which only sources of kind {kinds} have",
            tick_from.name()
        );
        return Err(wrong("tick_from", problem));
    }
    if let Some(delay_ms) = delay_ms.filter(|ms| !(0.0..=MAX_CAPTURE_DELAY_MS).contains(ms)) {
        let problem =
            format!("found {delay_ms:?}, expected milliseconds from 0 to {MAX_CAPTURE_DELAY_MS}");
        return Err(wrong("capture_delay_ms", problem));
    }
    Ok((tick_from, delay_ms.map(|ms| ms / 1000.0)))
}

/// Checks the source at `place`.
pub(super) fn source(
    file: &TomlFile<'_>,
    place: &Place,
    raw: RawSource,
) -> Result<Source, FileError> {
    let RawSource {
        kind,
        path,
        device,
        format,
        controls,
        url,
        options,
        grid,
        sigma_cells,
        content,
    } = raw;
    let given = [
        ("path", path.is_some()),
        ("device", device.is_some()),
        ("format", format.is_some()),
        ("controls", controls.is_some()),
        ("url", url.is_some()),
        ("options", options.is_some()),
        ("grid", grid.is_some()),
        ("sigma_cells", sigma_cells.is_some()),
        ("content", content.is_some()),
    ];
    check_fields(file, place, &kind, &given)?;
    let needed = |field: &str, value: Option<String>| match value {
        Some(text) if !text.is_empty() => Ok(text),
        Some(_) => Err(file.error(&place.key(field), "found \"\", expected a name")),
        None => Err(file.error(
            &place.key(field),
            format!("the field is missing in a source of kind \"{kind}\""),
        )),
    };
    match kind.as_str() {
        "video" => Ok(Source::Video {
            path: file.resolve(&needed("path", path)?),
        }),
        "images" => Ok(Source::Images {
            path: file.resolve(&needed("path", path)?),
        }),
        "v4l" => Ok(Source::V4l {
            device: file.resolve(&needed("device", device)?),
            settings: DeviceSettings {
                format,
                controls: self::controls(
                    file,
                    &place.key("controls"),
                    controls.unwrap_or_default(),
                )?,
            },
        }),
        "ffmpeg" => Ok(Source::Ffmpeg {
            url: needed("url", url)?,
            options: self::options(file, &place.key("options"), options.unwrap_or_default())?,
        }),
        "simulated" => {
            let path = file.resolve(&needed("path", path)?);
            let name = needed("content", content)?;
            let content = self::content(file, &place.key("content"), &name)?;
            let (grid, sigma_cells) = drawing(file, place, grid, sigma_cells)?;
            Ok(Source::Simulated {
                path,
                content,
                grid,
                sigma_cells,
            })
        }
        _ => {
            let path = file.resolve(&needed("path", path)?);
            let (grid, sigma_cells) = drawing(file, place, grid, sigma_cells)?;
            Ok(drawn(&kind, path, grid, sigma_cells))
        }
    }
}

/// Refuses an unknown kind, and a field that `kind` does not have.
fn check_fields(
    file: &TomlFile<'_>,
    place: &Place,
    kind: &str,
    given: &[(&str, bool)],
) -> Result<(), FileError> {
    let allowed = fields_of(kind).ok_or_else(|| {
        let problem = unknown_name("kind", kind, &KINDS);
        file.error(&place.key("kind"), problem)
    })?;
    if let Some((field, _)) = given
        .iter()
        .find(|(field, is_given)| *is_given && !allowed.contains(field))
    {
        let problem = format!(
            "a source of kind \"{kind}\" has no such field, expected `{}`",
            allowed.join("`, `")
        );
        return Err(file.error(&place.key(field), problem));
    }
    Ok(())
}

/// Options for reading a stream. ffmpeg has others that write files.
fn options(
    file: &TomlFile<'_>,
    place: &Place,
    given: BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>, FileError> {
    match given
        .keys()
        .find(|name| !STREAM_OPTIONS.contains(&name.as_str()))
    {
        Some(name) => Err(file.error(
            &place.key(name),
            unknown_name("option", name, &STREAM_OPTIONS),
        )),
        None => Ok(given),
    }
}

/// Values of a camera's controls; only the camera knows which exist.
fn controls(
    file: &TomlFile<'_>,
    place: &Place,
    given: BTreeMap<String, toml::Value>,
) -> Result<BTreeMap<String, ControlValue>, FileError> {
    let checked = |(name, value): (String, toml::Value)| {
        let value = match value {
            toml::Value::Boolean(on) => ControlValue::Switch(on),
            toml::Value::Integer(number) => ControlValue::Number(number),
            toml::Value::String(choice) => ControlValue::Choice(choice),
            other => {
                let problem =
                    format!("found {other}, expected true, false, a whole number or a text");
                return Err(file.error(&place.key(&name), problem));
            }
        };
        Ok((name, value))
    };
    given.into_iter().map(checked).collect()
}

/// A source of maps from a file, without a network.
fn drawn(kind: &str, path: PathBuf, grid: [u16; 2], sigma_cells: f64) -> Source {
    if kind == "maps" {
        Source::Maps {
            path,
            grid,
            sigma_cells,
        }
    } else {
        Source::Keypoints {
            path,
            grid,
            sigma_cells,
        }
    }
}

fn content(file: &TomlFile<'_>, place: &Place, name: &str) -> Result<SimulatedContent, FileError> {
    CONTENTS
        .into_iter()
        .find(|content| content.name() == name)
        .ok_or_else(|| {
            let known = CONTENTS.map(SimulatedContent::name);
            file.error(place, unknown_name("content", name, &known))
        })
}

/// Grid and sigma of maps made without a network.
fn drawing(
    file: &TomlFile<'_>,
    place: &Place,
    grid: Option<[u16; 2]>,
    sigma_cells: Option<f64>,
) -> Result<([u16; 2], f64), FileError> {
    let grid = grid.unwrap_or(DEFAULT_GRID);
    let sigma_cells = sigma_cells.unwrap_or(DEFAULT_SIGMA_CELLS);
    if grid
        .iter()
        .any(|&side| !(1..=MAX_SIDE).contains(&usize::from(side)))
    {
        let problem = format!("found {grid:?}, expected [width, height] of 1 to {MAX_SIDE} cells");
        return Err(file.error(&place.key("grid"), problem));
    }
    if !(0.3..=32.0).contains(&sigma_cells) {
        let problem = format!("found {sigma_cells}, expected a number from 0.3 to 32");
        return Err(file.error(&place.key("sigma_cells"), problem));
    }
    Ok((grid, sigma_cells))
}
