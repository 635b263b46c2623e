//! The loop of edges and fusion inside one process, and live venues behind relays, for tests and studies.

pub mod afar;
pub mod bytes;
pub mod conditions;
pub mod in_process;
pub mod leave_one_out;
pub mod live_venue;
pub mod namespaces;
pub mod relay;
pub mod ring;
pub mod suite;
pub mod view_peaks;
