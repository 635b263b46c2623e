//! Exchange with other programs: imports and exports; and the names of people.

pub(crate) mod export;
pub(crate) mod import;
pub(crate) mod people;
pub(crate) mod place;
pub(crate) mod recorded;
pub(crate) mod target;
