//! Whose crop it is. A network shows whoever stands in the middle of its crop: of who is hidden, or has gone, the crop
//! shows the neighbour, in every keypoint. That is not evidence of anybody but the neighbour.

use farfield_proto::patch::MAX_KEYPOINTS;
use nalgebra::Vector2;

use crate::estimate::estimator::Estimator;
use crate::estimate::evidence::View;
use crate::estimate::uncertainty::MadeOf;
use crate::method::Method;

/// Height from which on a map shows its keypoint.
const LEAST_HEIGHT: f64 = 0.3;
/// Least keypoints that tell whose the crop is.
const MIN_KEYPOINTS: usize = 6;
/// Share of the keypoints with a peak where they are expected from which on the crop is its own.
const OWN_SHARE: f64 = 0.5;
/// Share of the keypoints shown that must be where another's are expected.
const OTHERS_SHARE: f64 = 0.5;

/// Whether the crop of `own` in its `view` shows one of `others`, who are near there. All views are placed, and their
/// peaks found.
pub(super) fn shows_another<'a>(
    (own, view): (&Estimator, usize),
    others: impl Iterator<Item = &'a Estimator>,
    method: &Method,
) -> bool {
    let view = &own.views()[view];
    // What a keypoint that was not seen may be off.
    let near_m = method.parameters.contact.unseen_sigma_m;
    if is_its_own(view, near_m) {
        return false;
    }
    let shown = shown_in(view);
    let n_shown = shown.iter().flatten().count();
    let enough = method.enough_keypoints();
    let is_seen =
        |other: &&Estimator| MadeOf::from_estimates(other.estimates(), enough) == MadeOf::Views;
    let is_there = |other: &Estimator| {
        let shown = shown.iter().zip(other.predicted_m()).enumerate();
        let there = shown.filter(|(k, (cell, place_m))| {
            let (Some(cell), Some(expected)) = (cell, view.expected(*k)) else {
                return false;
            };
            let h = view.cell_from_world(*k) * place_m.push(1.0);
            h.z > 0.0 && (h.xy() / h.z - cell).norm() * expected.cell_m < near_m
        });
        there.count() as f64 > OTHERS_SHARE * n_shown as f64
    };
    n_shown >= MIN_KEYPOINTS && others.filter(is_seen).any(is_there)
}

/// The cells at which the maps show their keypoints, wherever these are expected.
fn shown_in(view: &View) -> [Option<Vector2<f64>>; MAX_KEYPOINTS] {
    let mut shown = [None; MAX_KEYPOINTS];
    for (k, shown) in shown.iter_mut().enumerate().take(view.n_keypoints()) {
        let peak = view.expected(k).and_then(|_| view.highest_of_map(k));
        let peak = peak.filter(|peak| peak.height >= LEAST_HEIGHT);
        *shown = peak.map(|peak| peak.cell);
    }
    shown
}

/// Whether half of the keypoints have a peak about where they are expected.
fn is_its_own(view: &View, near_m: f64) -> bool {
    let (mut all, mut own) = (0, 0);
    for k in 0..view.n_keypoints() {
        let Some(expected) = view.expected(k) else {
            continue;
        };
        all += 1;
        let mut peaks = view.peaks(k).as_slice().iter();
        own += usize::from(peaks.any(|peak| {
            let off_m = (peak.cell - expected.cell).norm() * expected.cell_m;
            peak.height >= LEAST_HEIGHT && off_m < 2.0 * near_m
        }));
    }
    own as f64 >= OWN_SHARE * f64::from(all)
}
