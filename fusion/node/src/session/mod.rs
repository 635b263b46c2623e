//! Fusion's side of the links: the session, incoming and outgoing messages, observers, refused nodes, and other fusions.

pub(super) mod authentication_log;
mod inbox;
pub(super) mod interceptor;
pub(super) mod link;
pub(super) mod messages;
pub(super) mod other_fusion;
pub(super) mod outbox;
mod publishers;
mod quota;
mod recorded_sets;
mod subscribers;
pub(super) mod wiretap;
