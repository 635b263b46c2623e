//! A venue that runs live, with faults: killed nodes, cut links, wrong clocks, failing cameras, hostile bytes.
//!
//! Every scenario starts real nodes behind relays (see `farfield_lab::live_venue`), waits until all people are tracked, and
//! injects its fault. It then checks that the other nodes work on, that the fault is reported with the name of the node, and
//! that nothing leaks. Waiting ends when a condition holds, so that a slow machine does not fail a test.

mod edges;
mod fusion;
mod hostile;
mod links;
mod page;
mod passwords;
mod recording;
mod run;
mod stage;
mod thumbnails;
