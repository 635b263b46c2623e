//! What fusion makes of itself and of all machines once a second: their clocks, their keys, and who floods.

use farfield_node::certificate::ending_notice;
use farfield_node::clock;
use farfield_node::process::say;
use farfield_proto::message::health::{LinkHealth, NodeHealth};
use farfield_proto::transport::FUSION;

use super::missed_target::MissedTarget;
use super::run::LiveFusion;
use crate::live::Micros;
use crate::live::edge::Edge;
use crate::node::recording::RecordingsOnDemand;

impl LiveFusion<'_> {
    /// Weighs the clocks of all systems, and says when it is this machine's that seems wrong.
    pub(super) fn weigh_clocks(&mut self) {
        for status in self.members.last_words() {
            let viewpoint = self.config.venue.viewpoint_named(&status.node);
            if let Some(edge) = viewpoint.and_then(|v| self.edges.get_mut(usize::from(v.0))) {
                edge.hear_system_clock(status.health.system_clock);
            }
        }
        let own = self.interceptor.clock.system();
        let now_us = self.interceptor.clock.now_us();
        // Who has left has no vote.
        let there = self.edges.iter().filter(|edge| edge.is_heard(now_us));
        let common_us = self.common_clock.weigh(own, there.map(Edge::clock));
        for edge in &mut self.edges {
            edge.agree_on_clock(common_us);
        }
        let bound_us = (self.config.venue.parameters.link.clock_bound_ms * 1e3) as Micros;
        let error_us = self.common_clock.own_error_us();
        let is_suspected = error_us.saturating_abs() > bound_us;
        if is_suspected != self.is_own_clock_suspected {
            let off_s = error_us as f64 / 1e6;
            if is_suspected {
                say(format_args!(
                    "the clock of this machine seems to be {off_s:.2} s off: those of the edges agree on another time, and are followed; set it by NTP or PTP"
                ));
            } else {
                say(format_args!(
                    "the clock of this machine agrees with those of the edges again"
                ));
            }
        }
        self.is_own_clock_suspected = is_suspected;
    }

    /// Says once of every viewpoint whose certificate ends soon that it does.
    pub(super) fn look_at_certificates(&mut self) {
        let now_s = clock::unix_s();
        for status in self.members.last_words() {
            let until_s = status.health.certificate_ends_s.map(u64::cast_signed);
            let notice = until_s.and_then(|until_s| ending_notice(&status.node, until_s, now_s));
            if let Some(notice) = notice
                && self.told_certificates.insert(status.node.clone())
            {
                say(format_args!("{notice}"));
            }
        }
    }

    /// Says what of the cameras does not fit, once.
    pub(super) fn look_at_agreement(&mut self) {
        if let Some(judge) = &mut self.agreement {
            self.disagreements = judge.warnings();
        }
    }

    /// Names who sends more than it may.
    pub(super) fn look_for_floods(&mut self) {
        let names = self.config.venue.viewpoints.iter().map(|v| v.name.as_str());
        let refused = (0..).map(|index| self.interceptor.refused(index));
        self.flood.look(names.zip(refused));
    }

    /// Names another fusion that has come since, once.
    pub(super) fn look_for_another(&mut self) {
        let other = self.others.named();
        if other.is_some() != self.is_other_told {
            let venue = &self.config.venue.name;
            match &other {
                Some(other) => say(format_args!(
                    "another fusion of venue {venue} is there: {other}; edges follow the one that they reach: end one of the two"
                )),
                None => say(format_args!("the other fusion of venue {venue} has gone")),
            }
        }
        self.is_other_told = other.is_some();
    }

    /// Says that the target latency is not kept, what takes the time and who is left out, when that begins and when it is over.
    pub(super) fn look_at_target(&mut self) {
        let Some(recent) = self.target.take_recent() else {
            return;
        };
        let target_ms = self.target.target_ms();
        let names: Vec<&str> = self.names().collect();
        let longest = self.delays.what_takes_longest();
        let missed = MissedTarget::of(target_ms, &recent, &names, &longest);
        missed.tell(&self.missed_target, recent.is_news);
        self.missed_target = missed;
    }

    /// How this node is.
    pub(super) fn health(&self) -> NodeHealth {
        let links = self
            .edges
            .iter()
            .enumerate()
            .map(|(index, edge)| LinkHealth {
                dropped: self.interceptor.dropped(index),
                ..edge.link_health()
            });
        let validity = self.config.reach.validity;
        let until_s = validity.map(|validity| validity.until_s);
        let mut health = NodeHealth {
            system_clock: Some(self.interceptor.clock.system()),
            certificate_ends_s: until_s.map(i64::cast_unsigned),
            follows: Some(self.session),
            links: links.collect(),
            ..NodeHealth::default()
        };
        if let Some(other) = self.others.named() {
            health.notice(format!(
                "another fusion of this venue is there: {other}; end one of the two"
            ));
        }
        let recorded = self.on_demand.and_then(RecordingsOnDemand::notice);
        let waiting = self.disks.iter().filter_map(|disk| disk.notice());
        for notice in waiting.chain(recorded) {
            health.notice(notice);
        }
        let now_s = clock::unix_s();
        let ending = until_s.and_then(|until_s| ending_notice(FUSION, until_s, now_s));
        if let Some(text) = ending {
            health.notice(text);
        }
        for index in self.flood.flooding() {
            let name = &self.config.venue.viewpoints[index].name;
            health.notice(format!("viewpoint {name} sends more than any edge may"));
        }
        let planned = self.plan_words.iter();
        for words in planned
            .chain(self.missed_target.words())
            .chain(&self.disagreements)
        {
            health.notice(words.clone());
        }
        if self.is_own_clock_suspected {
            let off_s = self.common_clock.own_error_us() as f64 / 1e6;
            health.notice(format!(
                "fusion's clock seems to be {off_s:.2} s off: those of the edges agree on another time"
            ));
        }
        health
    }
}
