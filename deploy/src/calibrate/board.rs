//! `farfield calibrate board`: how a camera sees, from pictures of a board.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use clap::Args;
use farfield_calibration::board::{
    BoardCalibration, BoardView, Charuco, Chessboard, Coefficients, DetectError, GrayPicture,
    calibrate, detect_charuco, detect_chessboard,
};
use farfield_calibration::formats::{CameraRecord, Format, export};
use farfield_node::process::{NodeError, say};
use image::GrayImage;
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::Serialize;

use super::board_video;
use super::convert::{format, size};
use super::{refuse_existing, write};
use crate::init::recordings::VIDEOS;
use crate::output;

/// Most pictures of one camera.
const MAX_PICTURES: usize = 2000;
/// What pictures are called.
const ENDINGS: [&str; 3] = ["jpg", "jpeg", "png"];

/// What `farfield calibrate board` is told.
#[derive(Debug, Args)]
pub(super) struct BoardArgs {
    /// Pictures of one camera (JPEG, PNG), videos, or folders of them.
    ///
    /// Of a video the sharpest picture of every third of a second is looked at; of those with a board at most forty are
    /// used, which differ the most.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// A chessboard, by inner corners: 4x7 has 5 x 8 squares.
    #[arg(long, value_name = "AxB", value_parser = size, required_unless_present = "charuco", conflicts_with = "charuco")]
    chessboard: Option<[u32; 2]>,
    /// A Charuco board, by its squares along a row and a column.
    #[arg(long, value_name = "AxB", value_parser = size, requires_all = ["marker_mm", "dictionary"])]
    charuco: Option<[u32; 2]>,
    /// Side of a square, millimetres.
    #[arg(long, value_name = "MM")]
    square_mm: f64,
    /// Side of a marker of the Charuco board, millimetres.
    #[arg(long, value_name = "MM")]
    marker_mm: Option<f64>,
    /// Dictionary of its markers, for example `DICT_4X4_50`.
    #[arg(long, value_name = "NAME")]
    dictionary: Option<String>,
    /// The camera's name in the file that is written.
    #[arg(long, value_name = "NAME")]
    camera: String,
    /// Numbers of the lens: 5, 8, or fisheye.
    #[arg(long, value_name = "5|8|fisheye", default_value = "5", value_parser = coefficients)]
    coefficients: Coefficients,
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
    /// Print what was found, or what went wrong, as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

fn coefficients(word: &str) -> Result<Coefficients, String> {
    match word {
        "5" => Ok(Coefficients::Five),
        "8" => Ok(Coefficients::Eight),
        "fisheye" => Ok(Coefficients::Fisheye),
        _ => Err(format!("`{word}` is not one of 5, 8, fisheye")),
    }
}

/// A board that is looked for.
enum Board {
    Chess(Chessboard),
    Charuco(Charuco),
}

/// A picture in which it was looked for.
struct LookedAt {
    name: String,
    size_px: [u32; 2],
    view: Result<BoardView, DetectError>,
}

/// What is printed as JSON.
#[derive(Debug, Serialize)]
struct Found<'a> {
    camera: &'a str,
    size_px: [u32; 2],
    rms_px: f64,
    corner_sigma_px: f64,
    parameters: Vec<Parameter>,
    pictures: Vec<Picture<'a>>,
    left_out: Vec<&'a (String, String)>,
    remarks: &'a [String],
    files: Vec<PathBuf>,
}

#[derive(Debug, Serialize)]
struct Parameter {
    name: &'static str,
    value: f64,
    sigma: f64,
}

#[derive(Debug, Serialize)]
struct Picture<'a> {
    name: &'a str,
    corners: usize,
    rms_px: f64,
    hurts: bool,
}

/// Looks for the board in every picture, fits the camera, and writes it.
///
/// # Errors
/// [`NodeError::Refused`] where pictures cannot be read or do not carry what is asked, [`NodeError::Failed`] where the disk
/// is in the way.
pub(super) fn from_board(args: &BoardArgs) -> Result<(), NodeError> {
    let found = found(args).map_err(NodeError::Refused)?;
    let record = CameraRecord {
        name: args.camera.clone(),
        size_px: found.size_px,
        intrinsics: found.intrinsics,
        lens: found.lens,
        camera_from_world: None,
    };
    let texts = export(&[record], args.to).map_err(NodeError::refused)?;
    let paths: Vec<PathBuf> = texts.iter().map(|file| args.out.join(&file.path)).collect();
    for path in &paths {
        refuse_existing(path, args.replace)?;
    }
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

fn found(args: &BoardArgs) -> anyhow::Result<BoardCalibration> {
    let board = board(args)?;
    let all = recorded(&args.pictures)?;
    let (videos, paths): (Vec<PathBuf>, Vec<PathBuf>) =
        all.into_iter().partition(|path| is_video(path));
    let looked: Vec<LookedAt> = paths
        .par_iter()
        .map(|path| look(path, &board))
        .collect::<anyhow::Result<_>>()?;
    let mut gathered = Gathered::default();
    for path in &videos {
        let filmed = board_video::look(path, |name, picture| detect(name, picture, &board))?;
        say(format_args!(
            "{}: of {} pictures {} were looked at, {} show the board, {} are used",
            path.display(),
            filmed.pictures,
            filmed.looked,
            filmed.shown,
            filmed.views.len()
        ));
        gathered.is_as_large(&path.display().to_string(), filmed.size_px)?;
        gathered.looked += filmed.looked;
        gathered.shown += filmed.shown;
        gathered.views.extend(filmed.views);
    }
    for it in looked {
        gathered.is_as_large(&it.name, it.size_px)?;
        gathered.looked += 1;
        match it.view {
            Ok(view) => {
                gathered.shown += 1;
                gathered.views.push(view);
            }
            Err(error @ (DetectError::Board(_) | DetectError::Bytes { .. })) => {
                return Err(anyhow!(error));
            }
            Err(error) => gathered.unseen.push((it.name, error.to_string())),
        }
    }
    let size_px = gathered.first.map_or([0, 0], |(_, size_px)| size_px);
    let calibrated = calibrate(size_px, &gathered.views, args.coefficients);
    let (shown, looked) = (gathered.shown, gathered.looked);
    let mut found = calibrated.map_err(|error| {
        anyhow!(
            "{error} (the board was found in {shown} of the {looked} pictures that were looked at)"
        )
    })?;
    found.left_out.extend(gathered.unseen);
    Ok(found)
}

/// What pictures and videos of one camera gave.
#[derive(Default)]
struct Gathered {
    /// The first of them, and how large its pictures are.
    first: Option<(String, [u32; 2])>,
    views: Vec<BoardView>,
    /// Pictures without a board, and why.
    unseen: Vec<(String, String)>,
    looked: usize,
    shown: usize,
}

impl Gathered {
    /// Refuses pictures that are not as large as those before.
    fn is_as_large(&mut self, name: &str, size_px: [u32; 2]) -> anyhow::Result<()> {
        let first = self.first.get_or_insert_with(|| (name.to_owned(), size_px));
        let ([w, h], [other_w, other_h]) = (first.1, size_px);
        let remedy = if [other_h, other_w] == [w, h] {
            "the camera was turned on its side: hold it as it will stand"
        } else {
            "one camera at a time, with the settings that it will have"
        };
        ensure!(
            first.1 == size_px,
            "{name}: found pictures of {other_w}x{other_h}, expected {w}x{h} as of {}: {remedy}",
            first.0
        );
        Ok(())
    }
}

fn board(args: &BoardArgs) -> anyhow::Result<Board> {
    let square_m = args.square_mm / 1000.0;
    match (
        args.chessboard,
        args.charuco,
        args.marker_mm,
        &args.dictionary,
    ) {
        (Some(corners), ..) => Ok(Board::Chess(Chessboard { corners, square_m })),
        (None, Some(squares), Some(marker_mm), Some(dictionary)) => Ok(Board::Charuco(Charuco {
            squares,
            square_m,
            marker_m: marker_mm / 1000.0,
            dictionary: dictionary.clone(),
        })),
        _ => Err(anyhow!(
            "expected --chessboard AxB, or --charuco AxB with --marker-mm and --dictionary"
        )),
    }
}

/// The pictures and videos that are meant, folders opened, in the order of their names.
fn recorded(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let mut all = Vec::new();
    for path in paths {
        if path.is_dir() {
            let mut inside = Vec::new();
            for entry in fs::read_dir(path).with_context(|| path.display().to_string())? {
                let entry = entry.with_context(|| path.display().to_string())?.path();
                if is_picture(&entry) || is_video(&entry) {
                    inside.push(entry);
                }
            }
            ensure!(
                !inside.is_empty(),
                "{}: found no picture in it, expected JPEG or PNG files, or videos",
                path.display()
            );
            inside.sort();
            all.extend(inside);
        } else {
            all.push(path.clone());
        }
        ensure!(
            all.len() <= MAX_PICTURES,
            "found more than {MAX_PICTURES} pictures: thirty that reach every corner are enough"
        );
    }
    Ok(all)
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().and_then(|it| it.to_str());
    ending.is_some_and(|it| ENDINGS.contains(&it.to_ascii_lowercase().as_str()))
}

fn is_video(path: &Path) -> bool {
    let ending = path.extension().and_then(|it| it.to_str());
    let is_one = |ending: &str| VIDEOS.contains(&ending.to_ascii_lowercase().as_str());
    ending.is_some_and(is_one)
}

fn look(path: &Path, board: &Board) -> anyhow::Result<LookedAt> {
    let name = path.display().to_string();
    let picture = image::open(path)
        .with_context(|| name.clone())?
        .into_luma8();
    let view = detect(&name, &picture, board);
    Ok(LookedAt {
        size_px: [picture.width(), picture.height()],
        name,
        view,
    })
}

fn detect(name: &str, picture: &GrayImage, board: &Board) -> Result<BoardView, DetectError> {
    let grey = GrayPicture {
        width: picture.width(),
        height: picture.height(),
        pixels: picture.as_raw(),
    };
    match board {
        Board::Chess(board) => detect_chessboard(name, &grey, board),
        Board::Charuco(board) => detect_charuco(name, &grey, board),
    }
}

/// The parameters with their standard deviations.
fn parameters(found: &BoardCalibration) -> Vec<Parameter> {
    let i = &found.intrinsics;
    let values = [i.fx_px, i.fy_px, i.cx_px, i.cy_px];
    let values = values.into_iter().chain(found.lens.coefficients());
    let named = found.parameters.iter().zip(values).zip(found.sigmas());
    named
        .map(|((name, value), sigma)| Parameter { name, value, sigma })
        .collect()
}

fn json(camera: &str, found: &BoardCalibration, files: Vec<PathBuf>) -> Result<String, NodeError> {
    let pictures = found.pictures.iter().map(|it| Picture {
        name: &it.name,
        corners: it.corners,
        rms_px: it.rms_px,
        hurts: it.hurts,
    });
    let document = Found {
        camera,
        size_px: found.size_px,
        rms_px: found.rms_px,
        corner_sigma_px: found.corner_sigma_px,
        parameters: parameters(found),
        pictures: pictures.collect(),
        left_out: found.left_out.iter().collect(),
        remarks: &found.remarks,
        files,
    };
    let text = serde_json::to_string_pretty(&document).map_err(NodeError::failed)?;
    Ok(text + "\n")
}

fn lines(camera: &str, found: &BoardCalibration, files: &[PathBuf]) -> String {
    let mut text = String::new();
    let [w, h] = found.size_px;
    // Writing to a string does not fail.
    writeln!(
        text,
        "camera {camera}, {w}x{h}: {:.3} px between drawn and seen corners, over {} pictures",
        found.rms_px,
        found.pictures.len()
    )
    .ok();
    for it in parameters(found) {
        let digits = if it.name.len() == 2 && !it.name.starts_with(['k', 'p']) {
            1
        } else {
            4
        };
        writeln!(
            text,
            "  {:<3} {:>11.digits$} +- {:.digits$}",
            it.name, it.value, it.sigma
        )
        .ok();
    }
    for picture in &found.pictures {
        let word = if picture.hurts {
            "  HURTS: look at it, or leave it out"
        } else {
            ""
        };
        writeln!(
            text,
            "  {:.3} px, {} corners  {}{word}",
            picture.rms_px, picture.corners, picture.name
        )
        .ok();
    }
    for (name, reason) in &found.left_out {
        writeln!(text, "  not used: {name}: {reason}").ok();
    }
    for remark in &found.remarks {
        writeln!(text, "{remark}").ok();
    }
    for path in files {
        writeln!(text, "{}", path.display()).ok();
    }
    text
}
