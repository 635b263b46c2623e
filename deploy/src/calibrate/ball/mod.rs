//! `farfield calibrate ball`: where cameras saw a ball that was carried through the field, a light in the dark, a drone.
//!
//! Writes the files that `farfield calibrate points` takes, each as soon as its camera is looked through; whoever is interrupted
//! finds them again.

mod camera;
mod looked;

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

use self::camera::LookingCamera;
pub(super) use self::camera::with_lenses;
use self::looked::Looked;
use super::lenses::{LensFile, lenses};
use super::progress::LookProgress;
use super::{refuse_existing, write};
use crate::init::recordings::Recording;
use crate::output;

/// Sightings below which nothing can be made of a camera.
const FEW: usize = 20;

/// What `farfield calibrate ball` is told.
#[derive(Debug, Args)]
pub(super) struct BallArgs {
    #[command(flatten)]
    look: BallLook,
    /// Lenses: a calibration of any format, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE", required = true)]
    lens: Vec<LensFile>,
    /// Folder for NAME.txt: `frame x y` on each line.
    ///
    /// Each is written when its camera is looked through. One that is there already, of the same recording, lens and options, is
    /// taken as it is: after an interruption only what is missing is looked for.
    #[arg(long, value_name = "DIR", default_value = "seen")]
    out: PathBuf,
    /// Replace files that are there already.
    #[arg(long)]
    replace: bool,
    /// Print what was found, or what went wrong, as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// What is looked for, and where.
#[derive(Debug, Args)]
pub(super) struct BallLook {
    /// The folder of the recordings: videos or folders of numbered pictures, named after the cameras.
    folder: PathBuf,
    /// What tells it: colour, moving-colour, light, motion.
    ///
    /// colour: nothing large has its colour; moving-colour: seats or signs have it too; light: a lamp in the dark; motion: a
    /// drone before the sky. For all but colour and light the cameras stand still.
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "moving-colour",
        hide_possible_values = true
    )]
    by: ToldBy,
    /// Its colour: #rrggbb, or hue,saturation,value ranges.
    ///
    /// As 20-45,60-100,30-100: degrees and percent. Left out: that of the most saturated round thing that moves.
    #[arg(long, value_name = "COLOUR")]
    colour: Option<ColourRange>,
    /// Least brightness of a light, 0 to 255.
    #[arg(long, value_name = "N", default_value_t = 200, hide_short_help = true)]
    least_brightness: u8,
    /// Least difference of what moves, levels of 255.
    #[arg(long, value_name = "N", default_value_t = 20, hide_short_help = true)]
    contrast: u8,
    /// Least and most diameter in a picture, pixels.
    #[arg(long, value_name = "A,B", value_parser = diameters, default_value = "5,400", hide_short_help = true)]
    diameter_px: [f64; 2],
}

/// By what the thing is told from all else.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ToldBy {
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

impl BallLook {
    /// The recordings, where what is looked for can be looked for.
    ///
    /// # Errors
    /// Diameters and colours that are none, a folder without recordings, two of one camera.
    pub(super) fn recordings(&self) -> anyhow::Result<Vec<Recording>> {
        let any = Appearance::MovingColour(ColourRange::saturated());
        BallFinder::new(BallRequest {
            appearance: self.appearance().unwrap_or(any),
            diameter_px: self.diameter_px,
            lens: None,
        })?;
        camera::recordings_in(&self.folder)
    }

    /// How it is told; `None` where its colour must be learnt first.
    fn appearance(&self) -> Option<Appearance> {
        match (self.by, self.colour) {
            (ToldBy::Light, _) => Some(Appearance::Bright {
                least: self.least_brightness,
            }),
            (ToldBy::Motion, _) => Some(Appearance::Moving {
                contrast: self.contrast,
            }),
            (by, Some(colour)) => Some(self::coloured(by, colour)),
            (_, None) => None,
        }
    }
}

fn coloured(by: ToldBy, colour: ColourRange) -> Appearance {
    if by == ToldBy::Colour {
        Appearance::Colour(colour)
    } else {
        Appearance::MovingColour(colour)
    }
}

/// What a camera saw.
#[derive(Debug, Serialize)]
pub(super) struct Seen {
    pub(super) camera: String,
    frames: u64,
    pub(super) sightings: usize,
    /// At the median, pixels.
    diameter_px: f64,
    pub(super) file: PathBuf,
    /// Whether it was found earlier.
    taken_up: bool,
}

impl Seen {
    fn of(camera: &LookingCamera, file: PathBuf, kept: &Looked, taken_up: bool) -> Self {
        Self {
            camera: camera.name().to_owned(),
            frames: kept.frames,
            sightings: kept.sightings,
            diameter_px: kept.diameter_px,
            file,
            taken_up,
        }
    }
}

/// Looks for it in every recording, and writes where it was.
///
/// # Errors
/// [`NodeError::Refused`] where recordings or lenses cannot be read, or a ball is nowhere.
pub(super) fn from_ball(args: &BallArgs) -> Result<(), NodeError> {
    let lenses = lenses(&args.lens).map_err(NodeError::Refused)?;
    let cameras = || camera::with_lenses(args.look.recordings()?, &lenses);
    let cameras = cameras().map_err(NodeError::Refused)?;
    let seen = look_at_all(&args.look, &cameras, &args.out, args.replace)?;
    let text = if args.json {
        serde_json::to_string_pretty(&seen).map_err(NodeError::failed)? + "\n"
    } else {
        lines(&seen)
    };
    output::print(&text).map_err(NodeError::Failed)
}

/// Looks through every recording of which `out` has no finished file yet, and writes what was seen.
///
/// # Errors
/// As [`from_ball`]; [`NodeError::Failed`] where the disk is in the way.
pub(super) fn look_at_all(
    look: &BallLook,
    cameras: &[LookingCamera],
    out: &Path,
    replace: bool,
) -> Result<Vec<Seen>, NodeError> {
    let asked = cameras.par_iter().map(|camera| {
        let made_of = camera.made_of(look)?;
        let file = camera.file(out);
        let kept = Looked::find(&file, &made_of);
        anyhow::Ok(Asked {
            camera,
            made_of,
            file,
            kept,
        })
    });
    let asked: anyhow::Result<Vec<Asked<'_>>> = asked.collect();
    let asked = asked.map_err(NodeError::Refused)?;
    let new: Vec<&Asked<'_>> = asked.iter().filter(|it| it.kept.is_none()).collect();
    let mut pictures = 0;
    for it in &new {
        refuse_existing(&it.file, replace)?;
        pictures += it.camera.pictures(look).map_err(NodeError::Refused)?;
    }
    let progress = LookProgress::new(pictures);
    let each: Vec<Result<Seen, NodeError>> = asked
        .par_iter()
        .map(|it| it.seen(look, &progress))
        .collect();
    drop(progress);
    let seen: Vec<Seen> = each.into_iter().collect::<Result<_, _>>()?;
    if seen.iter().all(|it| it.sightings == 0) {
        return Err(NodeError::Refused(anyhow!(
            "{}: nothing that moves was found in any recording: say what tells it by --by and --colour, and how large it \
             appears by --diameter-px",
            look.folder.display()
        )));
    }
    Ok(seen)
}

/// A camera, and what is there of it.
struct Asked<'a> {
    camera: &'a LookingCamera,
    /// Fingerprint of all that its file comes of.
    made_of: String,
    file: PathBuf,
    kept: Option<Looked>,
}

impl Asked<'_> {
    /// What it saw: looked for, and written, where that is not there yet.
    fn seen(&self, look: &BallLook, progress: &LookProgress) -> Result<Seen, NodeError> {
        let file = self.file.clone();
        if let Some(kept) = &self.kept {
            progress.say(format_args!(
                "camera {}: taken from {}, where it was found earlier",
                self.camera.name(),
                file.display()
            ));
            return Ok(Seen::of(self.camera, file, kept, true));
        }
        let looked = self.camera.look(look, progress);
        let (frames, found) = looked.map_err(NodeError::Refused)?;
        let kept = Looked::of(frames, &found);
        if found.is_empty() {
            // `points` takes none that is empty, and what an earlier look left is not of this one.
            remove(&file)?;
        } else {
            write(&file, &kept.text(&found, &self.made_of))?;
        }
        Ok(Seen::of(self.camera, file, &kept, false))
    }
}

/// Removes a file, if it is there.
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

/// What is said of them.
pub(super) fn lines(seen: &[Seen]) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    for it in seen {
        let (camera, file) = (&it.camera, it.file.display());
        let (sightings, frames) = (it.sightings, it.frames);
        if it.sightings == 0 {
            writeln!(text, "camera {camera}: not seen in {frames} frames").ok();
            continue;
        }
        let few = if it.sightings < FEW { ": too few" } else { "" };
        writeln!(
            text,
            "camera {camera}: seen in {sightings} of {frames} frames{few}, {:.0} px across at the median, {file}",
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
