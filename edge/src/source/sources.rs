//! How a program opens the sources of a venue. The edge knows nothing of simulated people; the command that contains it
//! may hand in an opener that does.

use std::fmt::Debug;

use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};

use super::{FrameSource, SourceError, SourceInfo, open, probe};

/// Opens the sources of a venue's cameras, whatever their kinds.
pub trait Sources: Debug + Send + Sync {
    /// As [`probe`].
    ///
    /// # Errors
    /// [`SourceError`], naming the file and what is wrong with it.
    fn probe(&self, camera: &VenueCamera, venue: &Venue) -> Result<SourceInfo, SourceError>;

    /// As [`open`].
    ///
    /// # Errors
    /// All of [`Self::probe`]'s, and [`SourceError::OutsideClip`] when the recording has no tick
    /// `from`.
    fn open(
        &self,
        camera: &VenueCamera,
        venue: &Venue,
        from: Tick,
    ) -> Result<Box<dyn FrameSource>, SourceError>;
}

/// Recordings, live cameras and keypoint files: all that an edge knows by itself. Simulated sources
/// are refused by name.
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
