//! Checks once a second in a live run: the plan of ticks, clocks, keys, agreement of the cameras, floods, other fusions, and the
//! target latency.

use farfield_fusion::live::Micros;
use farfield_fusion::live::edge::Edge;
use farfield_node::certificate::ending_notice;
use farfield_node::clock;
use farfield_node::process::say;
use farfield_proto::message::health::{LinkHealth, NodeHealth};
use farfield_proto::transport::FUSION;

use super::missed_target::MissedTarget;
use super::run::LiveFusion;
use crate::recording::RecordingsOnDemand;

impl LiveFusion<'_> {
    /// Compares the clocks of all machines, and reports this machine's clock if it seems wrong.
    pub(super) fn weigh_clocks(&mut self) {
        for status in self.members.last_words() {
            let viewpoint = self.config.venue.viewpoint_named(&status.node);
            if let Some(edge) = viewpoint.and_then(|v| self.edges.get_mut(usize::from(v.0))) {
                edge.set_system_clock(status.health.system_clock);
            }
        }
        let own = self.interceptor.clock.system();
        let now_us = self.interceptor.clock.now_us();
        // Edges that have left have no vote.
        let present = self.edges.iter().filter(|edge| edge.is_heard(now_us));
        let common_us = self.common_clock.weigh(own, present.map(Edge::clock));
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
                    "the clock of this machine seems to be {off_s:.2} s off: the edges' clocks agree on another time, which is used; set it by NTP or PTP"
                ));
            } else {
                say(format_args!(
                    "the clock of this machine agrees with those of the edges again"
                ));
            }
        }
        self.is_own_clock_suspected = is_suspected;
    }

    /// Reports certificates that expire soon, once per viewpoint.
    pub(super) fn check_certificates(&mut self) {
        let now_s = clock::unix_s();
        for status in self.members.last_words() {
            let until_s = status.health.certificate_ends_s.map(u64::cast_signed);
            let notice = until_s.and_then(|until_s| ending_notice(&status.node, until_s, now_s));
            if let Some(notice) = notice
                && self.reported_certificates.insert(status.node.clone())
            {
                say(format_args!("{notice}"));
            }
        }
    }

    /// Reports new disagreements of the cameras.
    pub(super) fn check_agreement(&mut self) {
        if let Some(judge) = &mut self.agreement {
            self.disagreements = judge.warnings();
        }
    }

    /// Reports viewpoints that exceed their quota.
    pub(super) fn check_floods(&mut self) {
        let names = self.config.venue.viewpoints.iter().map(|v| v.name.as_str());
        let refused = (0..).map(|index| self.interceptor.refused(index));
        self.flood.update(names.zip(refused));
    }

    /// Reports another fusion of the venue that has started since, once.
    pub(super) fn check_other_fusion(&mut self) {
        let other = self.others.described();
        if other.is_some() != self.is_other_reported {
            let venue = &self.config.venue.name;
            match &other {
                Some(other) => say(format_args!(
                    "another fusion of venue {venue} is running: {other}; edges follow the one that they reach: stop one of the two"
                )),
                None => say(format_args!("the other fusion of venue {venue} has ended")),
            }
        }
        self.is_other_reported = other.is_some();
    }

    /// Reports when the target latency is first exceeded, with its cause and the omitted viewpoints, and when it is met again.
    pub(super) fn check_target(&mut self) {
        let Some(recent) = self.target.take_recent() else {
            return;
        };
        let target_ms = self.target.target_ms();
        let names: Vec<&str> = self.names().collect();
        let longest = self.delays.largest_in_words();
        let missed = MissedTarget::new(target_ms, &recent, &names, &longest);
        missed.report(&self.missed_target, recent.is_news);
        self.missed_target = missed;
    }

    /// The health of this node.
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
        if let Some(other) = self.others.described() {
            health.notice(format!(
                "another fusion of this venue is running: {other}; stop one of the two"
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
                "fusion's clock seems to be {off_s:.2} s off: the edges' clocks agree on another time"
            ));
        }
        health
    }

    /// Plans the ticks of all edges from what each edge reports.
    pub(super) fn plan_ticks(&mut self) {
        let now_us = self.interceptor.clock.now_us();
        let needs = self.needs(now_us);
        let needed_nths: Vec<u16> = needs.iter().map(|(_, nth)| *nth).collect();
        self.plan.update(&needed_nths, now_us);
        let every_nth = self.plan.every_nth();
        for edge in &mut self.edges {
            edge.every_nth_tick = every_nth;
        }
        let slow = needs.iter().filter(|(_, nth)| *nth >= every_nth);
        let slow: Vec<&str> = slow.map(|(name, _)| name.as_str()).collect();
        let words = match (every_nth, slow.is_empty()) {
            (..=1, _) => None,
            // Edges have time again and the plan follows shortly: until then the old reason stays.
            (_, true) => self.plan_words.clone(),
            (_, false) => Some(self.plan_in_words(&slow)),
        };
        match (&self.plan_words, &words) {
            (None, Some(words)) => say(format_args!("{words}")),
            (Some(_), None) => say(format_args!("the edges work at every tick again")),
            _ => {}
        }
        self.plan_words = words;
    }

    fn plan_in_words(&self, slow: &[&str]) -> String {
        let rate_hz = self.config.venue.rate_hz;
        format!(
            "the edges share ticks at {:.0} of {rate_hz:.0} Hz: more is too much for {}",
            rate_hz / f64::from(self.plan.every_nth()),
            slow.join(", ")
        )
    }

    /// The present edges with people to work on, each with its n: it can work on every n-th tick.
    fn needs(&self, now_us: Micros) -> Vec<(String, u16)> {
        let needs = self.members.last_words().filter_map(|status| {
            let index = usize::from(self.config.venue.viewpoint_named(&status.node)?.0);
            let is_there = self.members.is_welcome(index) && self.edges[index].is_heard(now_us);
            let nth = status.live.as_ref().map(|live| live.needed_nth_tick);
            let nth = nth.filter(|nth| is_there && *nth > 0)?;
            Some((status.node.clone(), nth))
        });
        needs.collect()
    }
}
