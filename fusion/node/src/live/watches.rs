//! What fusion watches once a second in a live run, and its status.
//!
//! Each watch gives the conditions that it sees. [`Conditions`] prints their beginnings and ends, and keeps their notices for the
//! status.

use std::sync::Arc;

use farfield_fusion::live::Micros;
use farfield_node::certificate::ending_notice;
use farfield_node::clock;
use farfield_node::process::say;
use farfield_node::service_manager;
use farfield_proto::message::health::{LinkHealth, NodeHealth};
use farfield_proto::message::live::{EdgeLink, LiveStatus};
use farfield_proto::message::{MAX_STAGES, Status};
use farfield_proto::transport::FUSION;
use farfield_proto::wire;

use super::agreement::AgreementJudge;
use super::conditions::{Condition, Conditions};
use super::missed_target::missed_target;
use super::overload::FloodWatch;
use super::run::LiveFusion;
use crate::output::disk_watch::DiskWatch;
use crate::output::progress::Reporter;
use crate::recording::RecordingsOnDemand;
use crate::session::messages::FusionOutgoing;
use crate::session::other_fusion::OtherFusionWatch;
use crate::status::own_status;

/// The watches that keep something from one second to the next.
pub(super) struct Watches {
    /// The judge of the cameras' agreement.
    pub(super) agreement: AgreementJudge,
    /// The disks that the run writes to.
    pub(super) disks: Vec<Arc<DiskWatch>>,
    /// The watch for another fusion of the venue.
    pub(super) others: OtherFusionWatch,
    pub(super) flood: FloodWatch,
    /// How the target latency was missed when enough ticks were last counted.
    pub(super) missed_target: Vec<Condition>,
    pub(super) conditions: Conditions,
}

impl Watches {
    pub(super) fn new(
        agreement: AgreementJudge,
        disks: Vec<Arc<DiskWatch>>,
        others: OtherFusionWatch,
    ) -> Self {
        Self {
            agreement,
            disks,
            others,
            flood: FloodWatch::default(),
            missed_target: Vec::new(),
            conditions: Conditions::default(),
        }
    }
}

impl LiveFusion<'_> {
    /// The work of every second: clocks, the plan of ticks, conditions, fusion's status.
    pub(super) fn every_second(&mut self, reporter: &mut Reporter) {
        let clock = &self.interceptor.clock;
        clock.discipline();
        let now_us = clock.now_us();
        self.viewpoints.weigh_clocks(clock);
        self.viewpoints.plan_ticks(now_us);
        let links = self.viewpoints.links(now_us);
        let conditions = self.conditions_now(&links);
        for line in self.watches.conditions.update(conditions) {
            say(format_args!("{line}"));
        }
        let status = self.status(links.clone());
        service_manager::report(&status_line(&status));
        self.outbox.send(FusionOutgoing::Status(Box::new(status)));
        let recent = self.delays.take_recent();
        reporter.links(recent.map(|r| (r.p50_us, r.p99_us)), links);
    }

    /// The conditions that all watches see, the most important first: a status has room for a few.
    fn conditions_now(&mut self, links: &[EdgeLink]) -> Vec<Condition> {
        let mut all = Vec::new();
        all.extend(self.other_fusion());
        all.extend(self.disks());
        all.extend(self.certificates());
        all.extend(self.floods());
        all.extend(self.plan());
        all.extend(self.missed_target());
        all.extend(self.watches.agreement.conditions());
        all.extend(self.own_clock());
        all.extend(links.iter().filter_map(refused));
        all.extend(self.ticks.shedding.condition());
        all
    }

    /// Another fusion of the venue that has started since.
    fn other_fusion(&self) -> Option<Condition> {
        let other = self.watches.others.described()?;
        let venue = &self.config.venue.name;
        let condition = Condition::of("other fusion")
            .begins(format!(
                "another fusion of venue {venue} is running: {other}; edges follow the one that they reach: stop one of the two"
            ))
            .notice(format!(
                "another fusion of this venue is running: {other}; stop one of the two"
            ))
            .ends(format!("the other fusion of venue {venue} has ended"));
        Some(condition)
    }

    /// Disks that do not answer, and recordings that lack messages: these print their beginnings and ends themselves.
    fn disks(&self) -> impl Iterator<Item = Condition> {
        let disks = self.watches.disks.iter().filter_map(|disk| disk.notice());
        let recorded = self.on_demand.and_then(RecordingsOnDemand::notice);
        let notices = disks.chain(recorded);
        notices.map(|notice| Condition::of(notice.clone()).notice(notice))
    }

    /// Certificates that end soon. Edges have their notice in their own statuses; fusion printed its own at its start.
    fn certificates(&self) -> Vec<Condition> {
        let now_s = clock::unix_s();
        let own = self.certificate_ends_s();
        let own = own.and_then(|until_s| ending_notice(FUSION, until_s, now_s));
        let own = own.map(|text| Condition::of("own certificate").notice(text));
        let edges = self.viewpoints.members.last_words().filter_map(|status| {
            let until_s = status.health.certificate_ends_s?.cast_signed();
            let text = ending_notice(&status.node, until_s, now_s)?;
            Some(Condition::of(format!("certificate {}", status.node)).begins(text))
        });
        own.into_iter().chain(edges).collect()
    }

    fn certificate_ends_s(&self) -> Option<i64> {
        self.config.reach.validity.map(|validity| validity.until_s)
    }

    /// Viewpoints that exceed their quota.
    fn floods(&mut self) -> impl Iterator<Item = Condition> {
        let n_viewpoints = self.viewpoints.edges.len();
        let refused = (0..n_viewpoints).map(|index| self.interceptor.refused(index));
        self.watches.flood.update(refused);
        self.watches.flood.conditions(self.viewpoints.names())
    }

    /// Fewer ticks for all edges than the venue's rate.
    fn plan(&self) -> Option<Condition> {
        let every_nth = self.viewpoints.plan.every_nth();
        let (slow, rate_hz) = (&self.viewpoints.slow, self.config.venue.rate_hz);
        let condition = || {
            Condition::of("plan")
                .words(format!(
                    "the edges share ticks at {:.0} of {rate_hz:.0} Hz: more is too much for {}",
                    rate_hz / f64::from(every_nth),
                    slow.join(", ")
                ))
                .ends("the edges work at every tick again")
        };
        (!slow.is_empty()).then(condition)
    }

    /// A missed target latency, with its cause and the viewpoints that are left out.
    fn missed_target(&mut self) -> Vec<Condition> {
        if let Some(recent) = self.ticks.target.take_recent() {
            let names: Vec<&str> = self.viewpoints.names().collect();
            let longest = self.delays.largest_in_words();
            let target_ms = self.ticks.target.target_ms();
            self.watches.missed_target = missed_target(target_ms, &recent, &names, &longest);
        }
        self.watches.missed_target.clone()
    }

    /// This machine's clock, if it seems wrong.
    fn own_clock(&self) -> Option<Condition> {
        let bound_us = (self.config.venue.parameters.link.clock_bound_ms * 1e3) as Micros;
        let error_us = self.viewpoints.common_clock.own_error_us();
        let off_s = error_us as f64 / 1e6;
        let condition = || {
            Condition::of("own clock")
                .begins(format!(
                    "the clock of this machine seems to be {off_s:.2} s off: the edges' clocks agree on another time, which is used; set it by NTP or PTP"
                ))
                .notice(format!(
                    "fusion's clock seems to be {off_s:.2} s off: the edges' clocks agree on another time"
                ))
                .ends("the clock of this machine agrees with those of the edges again")
        };
        (error_us.saturating_abs() > bound_us).then(condition)
    }

    /// Fusion's status; `links` are the states of the edges' links.
    pub(super) fn status(&self, links: Vec<EdgeLink>) -> Status {
        let venue = &self.config.venue;
        let mut stages = self.delays.own();
        stages.extend(self.delays.all_edges());
        stages.extend(self.core_stages.iter().cloned());
        stages.truncate(MAX_STAGES);
        Status {
            tick: self.ticks.last,
            unreadable: self.lost().unreadable,
            stages,
            live: Some(LiveStatus {
                epoch_us: Some(self.ticks.time.epoch_us()),
                every_nth_tick: 1,
                missed_ticks: self.ticks.without_input,
                edges: links,
                recording_failure: self.interceptor.wiretap.failure().map(wire::cut_text),
                ..LiveStatus::default()
            }),
            health: self.health(),
            agreement: self.watches.agreement.cameras(venue),
            ..own_status(&venue.hashes)
        }
    }

    /// The health of this node.
    fn health(&self) -> NodeHealth {
        let edges = self.viewpoints.edges.iter().enumerate();
        let links = edges.map(|(index, edge)| LinkHealth {
            dropped: self.interceptor.dropped(index),
            ..edge.link_health()
        });
        let mut health = NodeHealth {
            system_clock: Some(self.interceptor.clock.system()),
            certificate_ends_s: self.certificate_ends_s().map(i64::cast_unsigned),
            follows: Some(self.session),
            links: links.collect(),
            ..NodeHealth::default()
        };
        for notice in self.watches.conditions.notices() {
            health.notice(notice.clone());
        }
        health
    }
}

/// A viewpoint that does not take part. Numbers in the reason change all the time, so that only its beginning is printed.
fn refused(link: &EdgeLink) -> Option<Condition> {
    let EdgeLink {
        viewpoint, refused, ..
    } = link;
    let why = refused.as_ref()?;
    let condition = Condition::of(format!("refused {viewpoint}"))
        .begins(format!("viewpoint {viewpoint}: {why}"))
        .ends(format!("viewpoint {viewpoint} is accepted"));
    Some(condition)
}

/// Summarises fusion's own `status` in one line.
fn status_line(status: &Status) -> String {
    let edges = status.live.iter().flat_map(|live| &live.edges);
    let live = edges.clone().filter(|edge| edge.live).count();
    let mut line = format!("{live} of {} edges take part", edges.count());
    for notice in &status.health.notices {
        line.push_str("; ");
        line.push_str(notice);
    }
    line
}
