//! Numbers to bytes at nearly their information: the range coder, and how whole numbers are split into bits.

pub(in crate::patch) mod range_coder;
pub(in crate::patch) mod symbol;
