//! Builds `summary.json` from the facts of a finished run.

use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

use farfield_fusion::camera_agreement::AgreementReport;
use farfield_fusion::export::summary::{
    CameraSummary, DropSummary, RecordingSummary, StageTiming, Summary, TargetLatencySummary,
    TickSpan, TimingSummary,
};
use farfield_node::process::Ending;
use farfield_proto::message::{DETECTION_STAGE, SIGHTING_STAGE, StageTime, Status};
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;

use super::exporter::Exported;
use super::tally::Tally;

/// Facts of a finished run.
pub(crate) struct RunFacts<'a> {
    /// The ticks of the run.
    pub(crate) ticks: Range<Tick>,
    /// The first statuses of the edges, with their networks.
    pub(crate) edges: &'a [Status],
    pub(crate) tally: &'a Tally,
    /// Messages that came too late or not at all.
    pub(crate) lost: Lost,
    /// How it ended; `None` if it failed.
    pub(crate) ending: Option<Ending>,
    /// The people of the run, and what the files lack.
    pub(crate) exported: &'a Exported,
    /// The agreement of the cameras.
    pub(crate) agreement: &'a AgreementReport,
    /// The last stepped tick.
    pub(crate) last: Option<Tick>,
    /// Times of fusion's own stages.
    pub(crate) stages: Vec<StageTime>,
    /// Delays between the nodes, by node; empty in lock-step.
    pub(crate) paths: Vec<(String, StageTime)>,
    /// The last statuses of the edges, with their times.
    pub(crate) last_words: &'a [Status],
    pub(crate) elapsed: Duration,
    /// Per camera, from its edge's statuses; empty in lock-step.
    pub(crate) cameras: BTreeMap<String, CameraSummary>,
    /// Result for the target latency, if a live run has one.
    pub(crate) target_latency: Option<TargetLatencySummary>,
    /// The recording, if there is one.
    pub(crate) recording: Option<RecordingSummary>,
}

/// Messages that no step used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Lost {
    /// Unreadable messages.
    pub(crate) unreadable: u64,
    pub(crate) late: u64,
    pub(crate) missing: u64,
    /// Messages of foreign nodes, of another session, of refused edges, or repeated.
    pub(crate) refused: u64,
    /// Messages dropped because the send queue was full.
    pub(crate) unsent: u64,
    /// Patches that ticks had no time for.
    pub(crate) shed: u64,
}

/// Builds the summary. Only `timing` depends on a clock or another process.
pub(crate) fn summarize(venue: &Venue, facts: &RunFacts<'_>) -> Summary {
    let RunFacts { ticks, lost, .. } = facts;
    let done = facts
        .last
        .map_or(0, |last| last + 1 - ticks.start)
        .unsigned_abs();
    let by_edge = |text: fn(&Status) -> &String| -> BTreeMap<String, String> {
        facts
            .edges
            .iter()
            .filter(|edge| !text(edge).is_empty())
            .map(|edge| (edge.node.clone(), text(edge).clone()))
            .collect()
    };
    let elapsed_s = facts.elapsed.as_secs_f64();
    Summary {
        venue: venue.name.clone(),
        venue_hash: venue.hashes.venue.clone(),
        calibration_hash: venue.hashes.calibration.clone(),
        rate_hz: venue.rate_hz,
        complete: facts.ending == Some(Ending::Done),
        ticks: TickSpan {
            first: ticks.start,
            end: ticks.end,
            done,
        },
        people: facts.exported.people_of_summary(),
        events: facts.tally.event_counts().clone(),
        agreement: facts.agreement.clone(),
        links: facts.tally.links(),
        drops: DropSummary {
            unreadable: facts
                .last_words
                .iter()
                .map(|status| status.unreadable)
                .sum::<u64>()
                + lost.unreadable,
            unusable: facts.tally.unusable,
            late: lost.late,
            missing: lost.missing,
            refused: lost.refused,
            unsent: lost.unsent,
            shed: lost.shed,
        },
        backends: by_edge(|status| &status.backend),
        models: by_edge(|status| &status.network_hash),
        versions: versions(),
        timing: TimingSummary {
            elapsed_s,
            ticks_per_s: done as f64 / elapsed_s.max(1e-9),
            stages: stages(facts),
            look_share: detection_shares(facts.last_words),
            missed_ticks: missed_ticks(facts.last_words),
            link_bytes_on_wire: BTreeMap::new(),
            cameras: facts.cameras.clone(),
            target_latency: facts.target_latency.clone(),
            poses: facts.exported.poses.clone(),
            recording: facts.recording.clone(),
        },
    }
}

/// Versions of the program and the wire format.
pub(crate) fn versions() -> BTreeMap<String, String> {
    [
        ("farfield".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("wire".to_owned(), farfield_proto::wire::VERSION.to_string()),
    ]
    .into()
}

/// Stages such as `fusion/step` and `<viewpoint>/read`.
fn stages(facts: &RunFacts<'_>) -> BTreeMap<String, StageTiming> {
    let of_edges = facts.last_words.iter().flat_map(|status| {
        status
            .stages
            .iter()
            .map(|stage| (status.node.as_str(), stage))
    });
    let paths = facts.paths.iter().map(|(node, time)| (node.as_str(), time));
    let own = facts.stages.iter().map(|stage| (FUSION, stage));
    let all = own.chain(of_edges).chain(paths);
    let timing = |stage: &StageTime| StageTiming {
        p50_us: f64::from(stage.p50_us),
        p99_us: f64::from(stage.p99_us),
        p999_us: f64::from(stage.p999_us),
        max_us: f64::from(stage.max_us),
    };
    all.map(|(node, stage)| (format!("{node}/{}", stage.stage), timing(stage)))
        .collect()
}

/// Per edge, the number of ticks that it should have worked on but did not.
fn missed_ticks(last_words: &[Status]) -> BTreeMap<String, u64> {
    let missed = last_words
        .iter()
        .map(|status| (status.node.clone(), status.missed_ticks()));
    missed.filter(|(_, missed)| *missed > 0).collect()
}

/// Share of each edge's work for detection passes, 0 to 1.
fn detection_shares(last_words: &[Status]) -> BTreeMap<String, f64> {
    let share = |status: &Status| {
        let total_us = |detection: bool| {
            let stages = status.stages.iter();
            let of_passes = [DETECTION_STAGE, SIGHTING_STAGE];
            let stages = stages.filter(|s| !detection || of_passes.contains(&&*s.stage));
            stages.map(|s| s.total_us).sum::<u64>() as f64
        };
        let all_us = total_us(false);
        (all_us > 0.0).then(|| (status.node.clone(), total_us(true) / all_us))
    };
    last_words.iter().filter_map(share).collect()
}
