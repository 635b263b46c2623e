//! What the shell of every Farfield node needs, written once: edge, fusion and recorder are processes with the same
//! clock, the same signals, the same log and a session with each other.
//!
//! Read [`process`] first: how a node is told to stop, how it ends, and what it says then. [`session`] is how it
//! speaks with others, [`endpoints`] where and as whom. [`files`] reads what describes a venue, which
//! [`farfield_proto`] then understands without opening anything. The rest is one function or type each:
//!
//! | module | what |
//! | --- | --- |
//! | [`certificate`] | until when a node's certificate holds |
//! | [`clock`] | the only reader of the machine's clock; the venue's clock, which never jumps |
//! | [`command_line`] | options that can do without a value, joined to theirs where they have one |
//! | [`histogram`] | how long things took, over days, in bounded room |
//! | [`keys`] | whether a node's keys are those of its venue and its authority, and fit each other |
//! | [`log`] | what a node logs, and how it listens in on a library's log |
//! | [`service_manager`] | what systemd hears of a node |
//! | [`system_clock`] | whether NTP or PTP keeps the machine's clock right |
//! | [`runtime`] | starting the runtime, and ending it whatever still waits |
//!
//! Nothing here knows what a node works on: what only edges or only fusion need lies with them.

pub mod certificate;
pub mod clock;
pub mod command_line;
pub mod endpoints;
pub mod files;
pub mod histogram;
pub mod keys;
pub mod log;
pub mod process;
pub mod runtime;
pub mod service_manager;
pub mod session;
pub mod system_clock;
