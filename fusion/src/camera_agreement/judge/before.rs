//! What was found when samples of a venue were judged: those that come later are mostly the same, as they are kept for a minute
//! and judged every few seconds.

use super::super::samples::{Burst, PassSample, ResultCache};
use super::super::time_shift::curves::BurstCosts;
use crate::sightings::reconstruction::Reconstruction;

/// What was found when samples of one venue were judged: for who judges those that come after.
#[derive(Debug, Default)]
pub struct JudgedBefore {
    /// What cameras cost beside each other in each burst.
    pub(in crate::camera_agreement) costs: ResultCache<Burst, BurstCosts>,
    /// The bodies on which lines of sight met in each detection pass.
    pub(in crate::camera_agreement) bodies: ResultCache<PassSample, Vec<Reconstruction>>,
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::super::fixture::{Hall, Mistake};
    use super::super::super::report::AgreementReport;
    use super::*;

    #[test]
    fn who_judges_again_finds_what_is_found_for_the_first_time() {
        let late = Mistake {
            late_ticks: 7,
            late_in_burst: Some(2),
            ..Mistake::default()
        };
        let mut hall = Hall::with(1, late);
        hall.bursts = 3;
        let all = hall.samples();
        let mut first = all.clone();
        first.samples.bursts.truncate(2);
        first.samples.passes.truncate(8);
        let mut before = JudgedBefore::default();
        let told = |report: &AgreementReport| report.disagreements.len();
        assert_eq!(told(&first.report_after(&mut before)), 0);
        // Those of the first time are known, and no others.
        let known = |before: &mut JudgedBefore| {
            let taken = all.samples.passes.iter().map(|pass| {
                let bodies = before.bodies.take(pass);
                (Arc::clone(pass), bodies)
            });
            let taken: Vec<_> = taken.collect();
            let is_known = taken.iter().map(|(_, bodies)| bodies.is_some()).collect();
            let known = taken
                .into_iter()
                .filter_map(|(of, bodies)| Some((of, bodies?)));
            before.bodies = known.collect();
            is_known
        };
        let is_known: Vec<bool> = known(&mut before);
        assert_eq!(is_known, [vec![true; 8], vec![false; 4]].concat());
        let fresh = all.report();
        assert!(told(&fresh) > 0);
        for _ in 0..2 {
            assert_eq!(all.report_after(&mut before), fresh);
        }
        // Those that are no longer kept are forgotten.
        assert_eq!(told(&first.report_after(&mut before)), 0);
        let is_known: Vec<bool> = known(&mut before);
        assert_eq!(is_known, [vec![true; 8], vec![false; 4]].concat());
    }
}
