//! `farfield calibrate board`: computes the lens of a camera from images of a board.

mod kind;
mod report;
mod scan;
mod stage;
mod video;

use std::path::PathBuf;

use clap::Args;
use farfield_calibration::board::BoardCalibration;
use farfield_calibration::formats::{CameraRecord, ExportError, Format, TextFile, export};
use farfield_node::process::NodeError;

use self::kind::BoardKindArgs;
use self::report::{json, lines};
use self::scan::{found, recorded};
use super::convert::format;
use super::lenses::Lens;
use super::{refuse_existing, write};
use crate::output;

pub(super) use self::stage::{BoardStage, BoardsArgs};
pub(super) use self::video::sharpness;

/// Arguments of `farfield calibrate board`.
#[derive(Debug, Args)]
pub(super) struct BoardArgs {
    /// Images of one camera (JPEG, PNG), videos, or folders of them.
    ///
    /// Of a video the sharpest image of every third of a second is scanned; of those with a board at most forty are
    /// used, which differ the most.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    #[command(flatten)]
    kind: BoardKindArgs,
    /// The camera's name in the output file.
    #[arg(long, value_name = "NAME")]
    camera: String,
    /// Folder for the file. Default: this one.
    #[arg(
        long,
        value_name = "DIR",
        default_value = ".",
        hide_default_value = true
    )]
    out: PathBuf,
    /// Output format: opencv-yaml or opencv-json.
    #[arg(long, hide_short_help = true, value_name = "FORMAT", default_value = "opencv-yaml", value_parser = format)]
    to: Format,
    /// Replace an existing file.
    #[arg(long)]
    replace: bool,
    /// Print the result or the error as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Detects the board in every image, fits the lens, and writes it.
///
/// # Errors
/// [`NodeError::Refused`] where images cannot be read or are unsuitable, [`NodeError::Failed`] for errors of the disk.
pub(super) fn from_board(args: &BoardArgs) -> Result<(), NodeError> {
    let board = args.kind.board().map_err(NodeError::Refused)?;
    // Before minutes of work: file names depend only on the camera.
    paths(args, &Lens::placeholder())?;
    let scan = || found(&board, recorded(&args.pictures)?, args.kind.coefficients);
    let found = scan().map_err(NodeError::Refused)?;
    let lens = lens_found(&found);
    let paths = paths(args, &lens)?;
    let texts = files(&args.camera, &lens, args.to).map_err(NodeError::refused)?;
    for (path, file) in paths.iter().zip(&texts) {
        write(path, &file.text)?;
    }
    let text = if args.json {
        json(&args.camera, &found, paths)?
    } else {
        lines(&args.camera, &found, &paths)
    };
    output::print(&text).map_err(NodeError::Failed)
}

fn lens_found(found: &BoardCalibration) -> Lens {
    Lens {
        size_px: found.size_px,
        intrinsics: found.intrinsics,
        model: found.lens,
    }
}

/// Paths of the files of `lens`; refused if a file exists.
fn paths(args: &BoardArgs, lens: &Lens) -> Result<Vec<PathBuf>, NodeError> {
    let texts = files(&args.camera, lens, args.to).map_err(NodeError::refused)?;
    let paths: Vec<PathBuf> = texts.iter().map(|file| args.out.join(&file.path)).collect();
    for path in &paths {
        refuse_existing(path, args.replace)?;
    }
    Ok(paths)
}

/// The files of the lens of `camera`.
fn files(camera: &str, lens: &Lens, format: Format) -> Result<Vec<TextFile>, ExportError> {
    let record = CameraRecord {
        name: camera.to_owned(),
        size_px: lens.size_px,
        intrinsics: lens.intrinsics,
        lens: lens.model,
        camera_from_world: None,
    };
    export(&[record], format)
}
