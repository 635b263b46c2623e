//! One person, as passed to every writer.

use crate::options::Options;
use crate::run::{PersonSurvey, Sample};
use crate::skeleton::{Offsets, Rig};
use crate::timeline::{Clock, Frame};

/// An exported person.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The id.
    pub id: u32,
    /// Name of the person, as given.
    pub name: &'a str,
    /// Survey of the person.
    pub survey: &'a PersonSurvey,
    /// Names of the keypoints.
    pub keypoints: &'a [String],
    /// The frames of the files.
    pub clock: Clock,
    /// Options of the export.
    pub options: &'a Options,
}

impl Subject<'_> {
    /// The skeleton at rest with the final lengths of the run.
    pub fn rig(&self) -> Rig {
        Rig::new(&self.survey.offsets, self.options.rest)
    }

    /// The skeleton at rest with the lengths of one moment.
    pub fn rig_at(&self, offsets: &Offsets) -> Rig {
        Rig::new(offsets, self.options.rest)
    }
}

/// Frames of a format that cannot represent absence: holds the last pose; before the first pose,
/// uses the first.
#[derive(Debug, Default)]
pub(crate) struct HoldLast {
    last: Option<Sample>,
    waiting: u64,
}

impl HoldLast {
    /// Adds a frame; calls `each` for every frame that is known now.
    pub(crate) fn push<E>(
        &mut self,
        frame: &Frame,
        mut each: impl FnMut(&Sample) -> Result<(), E>,
    ) -> Result<(), E> {
        if let Some((sample, _)) = &frame.pose {
            for _ in 0..std::mem::take(&mut self.waiting) {
                each(sample)?;
            }
            self.last = Some(sample.clone());
        }
        if let Some(sample) = &self.last {
            return each(sample);
        }
        self.waiting += 1;
        Ok(())
    }
}
