//! Lossy maps: the peaks of a map as Gaussians of a few integers, and corrections of the remaining
//! error.
//!
//! The encoder fits ([`fit`]) and chooses ([`explain`]) the Gaussians ([`mode`]). [`drawing`] draws
//! them, the same on both sides. [`mode_coder`] and [`correction`] write or read them in adaptive
//! [`contexts`] that start with [`priors`]. [`recipe`] defines the precision of each compression
//! level.

pub(in crate::patch) mod contexts;
pub(in crate::patch) mod correction;
mod drawing;
pub(in crate::patch) mod explain;
mod fit;
pub(in crate::patch) mod mode;
pub(in crate::patch) mod mode_coder;
mod priors;
pub(in crate::patch) mod recipe;
mod rounding;
