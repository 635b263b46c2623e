//! How often each viewpoint sees the people that it should see, and so what its silence is worth.
//!
//! If a viewpoint does not sight a body that is well in its image, that is evidence against the
//! body. This does not apply if the viewpoint misses many people: pillars hide them, or its network
//! is poor. So each viewpoint is measured over the detection passes:
//!
//! ```text
//!   a = (s0 + s) / (n0 + s + m),      w = min(1, (a / a0)^2),      a0 = s0 / n0
//! ```
//!
//! s and m count how often it recently saw and missed people who are tracked or that other
//! viewpoints sighted together. s0 and n0 are the prior of an unknown viewpoint. w is the weight of
//! its silence relative to a sighting. w is used if more viewpoints are silent than see a body.
//! Otherwise silence has the full weight, so that a reflection that half of them see is rejected.
//! The silence of a viewpoint that sees a third of the people has about a fifth of the full weight.

use farfield_proto::id::ViewpointIndex;

/// s0: people seen, of [`PRIOR_TOTAL`], by an unknown viewpoint.
const PRIOR_SEEN: f64 = 3.0;
/// n0.
const PRIOR_TOTAL: f64 = 4.0;
/// Share of the counts that the next detection pass keeps: people walk out from behind pillars.
const DECAY: f64 = 0.95;

/// Decaying counts of people that one viewpoint saw and missed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct SeenAndMissed {
    seen: f64,
    missed: f64,
}

/// The weight of each viewpoint's silence.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Attention {
    viewpoints: Vec<SeenAndMissed>,
}

impl Attention {
    /// Without data, for `n_viewpoints`.
    pub(crate) fn new(n_viewpoints: usize) -> Self {
        Self {
            viewpoints: vec![SeenAndMissed::default(); n_viewpoints],
        }
    }

    /// Begins another detection pass: earlier counts decay.
    pub(crate) fn fade(&mut self) {
        for counts in &mut self.viewpoints {
            counts.seen *= DECAY;
            counts.missed *= DECAY;
        }
    }

    /// Records that `viewpoint` saw a person that it should see.
    pub(crate) fn saw(&mut self, viewpoint: ViewpointIndex) {
        if let Some(counts) = self.viewpoints.get_mut(usize::from(viewpoint.0)) {
            counts.seen += 1.0;
        }
    }

    /// Records that `viewpoint` missed a person that it should see.
    pub(crate) fn missed(&mut self, viewpoint: ViewpointIndex) {
        if let Some(counts) = self.viewpoints.get_mut(usize::from(viewpoint.0)) {
            counts.missed += 1.0;
        }
    }

    /// The weight of the silence of `missed_by`, relative to the sightings of `seen_by` others. A
    /// minority has the full weight: a mirror is hidden from as many as see it. If more are silent
    /// than see, an obstacle stands in front of those that miss most people.
    pub(crate) fn weight_of_all(&self, missed_by: &[ViewpointIndex], seen_by: usize) -> f64 {
        if missed_by.len() <= seen_by {
            return missed_by.len() as f64;
        }
        missed_by.iter().map(|&v| self.weight(v)).sum()
    }

    /// The weight of the silence of `viewpoint` relative to a sighting, 0 to 1.
    fn weight(&self, viewpoint: ViewpointIndex) -> f64 {
        let counts = self.viewpoints.get(usize::from(viewpoint.0));
        let SeenAndMissed { seen, missed } = counts.copied().unwrap_or_default();
        let share = (PRIOR_SEEN + seen) / (PRIOR_TOTAL + seen + missed);
        (share * PRIOR_TOTAL / PRIOR_SEEN).powi(2).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: ViewpointIndex = ViewpointIndex(1);

    #[test]
    fn silence_weighs_less_for_viewpoints_that_miss_many() {
        let mut attention = Attention::new(2);
        assert!((attention.weight(ONE) - 1.0).abs() < 1e-12);
        for _ in 0..20 {
            attention.saw(ONE);
        }
        assert!((attention.weight(ONE) - 1.0).abs() < 1e-12);
        let mut attention = Attention::new(2);
        for _ in 0..10 {
            attention.saw(ONE);
            attention.missed(ONE);
            attention.missed(ONE);
        }
        let silence = attention.weight(ONE);
        assert!((0.15..0.3).contains(&silence), "{silence}");
    }

    #[test]
    fn a_silent_minority_has_the_full_weight() {
        let mut attention = Attention::new(12);
        let all: Vec<ViewpointIndex> = (0..12).map(ViewpointIndex).collect();
        for _ in 0..20 {
            for &viewpoint in &all {
                attention.missed(viewpoint);
            }
        }
        assert!((attention.weight_of_all(&all[..2], 2) - 2.0).abs() < 1e-12);
        assert!((attention.weight_of_all(&all[..3], 3) - 3.0).abs() < 1e-12);
        assert!(attention.weight_of_all(&all[..10], 2) < 1.0);
    }

    #[test]
    fn old_counts_decay() {
        let mut attention = Attention::new(2);
        for _ in 0..10 {
            attention.missed(ONE);
        }
        assert!(attention.weight(ONE) < 0.1);
        for _ in 0..100 {
            attention.fade();
        }
        assert!(attention.weight(ONE) > 0.9);
    }

    #[test]
    fn an_unknown_viewpoint_has_the_prior_weight() {
        let mut attention = Attention::new(1);
        attention.missed(ViewpointIndex(9));
        assert_eq!(attention, Attention::new(1));
    }
}
