//! Links that are cut, lose datagrams, or are shared; repeated outages of all links, and of fusion.

use std::collections::BTreeMap;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context as _, ensure};
use farfield_proto::tick::Tick;

use super::stage::{Field, MAX_MEAN_MM, SPRINTER, Stage};
use super::table::{FaultOutcome, Measure};
use crate::commands::links;
use crate::relay::Impairment;

/// Largest difference of an edge's rate behind a shared link from the mean, percent.
const MOST_APART: f64 = 20.0;

pub(super) fn cut_short(field: &Field) -> anyhow::Result<FaultOutcome> {
    cut(field, "cut-short", 0.7)
}

pub(super) fn cut_long(field: &Field) -> anyhow::Result<FaultOutcome> {
    cut(field, "cut-long", 3.0)
}

fn cut(field: &Field, name: &str, seconds: f64) -> anyhow::Result<FaultOutcome> {
    let stage = Stage::open(field, name, &[])?;
    let from = stage.tick()?;
    stage.live.relays[0].cut(Duration::from_secs_f64(seconds));
    stage.run_for(seconds + field.whole_or_quick(5.0, 3.0));
    Ok(FaultOutcome::Measured(stage.people_since(from)?))
}

pub(super) fn loss(field: &Field) -> anyhow::Result<FaultOutcome> {
    let stage = Stage::open(field, "loss", &[])?;
    let from = stage.tick()?;
    for relay in &stage.live.relays {
        relay.set_both(Impairment {
            loss: 0.2,
            ..Impairment::default()
        });
    }
    stage.run_for(field.whole_or_quick(20.0, 5.0));
    Ok(FaultOutcome::Measured(stage.people_since(from)?))
}

pub(super) fn bottleneck(field: &Field) -> anyhow::Result<FaultOutcome> {
    let row = links::one_bottleneck(&field.folder("bottleneck")?)?;
    let apart = row.rates_apart.map_or(f64::NAN, |share| 100.0 * share);
    Ok(FaultOutcome::Measured(vec![
        Measure::limited(
            "mean distance, mm",
            row.mpjpe_mm.unwrap_or(f64::NAN),
            MAX_MEAN_MM,
        ),
        Measure::limited("id switches", row.id_switches as f64, 0.0),
        Measure::limited("an edge's rate from the mean of all, %", apart, MOST_APART),
        Measure::reported(
            "capture to pose, P99, ms",
            row.delay_p99_ms.unwrap_or(f64::NAN),
        ),
        Measure::reported(
            "people and ticks without a pose, %",
            100.0 * row.gaps as f64 / row.frames.max(1) as f64,
        ),
    ]))
}

/// Periods of the outages, seconds; a quick run uses the first only.
const PERIODS_S: [f64; 3] = [4.0, 5.9, 7.0];
/// Outages of each period, whole and quick.
const OUTAGES: [usize; 2] = [10, 3];
/// Largest mean error of poses, outages included, millimetres.
const MAX_OUTAGE_MM: f64 = 30.0;
/// Poses are back when all people have one and the mean error is below this, millimetres.
const BACK_MM: f64 = 50.0;
/// Largest mean time from the end of an outage until poses are back, and how long to wait for them, seconds.
const BACK_S: f64 = 0.3;
const PATIENCE_S: f64 = 2.5;
/// Downtimes of fusion, and time after it until ids are compared, seconds.
const AWAY_S: [f64; 2] = [2.0, 3.0];
const FOUND_AFTER_S: f64 = 4.0;
/// Number of downtimes, whole and quick.
const TIMES: [usize; 2] = [6, 2];
/// Largest share of runners with a new id, percent.
const MOST_NEW: f64 = 5.0;

pub(super) fn of_300_ms(field: &Field) -> anyhow::Result<FaultOutcome> {
    outages(field, "outages-300", 0.3)
}

pub(super) fn of_500_ms(field: &Field) -> anyhow::Result<FaultOutcome> {
    outages(field, "outages-500", 0.5)
}

pub(super) fn of_700_ms(field: &Field) -> anyhow::Result<FaultOutcome> {
    outages(field, "outages-700", 0.7)
}

pub(super) fn of_1000_ms(field: &Field) -> anyhow::Result<FaultOutcome> {
    outages(field, "outages-1000", 1.0)
}

fn outages(field: &Field, name: &str, seconds: f64) -> anyhow::Result<FaultOutcome> {
    let stage = Stage::open(field.runners()?, name, &[])?;
    let from = stage.tick()?;
    let rate_hz = stage.live.venue().rate_hz;
    let periods = if field.is_quick { 1 } else { PERIODS_S.len() };
    let mut back_at = Vec::new();
    let mut kept_ids = KeptIds::default();
    let mut before = stage.ids_by_person()?;
    for period_s in &PERIODS_S[..periods] {
        for _ in 0..OUTAGES[usize::from(field.is_quick)] {
            for relay in &stage.live.relays {
                relay.cut(Duration::from_secs_f64(seconds));
            }
            stage.run_for(seconds);
            back_at.push(stage.tick()?);
            stage.run_for(period_s - seconds);
            let after = stage.ids_by_person()?;
            kept_ids.count(&before, &after);
            before = after;
        }
    }
    let patience = (PATIENCE_S * rate_hz) as i64;
    let back_s = back_at.iter().map(|&tick| {
        let mut ticks = (0..patience).map(|after| tick + after);
        let is_back = |&tick: &Tick| {
            let off_mm = stage.mean_mm_at(tick);
            off_mm.is_some_and(|mm| mm < BACK_MM)
        };
        let back = ticks.find(is_back).map_or(patience, |at| at - tick);
        back as f64 / rate_hz
    });
    let back_s: Vec<f64> = back_s.collect();
    let worst_s = back_s.iter().copied().fold(0.0, f64::max);
    let mean_s = back_s.iter().sum::<f64>() / back_s.len().max(1) as f64;
    let mut measures = vec![
        Measure::limited("back below 50 mm, mean, s", mean_s, BACK_S),
        Measure::reported("the latest of them, s", worst_s),
    ];
    measures.extend(stage.people_within(from, MAX_OUTAGE_MM)?);
    measures.extend(kept_ids.measures());
    Ok(FaultOutcome::Measured(measures))
}

/// Fusion is killed and started again 2 s later, as its systemd unit does, repeatedly.
pub(super) fn fusion_restarted(field: &Field) -> anyhow::Result<FaultOutcome> {
    fusion_away(field, "fusion-restart", |stage, life| {
        let fusion = stage.live.fusion.take().context("fusion was started")?;
        fusion.kill()?;
        stage.run_for(AWAY_S[0]);
        let out = stage.out(&format!("life-{life}"));
        Ok(stage.live.start_fusion(&out, &[])?)
    })
}

/// Fusion is stopped (SIGSTOP) for 3 s, repeatedly.
pub(super) fn fusion_stopped(field: &Field) -> anyhow::Result<FaultOutcome> {
    fusion_away(field, "fusion-stopped", |stage, _| {
        let fusion = stage.live.fusion.as_ref().context("fusion was started")?;
        let pid = fusion.pid().to_string();
        signal(&pid, "-STOP")?;
        stage.run_for(AWAY_S[1]);
        signal(&pid, "-CONT")
    })
}

fn signal(pid: &str, which: &str) -> anyhow::Result<()> {
    let status = Command::new("kill").args([which, pid]).status()?;
    ensure!(status.success(), "kill {which} {pid}: {status}");
    Ok(())
}

fn fusion_away(
    field: &Field,
    name: &str,
    away: impl Fn(&mut Stage<'_>, usize) -> anyhow::Result<()>,
) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field.runners()?, name)?;
    stage.live.fusion_by_hand();
    let out = stage.out("first");
    stage.begin(&out, &[])?;
    stage.run_for(1.0);
    let mut kept = KeptIds::default();
    for life in 0..TIMES[usize::from(field.is_quick)] {
        let before = stage.ids_by_person()?;
        away(&mut stage, life)?;
        stage.run_for(FOUND_AFTER_S);
        kept.count(&before, &stage.ids_by_person()?);
        stage.run_for(1.0);
    }
    Ok(FaultOutcome::Measured(kept.measures()))
}

/// Ids kept by people who run at up to 4 m/s. The sprinter may be anywhere after a second.
#[derive(Debug, Default)]
struct KeptIds {
    runners: usize,
    kept: usize,
    others: usize,
    sprinter_new: usize,
}

impl KeptIds {
    /// Compares the ids before and after.
    fn count(&mut self, before: &BTreeMap<u32, u32>, after: &BTreeMap<u32, u32>) {
        let has_kept = |person: &u32| before.get(person) == after.get(person);
        let runs = before.keys().filter(|person| **person != SPRINTER);
        self.runners += runs.clone().count();
        self.kept += runs.filter(|&person| has_kept(person)).count();
        self.sprinter_new += usize::from(before.contains_key(&SPRINTER) && !has_kept(&SPRINTER));
        self.others += others_ids(before, after);
    }

    fn measures(&self) -> Vec<Measure> {
        let new = 100.0 * (1.0 - self.kept as f64 / self.runners.max(1) as f64);
        vec![
            Measure::limited("runners without their id, %", new, MOST_NEW),
            Measure::limited("people with another's id", self.others as f64, 0.0),
            Measure::reported("runners and times", self.runners as f64),
            Measure::reported("times the sprinter lost its id", self.sprinter_new as f64),
        ]
    }
}

/// Number of people whose id `after` was another person's `before`.
fn others_ids(before: &BTreeMap<u32, u32>, after: &BTreeMap<u32, u32>) -> usize {
    let is_others = |(person, id): &(&u32, &u32)| {
        let mut had = before.iter();
        had.any(|(other, theirs)| other != *person && theirs == *id)
    };
    after.iter().filter(is_others).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_that_another_had_counts_and_a_new_one_does_not() {
        let before = [(1, 1), (2, 2), (3, 3)].into();
        assert_eq!(others_ids(&before, &[(1, 1), (2, 9), (3, 3)].into()), 0);
        assert_eq!(others_ids(&before, &[(1, 2), (2, 1), (3, 3)].into()), 2);
        assert_eq!(others_ids(&before, &[(1, 1), (2, 3)].into()), 1);
    }
}
