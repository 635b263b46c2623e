//! What the path between edges and fusion does to messages, in ticks and without a network: cuts, and links
//! that are far and lossy. Every run is the same.

use std::collections::VecDeque;
use std::ops::Range;

use farfield_edge::pipeline::EdgeOutput;
use farfield_proto::message::BoxSet;
use farfield_proto::tick::Tick;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Times at which nothing of what the edges say reaches fusion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cuts {
    /// From the beginning of one cut to that of the next, ticks; the first begins after as long.
    pub every: i64,
    /// How long a cut lasts, ticks.
    pub lasts: i64,
    /// By how many ticks what was cut off comes late; `None`: never.
    pub late: Option<i64>,
}

impl Cuts {
    /// The first ticks of the cuts within `ticks`, and those after their last ones.
    pub fn within(self, ticks: &Range<Tick>) -> impl Iterator<Item = [Tick; 2]> + use<> {
        let n = ticks.end.0 / self.every.max(1);
        (1..=n).map(move |i| {
            let from = Tick(i * self.every);
            [from, from + self.lasts]
        })
    }

    /// Whether fusion hears nothing at `tick`.
    pub fn holds(&self, tick: Tick) -> bool {
        tick.0 >= self.every && tick.0 % self.every.max(1) < self.lasts
    }
}

/// Links that are far and lose messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FarLinks {
    /// How many ticks after the one that was stepped its boxes are used, at least 1.
    pub ahead: i64,
    /// Share of the messages that are lost each way, 0 to 1.
    pub loss: f64,
    /// Which of them.
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

/// What is in flight over [`FarLinks`].
pub(crate) struct OnTheWay {
    links: FarLinks,
    lots: ChaCha8Rng,
    /// By the step that made them.
    boxes: VecDeque<Vec<BoxSet>>,
}

impl OnTheWay {
    pub(crate) fn new(links: FarLinks) -> Self {
        Self {
            links,
            lots: ChaCha8Rng::seed_from_u64(links.seed),
            boxes: VecDeque::new(),
        }
    }

    /// Fusion sends `boxes`; what has come to the edges by the next tick takes the place of what is in
    /// `newest`.
    pub(crate) fn send_boxes(&mut self, boxes: Vec<BoxSet>, newest: &mut [BoxSet]) {
        self.boxes.push_back(boxes);
        let under_way = usize::try_from(self.links.ahead - 1).unwrap_or(0);
        if self.boxes.len() <= under_way {
            return;
        }
        for (set, newest) in self.boxes.pop_front().into_iter().flatten().zip(newest) {
            if !self.is_lost() {
                *newest = set;
            }
        }
    }

    /// Takes out of `outputs` what does not reach fusion.
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

    /// Boxes that come back 233 ms later, over a link of 200 ms.
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
    fn who_runs_is_found_and_followed_over_a_far_link() {
        let run = run("sprint", 3.0, FAR);
        let found = run.found();
        assert!(!found.is_empty(), "nobody was found");
        let scores = run.score_since(&run.causal, &found);
        assert!(scores.mean.gaps < 0.5, "{} gaps", scores.mean.gaps);
    }

    #[test]
    fn a_far_and_lossy_link_costs_little_and_exchanges_nobody() {
        let far = run("futsal", 5.0, FarLinks { loss: 0.05, ..FAR });
        let near = run("futsal", 5.0, FarLinks::default());
        let [far, near] = [far, near].map(|run| {
            let found = run.found();
            assert_eq!(found.len(), 8, "everybody is found");
            run.score_since(&run.causal, &found)
        });
        println!(
            "MPJPE over a far and lossy link {:?}, over none {:?}",
            far.mean.mpjpe_mm, near.mean.mpjpe_mm
        );
        assert_eq!(far.identity.switches, 0);
    }

    #[test]
    fn messages_are_lost_as_often_as_it_was_said_and_the_same_ones_again() {
        let lost = || {
            let mut way = OnTheWay::new(FarLinks { loss: 0.05, ..FAR });
            (0..10_000).filter(|_| way.is_lost()).collect::<Vec<_>>()
        };
        assert!((400..600).contains(&lost().len()));
        assert_eq!(lost(), lost());
    }
}
