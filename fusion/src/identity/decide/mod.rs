//! Decisions about all tracks: facts in, events out. Pure: the same facts give the same events.
//!
//! ```text
//!   lives         who is confirmed, lost, found, or dropped for lack of evidence
//!   recognition   which confirmed person was here before; who is found elsewhere
//!   places        who has left the field, steps back, or stands in the place of another or of a given person
//!   sighted       which sighted persons are a waiting tentative track, a lost person, or new
//! ```
//!
//! The stages of a tick run in this order, because each needs the places of bodies after the
//! previous stage was applied ([`super::registry::Registry::step`] gives the reasons):
//!
//! ```text
//!   lives::decide                  over all tracks, from the counts of the tick
//!   recognition::decide            over the people that lives confirmed
//!   recognition::found_elsewhere   over the lost tracks of recognised people
//!   places::outside_the_field
//!   places::step_back
//!   places::same_place             over pairs that are still in one place
//!   sighted::reinitiate            over the sighted persons of a detection pass, if there was one
//!   sighted::revive                over the remaining ones; the rest is new
//!   places::replaced_by_hand       for each person given by hand at the next tick
//! ```

pub(crate) mod lives;
pub(crate) mod places;
pub(crate) mod recognition;
pub(crate) mod sighted;
