//! Nodes that die and start again, an edge that floods, and two fusions of one venue.

use std::net::{Ipv4Addr, UdpSocket};
use std::path::Path;
use std::process::Command;
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, ensure};
use farfield_node::clock;

use super::stage::{Field, Stage, edge_link};
use super::strangers::make_keys;
use super::table::{FaultOutcome, Measure};
use crate::live_venue::NodeProcess;

/// Longest time from the first poses of a restarted fusion until all people are tracked, seconds.
const BACK_WITHIN_S: f64 = 2.0;
/// Downtime of a fusion that is not restarted at once, seconds.
const DOWN_S: f64 = 4.0;
/// Longest time from the start of fusion until all people are tracked, seconds. Three times this is less than the lease of a
/// link, so that edges cannot have waited for the lease.
const WITHOUT_ALL_PEOPLE_S: f64 = 1.5;
/// Largest increase of a recording's growth under a flood, percent.
const MOST_GROWTH: f64 = 10.0;

pub(super) fn fusion_killed(field: &Field) -> anyhow::Result<FaultOutcome> {
    fusion_away(field, "fusion-killed", 0.0)
}

/// Fusion is killed and stays down for some seconds while people walk on.
pub(super) fn fusion_down(field: &Field) -> anyhow::Result<FaultOutcome> {
    fusion_away(field, "fusion-down", DOWN_S)
}

fn fusion_away(field: &Field, name: &str, down_s: f64) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, name)?;
    stage.live.fusion_by_hand();
    let [first, second] = ["first", "second"].map(|life| stage.out(life));
    stage.begin(&first, &[])?;
    let from = stage.tick()?;
    let session = stage
        .seen()?
        .newest
        .as_ref()
        .context("no pose has come")?
        .session;
    stage
        .live
        .fusion
        .take()
        .context("fusion was started")?
        .kill()?;
    stage.run_for(down_s);
    stage.live.start_fusion(&second, &[])?;
    let people = field.truth.people();
    let without = stage.wait("all people are tracked again", |seen| {
        let is_next = seen
            .newest
            .as_ref()
            .is_some_and(|set| set.session != session);
        is_next && seen.tracked() == people
    })?;
    let back_s = {
        let seen = stage.seen()?;
        let mut next = seen.arrivals.iter().filter(|it| it.session != session);
        let first = next
            .clone()
            .next()
            .context("the next fusion publishes no poses")?
            .tick;
        let whole = next
            .find(|it| it.tracked == people)
            .context("all people were never tracked")?
            .tick;
        (whole - first) as f64 / stage.live.venue().rate_hz
    };
    stage.run_for(field.whole_or_quick(5.0, 2.0));
    let mut measures = vec![
        Measure::limited(
            "from its first poses to all people, s",
            back_s,
            BACK_WITHIN_S,
        ),
        Measure::limited(
            "without all people, s",
            without.as_secs_f64(),
            WITHOUT_ALL_PEOPLE_S,
        ),
    ];
    measures.extend(stage.people_since(from)?);
    Ok(FaultOutcome::Measured(measures))
}

pub(super) fn edge_killed(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::open(field, "edge-killed", &[])?;
    let from = stage.tick()?;
    let edge = stage.live.edges[0].take().context("the edge was started")?;
    let name = edge.name().to_owned();
    edge.kill()?;
    stage.wait("fusion reports the edge as missing", |seen| {
        edge_link(seen, &name).is_some_and(|edge| !edge.live)
    })?;
    stage.run_for(1.0);
    stage.live.start_edges()?;
    let back = stage.wait("the edge is back", |seen| {
        edge_link(seen, &name).is_some_and(|edge| edge.live && edge.bytes_per_s > 0)
    })?;
    stage.run_for(field.whole_or_quick(5.0, 2.0));
    let mut measures = vec![Measure::reported(
        "from its start to its part, s",
        back.as_secs_f64(),
    )];
    measures.extend(stage.people_since(from)?);
    Ok(FaultOutcome::Measured(measures))
}

pub(super) fn flood(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, "flood")?;
    let recording = stage.out("run.mcap");
    let (out, path) = (
        stage.out("first"),
        recording.to_str().context("a path in UTF-8")?,
    );
    stage.begin(&out, &["--record", path])?;
    let span_s = field.whole_or_quick(10.0, 4.0);
    let before = growth(&stage, &recording, span_s)?;
    let from = stage.tick()?;
    let viewpoint = stage.live.venue().viewpoints[0].name.clone();
    let (flooded, sent_bytes) = stage
        .watch()?
        .flood(&viewpoint, || growth(&stage, &recording, span_s));
    let more = 100.0 * (flooded? / before - 1.0);
    let log = stage
        .live
        .fusion
        .as_ref()
        .map(NodeProcess::output)
        .unwrap_or_default();
    let is_reported = log.contains(&format!(
        "viewpoint {viewpoint} sends more than any edge may"
    ));
    let mut measures = vec![
        Measure::limited("the recording grows faster by, %", more, MOST_GROWTH),
        Measure::limited(
            "floods that are not reported",
            f64::from(u8::from(!is_reported)),
            0.0,
        ),
        Measure::reported("noise, MB/s", sent_bytes as f64 / 1e6 / span_s),
    ];
    measures.extend(stage.people_since(from)?);
    Ok(FaultOutcome::Measured(measures))
}

/// Growth of the recording over `span_s`, bytes per tick.
fn growth(stage: &Stage<'_>, recording: &Path, span_s: f64) -> anyhow::Result<f64> {
    let measure = || -> anyhow::Result<_> {
        let bytes = std::fs::metadata(recording)?.len();
        Ok((bytes, stage.tick()?))
    };
    let (bytes, tick) = measure()?;
    stage.run_for(span_s);
    let (later_bytes, later) = measure()?;
    ensure!(later > tick, "no pose has come for {span_s} s");
    Ok((later_bytes - bytes) as f64 / (later - tick) as f64)
}

/// Number of rounds.
const ROUNDS: u32 = 10;
/// Longest time until the waiting fusion listens after the other was killed, seconds: the lease of its link, and the time
/// until its old socket is free.
const TAKES_OVER_S: f64 = 8.0;
/// Time limit of all waits, seconds.
const PATIENCE_S: f64 = 30.0;
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(20);

pub(super) fn two_fusions(field: &Field) -> anyhow::Result<FaultOutcome> {
    let folder = field.folder("two-fusions")?;
    let keys = make_keys(field, &folder)?;
    let (mut slowest_s, mut failures, mut began) = (0.0_f64, 0, 0);
    for round in 0..ROUNDS {
        let [one, other] = [free_endpoint()?, free_endpoint()?];
        let venue = field.maps.venue.with_file_name("two.toml");
        let text = std::fs::read_to_string(&field.maps.venue)?;
        std::fs::write(
            &venue,
            format!("{text}\n[fusion]\nconnect = [\"{one}\", \"{other}\"]\n"),
        )?;
        let start = |endpoint: &str| {
            let mut command = Command::new(&field.maps.program);
            command.arg("fusion").arg(&venue).args(["--live", "--out"]);
            command.arg(folder.join(format!("{round}-{}", endpoint.replace('/', "-"))));
            command.args(["--listen", endpoint, "--certificates"]);
            command.arg(&keys);
            NodeProcess::start(endpoint, command)
        };
        let both = [start(&one)?, start(&other)?];
        let waits = |node: &NodeProcess| node.output().contains("this one waits");
        wait_for_nodes(&both, |both| both.iter().any(waits))?;
        let [one, other] = both;
        let (first, mut second) = if waits(&other) {
            (one, other)
        } else {
            (other, one)
        };
        // Both may have begun to listen before one stepped back.
        began += usize::from(second.output().contains("fusion listens on"));
        first.kill()?;
        let from = clock::now();
        let listens = |node: &NodeProcess| node.output().contains("fusion listens on");
        match wait_for_nodes(std::slice::from_ref(&second), |it| listens(&it[0])) {
            Ok(()) => {
                slowest_s = slowest_s.max(clock::now().duration_since(from).as_secs_f64());
            }
            Err(_) => failures += 1,
        }
        ensure!(
            second.wait(PAUSE)?.is_none() || failures > 0,
            "{}",
            second.output()
        );
    }
    Ok(FaultOutcome::Measured(vec![
        Measure::limited("times none took over", f64::from(failures), 0.0),
        Measure::limited("slowest takeover, s", slowest_s, TAKES_OVER_S),
        Measure::limited("times both worked", began as f64, 0.0),
        Measure::reported("times two were started", f64::from(ROUNDS)),
    ]))
}

/// A free endpoint of this machine.
fn free_endpoint() -> anyhow::Result<String> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    Ok(format!("quic/{}", socket.local_addr()?))
}

/// Waits until a condition holds.
fn wait_for_nodes(
    nodes: &[NodeProcess],
    condition: impl Fn(&[NodeProcess]) -> bool,
) -> anyhow::Result<()> {
    let from = clock::now();
    while !condition(nodes) {
        let waited_s = clock::now().duration_since(from).as_secs_f64();
        let output: String = nodes.iter().map(NodeProcess::output).collect();
        ensure!(waited_s < PATIENCE_S, "not within {PATIENCE_S} s\n{output}");
        thread::sleep(PAUSE);
    }
    Ok(())
}
