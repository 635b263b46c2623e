//! Links that are cut, lose datagrams, or are shared; repeated outages of all links, and of fusion.

use std::time::Duration;

use super::field::Field;
use super::stage::{MAX_MEAN_MM, Stage};
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
