//! The edges of a crowd in one process: plays recorded sets over sessions of their own at the venue's rate. So fusion can be
//! measured live on a machine that could not compute the sets at that rate.
//!
//! Every viewpoint has a session, receives its boxes, and sends the recorded patches for those boxes. People without a box are
//! not sent, and sightings are sent when fusion requests a detection pass.

mod mapping;
mod viewpoint;

use std::fs;
use std::path::{Path, PathBuf};
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, bail};
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_sim::recorded_venue::RecordedVenue;
use farfield_sim::scene::write::{calibration_text, write_truth};
use farfield_sim::simulated::VenueText;

use self::mapping::{IdMapping, Places, places_of_patches};
use self::viewpoint::{PlayedViewpoint, RecordedSets};
use super::watch::unix_us;

/// Time from the tick to the sending of its sets, microseconds: that of a fast edge.
const EDGE_US: u64 = 4_000;
/// Intervals of statuses before the ticks begin and after, microseconds.
const CALL_US: u64 = 100_000;
const STATUS_US: u64 = 1_000_000;
/// Time limit for fusion's start, microseconds.
const PATIENCE_US: u64 = 60_000_000;

/// Writes the venue of `recorded` and the truth of its ticks to `folder`; returns the venue file.
///
/// # Errors
/// The file system fails.
pub fn write_played_venue(recorded: &RecordedVenue, folder: &Path) -> anyhow::Result<PathBuf> {
    let scene = recorded.scene();
    fs::write(
        folder.join("calibration.toml"),
        calibration_text(scene.cameras()),
    )?;
    let mut truth = Vec::new();
    write_truth(scene, &scene.ticks(), &mut truth)?;
    fs::write(folder.join("truth.jsonl"), truth)?;
    // The file is never opened, since the sets exist already.
    let source = |_: &CameraModel| "{ kind = \"maps\", path = \"played.maps\" }".to_owned();
    let text = VenueText {
        scene,
        name: "crowd",
        head: "Played from sets that were made beforehand.",
        calibration: "calibration.toml",
        network: None,
        detector: None,
        source: &source,
        first_tick: Tick(0),
        given: None,
    };
    let path = folder.join("venue.toml");
    fs::write(&path, text.to_toml())?;
    Ok(path)
}

/// All viewpoints of a recorded venue, connected to fusion.
pub struct Player<'a> {
    recorded: &'a RecordedVenue,
    rate_hz: f64,
    viewpoints: Vec<PlayedViewpoint>,
}

/// Result of playing a recording.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Played {
    /// Ticks that were sent.
    pub ticks: u64,
    /// Largest lateness of a tick, microseconds.
    pub latest_us: u64,
}

impl<'a> Player<'a> {
    /// Connects to the fusion of `venue`, which [`write_played_venue`] made from `recorded`, at `endpoint`.
    ///
    /// # Errors
    /// Zenoh fails.
    pub fn connect(
        recorded: &'a RecordedVenue,
        venue: &Venue,
        endpoint: &str,
    ) -> anyhow::Result<Self> {
        let ticks = recorded.scene().ticks().end.0;
        let viewpoints = (0..venue.viewpoints.len())
            .map(|index| PlayedViewpoint::connect(venue, index, ticks, endpoint));
        Ok(Self {
            recorded,
            rate_hz: venue.rate_hz,
            viewpoints: viewpoints.collect::<anyhow::Result<_>>()?,
        })
    }

    /// Plays all ticks in real time, starting with fusion's first tick.
    ///
    /// # Errors
    /// Fusion does not start, or a message cannot be sent.
    pub fn play(&self) -> anyhow::Result<Played> {
        let epoch_us = self.wait_for_the_start()?;
        let mut mapping = IdMapping::default();
        let (mut played, mut status_us) = (Played::default(), 0);
        for (index, _) in self.recorded.groups().iter().enumerate() {
            let tick_us = epoch_us + (1e6 * index as f64 / self.rate_hz).round() as u64;
            let due_us = tick_us + EDGE_US;
            sleep_until(due_us);
            if self.viewpoints.iter().any(|v| v.received().is_over) {
                break;
            }
            let late_us = unix_us().saturating_sub(due_us);
            self.send(index, tick_us, &mut mapping)?;
            played.ticks += 1;
            played.latest_us = played.latest_us.max(late_us);
            if tick_us >= status_us + STATUS_US {
                status_us = tick_us;
                self.send_statuses()?;
            }
        }
        Ok(played)
    }

    /// Waits until fusion has published the time of tick 0: Unix time, microseconds.
    fn wait_for_the_start(&self) -> anyhow::Result<u64> {
        let until_us = unix_us() + PATIENCE_US;
        while unix_us() < until_us {
            self.send_statuses()?;
            let epoch_us =
                |v: &PlayedViewpoint| v.received().newest.as_ref()?.0.live.map(|l| l.epoch_us);
            if let Some(epoch_us) = self.viewpoints.iter().find_map(epoch_us) {
                return Ok(epoch_us);
            }
            sleep_until(unix_us() + CALL_US);
        }
        bail!("fusion did not begin")
    }

    fn send_statuses(&self) -> anyhow::Result<()> {
        let mut viewpoints = self.viewpoints.iter();
        viewpoints.try_for_each(PlayedViewpoint::send_status)
    }

    fn send(&self, index: usize, tick_us: u64, mapping: &mut IdMapping) -> anyhow::Result<()> {
        let group = &self.recorded.groups()[index];
        let sightings = self.recorded.sightings().get(index);
        let sightings = sightings.context("recorded without all sightings")?;
        let n = self.viewpoints.len();
        let sets: Vec<RecordedSets<'_>> = (0..n)
            .map(|v| RecordedSets {
                patch_sets: group
                    .patch_sets
                    .iter()
                    .filter(|set| usize::from(set.viewpoint.0) == v)
                    .collect(),
                sighting_sets: sightings
                    .iter()
                    .filter(|set| usize::from(set.viewpoint.0) == v)
                    .collect(),
            })
            .collect();
        let boxes: Vec<Places> = self
            .viewpoints
            .iter()
            .map(|v| v.places(group.tick))
            .collect();
        let patches = |sets: &RecordedSets<'_>| {
            places_of_patches(sets.patch_sets.iter().flat_map(|set| &set.persons))
        };
        mapping.update(&boxes, &sets.iter().map(patches).collect::<Vec<_>>());
        let mut pairs = self.viewpoints.iter().zip(&sets);
        pairs.try_for_each(|(viewpoint, sets)| viewpoint.send(group.tick, tick_us, sets, mapping))
    }
}

fn sleep_until(unix_time_us: u64) {
    thread::sleep(Duration::from_micros(
        unix_time_us.saturating_sub(unix_us()),
    ));
}
