//! The common shell of all Farfield nodes. Edge, fusion and recorder are processes with the same
//! clock, signals and log, and with a session between them.
//!
//! Read [`process`] first: how a node stops and reports its end. [`session`] connects it to other
//! nodes, [`endpoints`] gives its addresses and identity. [`files`] reads the files of a venue,
//! which [`farfield_proto`] parses without opening anything. The other modules have one function or
//! type each:
//!
//! | module | content |
//! | --- | --- |
//! | [`certificate`] | the validity of a node's certificate |
//! | [`clock`] | the only reader of the machine's clock; the venue's clock, which never jumps |
//! | [`command_line`] | options with an optional value |
//! | [`histogram`] | durations over days, in bounded memory |
//! | [`keys`] | checks that a node's keys belong to its venue, its authority and each other |
//! | [`log`] | a node's log, and a listener to a library's log |
//! | [`networks`] | the folder of installed networks |
//! | [`service_manager`] | reports to systemd |
//! | [`system_clock`] | whether NTP or PTP synchronises the machine's clock |
//! | [`runtime`] | starts the runtime and ends it without waiting |
//!
//! Nothing here depends on the work of a node: code for edges or for fusion is in their crates.

pub mod certificate;
pub mod clock;
pub mod command_line;
pub mod endpoints;
pub mod files;
pub mod histogram;
pub mod keys;
pub mod log;
pub mod networks;
pub mod process;
pub mod runtime;
pub mod service_manager;
pub mod session;
pub mod system_clock;
