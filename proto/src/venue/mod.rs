//! The venue file: one installation with its viewpoints, cameras, sources and parameters.
//!
//! All errors are reported here, at the start, with file, line and field; none occurs at tick 900.
//! The input is text; the caller opens the files.

mod check;
mod field;
mod inference;
pub mod layout;
pub mod parameters;
mod people;
mod raw;
pub mod same_files;
mod source;
mod stream;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use inference::Provider;
pub use parameters::Parameters;
pub use people::{KnownBy, VenueSubject};
pub use source::{ControlValue, DeviceSettings, SimulatedContent, Source};
pub use stream::{StreamField, VenueStream};

use raw::RawVenue;

use crate::calibration::Calibration;
use crate::camera::CameraModel;
use crate::court::PlacedCourt;
use crate::id::{CameraIndex, ViewpointIndex};
use crate::keypoints::KeypointSet;
use crate::tick::Tick;
use crate::toml_file::{FileError, Place, TomlFile};

/// One installation, parsed and checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Venue {
    /// First part of every Zenoh key.
    pub name: String,
    /// Ticks per second.
    pub rate_hz: f64,
    /// Tick of the first frame of recorded sources.
    pub first_tick: Tick,
    /// The calibration file.
    pub calibration_path: PathBuf,
    /// The keypoint network's card; present if any source gives pictures.
    pub network: Option<PathBuf>,
    /// The detector's card.
    pub detector: Option<PathBuf>,
    /// The keypoints of each person in keypoint files.
    pub keypoints: KeypointSet,
    /// The endpoints of fusion and edges.
    pub endpoints: Endpoints,
    /// Access and encryption.
    pub security: Security,
    /// The tracked box.
    pub field: Field,
    /// The court on its floor.
    pub court: Option<PlacedCourt>,
    /// The viewpoints in file order, indexed by [`ViewpointIndex`].
    pub viewpoints: Vec<Viewpoint>,
    /// The cameras of all viewpoints in file order, indexed by [`CameraIndex`].
    pub cameras: Vec<VenueCamera>,
    /// People given by hand.
    pub given_persons: Vec<GivenPerson>,
    /// Live streams of poses to other programs; only the command that runs fusion opens them.
    pub streams: Vec<VenueStream>,
    /// The expected people, in file order; fusion recognises them by their bodies.
    pub subjects: Vec<VenueSubject>,
    /// The parameters of the method.
    pub parameters: Parameters,
    /// Fingerprints of this venue.
    pub hashes: VenueHash,
}

/// Zenoh endpoints; empty lists leave the choice to the command.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Endpoints {
    /// The endpoints at which fusion listens.
    pub listen: Vec<String>,
    /// The endpoints to which edges connect.
    pub connect: Vec<String>,
}

/// `[security]`: access and encryption.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Security {
    /// The folder of `ca.pem`, `NODE.pem` and `NODE.key`; `None`: no TLS.
    pub certificates: Option<PathBuf>,
    /// Whether nodes may connect to other machines without TLS.
    pub allow_plaintext: bool,
    /// Whether small pictures of the cameras may leave the edges for display; without TLS only on
    /// one machine.
    pub pictures: bool,
}

/// The tracked box, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Minimum x, y and z.
    pub min_m: [f64; 3],
    /// Maximum x, y and z.
    pub max_m: [f64; 3],
    /// Height of the floor under the people, z: 0, or as close as the field extends, or that of a
    /// stage.
    pub floor_m: f64,
}

/// One place with one edge and its cameras.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Viewpoint {
    /// Its name, a part of Zenoh keys.
    pub name: String,
    /// Its cameras, at least one.
    pub cameras: Vec<CameraIndex>,
    /// The inference providers of its live networks, in the order of the attempts; empty: the
    /// processor.
    pub providers: Vec<Provider>,
}

/// One camera with its pose and source.
#[derive(Debug, Clone, PartialEq)]
pub struct VenueCamera {
    /// Its viewpoint.
    pub viewpoint: ViewpointIndex,
    /// Its calibration.
    pub model: CameraModel,
    /// The source of its pictures.
    pub source: Source,
    /// The source of its frames' tick numbers.
    pub tick_from: TickFrom,
    /// Delay from the capture of a live frame to its arrival or its driver's timestamp, seconds;
    /// `None`: as reported by the camera, else 0.
    pub capture_delay_s: Option<f64>,
}

/// The source of frames' tick numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TickFrom {
    /// Live: the capture time, by clocks that PTP or NTP synchronises. Recorded: the index in the
    /// recording, which starts at `first_tick`.
    #[default]
    Clock,
    /// Live: the camera's own count of frames taken by a hardware trigger.
    Count,
    /// Recorded: the SMPTE timecode at the start of the recording, in frames since midnight.
    Timecode,
}

impl TickFrom {
    /// The name in a venue file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clock => "clock",
            Self::Count => "count",
            Self::Timecode => "timecode",
        }
    }
}

/// A person given by hand instead of detected.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenPerson {
    /// The tick of the keypoints.
    pub tick: Tick,
    /// Known keypoints by name, world, metres.
    pub keypoints_m: BTreeMap<String, [f64; 3]>,
}

/// Fingerprints of the files that all nodes share: 16 hexadecimal digits each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VenueHash {
    /// Of the venue file.
    pub venue: String,
    /// Of the calibration file.
    pub calibration: String,
}

impl Venue {
    /// Parses a venue file whose `calibration` has been parsed already.
    ///
    /// # Errors
    /// As [`VenueFile::parse`] and [`VenueFile::venue`].
    pub fn parse(text: &str, path: &Path, calibration: Calibration) -> Result<Self, FileError> {
        VenueFile::parse(text, path)?.venue(calibration)
    }

    /// The camera at `index`.
    pub fn camera(&self, index: CameraIndex) -> Option<&VenueCamera> {
        self.cameras.get(usize::from(index.0))
    }

    /// The viewpoint `name`.
    pub fn viewpoint_named(&self, name: &str) -> Option<ViewpointIndex> {
        self.viewpoints
            .iter()
            .position(|v| v.name == name)
            .map(|i| ViewpointIndex(i as u16))
    }

    /// Whether any source gives pictures, which need a network.
    pub fn needs_network(&self) -> bool {
        self.cameras
            .iter()
            .any(|camera| camera.source.gives_pictures())
    }
}

/// A parsed venue file: its fields and their types are valid, their values not yet checked.
pub struct VenueFile<'a> {
    file: TomlFile<'a>,
    raw: RawVenue,
}

impl<'a> VenueFile<'a> {
    /// Parses a venue file. Its paths are relative to the folder of `path`, which errors also name.
    ///
    /// # Errors
    /// [`FileError`] with line and field for broken syntax and for a missing, unknown, mistyped or
    /// misplaced field.
    pub fn parse(text: &'a str, path: &'a Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        layout::check(&file)?;
        let raw = file.read()?;
        Ok(Self { file, raw })
    }

    /// The path of its calibration file.
    pub fn calibration_path(&self) -> PathBuf {
        self.file.resolve(&self.raw.calibration)
    }

    /// Its field `network`: the path of a card, or the name of an installed network.
    pub fn network(&self) -> Option<&str> {
        self.raw.network.as_deref()
    }

    /// Its field `detector`, as [`Self::network`].
    pub fn detector(&self) -> Option<&str> {
        self.raw.detector.as_deref()
    }

    /// An error about its calibration file, at that field and its line.
    pub fn calibration_error(&self, problem: impl Into<String>) -> FileError {
        self.file.error(&Place::field("calibration"), problem)
    }

    /// The venue with the calibration from [`Self::calibration_path`].
    ///
    /// # Errors
    /// [`FileError`] with line and field for a value out of range or inconsistent with the
    /// calibration.
    pub fn venue(self, calibration: Calibration) -> Result<Venue, FileError> {
        let hashes = VenueHash {
            venue: self.file.fingerprint(),
            calibration: calibration.hash.clone(),
        };
        check::venue(&self.file, self.raw, calibration, hashes)
    }
}

#[cfg(test)]
mod tests;
