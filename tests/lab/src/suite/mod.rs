//! Scenes run through the whole system and scored, beside what plain triangulation gets.

pub mod bars;
pub mod baseline;
pub mod bodies;
pub mod budget;
pub mod butterworth;
pub mod gaps;
pub mod limits;
pub mod meetings;
pub mod outliers;
pub mod overrides;
pub mod overview;
pub mod presence;
pub mod recovery;
pub mod report;
pub mod run;
pub mod scenes;
pub mod smoothed;
pub mod studies;
pub mod tee;
pub mod venue;
