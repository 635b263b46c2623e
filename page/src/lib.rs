//! The live page: shows the state of a venue to browsers and programs, by the protocol of
//! `docs/page.md`.
//!
//! [`state::PageState::message`] accepts the messages that pass on the wire or are in a recording.
//! The crate knows nothing of Zenoh and never blocks its caller: without room it drops messages and
//! counts them. [`server::Server`] serves the page. The host program performs actions that pages
//! request, through [`PageActions`].
//!
//! | module | content |
//! | --- | --- |
//! | [`protocol`] | messages as bytes and JSON, pure |
//! | [`state`] | current state, alarms, latencies; ticks of the last minutes or of a recording |
//! | [`playback`] | playback position of a client, pure |
//! | [`server`] | HTTP, web sockets, TLS, access rules; the page for clicking marks |
//! | [`qr`] | QR code of an address for a terminal |

#[cfg(test)]
extern crate self as farfield_page;

mod calibration;
pub mod playback;
pub mod protocol;
pub mod qr;
pub mod server;
pub mod skeleton;
pub mod state;

pub use calibration::{CalibrationSheet, ShownCalibration};
pub use protocol::request::Action;
pub use protocol::text::ActionKind;
pub use server::{Clicking, ClickingServer, Server, ServerOptions, Taken};
pub use skeleton::{Angle, AngleUnit, Skeleton};
pub use state::{HistoryBounds, PageActions, PageOptions, PageState, RecordedMessages};
