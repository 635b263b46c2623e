//! Results of earlier judgements of a venue. Later samples are mostly the same: they are kept for a minute and judged
//! every few seconds.

use super::super::samples::{Burst, PassSample, ResultCache};
use super::super::time_shift::curves::BurstCosts;
use crate::sightings::reconstruction::Reconstruction;

/// Results for samples of one venue that were judged before, for the next judgement.
#[derive(Debug, Default)]
pub struct JudgedBefore {
    /// Costs of cameras relative to each other, by burst.
    pub(in crate::camera_agreement) costs: ResultCache<Burst, BurstCosts>,
    /// The bodies on which lines of sight met, by detection pass.
    pub(in crate::camera_agreement) bodies: ResultCache<PassSample, Vec<Reconstruction>>,
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::super::fixture::{Hall, Mistake};
    use super::super::super::report::AgreementReport;
    use super::*;

    #[test]
    fn reused_results_give_the_same_report() {
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
        let count = |report: &AgreementReport| report.disagreements.len();
        assert_eq!(count(&first.report_after(&mut before)), 0);
        // Only results of the first judgement are known.
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
        assert!(count(&fresh) > 0);
        for _ in 0..2 {
            assert_eq!(all.report_after(&mut before), fresh);
        }
        // Results of samples that are no longer kept are dropped.
        assert_eq!(count(&first.report_after(&mut before)), 0);
        let is_known: Vec<bool> = known(&mut before);
        assert_eq!(is_known, [vec![true; 8], vec![false; 4]].concat());
    }
}
