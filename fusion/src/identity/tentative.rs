//! What is seen and said of a tentative person until it is confirmed.

use farfield_proto::tick::Tick;

use crate::body::keypoint_estimate::KeypointEstimate;

/// Detection passes before contradictions can end a tentative track: detectors miss people now and then.
const MIN_PASSES: u32 = 3;

/// The keypoint positions of one tick of a tentative person.
#[derive(Debug, Clone)]
pub(crate) struct TentativeTick {
    pub(crate) tick: Tick,
    pub(crate) estimates: Vec<KeypointEstimate>,
}

/// What the detection passes since an initiation said of a body.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Votes {
    pub(crate) passes: u32,
    /// Viewpoints that saw it, summed over the passes.
    pub(crate) seen: u32,
    /// Viewpoints that should have seen it and did not, each by what its silence is worth
    /// (`crate::sightings::attention`), summed over the passes.
    pub(crate) missed: f64,
}

impl Votes {
    /// Counts what the viewpoints of one pass said: how many saw the body, how many should have. A pass
    /// in which no viewpoint could say anything is none.
    pub(crate) fn count(&mut self, (seen, missed): (u32, f64)) {
        if seen == 0 && missed <= 0.0 {
            return;
        }
        self.passes += 1;
        self.seen += seen;
        self.missed += missed;
    }

    /// Whether the viewpoints contradict the body.
    pub(crate) fn are_against(&self) -> bool {
        self.passes >= MIN_PASSES && self.missed >= f64::from(self.seen)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradictions_end_a_tentative_track_and_single_misses_do_not() {
        let mut votes = Votes::default();
        votes.count((2, 1.0));
        votes.count((1, 3.0));
        assert!(!votes.are_against());
        votes.count((2, 1.0));
        assert!(votes.are_against());
        let mut votes = Votes::default();
        for _ in 0..10 {
            votes.count((2, 1.0));
        }
        assert!(!votes.are_against());
    }

    #[test]
    fn passes_that_say_nothing_contradict_nobody() {
        let mut votes = Votes::default();
        for _ in 0..3 {
            votes.count((0, 0.0));
        }
        assert!(!votes.are_against());
    }
}
