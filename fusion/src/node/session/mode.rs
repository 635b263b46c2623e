//! In which of the two ways a run deals with time.

/// What messages are worth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::node) enum RunMode {
    /// All of them come, in order, however long it takes.
    LockStep,
    /// The newest counts; what cannot go at once is dropped.
    Live,
}
