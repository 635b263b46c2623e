//! The shifts of cameras burst by burst: whether they drift.

use farfield_proto::tick::Tick;

use super::super::samples::Burst;
use super::curves::{CurvePart, ShiftCosts};
use super::{
    KeypointHalf, LATE_DIFFERENCE_TICKS, LATE_TICKS, Shift, is_same, put_beside, shifts_of,
};

/// Least time between the first and the last burst that tells a rate, minutes.
const LEAST_DRIFT_MINUTES: f64 = 0.08;

/// The shifts of all cameras in one burst, of both halves of the keypoints.
pub(in crate::camera_agreement) struct BurstShifts {
    /// From its first tick to the one after its last.
    pub(in crate::camera_agreement) ticks: [Tick; 2],
    odd: Vec<Option<Shift>>,
    even: Vec<Option<Shift>>,
}

impl BurstShifts {
    /// By how many ticks a camera is late, where that is sharp and both halves say so.
    pub(in crate::camera_agreement) fn told(&self, camera: usize) -> Option<f64> {
        let (odd, even) = (self.odd[camera]?, self.even[camera]?);
        let is_told = odd.is_sharp && even.is_sharp && is_same(odd.late_ticks, even.late_ticks);
        is_told.then_some(0.5 * (odd.late_ticks + even.late_ticks))
    }
}

/// Those of all bursts, beside the shifts of `all` of the time.
pub(in crate::camera_agreement) fn shifts_by_burst(
    costs: &mut ShiftCosts<'_>,
    all: &[Option<Shift>],
) -> Vec<BurstShifts> {
    let bursts: Vec<_> = costs.bursts().enumerate().collect();
    let of = |(index, burst): (usize, &Burst)| {
        let mut half = |half| {
            let burst = Some(index);
            let mut shifts = shifts_of(costs, CurvePart { half, burst }, all);
            put_beside(&mut shifts, all);
            shifts
        };
        BurstShifts {
            ticks: [
                burst.first,
                burst.first + burst.n_ticks().cast_signed() as i64,
            ],
            odd: half(KeypointHalf::OddPairs),
            even: half(KeypointHalf::EvenPairs),
        }
    };
    bursts.into_iter().map(of).collect()
}

/// How a camera drifts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::camera_agreement) struct Drift {
    /// By how many ticks more it is late every minute.
    pub(in crate::camera_agreement) ticks_per_minute: f64,
    /// Whether the bursts lie on a line, and that is steep.
    pub(in crate::camera_agreement) is_told: bool,
}

/// Per camera how it drifts; `None` where fewer than three bursts tell.
pub(in crate::camera_agreement) fn drifts(
    bursts: &[BurstShifts],
    n_cameras: usize,
    rate_hz: f64,
) -> Vec<Option<Drift>> {
    let minutes_at = |burst: &BurstShifts| burst.ticks[0].0 as f64 / rate_hz / 60.0;
    let drift = |camera: usize| {
        let told = bursts
            .iter()
            .filter_map(|burst| Some((minutes_at(burst), burst.told(camera)?)));
        let told: Vec<(f64, f64)> = told.collect();
        let (&(from, before), &(to, after)) = (told.first()?, told.last()?);
        let minutes = to - from;
        if told.len() < 3 || minutes < LEAST_DRIFT_MINUTES {
            return None;
        }
        let rate = (after - before) / minutes;
        let is_on_line = |&(at, late): &(f64, f64)| {
            let expected = before + rate * (at - from);
            (late - expected).abs() <= LATE_DIFFERENCE_TICKS
        };
        let is_told = (after - before).abs() >= 2.0 * LATE_TICKS && told.iter().all(is_on_line);
        Some(Drift {
            ticks_per_minute: rate,
            is_told,
        })
    };
    (0..n_cameras).map(drift).collect()
}
