//! Wrong clocks, only inside an edge: the clock of the machine is not changed.

use anyhow::Context as _;
use farfield_node::clock;
use farfield_proto::message::health::LinkHealth;
use farfield_proto::transport::FUSION;

use super::stage::Field;
use super::stage::{Stage, edge_link};
use super::table::{FaultOutcome, Measure};
use crate::live_venue::SeenVenue;
use crate::relay::{Direction, Impairment};

/// One-way delays of an asymmetric link, microseconds.
const UP_US: u32 = 30_000;
const DOWN_US: u32 = 10_000;
/// Longest time until a clock that was set right is used, and time until it is set, seconds.
const TAKEN_UP_S: f64 = 2.0;
const SET_AFTER_S: u32 = 12;

/// Fusion's status of the clock of the `i`-th viewpoint.
fn clock_of(seen: &SeenVenue, i: usize) -> Option<LinkHealth> {
    seen.statuses.get(FUSION)?.health.links.get(i).copied()
}

pub(super) fn asymmetric_link(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, "lopsided-link")?;
    for (direction, delay_us) in [(Direction::Up, UP_US), (Direction::Down, DOWN_US)] {
        let far = Impairment {
            delay_us,
            ..Impairment::default()
        };
        stage.live.relays[0].set(direction, far);
    }
    stage.live.start_edge(0, None, &["--clock-synchronised"])?;
    let out = stage.out("first");
    stage.begin(&out, &[])?;
    let from = stage.tick()?;
    stage.run_for(field.whole_or_quick(10.0, 4.0));
    let health = clock_of(&*stage.seen()?, 0).context("fusion reports no clock")?;
    let ms = |us: Option<i32>| us.map_or(f64::NAN, |us| f64::from(us.abs()) / 1e3);
    let unsure_ms = health
        .clock_uncertainty_us
        .map_or(f64::NAN, |us| f64::from(us) / 1e3);
    let mut measures = vec![
        Measure::limited(
            "correction of a right clock, ms",
            ms(health.clock_correction_us),
            1.0,
        ),
        Measure::reported("uncertainty of the offset, ms", unsure_ms),
    ];
    measures.extend(stage.people_since(from)?);
    Ok(FaultOutcome::Measured(measures))
}

pub(super) fn clock_set(field: &Field) -> anyhow::Result<FaultOutcome> {
    let mut stage = Stage::prepare(field, "clock-set")?;
    let after = SET_AFTER_S.to_string();
    let set = |by_ms: &'static str| ["--clock-set-by-ms", by_ms, "--clock-set-after-s", &after];
    let wrong_at_first = ["--clock-synchronised", "--clock-shift-ms", "-2000"];
    let begun = clock::now();
    stage
        .live
        .start_edge(0, None, &[&wrong_at_first[..], &set("2000")].concat())?;
    stage.live.start_edge(1, None, &set("2000"))?;
    let names = [0, 1].map(|i| stage.live.venue().viewpoints[i].name.clone());
    let out = stage.out("first");
    stage.begin(&out, &[])?;
    let from = stage.tick()?;
    stage.wait("the edge that is 2 s wrong is refused", |seen| {
        let refused = edge_link(seen, &names[0]).and_then(|edge| edge.refused.as_ref());
        refused.is_some_and(|why| why.contains("clock"))
    })?;
    stage.wait("the edge is accepted once its clock is right", |seen| {
        edge_link(seen, &names[0]).is_some_and(|edge| edge.live && edge.refused.is_none())
    })?;
    let taken_up_s = clock::now().duration_since(begun).as_secs_f64() - f64::from(SET_AFTER_S);
    stage.run_for(5.0);
    let is_in = edge_link(&*stage.seen()?, &names[1]).is_some_and(|edge| edge.live);
    let mut measures = vec![
        // Fusion publishes its status once a second.
        Measure::limited(
            "until it is accepted, s (published once a second)",
            taken_up_s,
            TAKEN_UP_S + 1.0,
        ),
        Measure::limited(
            "edges lost to a step while they work",
            f64::from(u8::from(!is_in)),
            0.0,
        ),
    ];
    measures.extend(stage.people_since(from)?);
    Ok(FaultOutcome::Measured(measures))
}
