//! `farfield calibrate`: computes lenses and camera poses, from images of a board, from a point carried through the
//! field, or from walking people; converts calibrations of other programs; and lets people click marks in images.

mod all;
mod ball;
mod board;
mod cached;
mod convert;
mod filmed_people;
mod known;
mod lenses;
mod marks;
mod metres;
mod people;
mod points;
mod recorded;
mod recorded_people;
mod results;
mod seen;
mod sheet;
mod thin_files;

pub(crate) use self::convert::{remark_line, venue_calibration};

use std::fs;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context as _, anyhow};
use clap::{Arg, Args, Subcommand};
use farfield_calibration::formats::TextFile;
use farfield_fusion::export::unfinished::write_whole_again;
use farfield_node::process::{EXIT_FAILED, ErrorFormat, NodeError, exit_code_with_format};
use farfield_proto::calibration::text_of;

/// Largest text file to read, bytes.
const MAX_TEXT_BYTES: u64 = 64 << 20;

/// Arguments of `farfield calibrate`.
#[derive(Debug, Args)]
pub(crate) struct CalibrateArgs {
    #[command(subcommand)]
    command: CalibrateCommand,
}

/// Ways to a calibration.
#[derive(Debug, Subcommand)]
enum CalibrateCommand {
    /// Compute camera poses from recordings of a ball and of boards, in one step.
    #[command(
        after_help = "Example: farfield calibrate all recordings/ --lens lenses.toml --distance north,south=24.1",
        mut_args(|it| only_long(it, &["by", "colour", "clocks", "rate_hz", "free", "charuco", "marker_mm", "dictionary", "coefficients"]))
    )]
    All(all::AllArgs),
    /// Compute the lens of a camera from images of a chessboard or a Charuco board.
    #[command(
        after_help = "Example: farfield calibrate board pictures/ --chessboard 4x7 --square-mm 60 --camera cam01"
    )]
    Board(board::BoardArgs),
    /// Find a ball, a light or a drone in recordings: the input of `points`.
    #[command(
        after_help = "Example: farfield calibrate ball recordings/ --lens lenses.toml --colour '#f08020'"
    )]
    Ball(ball::BallArgs),
    /// Compute camera poses from a ball, a light or a drone in their images.
    #[command(
        after_help = "Example: farfield calibrate points seen/*.txt --lens lenses.toml --distance north,south=24.1"
    )]
    Points(points::PointsArgs),
    /// Compute camera poses from people who walk in the field.
    #[command(
        after_help = "Example: farfield calibrate people keypoints/*.jsonl --rate-hz 50 --lens lenses.toml --distance north,south=24.1",
        mut_args(|it| only_long(it, &["clocks"]))
    )]
    People(people::PeopleArgs),
    /// Click corners, posts and lines in an image of each camera, in a browser: the input of `--marks`.
    #[command(
        after_help = "Example: farfield calibrate marks pictures/*.png --court futsal --lens lenses.toml --out clicked.toml"
    )]
    Marks(marks::MarksArgs),
    /// Convert calibrations of other programs to Farfield's format and back.
    #[command(after_help = "Example: farfield calibrate convert hall.qca.txt --out calibration")]
    Convert(convert::ConvertArgs),
}

/// Shows `names` only in the long help, so that the short help fits a terminal.
fn only_long(arg: Arg, names: &[&str]) -> Arg {
    let is_hidden = names.contains(&arg.get_id().as_str());
    if is_hidden {
        arg.hide_short_help(true)
    } else {
        arg
    }
}

/// Quality of a new calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Judged {
    /// A run can use it, as far as known.
    Passes,
    /// It is written, with its problems reported.
    Fails,
}

impl CalibrateArgs {
    fn is_json(&self) -> bool {
        match &self.command {
            CalibrateCommand::All(args) => args.output.json,
            CalibrateCommand::Ball(args) => args.json,
            CalibrateCommand::Board(args) => args.json,
            CalibrateCommand::Points(args) => args.output.json,
            CalibrateCommand::People(args) => args.output.json,
            CalibrateCommand::Convert(args) => args.json,
            CalibrateCommand::Marks(_) => false,
        }
    }
}

/// Computes the requested calibration. Exit code 1 if it does not pass, 2 if the input does not determine one.
pub(crate) fn main(args: &CalibrateArgs) -> ExitCode {
    let made = match &args.command {
        CalibrateCommand::All(args) => all::from_recordings(args),
        CalibrateCommand::Ball(args) => ball::from_ball(args).map(|()| Judged::Passes),
        CalibrateCommand::Board(args) => board::from_board(args).map(|()| Judged::Passes),
        CalibrateCommand::Points(args) => points::from_points(args),
        CalibrateCommand::People(args) => people::from_people(args),
        CalibrateCommand::Marks(args) => marks::click_marks(args).map(|()| Judged::Passes),
        CalibrateCommand::Convert(args) => convert::convert(args).map(|()| Judged::Passes),
    };
    match made {
        Ok(Judged::Passes) => ExitCode::SUCCESS,
        Ok(Judged::Fails) => ExitCode::from(EXIT_FAILED),
        Err(error) => exit_code_with_format(Err(error), ErrorFormat::as_json_if(args.is_json())),
    }
}

/// Reads a text file of a limited size.
fn read(path: &Path) -> anyhow::Result<TextFile> {
    let text = String::from_utf8(read_bytes(path)?);
    let text = text.map_err(|_| anyhow!("{}: found bytes that are not text", path.display()))?;
    Ok(TextFile {
        path: path.to_owned(),
        text,
    })
}

/// The same for a file that the user gives as a calibration.
pub(crate) fn read_calibration(path: &Path) -> anyhow::Result<TextFile> {
    Ok(TextFile {
        path: path.to_owned(),
        text: text_of(read_bytes(path)?, path)?,
    })
}

fn read_bytes(path: &Path) -> anyhow::Result<Vec<u8>> {
    let named = || path.display().to_string();
    let length = fs::metadata(path).with_context(named)?.len();
    if length > MAX_TEXT_BYTES {
        return Err(anyhow!(
            "{}: found {length} bytes, expected at most {MAX_TEXT_BYTES}",
            named()
        ));
    }
    fs::read(path).with_context(named)
}

/// Refuses to overwrite an existing file.
fn refuse_existing(path: &Path, replace: bool) -> Result<(), NodeError> {
    if !replace && path.exists() {
        let problem = anyhow!("{} already exists: --replace replaces it", path.display());
        return Err(NodeError::Refused(problem));
    }
    Ok(())
}

/// Writes a text file whole or not at all, and creates its folder. Left-overs of a killed command are no obstacle.
fn write(path: &Path, text: &str) -> Result<(), NodeError> {
    let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
    let made = folder.map_or(Ok(()), fs::create_dir_all);
    let written = made.and_then(|()| write_whole_again(path, text.as_bytes()));
    let written = written.with_context(|| format!("writing {}", path.display()));
    written.map_err(NodeError::Failed)
}

/// Parses `NAME=VALUE`.
fn named<T: std::str::FromStr>(word: &str, expected: &str) -> Result<(String, T), String> {
    let found = word.split_once('=').and_then(|(name, value)| {
        let value = value.trim().parse().ok()?;
        (!name.trim().is_empty()).then(|| (name.trim().to_owned(), value))
    });
    found.ok_or_else(|| format!("found `{word}`, expected {expected}"))
}
