//! Lock-step: fusion waits for every edge at every tick.

pub(super) mod readiness;
pub(super) mod run;
pub(super) mod start;
