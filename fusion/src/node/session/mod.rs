//! Fusion's side of the wire: the session, what comes in and goes out, who listens in, who was turned away,
//! whether there is another fusion.

pub(super) mod authentication_log;
mod inbox;
pub(super) mod interceptor;
pub(super) mod link;
pub(super) mod messages;
pub(super) mod mode;
pub(super) mod other_fusion;
mod publishers;
mod quota;
mod recorded_sets;
mod subscribers;
pub(super) mod wiretap;
