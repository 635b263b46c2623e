//! Names and edits of a run's people: an append-only list next to the run or recording; every line
//! can be undone.
//!
//! [`change`] is one edit and its line in the file, [`list`] the file, [`identities`] the combined
//! effect of all edits and the presence of people, by which edits are checked. [`carried`]
//! transfers edits to poses with other ids. Poses are never rewritten: readers apply
//! [`Identities`], so undoing all edits gives the original.

pub mod carried;
pub mod change;
pub mod identities;
pub mod list;

pub use carried::{Carried, Counterparts};
pub use change::{Change, Edit, RefusedEdit};
pub use identities::{Identities, PersonRoll, Roll};
pub use list::EditList;

#[cfg(test)]
mod tests;
