//! Fusion's side of the wire: the session, what comes in and goes out, who listens in, who was turned away.

pub(super) mod authentication_log;
mod inbox;
pub(super) mod interceptor;
pub(super) mod link;
pub(super) mod messages;
pub(super) mod mode;
mod publishers;
mod quota;
mod subscribers;
pub(super) mod wiretap;
