//! Known facts on a venue before its cameras are calibrated, from the command line.

use std::collections::BTreeSet;
use std::path::PathBuf;

use anyhow::ensure;
use clap::Args;
use farfield_calibration::alignment::{Anchors, KnownDistance, Marks};

use super::{named, read};

/// Facts that determine scale, origin and up.
#[derive(Debug, Args)]
pub(super) struct KnownArgs {
    /// Distance of two cameras, for the scale.
    #[arg(long, value_name = "A,B=METRES", value_parser = distance)]
    distance: Vec<KnownDistance>,
    /// Position of a camera; three give origin and up.
    ///
    /// Metres, z up; three cameras or more that are not in one line also give the scale.
    #[arg(long, value_name = "NAME=X,Y,Z", value_parser = place, allow_hyphen_values = true)]
    at: Vec<(String, [f64; 3])>,
    /// Clicked marks: court, places, lengths, floor.
    ///
    /// Marks clicked in images, and what they are: lines and corners of a court, places, lengths, the floor. A TOML
    /// file, described in `docs/calibration.md`.
    #[arg(long, value_name = "FILE")]
    marks: Option<PathBuf>,
}

impl KnownArgs {
    /// The anchors for a calibration.
    ///
    /// # Errors
    /// When a camera has two positions, even the same one, or the file of marks cannot be read.
    pub(super) fn anchors(&self) -> anyhow::Result<Anchors> {
        let mut placed = BTreeSet::new();
        for (name, _) in &self.at {
            ensure!(
                placed.insert(name),
                "--at: found two positions of camera `{name}`, expected one for each camera: remove one"
            );
        }
        let marks = self.marks.as_ref().map(|path| {
            let marks = Marks::parse(&read(path)?.text, path)?;
            anyhow::Ok(marks)
        });
        Ok(Anchors {
            centers_m: self.at.clone(),
            distances: self.distance.clone(),
            marks: marks.transpose()?,
            ..Anchors::default()
        })
    }
}

fn distance(word: &str) -> Result<KnownDistance, String> {
    let expected = "A,B=METRES, for example north,south=24.1";
    let (names, distance_m) = named::<f64>(word, expected)?;
    match names.split_once(',') {
        Some((first, second)) if distance_m > 0.0 => Ok(KnownDistance {
            first: first.trim().to_owned(),
            second: second.trim().to_owned(),
            distance_m,
        }),
        _ => Err(format!("found `{word}`, expected {expected}")),
    }
}

fn place(word: &str) -> Result<(String, [f64; 3]), String> {
    let expected = "NAME=X,Y,Z in metres, for example north=0,12.5,4";
    let (name, place) = named::<String>(word, expected)?;
    let numbers: Result<Vec<f64>, _> = place.split(',').map(|it| it.trim().parse()).collect();
    match numbers.map(<[f64; 3]>::try_from) {
        Ok(Ok(at_m)) => Ok((name, at_m)),
        _ => Err(format!("found `{word}`, expected {expected}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(clap::Parser)]
    struct KnownLine {
        #[command(flatten)]
        args: KnownArgs,
    }

    fn anchors(words: &[&str]) -> anyhow::Result<Anchors> {
        let words = [&["known"], words].concat();
        let line = <KnownLine as clap::Parser>::try_parse_from(words)?;
        line.args.anchors()
    }

    #[test]
    fn two_positions_of_a_camera_are_refused_even_if_equal() {
        let two = anchors(&["--at", "n=0,0,4", "--at", "s=0,8,4"]).unwrap();
        assert_eq!(two.centers_m.len(), 2);
        for again in ["n=0,8,4", "n=0,0,4"] {
            let refused = anchors(&["--at", "n=0,0,4", "--at", "s=0,8,4", "--at", again]);
            let error = refused.unwrap_err().to_string();
            assert!(error.contains("--at") && error.contains("`n`"), "{error}");
        }
    }

    #[test]
    fn places_and_distances_are_parsed_or_refused() {
        assert_eq!(
            place("n=0,-12.5, 4"),
            Ok(("n".to_owned(), [0.0, -12.5, 4.0]))
        );
        let known = distance("north,south=24.1").unwrap();
        assert_eq!(
            (known.first.as_str(), known.second.as_str()),
            ("north", "south")
        );
        for wrong in [
            distance("north=3").unwrap_err(),
            distance("a,b=-3").unwrap_err(),
            place("n=1,2").unwrap_err(),
        ] {
            assert!(wrong.contains("expected"), "{wrong}");
        }
    }
}
