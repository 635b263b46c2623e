//! Files of other programs: what they have found comes in, what we have found goes out, with the names of people.

mod cameras;
pub(crate) mod export;
pub(crate) mod import;
pub(crate) mod people;
pub(crate) mod place;
pub(crate) mod recorded;
pub(crate) mod target;
