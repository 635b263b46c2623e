//! Scenes run through the whole system and scored against plain triangulation.

pub mod baseline;
pub mod budget;
pub mod people;
pub mod report;
pub mod run;
pub mod scenes;
pub mod smoothed;
pub mod studies;
