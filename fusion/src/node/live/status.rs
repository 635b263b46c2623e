//! What fusion says once a second of itself and of every edge.

use farfield_proto::message::live::{EdgeLink, LiveStatus};
use farfield_proto::message::{MAX_STAGES, Status};
use farfield_proto::wire;

use super::super::config::FusionConfig;
use super::super::status::own_status;
use super::run::LiveFusion;
use crate::live::Micros;
use crate::live::membership::Membership;

impl LiveFusion<'_> {
    /// Fusion's status at `now_us`.
    pub(super) fn status(&mut self, config: &FusionConfig, now_us: Micros) -> Status {
        let edges = self.edge_links(now_us);
        let mut stages = self.delays.own();
        stages.extend(self.delays.of_all_edges());
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

    /// What its own `status` says, in a line.
    pub(super) fn in_a_line(&self, status: &Status) -> String {
        let edges = status.live.iter().flat_map(|live| &live.edges);
        let there = edges.clone().filter(|edge| edge.live).count();
        let mut line = format!("{there} of {} edges take part", edges.count());
        for notice in self.plan_words.iter().chain(&status.health.notices) {
            line.push_str("; ");
            line.push_str(notice);
        }
        line
    }

    /// How every edge is heard.
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

/// Why the viewpoint of this index does not take part, cut so that edges can read it; `clock`: what is
/// wrong with its clock.
fn refusal(members: &Membership, index: usize, clock: Option<String>) -> Option<String> {
    let given_up = || {
        let failure = members.failure(index)?;
        Some(format!("it has given up: {failure}"))
    };
    let refused = members.refused(index).map(str::to_owned);
    refused.or(clock).or_else(given_up).map(wire::cut_refusal)
}

#[cfg(test)]
mod tests {
    use farfield_proto::wire::{MAX_HASH_BYTES, MAX_REFUSAL_BYTES, MAX_TEXT_BYTES};

    use super::super::tests::venue;
    use super::*;

    fn said(spoil: impl FnOnce(&mut Status)) -> Option<String> {
        let venue = venue();
        let mut members = Membership::new(&venue);
        let mut status = Status {
            node: "a".to_owned(),
            ..own_status(&venue.hashes)
        };
        spoil(&mut status);
        let status: Status = wire::decode(&wire::encode(&status)).unwrap();
        members.hear(&status, 0);
        refusal(&members, 0, None)
    }

    #[test]
    fn who_says_the_longest_texts_is_refused_in_one_that_can_be_read() {
        // Symptom to prevent: the reason was longer than any text may be, and no edge could read fusion.
        let hash = said(|s| s.venue_hash = "h".repeat(MAX_HASH_BYTES)).unwrap();
        assert!(hash.ends_with("copy the same file to both"), "{hash}");
        let failure = said(|s| s.failure = Some("\u{2026}".repeat(MAX_TEXT_BYTES / 3))).unwrap();
        assert!(failure.starts_with("it has given up: \u{2026}"));
        assert!(hash.len().max(failure.len()) <= MAX_REFUSAL_BYTES);
    }
}
