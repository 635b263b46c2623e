//! What speaks for and against a calibration from people.

pub(super) mod assess;
pub(super) mod contradiction;
mod findings;
mod found;
mod suspects;
