//! The venue file: one installation, its viewpoints, cameras, sources and parameters.
//!
//! Everything is refused here, at start, with file, line and field; nothing is refused at tick
//! 900. Text in, venue out: who opens the files is the caller.

mod check;
mod field;
mod file;
mod given;
mod inference;
pub mod layout;
mod limits;
pub mod parameters;
mod raw;
pub mod same_files;
mod source;
mod stream;
mod subject;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use file::VenueFile;
pub use inference::Provider;
pub use parameters::Parameters;
pub use source::{ControlValue, DeviceSettings, SimulatedContent, Source};
pub use stream::{StreamField, VenueStream};
pub use subject::{KnownBy, VenueSubject};

use crate::calibration::Calibration;
use crate::camera::CameraModel;
use crate::court::PlacedCourt;
use crate::id::{CameraIndex, ViewpointIndex};
use crate::tick::Tick;
use crate::toml_file::FileError;

/// One installation, read and checked.
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
    /// The keypoint network's card; there is one unless no source gives pictures.
    pub network: Option<PathBuf>,
    /// The detector's card.
    pub detector: Option<PathBuf>,
    /// Where fusion listens and edges connect.
    pub endpoints: Endpoints,
    /// Who may talk to whom.
    pub security: Security,
    /// Where people are tracked.
    pub field: Field,
    /// The court that is painted on its floor.
    pub court: Option<PlacedCourt>,
    /// The viewpoints in file order; a [`ViewpointIndex`] counts them.
    pub viewpoints: Vec<Viewpoint>,
    /// The cameras of all viewpoints in file order; a [`CameraIndex`] counts them.
    pub cameras: Vec<VenueCamera>,
    /// People given by hand.
    pub given_persons: Vec<GivenPerson>,
    /// Where live poses shall go for other programs: opened by the command that runs fusion, by nobody else.
    pub streams: Vec<VenueStream>,
    /// Who may come, in file order: fusion knows them by their bodies.
    pub subjects: Vec<VenueSubject>,
    /// The tunable parts of the method.
    pub parameters: Parameters,
    /// What tells this venue from any other.
    pub hashes: VenueHash,
}

/// Zenoh endpoints; empty lists mean that the command chooses.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Endpoints {
    /// Where fusion listens.
    pub listen: Vec<String>,
    /// Where edges connect.
    pub connect: Vec<String>,
}

/// `[security]`: who may talk to whom.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Security {
    /// The folder of `ca.pem`, `NODE.pem` and `NODE.key`; `None`: there is no TLS.
    pub certificates: Option<PathBuf>,
    /// Whether nodes may talk to other machines without TLS.
    pub allow_plaintext: bool,
    /// Whether small pictures of the cameras may leave the edges, for people to look at; never without TLS but on one
    /// machine.
    pub pictures: bool,
}

/// The box in which people are tracked, world, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Least x, y and z.
    pub min_m: [f64; 3],
    /// Largest x, y and z.
    pub max_m: [f64; 3],
    /// Height of the floor that people stand on, z: 0, or as near as the field reaches, or that of a stage.
    pub floor_m: f64,
}

/// One place with one edge and its cameras.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Viewpoint {
    /// Its name, a part of Zenoh keys.
    pub name: String,
    /// Its cameras, at least one.
    pub cameras: Vec<CameraIndex>,
    /// What may run its networks while it works live, tried in this order; none: the processor.
    pub providers: Vec<Provider>,
}

/// One camera with its place and its pictures.
#[derive(Debug, Clone, PartialEq)]
pub struct VenueCamera {
    /// Whose camera it is.
    pub viewpoint: ViewpointIndex,
    /// Its calibration.
    pub model: CameraModel,
    /// Where its pictures come from.
    pub source: Source,
    /// What says which tick a frame is of.
    pub tick_from: TickFrom,
    /// How long before it arrives, or before its driver stamps it, a live frame is captured, seconds; `None`: as the camera says,
    /// else 0.
    pub capture_delay_s: Option<f64>,
}

/// What says which tick a frame is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum TickFrom {
    /// Live: the time of its capture, by clocks that PTP or NTP keep together. Recorded: its place in the
    /// recording, which begins at `first_tick`.
    #[default]
    Clock,
    /// Live: the camera's own count of the frames that a hardware trigger has taken.
    Count,
    /// Recorded: the SMPTE timecode that the recording begins with, in frames since midnight.
    Timecode,
}

impl TickFrom {
    /// As it is written in a venue file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Clock => "clock",
            Self::Count => "count",
            Self::Timecode => "timecode",
        }
    }
}

/// A person given by hand instead of found.
#[derive(Debug, Clone, PartialEq)]
pub struct GivenPerson {
    /// When.
    pub tick: Tick,
    /// Known keypoints by name, world, metres.
    pub keypoints_m: BTreeMap<String, [f64; 3]>,
}

/// Fingerprints of the files that all nodes must share: 16 hexadecimal digits each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VenueHash {
    /// Of the venue file.
    pub venue: String,
    /// Of the calibration file.
    pub calibration: String,
}

impl Venue {
    /// Reads the text of a venue file whose `calibration` has been read already.
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

    /// The viewpoint called `name`.
    pub fn viewpoint_named(&self, name: &str) -> Option<ViewpointIndex> {
        self.viewpoints
            .iter()
            .position(|v| v.name == name)
            .map(|i| ViewpointIndex(i as u16))
    }

    /// Whether any source gives pictures, which need a network to become maps.
    pub fn needs_network(&self) -> bool {
        self.cameras
            .iter()
            .any(|camera| camera.source.gives_pictures())
    }
}

#[cfg(test)]
mod tests;
