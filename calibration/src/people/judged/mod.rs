//! Assessment of a calibration from people.

pub(super) mod assess;
pub(super) mod evidence;
mod findings;
