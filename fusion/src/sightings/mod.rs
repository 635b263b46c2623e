//! Bodies that several viewpoints sighted without a box.
//!
//! ```text
//!   sightings -> rays -> growth -> association -> reconstruction, plausibility -> finder: SightedPerson
//!   explanation: which sightings a known body explains; contradiction: which viewpoints should see it and do not
//!   agreement: whether two sightings agree, and how near, and where, rays must meet
//!   attention: the weight of a silent viewpoint; diagnosis: why sightings gave no people
//! ```
//!
//! All comparisons are in the world, in metres. Identities are decided in [`crate::identity`].

mod agreement;
mod association;
mod attention;
pub(crate) mod contradiction;
pub mod diagnosis;
pub(crate) mod explanation;
pub mod finder;
#[cfg(test)]
pub(crate) mod fixture;
mod growth;
mod plausibility;
pub(crate) mod rays;
pub(crate) mod reconstruction;
