//! The loop of edges and fusion inside one process, and live venues behind relays, for tests and studies.

pub mod afar;
#[cfg(feature = "loop")]
pub mod bytes;
#[cfg(feature = "loop")]
pub mod conditions;
#[cfg(feature = "loop")]
pub mod in_process;
#[cfg(feature = "loop")]
pub mod leave_one_out;
#[cfg(feature = "loop")]
pub mod live_venue;
pub mod namespaces;
pub mod relay;
pub mod ring;
#[cfg(feature = "loop")]
pub mod suite;
pub mod view_peaks;
