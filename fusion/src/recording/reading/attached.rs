//! Metadata of a recording: versions and fingerprints, and the files that describe its venue.

use std::collections::BTreeMap;
use std::io::{Read, Seek};

use mcap::records::{AttachmentHeader, Metadata};

use super::RecordingError;
use crate::recording::framing::find_metadata;
use crate::recording::{CALIBRATION_FILE, CARD_FILE, FACTS, PROFILE, VENUE_FILE, is_subject_file};

/// Metadata of a recording.
#[derive(Debug, Clone, Default)]
pub struct Attached {
    profile: Option<String>,
    facts: BTreeMap<String, String>,
    files: BTreeMap<String, Vec<u8>>,
}

impl Attached {
    /// Versions, fingerprints, recorder.
    pub fn facts(&self) -> &BTreeMap<String, String> {
        &self.facts
    }

    /// The attached file `name`, as text.
    pub fn file(&self, name: &str) -> Option<&str> {
        std::str::from_utf8(self.files.get(name)?).ok()
    }

    /// The metadata of `file`, which define its topics. They are read before the messages, even if
    /// they come after them. The first facts of the file count.
    pub(super) fn from_metadata<R: Read + Seek>(file: &mut R) -> Result<Self, RecordingError> {
        let is_ours = |record: &Metadata| record.name == FACTS && !record.metadata.is_empty();
        let facts = find_metadata(file, is_ours)?;
        Ok(Self {
            facts: facts.map_or_else(BTreeMap::new, |record| record.metadata),
            ..Self::default()
        })
    }

    /// The first header of the file counts.
    pub(super) fn header(&mut self, profile: String) {
        self.profile = self.profile.take().or(Some(profile));
    }

    pub(super) fn attachment(&mut self, header: AttachmentHeader, data: Vec<u8>) {
        let ours = [VENUE_FILE, CALIBRATION_FILE, CARD_FILE];
        if ours.contains(&header.name.as_str()) || is_subject_file(&header.name) {
            self.files.entry(header.name).or_insert(data);
        }
    }

    /// Returns `self` after the whole file was read.
    ///
    /// # Errors
    /// If it is not our recording, or ends before its head does.
    pub(super) fn whole(self) -> Result<Self, RecordingError> {
        match self.profile {
            Some(profile) if profile != PROFILE => Err(RecordingError::Foreign(profile)),
            Some(_) if !self.facts.is_empty() => Ok(self),
            _ => Err(RecordingError::NoHead),
        }
    }
}
