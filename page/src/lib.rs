//! The live page: what is known of a venue, served to browsers and to programs, by the protocol of `docs/page.md`.
//!
//!
//! | module | what |
//! | --- | --- |
//! | [`protocol`] | messages as bytes and as JSON, pure |
//! | [`playback`] | where a client is in time, pure |
//! | [`qr`] | an address as a picture in a terminal |

pub mod actions;
pub mod playback;
pub mod protocol;
pub mod qr;
pub mod skeleton;

pub use actions::{Action, ActionKind, PageActions};
pub use skeleton::{Angle, AngleUnit, Skeleton};
