//! `farfield calibrate ball`: where cameras saw a ball that was carried through the field, a light in the dark, a drone.
//!
//! Writes the files that `farfield calibrate points` takes.

use std::fmt::Write as _;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, ensure};
use clap::{Args, ValueEnum};
use farfield_calibration::ball::{
    Appearance, BallFinder, BallLens, BallRequest, BallSighting, ColourRange, Picture,
    sightings_text,
};
use farfield_node::process::{NodeError, say};
use rayon::iter::{IntoParallelRefIterator as _, ParallelIterator as _};
use serde::Serialize;

use super::lenses::{Lens, LensFile, lens_of, lenses};
use super::recorded::OwnVenue;
use super::{refuse_existing, write};
use crate::init::recordings::{self, Recording, RecordingKind};
use crate::output;

/// Pictures of the first pass, in which the ball's colour is learnt.
const LEARNING_FRAMES: usize = 300;
/// Sightings below which nothing can be made of a camera.
const FEW: usize = 20;

/// What `farfield calibrate ball` is told.
#[derive(Debug, Args)]
pub(super) struct BallArgs {
    /// The folder of the recordings: videos or folders of numbered pictures, named after the cameras.
    folder: PathBuf,
    /// Lenses: a calibration of any format, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE", required = true)]
    lens: Vec<LensFile>,
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
    #[arg(long, value_name = "A,B", value_parser = diameters, default_value = "5,400")]
    diameter_px: [f64; 2],
    /// Folder for NAME.txt: `frame x y` on each line.
    #[arg(long, value_name = "DIR", default_value = "seen")]
    out: PathBuf,
    /// Replace files that are there already.
    #[arg(long)]
    replace: bool,
    /// Print what was found, or what went wrong, as JSON.
    #[arg(long)]
    pub(super) json: bool,
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

/// What a camera saw.
#[derive(Debug, Serialize)]
struct Seen {
    camera: String,
    frames: u64,
    sightings: usize,
    /// At the median, pixels.
    diameter_px: f64,
    file: PathBuf,
}

/// Looks for it in every recording, and writes where it was.
///
/// # Errors
/// [`NodeError::Refused`] where recordings or lenses cannot be read, or a ball is nowhere.
pub(super) fn from_ball(args: &BallArgs) -> Result<(), NodeError> {
    let cameras = cameras(args).map_err(NodeError::Refused)?;
    for camera in &cameras {
        refuse_existing(&camera.file(&args.out), args.replace)?;
    }
    let each: Vec<anyhow::Result<(u64, Vec<BallSighting>)>> =
        cameras.par_iter().map(|camera| camera.look(args)).collect();
    let mut seen = Vec::new();
    let mut texts = Vec::new();
    for (camera, found) in cameras.iter().zip(each) {
        let (frames, found) = found.map_err(NodeError::Refused)?;
        let mut diameters_px: Vec<f64> = found.iter().map(|it| it.diameter_px).collect();
        diameters_px.sort_by(f64::total_cmp);
        let middle = diameters_px.get(diameters_px.len() / 2);
        texts.push(sightings_text(&found));
        seen.push(Seen {
            camera: camera.recording.name.clone(),
            frames,
            sightings: found.len(),
            diameter_px: middle.copied().unwrap_or_default(),
            file: camera.file(&args.out),
        });
    }
    if seen.iter().all(|it| it.sightings == 0) {
        for it in &seen {
            remove(&it.file)?;
        }
        return Err(NodeError::Refused(anyhow!(
            "{}: nothing that moves was found in any recording: say what tells it by --by and --colour, and how large it \
             appears by --diameter-px",
            args.folder.display()
        )));
    }
    for (it, text) in seen.iter().zip(&texts) {
        if it.sightings > 0 {
            write(&it.file, text)?;
        } else {
            // `points` takes none that is empty, and what an earlier look left is not of this one.
            remove(&it.file)?;
        }
    }
    let text = if args.json {
        serde_json::to_string_pretty(&seen).map_err(NodeError::failed)? + "\n"
    } else {
        lines(&seen)
    };
    output::print(&text).map_err(NodeError::Failed)
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

fn lines(seen: &[Seen]) -> String {
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

/// A recording and the lens that it was made through.
struct LookingCamera {
    recording: Recording,
    lens: BallLens,
    venue: OwnVenue,
}

impl LookingCamera {
    fn file(&self, folder: &Path) -> PathBuf {
        folder.join(format!("{}.txt", self.recording.name))
    }

    /// How many frames there are, and where it was.
    fn look(&self, args: &BallArgs) -> anyhow::Result<(u64, Vec<BallSighting>)> {
        let appearance = match (args.by, args.colour) {
            (ToldBy::Light, _) => Appearance::Bright {
                least: args.least_brightness,
            },
            (ToldBy::Motion, _) => Appearance::Moving {
                contrast: args.contrast,
            },
            (ToldBy::Colour, Some(colour)) => Appearance::Colour(colour),
            (ToldBy::MovingColour, Some(colour)) => Appearance::MovingColour(colour),
            (by, None) => match self.learnt(args)? {
                (frames, None) => return Ok((frames, Vec::new())),
                (_, Some(colour)) if by == ToldBy::Colour => Appearance::Colour(colour),
                (_, Some(colour)) => Appearance::MovingColour(colour),
            },
        };
        let mut finder = self.finder(appearance, args)?;
        let frames = self.show(&mut finder, usize::MAX)?;
        Ok((frames, finder.finish()))
    }

    /// How many frames were looked at, and the colour of the most saturated round thing that moves in them.
    fn learnt(&self, args: &BallArgs) -> anyhow::Result<(u64, Option<ColourRange>)> {
        let any = Appearance::MovingColour(ColourRange::saturated());
        let mut finder = self.finder(any, args)?;
        let frames = self.show(&mut finder, LEARNING_FRAMES)?;
        let colour = finder.colour();
        let name = &self.recording.name;
        match &colour {
            Some(found) => say(format_args!(
                "camera {name}: its colour has hues of {:.0} to {:.0} degrees",
                found.hue_deg[0], found.hue_deg[1]
            )),
            None => say(format_args!(
                "camera {name}: nothing round, saturated and moving in the first {frames} frames: give --colour"
            )),
        }
        Ok((frames, colour))
    }

    fn finder(&self, appearance: Appearance, args: &BallArgs) -> anyhow::Result<BallFinder> {
        let request = BallRequest {
            appearance,
            diameter_px: args.diameter_px,
            lens: Some(self.lens),
        };
        BallFinder::new(request).with_context(|| self.recording.path.display().to_string())
    }

    /// Shows the finder the first frames, at most so many; how many there were.
    fn show(&self, finder: &mut BallFinder, most: usize) -> anyhow::Result<u64> {
        let named = || self.recording.path.display().to_string();
        self.venue.show(most, |number, image| {
            let picture = Picture::rgb8(image.as_raw(), [image.width(), image.height()]);
            let looked = picture.and_then(|picture| finder.look(number, &picture));
            looked.with_context(named).map(|_| ())
        })
    }
}

/// The recordings of the folder, each with its lens.
fn cameras(args: &BallArgs) -> anyhow::Result<Vec<LookingCamera>> {
    let lenses = lenses(&args.lens)?;
    let found = recordings::find(&args.folder, None)?;
    let pictures = found
        .into_iter()
        .filter(|it| it.kind != RecordingKind::Keypoints);
    let each = pictures.map(|recording| {
        let lens = lens_of(&lenses, &recording.name)
            .with_context(|| recording.path.display().to_string())?;
        camera(recording, lens)
    });
    let cameras: Vec<LookingCamera> = each.collect::<anyhow::Result<_>>()?;
    ensure!(
        !cameras.is_empty(),
        "{}: found keypoint files, expected videos or folders of pictures",
        args.folder.display()
    );
    Ok(cameras)
}

fn camera(recording: Recording, lens: &Lens) -> anyhow::Result<LookingCamera> {
    let looks = BallLens::new(lens.size_px, lens.intrinsics, lens.distortion);
    let looks = looks.with_context(|| format!("the lens of camera {}", recording.name))?;
    Ok(LookingCamera {
        venue: OwnVenue::new(&recording, lens)?,
        lens: looks,
        recording,
    })
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
