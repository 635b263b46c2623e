//! One person as every writer gets them.

use crate::options::Options;
use crate::run::{PersonSurvey, Sample};
use crate::skeleton::{Offsets, Rig};
use crate::timeline::{Clock, Frame};

/// A person who is exported.
#[derive(Debug, Clone, Copy)]
pub struct Subject<'a> {
    /// The id.
    pub id: u32,
    /// What the person is called, as it was given.
    pub name: &'a str,
    /// Who that is.
    pub survey: &'a PersonSurvey,
    /// Names of the keypoints.
    pub keypoints: &'a [String],
    /// The frames of the files.
    pub clock: Clock,
    /// How files are written.
    pub options: &'a Options,
}

impl Subject<'_> {
    /// The skeleton at rest, of the lengths that the run settled on.
    pub fn rig(&self) -> Rig {
        Rig::new(&self.survey.offsets, self.options.rest)
    }

    /// The skeleton at rest, of the lengths of one moment.
    pub fn rig_at(&self, offsets: &Offsets) -> Rig {
        Rig::new(offsets, self.options.rest)
    }
}

/// The poses of a format that cannot say that nobody is there: the last pose is held, and before the first the first.
#[derive(Debug, Default)]
pub(crate) struct Held {
    last: Option<Sample>,
    waiting: u64,
}

impl Held {
    /// Takes a frame; calls `each` once for every frame that is known by now.
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
