//! Identity: how people are found, confirmed, followed, lost, recognised and dropped.
//!
//! ```text
//!   facts     the state of each track at a tick, as plain values
//!   decide    facts -> events: pure, a table of rules
//!   registry  applies events to the tracks, and publishes them
//! ```
//!
//! A phase ([`phase::Phase`]) is stored only in [`track::TrackIdentity`], and only events change
//! it. Counts of evidence are stored next to it ([`phase::Coverage`]). Some decisions need the
//! outcome of others, for example where a body stands once its first ticks were solved again. So a
//! tick is decided in a few stages: [`registry::Registry::step`] lists them.

mod decide;
mod detection_scheduler;
mod event;
mod facts;
pub mod known;
pub mod phase;
mod poster;
mod recognise;
pub mod registry;
mod shown;
pub mod subjects;
pub mod track;
mod whereabouts;
