//! Files of other programs: what they have found comes in, what we have found goes out.

pub(crate) mod export;
pub(crate) mod import;
mod place;
mod recorded;
