//! The viewpoints of a live run, and what is known of their edges.

use std::collections::{BTreeMap, BTreeSet};

use farfield_fusion::export::summary::CameraSummary;
use farfield_fusion::live::cameras::Cameras;
use farfield_fusion::live::common_plan::CommonPlan;
use farfield_fusion::live::edge::Edge;
use farfield_fusion::live::edge::common_clock::CommonClock;
use farfield_fusion::live::late_detections::LateDetections;
use farfield_fusion::live::membership::Membership;
use farfield_fusion::live::pace::Pace;
use farfield_fusion::live::{Micros, SECOND_US};
use farfield_node::clock::VenueClock;
use farfield_proto::message::Status;
use farfield_proto::message::live::EdgeLink;
use farfield_proto::venue::Venue;
use farfield_proto::wire;

use super::start::LiveStart;

/// Time after the first tick to wait for the edges' first messages: at that tick all have a detection pass.
const FIRST_WORD_US: Micros = SECOND_US / 2;

/// The viewpoints of a live run, in the venue's order.
pub(super) struct Viewpoints<'a> {
    venue: &'a Venue,
    pub(super) members: Membership,
    pub(super) edges: Vec<Edge>,
    /// The present edges, by their tokens.
    pub(super) present: BTreeSet<String>,
    pub(super) cameras: Cameras,
    /// Results of detection passes that came too late, by viewpoint.
    pub(super) late_detections: Vec<LateDetections>,
    /// End of waiting for edges that have sent nothing yet.
    pub(super) expect_until_us: Micros,
    /// Unreadable messages of unknown senders.
    pub(super) unreadable: u64,
    pub(super) common_clock: CommonClock,
    /// The ticks that all edges work on.
    pub(super) plan: CommonPlan,
    /// The edges for which more ticks are too much.
    pub(super) slow: Vec<String>,
}

impl<'a> Viewpoints<'a> {
    pub(super) fn new(venue: &'a Venue, start: LiveStart) -> Self {
        let link = &venue.parameters.link;
        let pace = Pace::new(link.budget_bytes_per_s, venue.rate_hz);
        let ticks_per_pass = venue.parameters.births.ticks_per_look(venue.rate_hz);
        let expect_until_us = start.time.at(start.first) + FIRST_WORD_US;
        let edge = |viewpoint: &farfield_proto::venue::Viewpoint| {
            let edge = Edge::new(&viewpoint.name, link.clock_bound_ms);
            let mut edge = edge.with_pass_every(ticks_per_pass).at_pace(pace.clone());
            edge.expect(expect_until_us);
            edge
        };
        Self {
            venue,
            members: start.members,
            edges: venue.viewpoints.iter().map(edge).collect(),
            present: start.present,
            cameras: Cameras::default(),
            late_detections: vec![LateDetections::default(); venue.viewpoints.len()],
            expect_until_us,
            unreadable: 0,
            common_clock: CommonClock::default(),
            plan: CommonPlan::default(),
            slow: Vec::new(),
        }
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &'a str> + use<'a> {
        let viewpoints = self.venue.viewpoints.iter();
        viewpoints.map(|viewpoint| viewpoint.name.as_str())
    }

    /// The viewpoint of this index takes part: its files match and its clock is near enough.
    pub(super) fn takes_part(&self, index: usize) -> bool {
        self.members.is_welcome(index) && self.edges[index].is_on_time()
    }

    /// Whether to wait for messages of the edge of viewpoint `index`.
    pub(super) fn is_awaited(&self, index: usize, now_us: Micros) -> bool {
        self.members.is_welcome(index) && self.edges[index].is_awaited(now_us)
    }

    /// The newest statuses of the edges, by name.
    pub(super) fn last_words(&self) -> Vec<Status> {
        let mut words: Vec<Status> = self.members.last_words().cloned().collect();
        words.sort_by(|a, b| a.node.cmp(&b.node));
        words
    }

    /// Compares the clocks of all machines.
    pub(super) fn weigh_clocks(&mut self, clock: &VenueClock) {
        for status in self.members.last_words() {
            let viewpoint = self.venue.viewpoint_named(&status.node);
            if let Some(edge) = viewpoint.and_then(|v| self.edges.get_mut(usize::from(v.0))) {
                edge.set_system_clock(status.health.system_clock);
            }
        }
        let now_us = clock.now_us();
        // Edges that have left have no vote.
        let present = self.edges.iter().filter(|edge| edge.is_heard(now_us));
        let clocks = present.map(Edge::clock);
        let common_us = self.common_clock.weigh(clock.system(), clocks);
        for edge in &mut self.edges {
            edge.agree_on_clock(common_us);
        }
    }

    /// Plans the ticks of all edges from what each edge reports.
    pub(super) fn plan_ticks(&mut self, now_us: Micros) {
        let needs = self.needs(now_us);
        let needed_nths: Vec<u16> = needs.iter().map(|(_, nth)| *nth).collect();
        self.plan.update(&needed_nths, now_us);
        let every_nth = self.plan.every_nth();
        for edge in &mut self.edges {
            edge.every_nth_tick = every_nth;
        }
        let slow = needs.into_iter().filter(|(_, nth)| *nth >= every_nth);
        let slow: Vec<String> = slow.map(|(name, _)| name).collect();
        // If edges have time again, the plan follows shortly: until then the old reason stays.
        if every_nth <= 1 {
            self.slow.clear();
        } else if !slow.is_empty() {
            self.slow = slow;
        }
    }

    /// The present edges with people to work on, each with its n: it can work on every n-th tick.
    fn needs(&self, now_us: Micros) -> Vec<(String, u16)> {
        let needs = self.members.last_words().filter_map(|status| {
            let index = usize::from(self.venue.viewpoint_named(&status.node)?.0);
            let is_there = self.members.is_welcome(index) && self.edges[index].is_heard(now_us);
            let nth = status.live.as_ref().map(|live| live.needed_nth_tick);
            let nth = nth.filter(|nth| is_there && *nth > 0)?;
            Some((status.node.clone(), nth))
        });
        needs.collect()
    }

    /// The state of every edge's link.
    pub(super) fn links(&mut self, now_us: Micros) -> Vec<EdgeLink> {
        let members = &self.members;
        let links = self.edges.iter_mut().enumerate().map(|(index, edge)| {
            let mut link = edge.link(now_us);
            link.live &= members.is_welcome(index);
            link.refused = refusal(members, index, link.refused);
            if let Some(process) = members.second(index) {
                link.refuse_second(process);
            }
            link
        });
        links.collect()
    }

    /// Summaries of the cameras, by name.
    pub(super) fn camera_summaries(&self) -> BTreeMap<String, CameraSummary> {
        let named = self.cameras.records().filter_map(|(index, record)| {
            let camera = self.venue.camera(index)?;
            let summary = CameraSummary {
                health: record.health,
                frames_per_s: record.frames_per_s,
                troubles: record.troubles,
                reason: record.reason.clone(),
            };
            Some((camera.model.name().to_owned(), summary))
        });
        named.collect()
    }
}

/// Why the viewpoint of this index does not take part, cut to a length that edges can read. `clock` describes a fault of its
/// clock.
fn refusal(members: &Membership, index: usize, clock: Option<String>) -> Option<String> {
    let failed = || {
        let failure = members.failure(index)?;
        Some(format!("it has failed: {failure}"))
    };
    let refused = members.refused(index).map(str::to_owned);
    refused.or(clock).or_else(failed).map(wire::cut_refusal)
}

#[cfg(test)]
mod tests {
    use farfield_proto::wire::{MAX_HASH_BYTES, MAX_REFUSAL_BYTES, MAX_TEXT_BYTES};

    use super::super::tests::venue;
    use super::*;
    use crate::status::own_status;

    fn refusal_of(spoil: impl FnOnce(&mut Status)) -> Option<String> {
        let venue = venue();
        let mut members = Membership::new(&venue);
        let mut status = Status {
            node: "a".to_owned(),
            ..own_status(&venue.hashes)
        };
        spoil(&mut status);
        let status: Status = wire::decode(&wire::encode(&status)).unwrap();
        members.update(&status, 0);
        refusal(&members, 0, None)
    }

    #[test]
    fn refusals_with_the_longest_texts_can_be_read() {
        // Symptom to prevent: the reason was longer than any text may be, and no edge could read fusion's status.
        let hash = refusal_of(|s| s.venue_hash = "h".repeat(MAX_HASH_BYTES)).unwrap();
        assert!(hash.ends_with("copy the same file to both"), "{hash}");
        let failure =
            refusal_of(|s| s.failure = Some("\u{2026}".repeat(MAX_TEXT_BYTES / 3))).unwrap();
        assert!(failure.contains('\u{2026}'), "{failure}");
        assert!(hash.len().max(failure.len()) <= MAX_REFUSAL_BYTES);
    }
}
