//! How often each viewpoint sees whom it should: what its silence is worth.
//!
//! That a viewpoint does not sight a body that stands well in its image speaks against the body, unless the viewpoint
//! misses many: pillars stand before it, or its network is poor. So each is followed over the detection passes,
//!
//! ```text
//!   a = (s0 + s) / (n0 + s + m),      w = min(1, (a / a0)^2),      a0 = s0 / n0
//! ```
//!
//! s and m how often it saw and missed people who are tracked or whom others sighted together, of the last passes; s0
//! and n0 what is believed of a viewpoint of which nothing is known; w what its silence counts beside a sighting.
//! w counts where more viewpoints are silent than see a body; else silence counts whole, so that what a mirror shows
//! to half of them stays a picture. A viewpoint that sees a third of the people says with its silence about a fifth of what one says that sees all.

use farfield_proto::id::ViewpointIndex;

/// s0: people seen, of [`BELIEVED`], by a viewpoint of which nothing is known.
const BELIEVED_SEEN: f64 = 3.0;
/// n0.
const BELIEVED: f64 = 4.0;
/// Share of what was counted that the next detection pass leaves: people walk out from behind pillars.
const KEPT: f64 = 0.95;

/// What one viewpoint saw and missed, faded.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct SeenAndMissed {
    seen: f64,
    missed: f64,
}

/// What the silence of each viewpoint is worth.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Attention {
    viewpoints: Vec<SeenAndMissed>,
}

impl Attention {
    /// Nothing known of `n_viewpoints`.
    pub(crate) fn new(n_viewpoints: usize) -> Self {
        Self {
            viewpoints: vec![SeenAndMissed::default(); n_viewpoints],
        }
    }

    /// Begins another detection pass: what was before it counts a little less.
    pub(crate) fn fade(&mut self) {
        for counted in &mut self.viewpoints {
            counted.seen *= KEPT;
            counted.missed *= KEPT;
        }
    }

    /// Notes that `viewpoint` saw somebody whom it should see.
    pub(crate) fn saw(&mut self, viewpoint: ViewpointIndex) {
        if let Some(counted) = self.viewpoints.get_mut(usize::from(viewpoint.0)) {
            counted.seen += 1.0;
        }
    }

    /// Notes that `viewpoint` missed somebody whom it should see.
    pub(crate) fn missed(&mut self, viewpoint: ViewpointIndex) {
        if let Some(counted) = self.viewpoints.get_mut(usize::from(viewpoint.0)) {
            counted.missed += 1.0;
        }
    }

    /// What the silence of viewpoints, `missed_by`, counts beside the sightings of `seen_by` others. Few are believed
    /// whole: a mirror hides from as many as look into it. Where more are silent than see, something stands before
    /// those that miss most people.
    pub(crate) fn of_all(&self, missed_by: &[ViewpointIndex], seen_by: usize) -> f64 {
        if missed_by.len() <= seen_by {
            return missed_by.len() as f64;
        }
        missed_by.iter().map(|&v| self.of_silence(v)).sum()
    }

    /// What the silence of `viewpoint` counts beside a sighting, 0 to 1.
    fn of_silence(&self, viewpoint: ViewpointIndex) -> f64 {
        let counted = self.viewpoints.get(usize::from(viewpoint.0));
        let SeenAndMissed { seen, missed } = counted.copied().unwrap_or_default();
        let share = (BELIEVED_SEEN + seen) / (BELIEVED + seen + missed);
        (share * BELIEVED / BELIEVED_SEEN).powi(2).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: ViewpointIndex = ViewpointIndex(1);

    #[test]
    fn the_silence_of_who_sees_everybody_counts_whole_and_of_who_misses_most_little() {
        let mut attention = Attention::new(2);
        assert!((attention.of_silence(ONE) - 1.0).abs() < 1e-12);
        for _ in 0..20 {
            attention.saw(ONE);
        }
        assert!((attention.of_silence(ONE) - 1.0).abs() < 1e-12);
        let mut attention = Attention::new(2);
        for _ in 0..10 {
            attention.saw(ONE);
            attention.missed(ONE);
            attention.missed(ONE);
        }
        let silence = attention.of_silence(ONE);
        assert!((0.15..0.3).contains(&silence), "{silence}");
    }

    #[test]
    fn few_that_are_silent_are_believed_whole_however_much_they_miss() {
        let mut attention = Attention::new(12);
        let all: Vec<ViewpointIndex> = (0..12).map(ViewpointIndex).collect();
        for _ in 0..20 {
            for &viewpoint in &all {
                attention.missed(viewpoint);
            }
        }
        assert!((attention.of_all(&all[..2], 2) - 2.0).abs() < 1e-12);
        assert!((attention.of_all(&all[..3], 3) - 3.0).abs() < 1e-12);
        assert!(attention.of_all(&all[..10], 2) < 1.0);
    }

    #[test]
    fn what_was_long_ago_is_forgotten() {
        let mut attention = Attention::new(2);
        for _ in 0..10 {
            attention.missed(ONE);
        }
        assert!(attention.of_silence(ONE) < 0.1);
        for _ in 0..100 {
            attention.fade();
        }
        assert!(attention.of_silence(ONE) > 0.9);
    }

    #[test]
    fn a_viewpoint_that_the_venue_does_not_have_is_nobody() {
        let mut attention = Attention::new(1);
        attention.missed(ViewpointIndex(9));
        assert_eq!(attention, Attention::new(1));
    }
}
