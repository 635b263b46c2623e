//! Reading recordings: tick by tick for who solves them again, or in time for who looks on.

pub mod attached;
mod error;
pub mod messages;
mod placed;
pub mod published;
pub mod reader;
