//! `farfield init`: writes the venue file of a folder of recordings and a calibration.
//!
//! Find (calibration, recordings) -> match names -> rate, viewpoints, field -> write a new file -> check. On a terminal
//! it asks for missing options; otherwise it refuses and names the option.

mod calibration;
pub(crate) mod recordings;
mod seen_field;
mod venue_text;
mod viewpoints;

use std::fs::{self, File};
use std::io::{self, IsTerminal as _, Write as _, stderr, stdin};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, anyhow, bail, ensure};
use clap::Args;
use farfield_networks::known::Task;
use farfield_node::log::start_log;
use farfield_node::process::{ErrorFormat, NodeError, exit_code_with_format, say};
use farfield_proto::calibration::Calibration;
use farfield_proto::model_card::{DetectorCard, HeatmapCard, unread_card};
use farfield_proto::venue::Venue;

use crate::check_venue::check;
use crate::exchange::target::check_file;
use crate::networks::{INSTALL, card_path, installed_for};
use crate::output;
use crate::report_lines::{ReportForm, ReportLines, Verdict};

use self::calibration::VenueCalibration;
use self::recordings::Recording;
use self::venue_text::VenueDraft;
use self::viewpoints::ViewpointArg;

/// Arguments of `farfield init`.
#[derive(Debug, Args)]
pub(crate) struct InitArgs {
    /// The folder of the recordings.
    ///
    /// Videos, folders of numbered images, or keypoint files, named after the cameras.
    pub(crate) folder: PathBuf,
    /// The calibration file.
    ///
    /// Any that `farfield calibrate convert` reads from one file. Default: the one in the folder.
    #[arg(long, value_name = "FILE")]
    pub(crate) calibration: Option<PathBuf>,
    /// Folder of the recordings.
    ///
    /// Default: the folder itself, or `videos` in it.
    #[arg(long, value_name = "DIR")]
    pub(crate) videos: Option<PathBuf>,
    /// Frames per second.
    ///
    /// Default: the rate of the videos.
    #[arg(long, value_name = "HZ")]
    pub(crate) rate: Option<f64>,
    /// Card of the keypoint network, or its name.
    ///
    /// Required for images. Default: an installed one (`farfield networks list`).
    #[arg(long, value_name = "CARD")]
    pub(crate) network: Option<PathBuf>,
    /// Card of the detector, or its name.
    ///
    /// It detects people in images. Default: an installed one.
    #[arg(long, value_name = "CARD")]
    pub(crate) detector: Option<PathBuf>,
    /// Cameras at one place.
    ///
    /// Only the listed cameras are used. Default: all, each a viewpoint.
    #[arg(long, value_name = "NAME=CAM1,CAM2")]
    pub(crate) viewpoint: Vec<ViewpointArg>,
    /// Area in which people are tracked, metres.
    ///
    /// Default: the area that two viewpoints see.
    #[arg(long, value_name = "X0,Y0,X1,Y1", allow_hyphen_values = true, value_parser = seen_field::parse)]
    pub(crate) field: Option<[f64; 4]>,
    /// Refuse pictures that differ by padding.
    ///
    /// Without it, pictures a few pixels larger or smaller than the calibration says are taken as padded or cut at the
    /// right and lower edge.
    #[arg(long, hide_short_help = true)]
    pub(crate) exact_sizes: bool,
    /// The venue file to write.
    ///
    /// Default: `venue.toml` in the folder.
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Print the checks as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Writes a venue file, checks it, and prints the next command.
pub(crate) fn main(args: &InitArgs) -> ExitCode {
    start_log();
    init(args).unwrap_or_else(|error| {
        exit_code_with_format(Err(error), ErrorFormat::as_json_if(args.json))
    })
}

fn init(args: &InitArgs) -> Result<ExitCode, NodeError> {
    let out = args
        .out
        .clone()
        .unwrap_or_else(|| args.folder.join("venue.toml"));
    let (text, calibration) = draft(args, &out).map_err(NodeError::Refused)?;
    let mut report = ReportLines::default();
    if let Some(text) = &calibration.text {
        write_new(&calibration.path, |file| write_all(file, text)).map_err(NodeError::Failed)?;
        report.ok("written", calibration.path.display().to_string());
    }
    let written = write_new(&out, |file| write_all(file, &text));
    if written.is_err() && calibration.text.is_some() {
        // It would refuse the next try.
        drop(fs::remove_file(&calibration.path));
    }
    written.map_err(NodeError::Failed)?;
    report.ok("written", out.display().to_string());
    check(&out, None, &mut report)?;
    let form = ReportForm::from_flag(args.json);
    let code = report.print(form).map_err(NodeError::Failed)?;
    if form == ReportForm::Text {
        let next = match report.verdict() {
            Verdict::Failed => {
                format!("fix what failed, then: farfield check {}\n", out.display())
            }
            _ => format!("next: farfield run {} --overlay\n", out.display()),
        };
        output::print(&next).map_err(NodeError::Failed)?;
    }
    Ok(code)
}

/// The text of the venue file that will be `out`, and its calibration.
fn draft(args: &InitArgs, out: &Path) -> anyhow::Result<(String, VenueCalibration)> {
    ensure!(
        !out.exists(),
        "{} already exists, and is not overwritten: choose another file with `--out FILE`",
        out.display()
    );
    ensure!(
        args.folder.is_dir(),
        "{}: expected a folder",
        args.folder.display()
    );
    check_file("--out", out)?;
    let folder = out.parent().filter(|it| !it.as_os_str().is_empty());
    ensure!(
        folder.is_none_or(Path::is_dir),
        "--out {}: its folder does not exist",
        out.display()
    );
    let calibration = VenueCalibration::find(args, out)?;
    let recordings = recordings::find(
        &args.folder,
        args.videos.as_deref(),
        "set their folder with `--videos DIR`",
    )?;
    let viewpoints = viewpoints::choose(&args.viewpoint, &calibration.calibration)?;
    let cameras: Vec<&str> = viewpoints
        .iter()
        .flat_map(|it| &it.cameras)
        .map(String::as_str)
        .collect();
    let matched = viewpoints::matched(&cameras, &recordings, args.viewpoint.is_empty())?;
    let rate_hz = rate_hz(args, &recordings)?;
    let needs_network = recordings.iter().any(Recording::has_images);
    let network = network(args, needs_network)?;
    if let Some(path) = network.as_deref().map(card_path) {
        HeatmapCard::parse(&card(&path)?, &path)?;
    }
    let detector = detector(args, needs_network)?;
    if let Some(path) = detector.as_deref().map(card_path) {
        DetectorCard::parse(&card(&path)?, &path)?;
    }
    let mut draft = VenueDraft {
        out,
        name: venue_text::name_of(&args.folder),
        rate_hz,
        calibration: &calibration.path,
        network: network.as_deref(),
        detector: detector.as_deref(),
        field: args.field,
        viewpoints: &viewpoints,
        matched: &matched,
    };
    // First without a field: the venue is needed to read pictures, and to compute the area that cameras see.
    let venue = parsed(&draft.to_toml(), out, &calibration.calibration)?;
    let resized = if args.exact_sizes {
        None
    } else {
        calibration.of_pictures(&venue, out)?
    };
    if let Some(resized) = &resized {
        draft.calibration = &resized.path;
    }
    let used = resized.as_ref().unwrap_or(&calibration);
    if draft.field.is_none() {
        let venue = parsed(&draft.to_toml(), out, &used.calibration)?;
        draft.field = seen_field::seen(&venue);
    }
    let text = draft.to_toml();
    parsed(&text, out, &used.calibration)?;
    Ok((text, resized.unwrap_or(calibration)))
}

fn parsed(text: &str, out: &Path, calibration: &Calibration) -> anyhow::Result<Venue> {
    Venue::parse(text, out, calibration.clone()).context("the venue file to write is invalid")
}

fn rate_hz(args: &InitArgs, recordings: &[Recording]) -> anyhow::Result<f64> {
    if let Some(rate_hz) = args.rate {
        ensure!(
            rate_hz > 0.0,
            "`--rate`: found {rate_hz}, expected frames per second"
        );
        return Ok(rate_hz);
    }
    if let Some(rate_hz) = recordings::rate_of_videos(recordings)? {
        return Ok(rate_hz);
    }
    match answer("How many frames per second do the recordings have?")? {
        Some(text) => text
            .parse()
            .map_err(|_| anyhow!("found `{text}`, expected a number such as 60")),
        None => bail!("these recordings have no frame rate: set it with `--rate HZ`"),
    }
}

/// The keypoint network: the given one, else an installed one.
fn network(args: &InitArgs, is_needed: bool) -> anyhow::Result<Option<PathBuf>> {
    if args.network.is_some() || !is_needed {
        return Ok(args.network.clone());
    }
    if let Some(name) = installed("--network", Task::Keypoints)? {
        return Ok(Some(name));
    }
    let problem = "images need a keypoint network, and none is installed";
    match answer(&format!(
        "{problem} (`{INSTALL}` installs one). Which file is its card?"
    ))? {
        Some(path) => Ok(Some(path.into())),
        None => bail!(
            "{problem}: run `{INSTALL}`, or set its card with `--network CARD` (docs/networks.md)"
        ),
    }
}

/// The detector: the given one, else an installed one, if any.
fn detector(args: &InitArgs, is_needed: bool) -> anyhow::Result<Option<PathBuf>> {
    if args.detector.is_some() || !is_needed {
        return Ok(args.detector.clone());
    }
    installed("--detector", Task::Detection)
}

/// The name of the first installed network for `task`, which `option` replaces.
fn installed(option: &str, task: Task) -> anyhow::Result<Option<PathBuf>> {
    let all = installed_for(task)?;
    let Some(first) = all.first() else {
        return Ok(None);
    };
    let names: Vec<&str> = all.iter().map(|network| network.name.as_str()).collect();
    let (name, names) = (&first.name, names.join(", "));
    say(format_args!(
        "using the network {name}; installed: {names}; `{option} NAME` uses another"
    ));
    Ok(Some(name.into()))
}

/// The answer to a question; `None` without a terminal, or without an answer.
///
/// # Errors
/// When the terminal cannot be read.
fn answer(question: &str) -> anyhow::Result<Option<String>> {
    if !(stdin().is_terminal() && stderr().is_terminal()) {
        return Ok(None);
    }
    // A failed write shows in the read that follows.
    write!(stderr(), "{question} ").ok();
    let mut line = String::new();
    stdin().read_line(&mut line).context("reading the answer")?;
    let answer = line.trim();
    Ok((!answer.is_empty()).then(|| answer.to_owned()))
}

fn card(path: &Path) -> anyhow::Result<String> {
    let shown = path.display();
    ensure!(
        path.extension().is_none_or(|is| is != "onnx"),
        "{shown}: found a network, expected its card: a TOML file that describes input and output (docs/venue.md)"
    );
    fs::read_to_string(path)
        .map_err(|error| anyhow!("reading the card {shown}: {}", unread_card(&error, path)))
}

fn write_all(file: &mut File, text: &str) -> io::Result<()> {
    file.write_all(text.as_bytes())?;
    file.sync_all()
}

/// Writes a new file. On failure none remains.
fn write_new(path: &Path, write: impl FnOnce(&mut File) -> io::Result<()>) -> anyhow::Result<()> {
    let written = File::create_new(path).and_then(|mut file| {
        // Half a file would refuse the next try.
        write(&mut file).inspect_err(|_| drop(fs::remove_file(path)))
    });
    written.with_context(|| format!("writing {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_incomplete_file_is_removed_and_an_existing_one_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("venue.toml");
        let full = |file: &mut File| {
            file.write_all(b"half")?;
            Err(io::ErrorKind::StorageFull.into())
        };
        write_new(&path, full).unwrap_err();
        assert!(!path.exists());
        write_new(&path, |file| file.write_all(b"whole")).unwrap();
        write_new(&path, full).unwrap_err();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }
}
