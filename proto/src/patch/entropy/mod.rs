//! Entropy coding: the range coder, and the binary form of integers.

pub(in crate::patch) mod range_coder;
pub(in crate::patch) mod symbol;
