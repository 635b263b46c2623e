//! Names and edits of a run's people: an append-only list beside the run or recording, each of whose lines can be undone.
//!
//! [`change`] is one edit as a line of the file, [`list`] the file, [`identities`] what all edits come to: who of the poses is
//! whom, and what they are called. [`roll`] is who is there when, by which edits are checked, [`carried`] what of them holds for poses with other ids. Poses are never written anew:
//! whoever reads them asks [`Identities`], so that taking back all edits gives the original.

pub mod carried;
pub mod change;
pub mod identities;
pub mod list;
pub mod roll;

pub use carried::{Carried, Counterparts};
pub use change::{Change, Edit, RefusedEdit};
pub use identities::Identities;
pub use list::EditList;
pub use roll::{PersonRoll, Roll};

#[cfg(test)]
mod tests;
