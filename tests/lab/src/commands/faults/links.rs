//! Links that are cut, lose datagrams, or are one for all.

use std::time::Duration;

use super::field::Field;
use super::stage::{MOST_MM, Stage};
use super::table::{Driven, Measure};
use crate::commands::links;
use crate::relay::Impairment;

/// How far the rate of any edge behind one link may be from the mean of all, percent.
const MOST_APART: f64 = 20.0;

pub(super) fn cut_short(field: &Field) -> anyhow::Result<Driven> {
    cut(field, "cut-short", 0.7)
}

pub(super) fn cut_long(field: &Field) -> anyhow::Result<Driven> {
    cut(field, "cut-long", 3.0)
}

fn cut(field: &Field, name: &str, seconds: f64) -> anyhow::Result<Driven> {
    let stage = Stage::open(field, name, &[])?;
    let from = stage.tick()?;
    stage.live.relays[0].cut(Duration::from_secs_f64(seconds));
    stage.go_on(seconds + field.either(5.0, 3.0));
    Ok(Driven::Measured(stage.people_since(from)?))
}

pub(super) fn loss(field: &Field) -> anyhow::Result<Driven> {
    let stage = Stage::open(field, "loss", &[])?;
    let from = stage.tick()?;
    for relay in &stage.live.relays {
        relay.set_both(Impairment {
            loss: 0.2,
            ..Impairment::default()
        });
    }
    stage.go_on(field.either(20.0, 5.0));
    Ok(Driven::Measured(stage.people_since(from)?))
}

pub(super) fn bottleneck(field: &Field) -> anyhow::Result<Driven> {
    let row = links::one_bottleneck(&field.folder("bottleneck")?)?;
    let apart = row.rates_apart.map_or(f64::NAN, |share| 100.0 * share);
    Ok(Driven::Measured(vec![
        Measure::barred(
            "mean distance, mm",
            row.mpjpe_mm.unwrap_or(f64::NAN),
            MOST_MM,
        ),
        Measure::barred("id switches", row.id_switches as f64, 0.0),
        Measure::barred("an edge's rate from the mean of all, %", apart, MOST_APART),
        Measure::told(
            "capture to pose, P99, ms",
            row.delay_p99_ms.unwrap_or(f64::NAN),
        ),
        Measure::told(
            "people and ticks without a pose, %",
            100.0 * row.gaps as f64 / row.frames.max(1) as f64,
        ),
    ]))
}
