//! Bodies that several viewpoints sighted without a box.
//!
//! ```text
//!   sightings -> rays -> growth -> association -> reconstruction, plausibility -> finder: SightedPerson
//!   explanation: which sightings a known body explains; contradiction: which viewpoints should see it and do not
//!   agreement: what two sightings say about each other; gates: how near, and where, rays must meet
//!   attention: what the silence of a viewpoint is worth; diagnosis: why sightings became nobody
//! ```
//!
//! Everything is compared in the world, in metres. Who is who is not decided here.

mod agreement;
mod association;
mod attention;
pub(crate) mod contradiction;
pub mod diagnosis;
pub(crate) mod explanation;
pub mod finder;
#[cfg(test)]
pub(crate) mod fixture;
mod gates;
mod growth;
mod plausibility;
pub(crate) mod rays;
pub(crate) mod reconstruction;
