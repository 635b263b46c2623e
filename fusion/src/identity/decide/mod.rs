//! What becomes of everybody: facts in, events out. Pure: the same facts give the same events.
//!
//! ```text
//!   lives         who is confirmed, lost, found, or let go for want of evidence
//!   recognition   which of the confirmed was here before; who is found elsewhere
//!   places        who has left the field; who steps back from, or stands in, another's place
//!   sighted       which sighted persons are a tentative track that waits, a lost person, or somebody new
//! ```
//!
//! One call per stage: each needs to know where bodies stand after the one before was applied.

pub(crate) mod lives;
pub(crate) mod places;
pub(crate) mod recognition;
pub(crate) mod sighted;
