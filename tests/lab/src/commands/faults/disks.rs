//! Disks that are full for a while, or that hang: mounted for the drive, which takes root.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use anyhow::Context as _;
use farfield_proto::tick::Tick;

use super::field::Field;
use super::stage::Stage;
use super::table::{Driven, Measure};
use crate::small_disk::SmallDisk;

/// For how long a disk hangs, seconds.
const HANGS_S: u32 = 10;
/// Share of the ticks without a pose while it does, percent.
const MOST_GAPS: f64 = 1.0;

pub(super) fn full(field: &Field) -> anyhow::Result<Driven> {
    let mut stage = Stage::prepare(field, "disk-full")?;
    let disk = match SmallDisk::mount(&stage.out("disk")) {
        Ok(disk) => disk,
        Err(why) => return Ok(Driven::NotHad(why)),
    };
    let out = disk.path().join("out");
    stage.begin(&out, &[])?;
    let from = stage.tick()?;
    let has_said = |words: &str| {
        let fusion = stage.live.fusion.as_ref();
        fusion.is_some_and(|fusion| fusion.said().contains(words))
    };
    stage.wait("the disk is full", |_| has_said("the disk is full"))?;
    stage.go_on(field.either(10.0, 3.0));
    disk.grow().map_err(anyhow::Error::msg)?;
    stage.wait("there is room again", |_| has_said("there is room again"))?;
    stage.go_on(2.0);
    let people = stage.people_since(from)?;
    stage.finish()?;
    let mut measures = written(&stage, &out)?;
    measures.extend(people);
    Ok(Driven::Measured(measures))
}

pub(super) fn hangs(field: &Field) -> anyhow::Result<Driven> {
    let mut stage = Stage::prepare(field, "disk-hangs")?;
    let disk = match SmallDisk::mount_freezable(&stage.out("disk")) {
        Ok(disk) => disk,
        Err(why) => return Ok(Driven::NotHad(why)),
    };
    let out = disk.path().join("out");
    stage.begin(&out, &[])?;
    let mut hanging = disk.freeze(HANGS_S)?;
    stage.go_on(0.5);
    let from = stage.tick()?;
    stage.go_on(f64::from(HANGS_S) - 1.0);
    let until = stage.tick()?;
    let ticks: BTreeSet<Tick> = stage.seen()?.arrivals.iter().map(|it| it.tick).collect();
    let there = ticks.range(from..until).count();
    let gaps = 100.0 * (1.0 - there as f64 / (until - from).max(1) as f64);
    let behind_s = f64::from(HANGS_S) - 1.0 - (until - from) as f64 / stage.live.venue().rate_hz;
    let people = stage.people_since(from)?;
    hanging.wait()?;
    stage.go_on(2.0);
    stage.finish()?;
    let mut measures = vec![
        Measure::barred("ticks without poses while it hangs, %", gaps, MOST_GAPS),
        Measure::barred("what poses are behind after it, s", behind_s, 0.1),
    ];
    measures.extend(written(&stage, &out)?);
    measures.extend(people);
    Ok(Driven::Measured(measures))
}

/// What is in the file of poses, and what of them was heard and is not there.
fn written(stage: &Stage<'_>, out: &Path) -> anyhow::Result<Vec<Measure>> {
    let path = out.join("poses.jsonl");
    let file = File::open(&path).with_context(|| format!("opening {}", path.display()))?;
    let (mut ticks, mut unreadable) = (BTreeSet::new(), 0u32);
    for line in BufReader::new(file).lines() {
        let line: serde_json::Value = serde_json::from_str(&line?).unwrap_or_default();
        match line["tick"].as_i64() {
            Some(tick) => drop(ticks.insert(Tick(tick))),
            None => unreadable += 1,
        }
    }
    let seen = stage.seen()?;
    let heard = seen.arrivals.iter().filter(|it| it.tracked > 0);
    let missing = heard.filter(|it| !ticks.contains(&it.tick)).count();
    Ok(vec![
        Measure::barred(
            "ticks that were heard and are not in the file",
            missing as f64,
            0.0,
        ),
        Measure::barred("lines that cannot be read", f64::from(unreadable), 0.0),
    ])
}
