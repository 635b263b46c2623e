//! One thing among others, over many frames.
