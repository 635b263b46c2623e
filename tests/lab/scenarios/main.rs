//! Whole-system scenarios: the commands of `farfield`, through the built `lab`, with real processes, sockets and files.
#![expect(
    clippy::unwrap_used,
    reason = "what goes wrong in a scenario fails it, with its place"
)]

mod agreement;
mod bad_input;
mod before_a_run;
mod data;
mod demo;
mod far_people;
mod farfield;
mod fisheye;
mod live;
mod mistakes;
mod nets;
mod nodes_by_hand;
mod other_programs;
mod outputs;
mod recording;
mod same_bits;
mod shelf;
mod stopping;
mod strangers;
mod suite;
mod tidy;
mod treadmill;
