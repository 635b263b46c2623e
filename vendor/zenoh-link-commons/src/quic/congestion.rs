//! Farfield's addition to this crate: see FARFIELD.md.

use std::{any::Any, sync::Arc, time::Instant};

use quinn::congestion::{Controller, ControllerFactory, Cubic, CubicConfig};
use quinn_proto::RttEstimator;

/// Makes [`SteadyWindow`]s.
#[derive(Clone, Debug)]
pub(crate) struct SteadyWindowConfig {
    /// Bytes that may be in flight whatever was lost.
    pub(crate) min_window: u64,
}

impl ControllerFactory for SteadyWindowConfig {
    fn build(self: Arc<Self>, now: Instant, current_mtu: u16) -> Box<dyn Controller> {
        Box::new(SteadyWindow {
            cubic: Cubic::new(Arc::new(CubicConfig::default()), now, current_mtu),
            min_window: self.min_window,
        })
    }
}

/// Cubic, but never below a window that the application answers for.
///
/// Cubic takes every lost packet for a full queue. An application that has its own rate control, and
/// whose messages are lost for good when they are late, must not wait because a radio link lost one.
#[derive(Clone, Debug)]
struct SteadyWindow {
    cubic: Cubic,
    min_window: u64,
}

impl Controller for SteadyWindow {
    fn on_ack(
        &mut self,
        now: Instant,
        sent: Instant,
        bytes: u64,
        app_limited: bool,
        rtt: &RttEstimator,
    ) {
        self.cubic.on_ack(now, sent, bytes, app_limited, rtt);
    }

    fn on_congestion_event(
        &mut self,
        now: Instant,
        sent: Instant,
        is_persistent_congestion: bool,
        lost_bytes: u64,
    ) {
        self.cubic
            .on_congestion_event(now, sent, is_persistent_congestion, lost_bytes);
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.cubic.on_mtu_update(new_mtu);
    }

    fn window(&self) -> u64 {
        self.cubic.window().max(self.min_window)
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        self.cubic.initial_window().max(self.min_window)
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}
