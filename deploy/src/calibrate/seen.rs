//! Options on the lenses and clocks of cameras, and files of detections, which have the names of the cameras.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::{Args, ValueEnum};
use farfield_calibration::alignment::{Anchors, Marks};
use farfield_calibration::points::Timing;

use super::lenses::{Lens, LensFile, lens_of, lenses};
use super::named;

/// Largest relative difference of two notations of one rate: 30000/1001 and 29.97, 24000/1001 and 23.976.
const SAME_RATE: f64 = 2e-6;
/// Largest difference of frames with the same number, in frames: beyond it, the frame belongs to another number.
const MOST_APART: f64 = 0.5;
/// Assumed minimum of frames in a recording that was not counted.
pub(super) const LEAST_FRAMES: f64 = 100.0;

#[derive(Debug, Clone, Args)]
pub(super) struct SeenArgs {
    /// Lenses: any calibration, or one camera's.
    ///
    /// A calibration of any format that `farfield calibrate convert` reads, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE")]
    lens: Vec<LensFile>,
    /// Clocks: synchronised, given or unknown.
    ///
    /// synchronised, the default: frames of one number show the same moment; given: by --rate-hz and --offset-s;
    /// unknown: rates are approximate, offsets are estimated.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "synchronised",
        hide_default_value = true,
        hide_possible_values = true
    )]
    clocks: Clocks,
    /// Frames per second: of all cameras, or NAME=HZ.
    #[arg(long, value_name = "[NAME=]HZ", value_parser = rate)]
    rate_hz: Vec<(Option<String>, f64)>,
    /// Time of a camera's frame 0, seconds, on a common clock.
    #[arg(long, value_name = "NAME=S", value_parser = offset, hide_short_help = true)]
    offset_s: Vec<(String, f64)>,
}

/// A camera with its detections.
pub(super) struct SeenCamera<T> {
    pub(super) name: String,
    pub(super) lens: Lens,
    /// Frames per second, if known.
    pub(super) rate_hz: Option<f64>,
    /// Time of its frame 0, seconds, if known.
    pub(super) offset_s: Option<f64>,
    pub(super) seen: T,
}

/// Files of detections, by camera.
///
/// # Errors
/// A path that is no file, or two files for one camera.
pub(super) fn by_camera(files: &[PathBuf]) -> anyhow::Result<BTreeMap<String, PathBuf>> {
    let mut named = BTreeMap::new();
    for path in files {
        ensure!(
            !path.is_dir(),
            "{}: found a folder, expected the files in it, one per camera",
            path.display()
        );
        ensure!(path.exists(), "{}: the file does not exist", path.display());
        let name = path.file_stem().and_then(|it| it.to_str());
        let name = name.unwrap_or_default().to_owned();
        if let Some(first) = named.insert(name.clone(), path.clone()) {
            bail!(
                "{} and {}: both files belong to camera `{name}`",
                first.display(),
                path.display()
            );
        }
    }
    Ok(named)
}

impl SeenArgs {
    /// Known facts on time.
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

    /// The lenses; at least one is required.
    ///
    /// # Errors
    /// As [`lenses`], and if none is given.
    pub(super) fn needed_lenses(&self) -> anyhow::Result<BTreeMap<String, Lens>> {
        ensure!(
            !self.lens.is_empty(),
            "no lens: set those of all cameras with --lens FILE, or of each with --lens NAME=FILE"
        );
        self.lenses()
    }

    /// The same, with rates for cameras that have none.
    pub(super) fn with_rates(&self, rates_hz: &BTreeMap<String, f64>) -> Self {
        let mut with = self.clone();
        for (name, rate_hz) in rates_hz {
            if self.rate_of(name).is_none() {
                with.rate_hz.push((Some(name.clone()), *rate_hz));
            }
        }
        with
    }

    /// The same with one rate for all cameras if they are synchronised, that of the first of `names`: containers state
    /// 30000/1001 and 2997/100 for the same rate. `frames` returns the length of the longest recording; it is called
    /// only if rates differ.
    ///
    /// # Errors
    /// Two cameras whose frames of the same number drift apart; errors of `frames`.
    pub(super) fn with_one_rate(
        &self,
        names: &[&str],
        frames: impl FnOnce() -> anyhow::Result<f64>,
    ) -> anyhow::Result<Self> {
        let rates = names
            .iter()
            .filter_map(|name| Some((*name, self.rate_of(name)?)));
        let rates: Vec<(&str, f64)> = rates.collect();
        let mut with = self.clone();
        let (Timing::Synchronised, Some((first, first_hz))) = (self.timing(), rates.first()) else {
            return Ok(with);
        };
        let share = |hz: f64| (hz - first_hz).abs() / first_hz.abs();
        let differs = |(_, hz): &&(&str, f64)| share(*hz) > SAME_RATE;
        let farthest = rates.iter().filter(differs);
        let farthest = farthest.max_by(|a, b| share(a.1).total_cmp(&share(b.1)));
        if let Some((name, hz)) = farthest {
            let frames = frames()?;
            ensure!(
                share(*hz) * frames <= MOST_APART,
                "camera `{name}` has {hz:.3} frames per second and `{first}` {first_hz:.3}: after {frames} frames those of one number are \
                 {:.3} s apart, so the cameras are not synchronised: set --clocks given, or unknown; or, if a file is wrong, the rate of \
                 all with --rate-hz HZ",
                frames * (1.0 / hz - 1.0 / first_hz).abs()
            );
        }
        for (_, hz) in &mut with.rate_hz {
            *hz = *first_hz;
        }
        Ok(with)
    }

    /// Time of its frame 0, seconds, if given.
    pub(super) fn offset_of(&self, name: &str) -> Option<f64> {
        let found = self.offset_s.iter().find(|(camera, _)| camera == name);
        found.map(|(_, s)| *s)
    }

    /// Whether any rate is given.
    pub(super) fn has_rates(&self) -> bool {
        !self.rate_hz.is_empty()
    }

    /// The cameras of these files, by name; `read` reads each file. The names in `anchors` and the clock options are
    /// checked before any file is read.
    ///
    /// # Errors
    /// An unreadable file, a camera without a lens or with an unknown name, offsets without given clocks.
    pub(super) fn cameras<T>(
        &self,
        files: &BTreeMap<String, PathBuf>,
        anchors: &Anchors,
        mut read: impl FnMut(&str, &Path) -> anyhow::Result<T>,
    ) -> anyhow::Result<Vec<SeenCamera<T>>> {
        let names: Vec<&str> = files.keys().map(String::as_str).collect();
        self.check_clocks()?;
        self.check_names(anchors, &names)?;
        let lenses = self.needed_lenses()?;
        for name in &names {
            lens_of(&lenses, name)?;
        }
        let each = files.iter().map(|(name, path)| {
            Ok(SeenCamera {
                lens: lens_of(&lenses, name)?.clone(),
                rate_hz: self.rate_of(name),
                offset_s: self.offset_of(name),
                seen: read(name, path)?,
                name: name.clone(),
            })
        });
        each.collect()
    }

    /// Refuses offsets without given clocks, and options given twice.
    ///
    /// # Errors
    /// Names the option.
    pub(super) fn check_clocks(&self) -> anyhow::Result<()> {
        ensure!(
            self.timing() == Timing::Clocks || self.offset_s.is_empty(),
            "--offset-s: offsets are for --clocks given"
        );
        let rates = self
            .rate_hz
            .iter()
            .map(|(name, _)| ("--rate-hz", name.as_deref()));
        let offsets = self
            .offset_s
            .iter()
            .map(|(name, _)| ("--offset-s", Some(name.as_str())));
        let mut seen = BTreeSet::new();
        for (option, name) in rates.chain(offsets) {
            ensure!(
                seen.insert((option, name)),
                "{option}: found two values for {}, expected one",
                name.unwrap_or("all cameras")
            );
        }
        Ok(())
    }

    /// Refuses options on cameras that are not among `has`.
    ///
    /// # Errors
    /// Names the camera and the option.
    pub(super) fn check_names(&self, anchors: &Anchors, has: &[&str]) -> anyhow::Result<()> {
        let lenses = self.lens.iter().filter_map(LensFile::camera);
        let rates = self.rate_hz.iter().filter_map(|(name, _)| name.as_deref());
        let offsets = self.offset_s.iter().map(|(name, _)| name.as_str());
        let marks = anchors.marks.iter().flat_map(Marks::cameras);
        let places = Anchors {
            marks: None,
            ..anchors.clone()
        };
        let named = lenses.map(|name| ("--lens", name));
        let named = named.chain(rates.map(|name| ("--rate-hz", name)));
        let named = named.chain(offsets.map(|name| ("--offset-s", name)));
        let named = named.chain(places.cameras().map(|name| ("--at, --distance", name)));
        let mut named = named.chain(marks.map(|name| ("--marks", name)));
        if let Some((option, name)) = named.find(|(_, name)| !has.contains(name)) {
            bail!(
                "{option}: unknown camera `{name}`, expected one of {}",
                has.join(", ")
            );
        }
        Ok(())
    }

    /// Whether any offset is given.
    pub(super) fn has_offsets(&self) -> bool {
        !self.offset_s.is_empty()
    }

    /// Its own rate, else that of all cameras.
    pub(super) fn rate_of(&self, name: &str) -> Option<f64> {
        let find = |name: Option<&str>| self.rate_hz.iter().find(|(it, _)| it.as_deref() == name);
        find(Some(name)).or_else(|| find(None)).map(|(_, hz)| *hz)
    }
}

/// Known facts on the times of frames.
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

    fn with_rates(clocks: Clocks, rates_hz: &[(&str, f64)]) -> SeenArgs {
        let named = |(name, hz): &(&str, f64)| (Some((*name).to_owned()), *hz);
        SeenArgs {
            lens: Vec::new(),
            clocks,
            rate_hz: rates_hz.iter().map(named).collect(),
            offset_s: Vec::new(),
        }
    }

    #[test]
    fn files_are_assigned_to_cameras_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str| {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, "").unwrap();
            path
        };
        let (north, south) = (file("north.txt"), file("south.txt"));
        let found = by_camera(&[south.clone(), north.clone()]).unwrap();
        assert_eq!(
            found,
            BTreeMap::from([
                ("north".to_owned(), north.clone()),
                ("south".to_owned(), south)
            ])
        );
        let refused = |files: &[PathBuf]| by_camera(files).unwrap_err().to_string();
        let again = file("later/north.csv");
        let error = refused(&[north.clone(), again.clone()]);
        let both = format!("{} and {}: ", north.display(), again.display());
        assert!(error.starts_with(&both) && error.contains("`north`"));
        let error = refused(&[north.clone(), north]);
        assert!(error.contains("camera `north`"), "{error}");
        let error = refused(&[folder.path().join("later")]);
        assert!(error.contains("later: found a folder"), "{error}");
        let error = refused(&[folder.path().join("west.txt")]);
        assert!(error.contains("west.txt: "), "{error}");
    }

    #[test]
    fn two_values_for_one_camera_are_refused() {
        let checked = |rates: &[(&str, f64)], offsets: &[(&str, f64)]| {
            let mut args = with_rates(Clocks::Given, rates);
            args.offset_s = offsets
                .iter()
                .map(|(name, s)| ((*name).to_owned(), *s))
                .collect();
            args.check_clocks()
        };
        checked(
            &[("east", 50.0), ("west", 50.0)],
            &[("east", 0.0), ("west", 0.3)],
        )
        .unwrap();
        let error = checked(&[("east", 50.0), ("east", 25.0)], &[]).unwrap_err();
        assert!(error.to_string().contains("--rate-hz: "), "{error}");
        let error = checked(&[], &[("east", 0.0), ("east", 0.0)]).unwrap_err();
        assert!(error.to_string().contains("--offset-s: "), "{error}");
    }

    #[test]
    fn synchronised_cameras_with_almost_equal_rates_get_the_first_rate() {
        let names = ["east", "north", "west"];
        let (ntsc_hz, rounded_hz) = (30_000.0 / 1001.0, 2997.0 / 100.0);
        let one_rate = |clocks, rates: &[(&str, f64)], frames: f64| {
            with_rates(clocks, rates).with_one_rate(&names, || Ok(frames))
        };
        let rates = [("east", ntsc_hz), ("north", rounded_hz), ("west", 29.97)];
        let one = one_rate(Clocks::Synchronised, &rates, 1e9).unwrap();
        for name in names {
            assert_eq!(one.rate_of(name), Some(ntsc_hz), "{name}");
        }
        let rates = [("east", 25.0), ("north", 25.0), ("west", 30.0)];
        let error = one_rate(Clocks::Synchronised, &rates, LEAST_FRAMES);
        let error = error.unwrap_err().to_string();
        for part in ["`west`", "30.000", "`east`", "25.000", "--rate-hz HZ"] {
            assert!(error.contains(part), "{error}");
        }
        let own = one_rate(Clocks::Unknown, &rates, LEAST_FRAMES);
        assert_eq!(own.unwrap().rate_of("west"), Some(30.0));
    }

    #[test]
    fn almost_equal_rates_are_refused_if_frames_drift_half_a_frame_apart() {
        let names = ["east", "west"];
        let rates = [("east", 30.0), ("west", 29.97)];
        let one_rate = |frames: f64| {
            with_rates(Clocks::Synchronised, &rates).with_one_rate(&names, || Ok(frames))
        };
        assert_eq!(one_rate(490.0).unwrap().rate_of("west"), Some(30.0));
        // Two minutes.
        let error = one_rate(3600.0).unwrap_err().to_string();
        assert!(error.contains("0.120 s"), "{error}");
    }

    #[test]
    fn rates_and_offsets_are_parsed_or_refused() {
        assert_eq!(rate("59.94"), Ok((None, 59.94)));
        assert_eq!(rate("north=25"), Ok((Some("north".to_owned()), 25.0)));
        for wrong in [rate("fast").unwrap_err(), offset("0.3").unwrap_err()] {
            assert!(wrong.contains("expected"), "{wrong}");
        }
    }
}
