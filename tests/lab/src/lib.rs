//! The laboratory: suites, studies, benches and long runs of the whole system. Its program is `lab`, which is [`main`]
//! and takes every command of `farfield` too; `lab help` lists them.
//!
//! Read [`in_process`] first: edges and fusion in one process, in lock-step and without a network. Most studies run
//! that loop. Then [`suite`]: scenes that are run through it and scored.
//!
//! | module | what |
//! | --- | --- |
//! | [`conditions`] | links that are cut, far or lossy, in ticks and without a network |
//! | [`live_venue`], [`relay`], [`namespaces`], [`small_disk`] | live venues of processes, or of edges played from a recording; the relays and network namespaces between them; disks that are full or hang |
//! | [`bytes`] | our codec of maps beside what others send, bytes beside errors |
//! | [`view_peaks`], [`leave_one_out`] | plain triangulation to compare with, and a comparison that needs no truth |
//! | [`afar`] | real recordings as a camera much farther away would have made them |
//! | [`ring`] | a walker in a ring of viewpoints, for benches and tests of fusion alone |
//! | [`hostile_input`], [`corpus`] | what the fuzz targets run, and the inputs that fuzzers found |
//! | [`reading`] | this project's own files: their sizes and words |

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
pub mod small_disk;
pub mod suite;
pub mod view_peaks;

pub use self::commands::main;
