//! Nodes that die and come again, and one that is in other hands.

use std::path::Path;

use anyhow::{Context as _, ensure};

use super::field::Field;
use super::stage::{Stage, heard};
use super::table::{Driven, Measure};
use crate::live_venue::NodeProcess;

/// How soon after its first poses a fusion that was started again must have everybody, seconds.
const BACK_WITHIN_S: f64 = 2.0;
/// How long a fusion stays away that nothing starts again at once, seconds.
const DOWN_S: f64 = 4.0;
/// How long after its start everybody must be there again, seconds: three times as long is still less than the lease of a
/// link, so that edges have not waited for that.
const WITHOUT_EVERYBODY_S: f64 = 1.5;
/// How much faster a recording may grow under a flood, percent.
const MOST_GROWTH: f64 = 10.0;

pub(super) fn fusion_killed(field: &Field) -> anyhow::Result<Driven> {
    fusion_away(field, "fusion-killed", 0.0)
}

/// The same, and nothing starts it again for some seconds, in which people walk on.
pub(super) fn fusion_down(field: &Field) -> anyhow::Result<Driven> {
    fusion_away(field, "fusion-down", DOWN_S)
}

fn fusion_away(field: &Field, name: &str, down_s: f64) -> anyhow::Result<Driven> {
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
    stage.go_on(down_s);
    stage.live.start_fusion(&second, &[])?;
    let people = field.truth.people();
    let without = stage.wait("everybody is tracked again", |seen| {
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
            .context("the next fusion says poses")?
            .tick;
        let whole = next
            .find(|it| it.tracked == people)
            .context("everybody was tracked")?
            .tick;
        (whole - first) as f64 / stage.live.venue().rate_hz
    };
    stage.go_on(field.either(5.0, 2.0));
    let mut measures = vec![
        Measure::barred(
            "from its first poses to everybody, s",
            back_s,
            BACK_WITHIN_S,
        ),
        Measure::barred(
            "without everybody, s",
            without.as_secs_f64(),
            WITHOUT_EVERYBODY_S,
        ),
    ];
    measures.extend(stage.people_since(from)?);
    Ok(Driven::Measured(measures))
}

pub(super) fn edge_killed(field: &Field) -> anyhow::Result<Driven> {
    let mut stage = Stage::open(field, "edge-killed", &[])?;
    let from = stage.tick()?;
    let edge = stage.live.edges[0].take().context("the edge was started")?;
    let name = edge.name().to_owned();
    edge.kill()?;
    stage.wait("the edge is missed", |seen| {
        heard(seen, &name).is_some_and(|edge| !edge.live)
    })?;
    stage.go_on(1.0);
    stage.live.start_edges()?;
    let back = stage.wait("the edge is back", |seen| {
        heard(seen, &name).is_some_and(|edge| edge.live && edge.bytes_per_s > 0)
    })?;
    stage.go_on(field.either(5.0, 2.0));
    let mut measures = vec![Measure::told(
        "from its start to its part, s",
        back.as_secs_f64(),
    )];
    measures.extend(stage.people_since(from)?);
    Ok(Driven::Measured(measures))
}

pub(super) fn flood(field: &Field) -> anyhow::Result<Driven> {
    let mut stage = Stage::prepare(field, "flood")?;
    let recording = stage.out("run.mcap");
    let (out, path) = (
        stage.out("first"),
        recording.to_str().context("a path in UTF-8")?,
    );
    stage.begin(&out, &["--record", path])?;
    let span_s = field.either(10.0, 4.0);
    let before = growth(&stage, &recording, span_s)?;
    let from = stage.tick()?;
    let viewpoint = stage.live.venue().viewpoints[0].name.clone();
    let (flooded, said_bytes) = stage
        .watch()?
        .flood(&viewpoint, || growth(&stage, &recording, span_s));
    let more = 100.0 * (flooded? / before - 1.0);
    let said = stage
        .live
        .fusion
        .as_ref()
        .map(NodeProcess::said)
        .unwrap_or_default();
    let is_named = said.contains(&format!(
        "viewpoint {viewpoint} sends more than any edge may"
    ));
    let mut measures = vec![
        Measure::barred("the recording grows faster by, %", more, MOST_GROWTH),
        Measure::barred(
            "floods that are not named",
            f64::from(u8::from(!is_named)),
            0.0,
        ),
        Measure::told("noise, MB/s", said_bytes as f64 / 1e6 / span_s),
    ];
    measures.extend(stage.people_since(from)?);
    Ok(Driven::Measured(measures))
}

/// How fast the recording grows over `span_s`, bytes per tick.
fn growth(stage: &Stage<'_>, recording: &Path, span_s: f64) -> anyhow::Result<f64> {
    let look = || -> anyhow::Result<_> {
        let bytes = std::fs::metadata(recording)?.len();
        Ok((bytes, stage.tick()?))
    };
    let (bytes, tick) = look()?;
    stage.go_on(span_s);
    let (later_bytes, later) = look()?;
    ensure!(later > tick, "no pose has come for {span_s} s");
    Ok((later_bytes - bytes) as f64 / (later - tick) as f64)
}
