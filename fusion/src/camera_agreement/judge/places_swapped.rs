//! Whether two cameras have each other's places: rotation and translation were exchanged in the calibration, and the lenses were
//! not. Where the lenses are alike, that is no other thing than two sources that were swapped.

use super::super::pairs::{CameraRays, PictureChange};
use super::super::report::{Disagreement, DisagreementCause};
use super::Judge;
use super::lenses_swapped::are_different;

/// What the place of the other must leave of the cost of each.
const EXPLAINS: f64 = 0.6;
/// What it must leave of that with all of the other's calibration.
const STANDS_OUT: f64 = 0.9;

impl Judge<'_> {
    /// Two cameras that have each other's places.
    pub(super) fn find_places_swapped(&self, all: &mut Vec<Disagreement>, told: &mut [bool]) {
        let pairs = self.groups(told).into_iter().flat_map(|group| {
            let right = self.taken_for_right(&group);
            let outside = |camera: &usize| !right.contains(camera) && !told[*camera];
            let outside: Vec<usize> = group.into_iter().filter(outside).collect();
            let with_later = |(index, a): (usize, usize)| {
                let later = outside[index + 1..].iter();
                later.map(move |&b| (a, b)).collect::<Vec<_>>()
            };
            let pairs = outside.iter().copied().enumerate().flat_map(with_later);
            pairs.collect::<Vec<_>>()
        });
        let pairs = pairs.filter(|&(a, b)| self.are_apart(a, b));
        let weighed = pairs.filter_map(|(a, b)| Some((self.with_places_swapped((a, b))?, (a, b))));
        if let Some((_, (a, b))) = weighed.min_by(|one, other| one.0.total_cmp(&other.0)) {
            told[a] = true;
            told[b] = true;
            all.push(self.disagreement(&[a, b], DisagreementCause::PlacesSwapped));
        }
    }

    /// What the places of each other leave of the cost of two cameras; `None` where that is no explanation.
    fn with_places_swapped(&self, (a, b): (usize, usize)) -> Option<f64> {
        if !are_different(self.models.get(a)?, self.models.get(b)?) {
            return None;
        }
        let is_apart =
            |of: &usize| ![a, b].contains(of) && self.are_apart(a, *of) && self.are_apart(b, *of);
        let others: Vec<usize> = (0..self.cameras.len()).filter(is_apart).collect();
        let (mut before, mut after, mut swapped) = (0.0, 0.0, 0.0);
        for (own, other) in [(a, b), (b, a)] {
            let there = self.lines[own].standing_as(&self.lines[other]);
            let there = CameraRays::of(
                &self.passes,
                (own, self.cameras[own].size_px),
                &there,
                (PictureChange::AsItIs, self.partners),
            );
            let all_of_other = self.rays(own, other, PictureChange::AsItIs);
            let own_before = self.cost_against(own, &self.as_it_is[own], &others)?;
            let own_after = self.cost_against(own, &there, &others)?;
            if own_after >= EXPLAINS * own_before {
                return None;
            }
            before += own_before;
            after += own_after;
            swapped += self.cost_against(own, &all_of_other, &others)?;
        }
        (after < STANDS_OUT * swapped).then(|| after / before)
    }
}
