//! What becomes of everybody: facts in, events out. Pure: the same facts give the same events.
//!
//! ```text
//!   lives         who is confirmed, lost, found, or let go for want of evidence
//!   recognition   which of the confirmed was here before; who is found elsewhere
//!   places        who has left the field; who steps back from, or stands in, another's place, or a given one's
//!   sighted       which sighted persons are a tentative track that waits, a lost person, or somebody new
//! ```
//!
//! The stages of a tick, in this order, because each needs to know where bodies stand after the one before was
//! applied ([`super::registry::Registry::step`] says why they follow each other):
//!
//! ```text
//!   lives::decide                  over all tracks, by what the tick counted
//!   recognition::decide            over those whom lives confirmed
//!   recognition::found_elsewhere   over the lost tracks of who was recognised
//!   places::outside_the_field
//!   places::step_back
//!   places::same_place             over pairs that are still in one place
//!   sighted::reinitiate            over what the detection pass found, if there was one
//!   sighted::revive                over what is left of that; the rest is new
//!   places::replaced_by_hand       for each who is given by hand at the next tick
//! ```

pub(crate) mod lives;
pub(crate) mod places;
pub(crate) mod recognition;
pub(crate) mod sighted;
