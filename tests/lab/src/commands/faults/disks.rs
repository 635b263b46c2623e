//! Disks that are full for a while or hang: mounted for the fault, which needs root. Disks with errors: a library that wraps
//! system calls, which needs a C compiler.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;
use std::process::Command;

use anyhow::Context as _;
use farfield_proto::tick::Tick;
use farfield_proto::transport::FUSION;

use super::stage::Field;
use super::stage::Stage;
use super::table::{FaultOutcome, Measure};
use crate::small_disk::SmallDisk;

/// Duration of a hang, seconds.
const HANGS_S: u32 = 22;
/// Largest share of ticks without a pose during the hang, percent.
const MOST_GAPS: f64 = 1.0;

pub(super) fn full(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, "disk-full")?;
    let disk = match SmallDisk::mount(&stage.out("disk")) {
        Ok(disk) => disk,
        Err(why) => return Ok(FaultOutcome::Unavailable(why)),
    };
    let out = disk.path().join("out");
    stage.begin(&out, &[])?;
    let from = stage.tick()?;
    let has_printed = |words: &str| {
        let fusion = stage.live.fusion.as_ref();
        fusion.is_some_and(|fusion| fusion.output().contains(words))
    };
    stage.wait("the disk is full", |_| has_printed("the disk is full"))?;
    stage.run_for(field.whole_or_quick(10.0, 3.0));
    disk.grow().map_err(anyhow::Error::msg)?;
    stage.wait("there is room again", |_| {
        has_printed("there is room again")
    })?;
    stage.run_for(2.0);
    let people = stage.people_since(from)?;
    stage.finish()?;
    let mut measures = check_pose_files(&stage, &out)?;
    measures.extend(people);
    Ok(FaultOutcome::Measured(measures))
}

pub(super) fn hangs(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, "disk-hangs")?;
    let disk = match SmallDisk::mount_freezable(&stage.out("disk")) {
        Ok(disk) => disk,
        Err(why) => return Ok(FaultOutcome::Unavailable(why)),
    };
    let out = disk.path().join("out");
    let record = disk.path().join("run.mcap");
    stage.begin(&out, &["--record", &record.display().to_string()])?;
    let mut hanging = disk.freeze(HANGS_S)?;
    let reported = stage.wait("the hang is in the status", |seen| {
        seen.statuses.get(FUSION).is_some_and(|status| {
            let mut notices = status.health.notices.iter();
            notices.any(|notice| notice.contains("the disk has not answered"))
        })
    })?;
    let from = stage.tick()?;
    let rest_s = f64::from(HANGS_S) - reported.as_secs_f64() - 1.0;
    stage.run_for(rest_s);
    let until = stage.tick()?;
    let ticks: BTreeSet<Tick> = stage.seen()?.arrivals.iter().map(|it| it.tick).collect();
    let there = ticks.range(from..until).count();
    let gaps = 100.0 * (1.0 - there as f64 / (until - from).max(1) as f64);
    let behind_s = rest_s - (until - from) as f64 / stage.live.venue().rate_hz;
    let people = stage.people_since(from)?;
    hanging.wait()?;
    stage.run_for(2.0);
    let log = stage.live.output();
    let missing = ["the disk has not answered", "the disk answers again"]
        .into_iter()
        .filter(|words| !log.contains(words));
    let n_missing = missing.count();
    stage.finish()?;
    let summary =
        std::fs::read_to_string(out.join("summary.json")).context("reading the summary")?;
    let summary: serde_json::Value = serde_json::from_str(&summary)?;
    let lost = summary["timing"]["recording"]["lost"].as_f64();
    let mut measures = vec![
        Measure::limited("ticks without poses while it hangs, %", gaps, MOST_GAPS),
        Measure::limited("lag of poses after it, s", behind_s, 0.1),
        Measure::limited("until it is in the status, s", reported.as_secs_f64(), 4.0),
        Measure::limited(
            "reports that are not on the terminal",
            n_missing as f64,
            0.0,
        ),
        Measure::limited(
            "messages that were not recorded",
            lost.unwrap_or(f64::NAN),
            0.0,
        ),
    ];
    measures.extend(check_pose_files(&stage, &out)?);
    measures.extend(people);
    Ok(FaultOutcome::Measured(measures))
}

pub(super) fn errors(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, "disk-errors")?;
    let library = stage.out("failing_disk.so");
    if let Err(why) = build(&library) {
        return Ok(FaultOutcome::Unavailable(why));
    }
    stage.live.fusion_environment(vec![
        ("LD_PRELOAD".to_owned(), library.display().to_string()),
        (
            "FAILING_WRITES".to_owned(),
            "/poses.jsonl.tmp:/poses_2.trc.tmp".to_owned(),
        ),
        ("FAILING_SYNC".to_owned(), "/angles_1.mot.tmp".to_owned()),
    ]);
    let out = stage.out("out");
    stage.begin(&out, &[])?;
    let from = stage.tick()?;
    // The files of persons are synced every ten seconds.
    stage.run_for(11.0);
    let log = stage.live.output();
    let reports = ["poses.jsonl: ", "poses_2.trc: ", "angles_1.mot: "].map(|name| {
        let n = log.matches(&format!("error: {name}")).count();
        n.abs_diff(1)
    });
    let people = stage.people_since(from)?;
    stage.finish()?;
    let mut measures = vec![Measure::limited(
        "refused files that are not reported once",
        reports.iter().sum::<usize>() as f64,
        0.0,
    )];
    measures.extend(check_pose_files(&stage, &out)?);
    measures.extend(people);
    Ok(FaultOutcome::Measured(measures))
}

/// Builds the library that wraps the system calls.
///
/// # Errors
/// The reason, for example no C compiler.
fn build(library: &Path) -> Result<(), String> {
    let source = library.with_extension("c");
    std::fs::write(&source, include_str!("failing_disk.c")).map_err(|error| error.to_string())?;
    let mut cc = Command::new("cc");
    let built = cc
        .args(["-shared", "-fPIC", "-o"])
        .args([library, &source])
        .arg("-ldl")
        .output();
    let built = built.map_err(|error| format!("cc: {error}"))?;
    if built.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&built.stderr).into_owned())
    }
}

/// Ticks that were received but are missing in the files of poses, and lines that cannot be read.
fn check_pose_files(stage: &Stage<'_>, out: &Path) -> anyhow::Result<Vec<Measure>> {
    let (mut ticks, mut unreadable) = (BTreeSet::new(), 0u32);
    for entry in out
        .read_dir()
        .with_context(|| format!("reading {}", out.display()))?
    {
        let path = entry?.path();
        if path
            .extension()
            .is_none_or(|extension| extension != "jsonl")
        {
            continue;
        }
        let file = File::open(&path).with_context(|| format!("opening {}", path.display()))?;
        for line in BufReader::new(file).lines() {
            let line: serde_json::Value = serde_json::from_str(&line?).unwrap_or_default();
            match line["tick"].as_i64() {
                Some(tick) => drop(ticks.insert(Tick(tick))),
                None => unreadable += 1,
            }
        }
    }
    let seen = stage.seen()?;
    let received = seen.arrivals.iter().filter(|it| it.tracked > 0);
    let missing = received.filter(|it| !ticks.contains(&it.tick)).count();
    Ok(vec![
        Measure::limited(
            "received ticks that are not in the file",
            missing as f64,
            0.0,
        ),
        Measure::limited("lines that cannot be read", f64::from(unreadable), 0.0),
    ])
}
