//! `farfield calibrate board`: how a camera sees, from pictures of a board.

mod kind;
mod look;
mod stage;
mod told;
mod video;

use std::path::PathBuf;

use clap::Args;
use farfield_calibration::board::BoardCalibration;
use farfield_calibration::formats::{CameraRecord, ExportError, Format, TextFile, export};
use farfield_node::process::NodeError;

use self::kind::BoardKindArgs;
use self::look::{found, recorded};
use self::told::{json, lines};
use super::convert::format;
use super::lenses::Lens;
use super::{refuse_existing, write};
use crate::output;

pub(super) use self::stage::{BoardStage, BoardsArgs};
pub(super) use self::video::sharpness;

/// What `farfield calibrate board` is told.
#[derive(Debug, Args)]
pub(super) struct BoardArgs {
    /// Pictures of one camera (JPEG, PNG), videos, or folders of them.
    ///
    /// Of a video the sharpest picture of every third of a second is looked at; of those with a board at most forty are
    /// used, which differ the most.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    #[command(flatten)]
    kind: BoardKindArgs,
    /// The camera's name in the file that is written.
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
    /// How it is written: opencv-yaml or opencv-json.
    #[arg(long, hide_short_help = true, value_name = "FORMAT", default_value = "opencv-yaml", value_parser = format)]
    to: Format,
    /// Replace a file that is there already.
    #[arg(long)]
    replace: bool,
    /// Print what was found or went wrong as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Looks for the board in every picture, fits the camera, and writes it.
///
/// # Errors
/// [`NodeError::Refused`] where pictures cannot be read or do not carry what is asked, [`NodeError::Failed`] where the disk
/// is in the way.
pub(super) fn from_board(args: &BoardArgs) -> Result<(), NodeError> {
    let board = args.kind.board().map_err(NodeError::Refused)?;
    // Before looks of minutes: files are called after the camera, whatever its lens.
    paths(args, &Lens::of_nobody())?;
    let look = || found(&board, recorded(&args.pictures)?, args.kind.coefficients);
    let found = look().map_err(NodeError::Refused)?;
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

/// The lens that boards told.
fn lens_found(found: &BoardCalibration) -> Lens {
    Lens {
        size_px: found.size_px,
        intrinsics: found.intrinsics,
        model: found.lens,
    }
}

/// Where the files of `lens` go; refused where something is in their place.
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
