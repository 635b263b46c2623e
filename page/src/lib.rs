//! The live page: what is known of a venue, served to browsers and to programs, by the protocol of `docs/page.md`.
//!
//! It is fed with what passes on the wire anyway (or stands in a recording) by [`state::PageState::message`], knows nothing
//! of Zenoh, and holds nobody up: what it has no room for it drops, and says so. [`server::Server`] serves it. What pages
//! ask for beyond looking is done by who runs the server, behind [`actions::PageActions`].
//!
//! | module | what |
//! | --- | --- |
//! | [`protocol`] | messages as bytes and as JSON, pure |
//! | [`state`] | what is known now, alarms in words, latencies; the ticks that can be gone to, of the last minutes or of a recording |
//! | [`playback`] | where a client is in time, pure |
//! | [`server`] | HTTP, WebSockets, TLS, who may ask what; the page on which marks are clicked |
//! | [`qr`] | an address as a picture in a terminal |

#[cfg(test)]
extern crate self as farfield_page;

pub mod actions;
mod calibration;
pub mod playback;
pub mod protocol;
pub mod qr;
pub mod server;
pub mod skeleton;
pub mod state;

pub use actions::{Action, ActionKind, PageActions};
pub use calibration::{CalibrationSheet, ShownCalibration};
pub use server::{Clicking, ClickingServer, Server, ServerOptions, Taken};
pub use skeleton::{Angle, AngleUnit, Skeleton};
pub use state::{HistoryBounds, PageOptions, PageState, RecordedMessages};
