//! What fusion says once a second of itself and of every edge.

use farfield_proto::live::{EdgeLink, LiveStatus};
use farfield_proto::message::{MAX_STAGES, Status};
use farfield_proto::wire;

use super::super::config::Config;
use super::super::start::own_status;
use super::run::Live;
use crate::live::Micros;

impl Live<'_> {
    /// Fusion's status at `now_us`.
    pub(super) fn status(&mut self, config: &Config, now_us: Micros) -> Status {
        let edges = self.edge_links(now_us);
        let mut stages = self.delays.own();
        stages.extend(self.core_stages.iter().cloned());
        stages.truncate(MAX_STAGES);
        Status {
            tick: self.last,
            unreadable: self.lost().unreadable,
            stages,
            live: Some(LiveStatus {
                epoch_us: Some(self.time.epoch_us()),
                every_nth_tick: 1,
                missed_ticks: self.over_nothing,
                edges,
                recording_failure: self.ear.tap.failure().map(wire::cut_text),
                ..LiveStatus::default()
            }),
            ..own_status(&config.venue.hashes)
        }
    }

    /// How every edge is heard.
    pub(super) fn edge_links(&mut self, now_us: Micros) -> Vec<EdgeLink> {
        let mut links = Vec::with_capacity(self.edges.len());
        for (index, edge) in self.edges.iter_mut().enumerate() {
            let mut link = edge.link(now_us);
            link.live &= self.members.is_welcome(index);
            if let Some(refused) = self.members.refused(index) {
                link.refused = Some(refused.to_owned());
            }
            if let (None, Some(failure)) = (&link.refused, self.members.failure(index)) {
                link.refused = Some(format!("it has given up: {failure}"));
            }
            if let Some(process) = self.members.second(index) {
                link.refuse_second(process);
            }
            links.push(link);
        }
        links
    }
}
