//! Fusion's side of the wire: the session, what comes in and goes out, who listens in, who was turned away.

pub(super) mod authentication_log;
pub(super) mod link;
pub(super) mod mode;
pub(super) mod subscribers;
pub(super) mod wiretap;
