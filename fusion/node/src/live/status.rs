//! Fusion's status, once a second, with the links of all edges.

use farfield_fusion::live::Micros;
use farfield_fusion::live::membership::Membership;
use farfield_proto::message::live::{EdgeLink, LiveStatus};
use farfield_proto::message::{MAX_STAGES, Status};
use farfield_proto::wire;

use super::super::config::FusionConfig;
use super::super::status::own_status;
use super::run::LiveFusion;

impl LiveFusion<'_> {
    /// Fusion's status at `now_us`.
    pub(super) fn status(&mut self, config: &FusionConfig, now_us: Micros) -> Status {
        let edges = self.edge_links(now_us);
        let mut stages = self.delays.own();
        stages.extend(self.delays.all_edges());
        stages.extend(self.core_stages.iter().cloned());
        stages.truncate(MAX_STAGES);
        Status {
            tick: self.last,
            unreadable: self.lost().unreadable,
            stages,
            live: Some(LiveStatus {
                epoch_us: Some(self.time.epoch_us()),
                every_nth_tick: 1,
                missed_ticks: self.without_input,
                edges,
                recording_failure: self.interceptor.wiretap.failure().map(wire::cut_text),
                ..LiveStatus::default()
            }),
            health: self.health(),
            agreement: self
                .agreement
                .as_ref()
                .map(|judge| judge.cameras(&config.venue))
                .unwrap_or_default(),
            ..own_status(&config.venue.hashes)
        }
    }

    /// Summarises its own `status` in one line.
    pub(super) fn status_line(&self, status: &Status) -> String {
        let edges = status.live.iter().flat_map(|live| &live.edges);
        let live = edges.clone().filter(|edge| edge.live).count();
        let mut line = format!("{live} of {} edges take part", edges.count());
        for notice in self.plan_words.iter().chain(&status.health.notices) {
            line.push_str("; ");
            line.push_str(notice);
        }
        line
    }

    /// The state of every edge's link.
    pub(super) fn edge_links(&mut self, now_us: Micros) -> Vec<EdgeLink> {
        let mut links = Vec::with_capacity(self.edges.len());
        for (index, edge) in self.edges.iter_mut().enumerate() {
            let mut link = edge.link(now_us);
            link.live &= self.members.is_welcome(index);
            link.refused = refusal(&self.members, index, link.refused);
            if let Some(process) = self.members.second(index) {
                link.refuse_second(process);
            }
            links.push(link);
        }
        links
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
