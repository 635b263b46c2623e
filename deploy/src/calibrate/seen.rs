//! What cameras saw, through which lenses and when, as the command line says it: a file for each camera, called as it is.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::{Args, ValueEnum};
use farfield_calibration::points::Timing;

use super::known::KnownArgs;
use super::lenses::{Lens, LensFile, lens_of, lenses};
use super::named;

/// Lenses and clocks.
#[derive(Debug, Args)]
pub(super) struct SeenArgs {
    /// Lenses: a calibration of any format, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE")]
    lens: Vec<LensFile>,
    /// Whether frames are of one moment: synchronised, given, unknown.
    ///
    /// synchronised: frames of one number; given: by --rate-hz and --offset-s; unknown: rates are about right, offsets are
    /// looked for.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "synchronised",
        hide_possible_values = true
    )]
    clocks: Clocks,
    /// Frames per second: of all cameras, or NAME=HZ.
    #[arg(long, value_name = "[NAME=]HZ", value_parser = rate)]
    rate_hz: Vec<(Option<String>, f64)>,
    /// Time of a camera's frame 0, seconds, on a clock that all share.
    #[arg(long, value_name = "NAME=S", value_parser = offset, hide_short_help = true)]
    offset_s: Vec<(String, f64)>,
}

/// A camera and what it saw.
pub(super) struct SeenCamera<T> {
    pub(super) name: String,
    pub(super) lens: Lens,
    /// Frames per second, where that is said.
    pub(super) rate_hz: Option<f64>,
    /// Time of its frame 0, seconds, where that is said.
    pub(super) offset_s: Option<f64>,
    pub(super) seen: T,
}

impl SeenArgs {
    /// What is known of time.
    pub(super) fn timing(&self) -> Timing {
        match self.clocks {
            Clocks::Synchronised => Timing::Synchronised,
            Clocks::Given => Timing::Clocks,
            Clocks::Unknown => Timing::Unknown,
        }
    }

    /// The lenses of all cameras that have one.
    ///
    /// # Errors
    /// As [`lenses`].
    pub(super) fn lenses(&self) -> anyhow::Result<BTreeMap<String, Lens>> {
        lenses(&self.lens)
    }

    /// Time of its frame 0, seconds, where that is said.
    pub(super) fn offset_of(&self, name: &str) -> Option<f64> {
        let found = self.offset_s.iter().find(|(of, _)| of == name);
        found.map(|(_, s)| *s)
    }

    /// Whether any rate is said.
    pub(super) fn has_rates(&self) -> bool {
        !self.rate_hz.is_empty()
    }

    /// The cameras of these files, by name, each as `read` reads it; what `known` and the clocks say must be of these.
    ///
    /// # Errors
    /// What cannot be read, two files of one camera, a camera without a lens or that nobody knows, offsets of clocks that are
    /// not given.
    pub(super) fn cameras<T>(
        &self,
        files: &[PathBuf],
        known: &KnownArgs,
        mut read: impl FnMut(&str, &Path) -> anyhow::Result<T>,
    ) -> anyhow::Result<Vec<SeenCamera<T>>> {
        ensure!(
            self.timing() == Timing::Clocks || self.offset_s.is_empty(),
            "--offset-s: offsets are for --clocks given"
        );
        ensure!(
            !self.lens.is_empty(),
            "no lens: give those of all cameras by --lens FILE, or of each by --lens NAME=FILE"
        );
        let lenses = self.lenses()?;
        let mut seen = BTreeMap::new();
        for path in files {
            let name = path
                .file_stem()
                .and_then(|it| it.to_str())
                .unwrap_or_default();
            if seen.insert(name.to_owned(), read(name, path)?).is_some() {
                bail!("{}: two files are of camera `{name}`", path.display());
            }
        }
        self.check_names(known, seen.keys().map(String::as_str))?;
        let each = seen.into_iter().map(|(name, seen)| {
            Ok(SeenCamera {
                lens: lens_of(&lenses, &name)?.clone(),
                rate_hz: self.rate_of(&name),
                offset_s: self.offset_of(&name),
                seen,
                name,
            })
        });
        each.collect()
    }

    /// The names that lenses are given for.
    pub(super) fn lens_names(&self) -> impl Iterator<Item = &str> {
        self.lens.iter().filter_map(LensFile::camera)
    }

    /// Refuses what is said of cameras that are not among `has`.
    ///
    /// # Errors
    /// The name that nobody knows.
    pub(super) fn check_names<'a>(
        &self,
        known: &KnownArgs,
        has: impl Iterator<Item = &'a str>,
    ) -> anyhow::Result<()> {
        let has: Vec<&str> = has.collect();
        let rates = self.rate_hz.iter().filter_map(|(name, _)| name.as_ref());
        let offsets = self.offset_s.iter().map(|(name, _)| name);
        for name in rates.chain(offsets).chain(known.cameras()) {
            ensure!(
                has.contains(&name.as_str()),
                "unknown camera `{name}`, expected one of {}",
                has.join(", ")
            );
        }
        Ok(())
    }

    /// Whether any offset is said.
    pub(super) fn has_offsets(&self) -> bool {
        !self.offset_s.is_empty()
    }

    /// Its own rate, else that of all cameras.
    pub(super) fn rate_of(&self, name: &str) -> Option<f64> {
        let find = |of: Option<&str>| self.rate_hz.iter().find(|(it, _)| it.as_deref() == of);
        find(Some(name)).or_else(|| find(None)).map(|(_, hz)| *hz)
    }
}

/// What is known of when frames were taken.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Clocks {
    Synchronised,
    Given,
    Unknown,
}

fn rate(word: &str) -> Result<(Option<String>, f64), String> {
    let expected = "HZ or NAME=HZ, for example 59.94 or north=59.94";
    if word.contains('=') {
        let (name, hz) = named(word, expected)?;
        return Ok((Some(name), hz));
    }
    let hz = word
        .parse()
        .map_err(|_| format!("found `{word}`, expected {expected}"))?;
    Ok((None, hz))
}

fn offset(word: &str) -> Result<(String, f64), String> {
    named(word, "NAME=SECONDS, for example north=-0.35")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_known_of_cameras_is_understood_or_said() {
        assert_eq!(rate("59.94"), Ok((None, 59.94)));
        assert_eq!(rate("north=25"), Ok((Some("north".to_owned()), 25.0)));
        for wrong in [rate("fast").unwrap_err(), offset("0.3").unwrap_err()] {
            assert!(wrong.contains("expected"), "{wrong}");
        }
    }
}
