//! `farfield calibrate ball`: finds a ball that was carried through the field, a light in the dark, or a drone.
//!
//! Writes the input files of `farfield calibrate points`, each after the scan of its camera; after an interruption they
//! are reused.

mod camera;

use std::fmt::Write as _;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use farfield_calibration::ball::{Appearance, BallFinder, BallRequest, ColourRange};
use farfield_node::process::NodeError;
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::Serialize;

pub(super) use self::camera::with_lenses;
use self::camera::{BallCounts, ScanCamera};
use super::lenses::{LensFile, lenses};
use super::recorded::ScanProgress;
use super::{refuse_existing, write};
use crate::init::recordings::Recording;
use crate::output;

/// With fewer sightings, a camera cannot be calibrated.
const FEW: usize = 20;

/// Arguments of `farfield calibrate ball`.
#[derive(Debug, Args)]
pub(super) struct BallArgs {
    #[command(flatten)]
    scan: BallScan,
    /// Lenses: a calibration of any format, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE", required = true)]
    lens: Vec<LensFile>,
    /// Folder for NAME.txt: `frame x y` per line.
    ///
    /// Each is written after the scan of its camera. An existing one of the same recording, lens and options is reused:
    /// after an interruption only missing ones are scanned.
    #[arg(long, value_name = "DIR", default_value = "seen")]
    out: PathBuf,
    /// Replace existing files.
    #[arg(long)]
    replace: bool,
    /// Print the result or the error as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// What to find, and in which recordings.
#[derive(Debug, Args)]
pub(super) struct BallScan {
    /// The folder of the recordings: videos or folders of numbered images, named after the cameras.
    folder: PathBuf,
    /// How to recognise it: colour, moving-colour, light, motion.
    ///
    /// colour: nothing else of its size has its colour; moving-colour: seats or signs have it, too; light: a lamp in
    /// the dark; motion: a drone in front of the sky. Except for colour and light, the cameras must not move.
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "moving-colour",
        hide_possible_values = true
    )]
    by: Cue,
    /// Its colour: #rrggbb, or hue,saturation,value ranges.
    ///
    /// Such as 20-45,60-100,30-100: degrees and percent. Default: that of the most saturated round thing that moves.
    #[arg(long, value_name = "COLOUR")]
    colour: Option<ColourRange>,
    /// Minimum brightness of a light, 0 to 255.
    #[arg(long, value_name = "N", default_value_t = 200, hide_short_help = true)]
    least_brightness: u8,
    /// Minimum difference of moving pixels, levels of 255.
    #[arg(long, value_name = "N", default_value_t = 20, hide_short_help = true)]
    contrast: u8,
    /// Smallest and largest diameter in the image, pixels.
    #[arg(long, value_name = "A,B", value_parser = diameters, default_value = "5,400", hide_short_help = true)]
    diameter_px: [f64; 2],
}

/// How the ball is recognised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Cue {
    Colour,
    MovingColour,
    Light,
    Motion,
}

fn diameters(word: &str) -> Result<[f64; 2], String> {
    let parsed = word
        .split_once(',')
        .and_then(|(least, most)| Some([least.trim().parse().ok()?, most.trim().parse().ok()?]));
    parsed.ok_or_else(|| format!("found `{word}`, expected A,B in pixels, for example 8,120"))
}

impl BallScan {
    /// The recordings, after checks of the options.
    ///
    /// # Errors
    /// Invalid diameters and colours, a folder without recordings, two of one camera.
    pub(super) fn recordings(&self) -> anyhow::Result<Vec<Recording>> {
        let any = Appearance::MovingColour(ColourRange::saturated());
        BallFinder::new(BallRequest {
            appearance: self.appearance().unwrap_or(any),
            diameter_px: self.diameter_px,
            lens: None,
        })?;
        camera::recordings_in(&self.folder)
    }

    /// The appearance; `None` if its colour must be learnt first.
    fn appearance(&self) -> Option<Appearance> {
        match (self.by, self.colour) {
            (Cue::Light, _) => Some(Appearance::Bright {
                least: self.least_brightness,
            }),
            (Cue::Motion, _) => Some(Appearance::Moving {
                contrast: self.contrast,
            }),
            (by, Some(colour)) => Some(self::coloured(by, colour)),
            (_, None) => None,
        }
    }
}

fn coloured(by: Cue, colour: ColourRange) -> Appearance {
    if by == Cue::Colour {
        Appearance::Colour(colour)
    } else {
        Appearance::MovingColour(colour)
    }
}

/// The sightings of a camera.
#[derive(Debug, Serialize)]
pub(super) struct Seen {
    pub(super) camera: String,
    frames: u64,
    pub(super) sightings: usize,
    /// Median, pixels.
    diameter_px: f64,
    pub(super) file: PathBuf,
    /// Whether it comes from an earlier scan.
    taken_up: bool,
}

impl Seen {
    fn new(camera: &ScanCamera, file: PathBuf, counts: &BallCounts, taken_up: bool) -> Self {
        Self {
            camera: camera.name().to_owned(),
            frames: counts.frames,
            sightings: counts.sightings,
            diameter_px: counts.diameter_px,
            file,
            taken_up,
        }
    }
}

/// Finds the ball in every recording, and writes its positions.
///
/// # Errors
/// [`NodeError::Refused`] where recordings or lenses cannot be read, or no ball is found.
pub(super) fn from_ball(args: &BallArgs) -> Result<(), NodeError> {
    let lenses = lenses(&args.lens).map_err(NodeError::Refused)?;
    let cameras = || camera::with_lenses(args.scan.recordings()?, &lenses);
    let cameras = cameras().map_err(NodeError::Refused)?;
    let seen = scan_all(&args.scan, &cameras, &args.out, args.replace)?;
    let text = if args.json {
        serde_json::to_string_pretty(&seen).map_err(NodeError::failed)? + "\n"
    } else {
        lines(&seen)
    };
    output::print(&text).map_err(NodeError::Failed)
}

/// Scans every recording without a valid file in `out`, and writes the sightings.
///
/// # Errors
/// As [`from_ball`]; [`NodeError::Failed`] for errors of the disk.
pub(super) fn scan_all(
    scan: &BallScan,
    cameras: &[ScanCamera],
    out: &Path,
    replace: bool,
) -> Result<Vec<Seen>, NodeError> {
    let jobs = cameras.par_iter().map(|camera| {
        let made_of = camera.made_of(scan)?;
        let file = camera.file(out);
        let cached = BallCounts::find(&file, &made_of);
        anyhow::Ok(ScanJob {
            camera,
            made_of,
            file,
            cached,
        })
    });
    let jobs: anyhow::Result<Vec<ScanJob<'_>>> = jobs.collect();
    let jobs = jobs.map_err(NodeError::Refused)?;
    let new: Vec<&ScanJob<'_>> = jobs.iter().filter(|it| it.cached.is_none()).collect();
    let mut images = 0;
    for it in &new {
        refuse_existing(&it.file, replace)?;
        images += it.camera.images(scan).map_err(NodeError::Refused)?;
    }
    let progress = ScanProgress::new(images);
    let each: Vec<Result<Seen, NodeError>> =
        jobs.par_iter().map(|it| it.seen(scan, &progress)).collect();
    drop(progress);
    let seen: Vec<Seen> = each.into_iter().collect::<Result<_, _>>()?;
    if seen.iter().all(|it| it.sightings == 0) {
        return Err(NodeError::Refused(anyhow!(
            "{}: found no moving ball in any recording: set how to recognise it with --by and --colour, and its size in the image \
             with --diameter-px",
            scan.folder.display()
        )));
    }
    Ok(seen)
}

/// A camera, and its earlier result.
struct ScanJob<'a> {
    camera: &'a ScanCamera,
    /// Fingerprint of everything that its file depends on.
    made_of: String,
    file: PathBuf,
    cached: Option<BallCounts>,
}

impl ScanJob<'_> {
    /// The sightings: scanned and written unless they are cached.
    fn seen(&self, scan: &BallScan, progress: &ScanProgress) -> Result<Seen, NodeError> {
        let file = self.file.clone();
        if let Some(cached) = &self.cached {
            progress.say(format_args!(
                "camera {}: {} from an earlier scan is reused",
                self.camera.name(),
                file.display()
            ));
            return Ok(Seen::new(self.camera, file, cached, true));
        }
        let scanned = self.camera.scan(scan, progress);
        let (frames, found) = scanned.map_err(NodeError::Refused)?;
        let counts = BallCounts::new(frames, &found);
        if found.is_empty() {
            // `points` refuses an empty file, and an earlier one does not belong to this scan.
            remove(&file)?;
        } else {
            write(&file, &counts.text(&found, &self.made_of))?;
        }
        Ok(Seen::new(self.camera, file, &counts, false))
    }
}

/// Removes a file if it exists.
fn remove(path: &Path) -> Result<(), NodeError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            let error = anyhow::Error::new(error);
            let error = error.context(format!("removing {}", path.display()));
            Err(NodeError::Failed(error))
        }
        _ => Ok(()),
    }
}

/// A line for each camera.
pub(super) fn lines(seen: &[Seen]) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    for it in seen {
        let (camera, file) = (&it.camera, it.file.display());
        let (sightings, frames) = (it.sightings, it.frames);
        if it.sightings == 0 {
            writeln!(text, "camera {camera}: not found in {frames} frames").ok();
            continue;
        }
        let few = if it.sightings < FEW { ": too few" } else { "" };
        writeln!(
            text,
            "camera {camera}: found in {sightings} of {frames} frames{few}, median diameter {:.0} px, {file}",
            it.diameter_px
        )
        .ok();
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn diameters_are_two_numbers() {
        assert_eq!(diameters("8, 120"), Ok([8.0, 120.0]));
        for wrong in ["8", "a,b", "8-120"] {
            assert!(diameters(wrong).unwrap_err().contains("expected"));
        }
    }
}
