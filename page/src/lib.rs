//! The live page: what is known of a venue, served to browsers and to programs, by the protocol of `docs/page.md`.
//!
//! It is fed with what passes on the wire anyway (or stands in a recording) by [`state::PageState::message`], knows nothing
//!
//! | module | what |
//! | --- | --- |
//! | [`protocol`] | messages as bytes and as JSON, pure |
//! | [`state`] | what is known now, alarms in words, latencies |
//! | [`history`], [`recording`] | the ticks that can be gone to |
//! | [`playback`] | where a client is in time, pure |
//! | [`qr`] | an address as a picture in a terminal |

pub mod actions;
pub mod history;
pub mod playback;
pub mod protocol;
pub mod qr;
pub mod recording;
pub mod skeleton;
pub mod state;

pub use actions::{Action, ActionKind, PageActions};
pub use recording::RecordedMessages;
pub use skeleton::{Angle, AngleUnit, Skeleton};
pub use state::{PageOptions, PageState};
