//! The laboratory: suites, studies, benches and long runs of the whole system. Its program is `lab`, which is [`main`] and
//! has every command of `farfield` too; `lab help` lists them.
//!
//! Start with [`in_process`]: edges and fusion in one process, in lock-step and without a network. Most studies run that
//! loop. Then read [`suite`]: scenes that run through it and are scored.
//!
//! | module | what |
//! | --- | --- |
//! | [`conditions`] | links that are cut, far or lossy, in ticks and without a network |
//! | [`live_venue`], [`relay`], [`namespaces`], [`small_disk`] | live venues of processes, or of edges played from a recording; relays and network namespaces between them; disks that are full or hang |
//! | [`bytes`] | our codec of maps and other codecs: bytes against errors |
//! | [`view_peaks`], [`leave_one_out`] | plain triangulation as a reference, and a comparison with a view that was withheld |
//! | [`afar`] | real recordings as from a camera much farther away |
//! | [`ring`] | a walker in a ring of viewpoints, for benches and tests of fusion alone |
//! | [`hostile_input`], [`corpus`] | the functions of the fuzz targets, and the inputs that fuzzers found |
//! | [`reading`] | sizes and words of this project's own files |

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
