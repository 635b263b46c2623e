//! Effects of the path between edges and fusion on messages, in ticks and without a network: cuts, and links that are far
//! and lossy. Every run gives the same result.

use std::collections::VecDeque;
use std::ops::Range;

use farfield_edge::pipeline::EdgeOutput;
use farfield_proto::message::BoxSet;
use farfield_proto::tick::Tick;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Periods in which no message of the edges reaches fusion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cuts {
    /// Period from the start of one cut to that of the next, ticks; the first cut starts after one period.
    pub every: i64,
    /// Duration of a cut, ticks.
    pub lasts: i64,
    /// Delay of the cut messages, ticks; `None`: lost.
    pub late: Option<i64>,
}

impl Cuts {
    /// First tick of each cut within `ticks`, and the tick after its last one.
    pub fn within(self, ticks: &Range<Tick>) -> impl Iterator<Item = [Tick; 2]> + use<> {
        let n = ticks.end.0 / self.every.max(1);
        (1..=n).map(move |i| {
            let from = Tick(i * self.every);
            [from, from + self.lasts]
        })
    }

    /// Whether fusion receives nothing at `tick`.
    pub fn contains(&self, tick: Tick) -> bool {
        tick.0 >= self.every && tick.0 % self.every.max(1) < self.lasts
    }
}

/// Links that are far and lose messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarLinks {
    /// Boxes are used this many ticks after the tick that made them, at least 1.
    pub ahead: i64,
    /// Share of messages lost each way, 0 to 1.
    pub loss: f64,
    /// Seed of the losses.
    pub seed: u64,
}

impl Default for FarLinks {
    fn default() -> Self {
        Self {
            ahead: 1,
            loss: 0.0,
            seed: 1,
        }
    }
}

/// Messages in flight over [`FarLinks`].
pub(crate) struct InFlight {
    links: FarLinks,
    lots: ChaCha8Rng,
    /// By the step that made them.
    boxes: VecDeque<Vec<BoxSet>>,
}

impl InFlight {
    pub(crate) fn new(links: FarLinks) -> Self {
        Self {
            links,
            lots: ChaCha8Rng::seed_from_u64(links.seed),
            boxes: VecDeque::new(),
        }
    }

    /// Fusion sends `boxes`; those that reach the edges by the next tick replace the ones in `newest`.
    pub(crate) fn send_boxes(&mut self, boxes: Vec<BoxSet>, newest: &mut [BoxSet]) {
        self.boxes.push_back(boxes);
        let n_in_flight = usize::try_from(self.links.ahead - 1).unwrap_or(0);
        if self.boxes.len() <= n_in_flight {
            return;
        }
        for (set, newest) in self.boxes.pop_front().into_iter().flatten().zip(newest) {
            if !self.is_lost() {
                *newest = set;
            }
        }
    }

    /// Removes messages from `outputs` that do not reach fusion.
    pub(crate) fn lose(&mut self, outputs: &mut [EdgeOutput]) {
        for output in outputs {
            output.patch_sets.retain(|_| !self.is_lost());
            output.sighting_sets.retain(|_| !self.is_lost());
        }
    }

    fn is_lost(&mut self) -> bool {
        self.links.loss > 0.0 && self.lots.random_bool(self.links.loss.min(1.0))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::suite::run::{SceneRun, SceneRunPlan};
    use farfield_sim::embedded;
    use farfield_sim::simulated::in_memory::Input;

    /// Boxes return 233 ms later, over a link of 200 ms.
    const FAR: FarLinks = FarLinks {
        ahead: 14,
        loss: 0.0,
        seed: 1,
    };

    fn run(scene: &str, seconds: f64, links: FarLinks) -> SceneRun {
        let scene = embedded::scene(scene).unwrap().shortened(seconds);
        let plan = SceneRunPlan {
            links,
            ..SceneRunPlan::default()
        };
        SceneRun::make(&Arc::new(scene), &Input::Maps, plan).unwrap()
    }

    #[test]
    fn a_runner_is_found_and_tracked_over_a_far_link() {
        let run = run("sprint", 3.0, FAR);
        let first_ticks = run.first_ticks();
        assert!(!first_ticks.is_empty(), "no people were found");
        let scores = run.score_since(&run.causal, &first_ticks);
        assert!(scores.mean.gaps < 0.5, "{} gaps", scores.mean.gaps);
    }

    #[test]
    fn a_far_and_lossy_link_costs_little_and_swaps_no_ids() {
        let far = run("futsal", 5.0, FarLinks { loss: 0.05, ..FAR });
        let near = run("futsal", 5.0, FarLinks::default());
        let [far, near] = [far, near].map(|run| {
            let first_ticks = run.first_ticks();
            assert_eq!(first_ticks.len(), 8, "all people are found");
            run.score_since(&run.causal, &first_ticks)
        });
        println!(
            "MPJPE over a far and lossy link {:?}, over none {:?}",
            far.mean.mpjpe_mm, near.mean.mpjpe_mm
        );
        assert_eq!(far.identity.switches, 0);
    }

    #[test]
    fn losses_have_the_given_share_and_are_reproducible() {
        let lost = || {
            let mut in_flight = InFlight::new(FarLinks { loss: 0.05, ..FAR });
            (0..10_000)
                .filter(|_| in_flight.is_lost())
                .collect::<Vec<_>>()
        };
        assert!((400..600).contains(&lost().len()));
        assert_eq!(lost(), lost());
    }
}
