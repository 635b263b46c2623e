//! The laboratory: suites, studies and baselines over the loop of edges and fusion inside one process,
//! and live venues behind relays. Its program is `lab`, which is [`main`].

pub mod afar;
pub mod bytes;
mod commands;
pub mod conditions;
pub mod corpus;
pub mod hostile_input;
pub mod in_process;
pub mod leave_one_out;
pub mod live_venue;
pub mod namespaces;
pub mod reading;
pub mod relay;
pub mod ring;
pub mod suite;
pub mod view_peaks;

pub use self::commands::main;
