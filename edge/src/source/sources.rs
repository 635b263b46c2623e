//! Opening of the sources of a venue. The edge does not know simulated sources; a program that
//! contains it can pass an opener that does.

use std::fmt::Debug;

use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};

use super::{FrameSource, SourceError, SourceInfo, open, probe};

/// Opens the sources of a venue's cameras.
pub trait Sources: Debug + Send + Sync {
    /// See [`probe`].
    ///
    /// # Errors
    /// [`SourceError`], with the file and the problem.
    fn probe(&self, camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError>;

    /// See [`open`].
    ///
    /// # Errors
    /// All errors of [`Self::probe`], and [`SourceError::OutsideClip`] if the recording does not
    /// have tick `from`.
    fn open(
        &self,
        camera: &VenueCamera,
        venue: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError>;
}

/// Recordings, live cameras and keypoint files. Simulated sources are refused.
#[derive(Debug, Clone, Copy, Default)]
pub struct RecordedSources;

impl Sources for RecordedSources {
    fn probe(&self, camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError> {
        probe(camera, venue)
    }

    fn open(
        &self,
        camera: &VenueCamera,
        venue: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError> {
        open(camera, venue, from)
    }
}
