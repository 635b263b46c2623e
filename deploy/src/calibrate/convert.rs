//! `farfield calibrate convert`: converts calibrations of other programs.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use clap::Args;
use farfield_calibration::formats::{
    CameraAxes, CameraRecord, Format, ImportOptions, Imported, Origin, PoseMeaning, Remark,
    TextFile, WorldAxis, export, import, losses,
};
use farfield_node::process::NodeError;
use farfield_proto::calibration::Calibration;
use farfield_proto::toml_file::unknown_name;
use serde::Serialize;

use super::{named, read_calibration, refuse_existing, write};
use crate::exchange::target::check_folder;
use crate::output;

/// Arguments of `farfield calibrate convert`.
#[derive(Debug, Args)]
pub(super) struct ConvertArgs {
    /// The files of one calibration; some formats have one per camera.
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Folder for the new files.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Target format, e.g. qualisys.
    ///
    /// farfield (also for aniposelib and Pose2Sim), freemocap, caliscope, opencv-yaml, opencv-json, qualisys, theia,
    /// easymocap, vicon, colmap, kalibr.
    #[arg(long, value_name = "FORMAT", default_value = "farfield", value_parser = format)]
    to: Format,
    /// Source format. Default: detected by content.
    #[arg(long, value_name = "FORMAT", value_parser = format)]
    from: Option<Format>,
    /// Metres per unit. Default: by the numbers.
    ///
    /// Length of a unit in metres; detected from format and numbers by default.
    #[arg(long, value_name = "M")]
    metres_per_unit: Option<f64>,
    /// Axis that points up: x, -x, y, -y, z, -z.
    ///
    /// It becomes z.
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    up: Option<WorldAxis>,
    /// Point of the file's world that becomes the origin: X,Y,Z, or auto.
    ///
    /// Metres, z up: it is subtracted from the camera positions, and written as `origin_m` into `[metadata]`. Surveyed
    /// coordinates need it; auto takes a round point on the floor between the cameras.
    #[arg(long, value_name = "X,Y,Z", value_parser = origin, allow_hyphen_values = true)]
    origin: Option<Origin>,
    /// Turn a camera clockwise by 90, 180 or -90 degrees, with its images: `cam1=-90`.
    ///
    /// Turn the images with ffmpeg: `-vf transpose=1` for 90, `transpose=2` for -90, `hflip,vflip` for 180.
    #[arg(long, value_name = "CAMERA=DEGREES", value_parser = turn)]
    turn: Vec<(String, u32)>,
    /// Axis of a left-handed world to reverse.
    #[arg(long, value_name = "AXIS", value_parser = axis, allow_hyphen_values = true)]
    mirrored: Option<WorldAxis>,
    /// Direction of poses: as-format, or inverse, camera to world where the format has world to camera.
    #[arg(long, hide_short_help = true, value_name = "WAY", default_value = "as-format", value_parser = poses)]
    poses: PoseMeaning,
    /// Axes of the cameras: opencv, or opengl, along -z with y up, as in Blender.
    #[arg(long, hide_short_help = true, value_name = "AXES", default_value = "opencv", value_parser = camera_axes)]
    camera_axes: CameraAxes,
    /// Distortions of four numbers are a fisheye's if the file does not define them.
    #[arg(long, hide_short_help = true)]
    four_are_fisheye: bool,
    /// Size of the videos if they show the middle of the sensor: `1280x720`.
    #[arg(long, hide_short_help = true, value_name = "WxH", value_parser = size_px)]
    video_px: Option<[u32; 2]>,
    /// Replace existing files.
    #[arg(long)]
    replace: bool,
    /// Print the result or the error as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Parses the name of a format.
pub(super) fn format(word: &str) -> Result<Format, String> {
    Format::from_name(word).ok_or_else(|| {
        let names: Vec<&str> = Format::ALL.iter().map(|format| format.name()).collect();
        format!("`{word}` is not one of {}", names.join(", "))
    })
}

fn axis(word: &str) -> Result<WorldAxis, String> {
    let named = WorldAxis::from_name(word.trim_start_matches('+'));
    named.ok_or_else(|| format!("`{word}` is not one of x, -x, y, -y, z, -z"))
}

/// Parses `500000,5000000,120`, or `auto`.
fn origin(word: &str) -> Result<Origin, String> {
    if word == "auto" {
        return Ok(Origin::Auto);
    }
    let numbers: Result<Vec<f64>, _> = word.split(',').map(|it| it.trim().parse()).collect();
    let point = numbers.ok().and_then(|it| <[f64; 3]>::try_from(it).ok());
    let point = point.filter(|it| it.iter().all(|v| v.is_finite()));
    point.map(Origin::At).ok_or_else(|| {
        format!("found `{word}`, expected three numbers, for example 500000,5000000,120, or auto")
    })
}

/// Parses `cam1=-90`: the camera, and its clockwise quarter turns.
fn turn(word: &str) -> Result<(String, u32), String> {
    let (camera, degrees): (String, i32) = named(word, "CAMERA=DEGREES, for example cam1=-90")?;
    match degrees {
        90 => Ok((camera, 1)),
        180 | -180 => Ok((camera, 2)),
        -90 | 270 => Ok((camera, 3)),
        _ => Err(format!(
            "`{word}`: found {degrees} degrees, expected 90, 180 or -90"
        )),
    }
}

fn poses(word: &str) -> Result<PoseMeaning, String> {
    match word {
        "as-format" => Ok(PoseMeaning::AsFormat),
        "inverse" => Ok(PoseMeaning::Inverse),
        _ => Err(format!("`{word}` is not one of as-format, inverse")),
    }
}

fn camera_axes(word: &str) -> Result<CameraAxes, String> {
    match word {
        "opencv" => Ok(CameraAxes::OpenCv),
        "opengl" => Ok(CameraAxes::OpenGl),
        _ => Err(format!("`{word}` is not one of opencv, opengl")),
    }
}

/// Parses `1280x720`.
fn size_px(word: &str) -> Result<[u32; 2], String> {
    two_sides(word, "1280x720")
}

/// Parses `4x7`.
pub(super) fn size(word: &str) -> Result<[u32; 2], String> {
    two_sides(word, "4x7")
}

fn two_sides(word: &str, example: &str) -> Result<[u32; 2], String> {
    let sides = word.split_once('x');
    let sides = sides.and_then(|(a, b)| Some([a.parse().ok()?, b.parse().ok()?]));
    sides
        .filter(|sides: &[u32; 2]| !sides.contains(&0))
        .ok_or_else(|| {
            format!("found `{word}`, expected two numbers above 0, for example {example}")
        })
}

/// The JSON output.
#[derive(Debug, Serialize)]
struct Converted<'a> {
    from: &'static str,
    to: &'static str,
    cameras: Vec<&'a str>,
    origin_m: Option<[f64; 3]>,
    remarks: &'a [Remark],
    files: Vec<PathBuf>,
}

/// Converts a calibration, and prints assumptions and losses.
///
/// # Errors
/// [`NodeError::Refused`] if files cannot be read or exist, [`NodeError::Failed`] for errors of the disk.
pub(super) fn convert(args: &ConvertArgs) -> Result<(), NodeError> {
    check_folder("--out", &args.out).map_err(NodeError::Refused)?;
    let files: Vec<TextFile> = args
        .files
        .iter()
        .map(|path| read_calibration(path))
        .collect::<Result<_, _>>()
        .map_err(NodeError::Refused)?;
    let mut imported = import(&files, &options(args)).map_err(NodeError::refused)?;
    for (name, quarters) in &args.turn {
        turn_camera(&mut imported.cameras, name, *quarters).map_err(NodeError::Refused)?;
    }
    let texts = export(&imported.cameras, args.to).map_err(NodeError::refused)?;
    let lost = losses(&imported.cameras, args.to);
    imported.remarks.extend(lost);
    let texts: Vec<TextFile> = texts
        .into_iter()
        .map(|file| TextFile {
            path: args.out.join(&file.path),
            text: match args.to {
                Format::Farfield => with_origin(file.text, &imported),
                _ => file.text,
            },
        })
        .collect();
    for file in &texts {
        refuse_existing(&file.path, args.replace)?;
    }
    if args.to == Format::Farfield {
        for file in &texts {
            usable(&file.text, &file.path).map_err(NodeError::Refused)?;
        }
    }
    for file in &texts {
        write(&file.path, &file.text)?;
    }
    let result = if args.json {
        json(&imported, args.to, &texts)?
    } else {
        lines(&imported, &texts)
    };
    output::print(&result).map_err(NodeError::Failed)
}

/// The text of a venue's calibration at `path` with the cameras of `imported`, and its content.
///
/// # Errors
/// A camera has no pose, or no run can use the calibration.
pub(crate) fn venue_calibration(
    imported: &Imported,
    path: &Path,
) -> anyhow::Result<(String, Calibration)> {
    let files = export(&imported.cameras, Format::Farfield)?;
    let text: String = files.into_iter().map(|file| file.text).collect();
    let text = with_origin(text, imported);
    let calibration = usable(&text, path)?;
    Ok((text, calibration))
}

/// `text` with the origin of its world, if that is not the original one.
fn with_origin(text: String, imported: &Imported) -> String {
    match imported.origin_m {
        // The file ends with the table `[metadata]`.
        Some(origin_m) => format!("{text}origin_m = {origin_m:?}\n"),
        None => text,
    }
}

fn usable(text: &str, path: &Path) -> anyhow::Result<Calibration> {
    Calibration::parse(text, path).map_err(|error| anyhow!("no run can use it: {error}"))
}

fn turn_camera(cameras: &mut [CameraRecord], name: &str, quarters: u32) -> anyhow::Result<()> {
    let known: Vec<String> = cameras.iter().map(|it| it.name.clone()).collect();
    let Some(camera) = cameras.iter_mut().find(|it| it.name == name) else {
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        bail!(
            "--turn: {}",
            unknown_name("camera of the calibration", name, &known)
        );
    };
    *camera = camera.turned(quarters);
    Ok(())
}

fn options(args: &ConvertArgs) -> ImportOptions {
    ImportOptions {
        format: args.from,
        metres_per_unit: args.metres_per_unit,
        up: args.up,
        origin: args.origin,
        mirrored: args.mirrored,
        pose: args.poses,
        camera_axes: args.camera_axes,
        four_are_fisheye: args.four_are_fisheye,
        video_px: args.video_px,
        only_lenses: false,
    }
}

/// A remark as a line for the operator.
pub(crate) fn remark_line(remark: &Remark) -> String {
    let camera = remark.camera.as_deref();
    let camera = camera.map_or_else(String::new, |camera| format!("camera {camera}: "));
    format!("{}: {camera}{}", remark.kind.name(), remark.text)
}

fn json(imported: &Imported, to: Format, texts: &[TextFile]) -> Result<String, NodeError> {
    let converted = Converted {
        from: imported.format.name(),
        to: to.name(),
        cameras: imported.cameras.iter().map(|it| it.name.as_str()).collect(),
        origin_m: imported.origin_m,
        remarks: &imported.remarks,
        files: texts.iter().map(|file| file.path.clone()).collect(),
    };
    let text = serde_json::to_string_pretty(&converted).map_err(NodeError::failed)?;
    Ok(text + "\n")
}

fn lines(imported: &Imported, texts: &[TextFile]) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    writeln!(
        text,
        "{} cameras of a calibration of the format {}",
        imported.cameras.len(),
        imported.format
    )
    .ok();
    for remark in &imported.remarks {
        writeln!(text, "{}", remark_line(remark)).ok();
    }
    for file in texts {
        writeln!(text, "{}", file.path.display()).ok();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_axes_and_sizes_are_parsed_or_refused() {
        assert_eq!(format("pose2sim"), Ok(Format::Farfield));
        assert!(format("blender").unwrap_err().contains("qualisys"));
        assert_eq!(axis("-y"), Ok(WorldAxis::MinusY));
        assert!(axis("up").unwrap_err().contains("-z"));
        assert_eq!(size("4x7"), Ok([4, 7]));
        for word in ["4", "4x", "0x7", "4x-7"] {
            assert!(size(word).is_err(), "{word}");
        }
    }
}
