//! Who is who: how persons are found, confirmed, followed, lost, recognised and let go.
//!
//! ```text
//!   facts     what the tick knows of each track, as plain values
//!   decide    facts -> events: pure, a table of rules
//!   registry  applies events to the tracks, and publishes them
//! ```
//!
//! A phase ([`phase::Phase`]) is stored in one place, [`track::TrackIdentity`], and changed by events alone; what
//! ticks count of the evidence is kept beside it ([`phase::Coverage`]). Some
//! decisions need the outcome of others (where a body stands once its first ticks were solved again), so a
//! tick is decided in a few stages: [`registry::Registry::step`] reads as their sequence.

mod confirmation;
mod decide;
mod detection_scheduler;
mod event;
mod facts;
pub mod known;
mod memory;
pub mod phase;
mod poster;
mod recognise;
pub mod registry;
mod shown;
pub mod subjects;
mod tentative;
pub mod track;
mod whereabouts;
