//! Eight runners whose links are all away again and again, and whose fusion is away for seconds.

use std::collections::BTreeMap;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context as _, ensure};
use farfield_proto::tick::Tick;

use super::field::{Field, SPRINTER};
use super::stage::Stage;
use super::table::{Driven, Measure};

/// From the beginning of one outage to that of the next, seconds; a quick drive has the first alone.
const PERIODS_S: [f64; 3] = [4.0, 5.9, 7.0];
/// Outages of each period, whole and quick.
const OUTAGES: [usize; 2] = [10, 3];
/// How far poses may be from the truth on average, outages included, millimetres.
const MOST_MM: f64 = 30.0;
/// Poses are back when everybody has one, and they are so near to the truth on average, millimetres.
const BACK_MM: f64 = 50.0;
/// How soon after the links they must be back, seconds, and how long they are waited for.
const BACK_S: f64 = 0.3;
const PATIENCE_S: f64 = 2.5;
/// For how long fusion is away, and how long after that everybody is looked for, seconds.
const AWAY_S: [f64; 2] = [2.0, 3.0];
const FOUND_AFTER_S: f64 = 4.0;
/// How often it is away, whole and quick.
const TIMES: [usize; 2] = [6, 2];
/// Share of the runners who may get a new id, percent.
const MOST_NEW: f64 = 5.0;

pub(super) fn of_300_ms(field: &Field) -> anyhow::Result<Driven> {
    outages(field, "outages-300", 0.3)
}

pub(super) fn of_500_ms(field: &Field) -> anyhow::Result<Driven> {
    outages(field, "outages-500", 0.5)
}

pub(super) fn of_700_ms(field: &Field) -> anyhow::Result<Driven> {
    outages(field, "outages-700", 0.7)
}

pub(super) fn of_1000_ms(field: &Field) -> anyhow::Result<Driven> {
    outages(field, "outages-1000", 1.0)
}

fn outages(field: &Field, name: &str, seconds: f64) -> anyhow::Result<Driven> {
    let stage = Stage::open(field.runners()?, name, &[])?;
    let from = stage.tick()?;
    let rate_hz = stage.live.venue().rate_hz;
    let periods = if field.is_quick { 1 } else { PERIODS_S.len() };
    let mut back_at = Vec::new();
    let mut kept = KeptIds::default();
    let mut before = stage.who_is_who()?;
    for period_s in &PERIODS_S[..periods] {
        for _ in 0..OUTAGES[usize::from(field.is_quick)] {
            for relay in &stage.live.relays {
                relay.cut(Duration::from_secs_f64(seconds));
            }
            stage.go_on(seconds);
            back_at.push(stage.tick()?);
            stage.go_on(period_s - seconds);
            let after = stage.who_is_who()?;
            kept.count(&before, &after);
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
        Measure::barred("back below 50 mm, mean, s", mean_s, BACK_S),
        Measure::told("the latest of them, s", worst_s),
    ];
    measures.extend(stage.people_within(from, MOST_MM)?);
    measures.extend(kept.measures());
    Ok(Driven::Measured(measures))
}

/// Fusion is killed and started again 2 s later, as its unit does, again and again.
pub(super) fn fusion_restarted(field: &Field) -> anyhow::Result<Driven> {
    fusion_away(field, "fusion-restart", |stage, life| {
        let fusion = stage.live.fusion.take().context("fusion was started")?;
        fusion.kill()?;
        stage.go_on(AWAY_S[0]);
        let out = stage.out(&format!("life-{life}"));
        Ok(stage.live.start_fusion(&out, &[])?)
    })
}

/// Fusion is stopped (SIGSTOP) for 3 s, again and again.
pub(super) fn fusion_stopped(field: &Field) -> anyhow::Result<Driven> {
    fusion_away(field, "fusion-stopped", |stage, _| {
        let fusion = stage.live.fusion.as_ref().context("fusion was started")?;
        let pid = fusion.pid().to_string();
        signal(&pid, "-STOP")?;
        stage.go_on(AWAY_S[1]);
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
) -> anyhow::Result<Driven> {
    let mut stage = Stage::prepare(field.runners()?, name)?;
    stage.live.fusion_by_hand();
    let out = stage.out("first");
    stage.begin(&out, &[])?;
    stage.go_on(1.0);
    let mut kept = KeptIds::default();
    for life in 0..TIMES[usize::from(field.is_quick)] {
        let before = stage.who_is_who()?;
        away(&mut stage, life)?;
        stage.go_on(FOUND_AFTER_S);
        kept.count(&before, &stage.who_is_who()?);
        stage.go_on(1.0);
    }
    Ok(Driven::Measured(kept.measures()))
}

/// Who has its id still, of those who run at up to 4 m/s; the sprinter may be anywhere after a second.
#[derive(Debug, Default)]
struct KeptIds {
    runners: usize,
    kept: usize,
    others: usize,
    sprinter_new: usize,
}

impl KeptIds {
    /// Compares who was who before and after.
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
            Measure::barred("runners without their id, %", new, MOST_NEW),
            Measure::barred("people with another's id", self.others as f64, 0.0),
            Measure::told("runners and times", self.runners as f64),
            Measure::told("times the sprinter lost its id", self.sprinter_new as f64),
        ]
    }
}

/// How many have the id `after` that another had `before`.
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
