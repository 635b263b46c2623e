//! Alarms of clocks: one that nothing keeps right, where it matters, and one that is far off.

use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::Micros;

use super::Found;
use crate::protocol::status::Severity;

/// A clock that nothing keeps right is worth a word where its offset is known no better than this, microseconds: a runner at 8 m/s is
/// 16 mm farther by then. Fusion measures and corrects the rest, and nodes on one machine have one clock.
const MATTERS_US: Micros = 2_000;

impl Found<'_> {
    /// A clock that neither NTP nor PTP keeps right, and of which fusion does not know well enough how far it is off.
    pub(super) fn free_clock(&mut self, node: Option<ViewpointIndex>, subject: &str) {
        let Some(heard) = self.of.nodes.get(node) else {
            return;
        };
        let system = heard.status.health.system_clock;
        let is_free = system.is_some_and(|system| !system.synchronised);
        if !is_free || heard.status.live.is_none() || !self.is_badly_known(node) {
            return;
        }
        let name = self.of.context.node_name(node).to_owned();
        self.say(
            Severity::Warning,
            format!("clock/{name}/free"),
            subject,
            format!("nothing keeps the clock of {subject} right"),
            "start NTP or PTP on it (`timedatectl set-ntp true`, or chrony)",
        );
    }

    /// Whether the offset of a node's clock, of fusion that of any edge's against it, is known no better than what matters.
    fn is_badly_known(&self, node: Option<ViewpointIndex>) -> bool {
        let links = self.of.nodes.links(self.of.context);
        let mut of_node = links.filter(|(_, viewpoint, link, _)| {
            link.live && node.is_none_or(|node| node == *viewpoint)
        });
        of_node.any(|(_, _, _, health)| {
            let known_to_us = health.clock_uncertainty_us.map(Micros::from);
            known_to_us.is_none_or(|us| us > MATTERS_US)
        })
    }

    /// A clock that is far off, and corrected.
    pub(super) fn clock(
        &mut self,
        name: &str,
        offset_us: Option<i32>,
        uncertainty_us: Option<u32>,
    ) {
        let bound_ms = self.of.context.venue.parameters.link.clock_bound_ms;
        let Some(offset_us) = offset_us else {
            return;
        };
        let off_ms = f64::from(offset_us.unsigned_abs()) / 1e3;
        // Past the bound it is refused, which says so itself.
        if off_ms > 0.5 * bound_ms {
            let bound = uncertainty_us.map_or(String::new(), |us| {
                format!(" (±{:.1})", f64::from(us) / 1e3)
            });
            let text = format!(
                "the clock of {name} is {off_ms:.1} ms{bound} off; it is corrected up to {bound_ms} ms"
            );
            let remedy = "start NTP or PTP on it";
            self.say(
                Severity::Warning,
                format!("clock/{name}"),
                &format!("clock of {name}"),
                text,
                remedy,
            );
        }
    }
}
