//! Small faults at random moments while a venue runs: links, edges, clocks. The same seed gives the same ones.

use std::fmt;
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::live_venue::LiveVenue;
use crate::relay::Impairment;

/// Time at the start without faults: people are found.
const SETTLE: Duration = Duration::from_secs(15);
/// Time from one fault to the next, seconds.
const EVERY_S: [f64; 2] = [5.0, 15.0];
/// Duration of a cut, duration and loss of a lossy link, and downtime of an edge.
const CUT_S: [f64; 2] = [0.1, 1.5];
const LOSSY_S: [f64; 2] = [1.0, 5.0];
const LOSS: [f64; 2] = [0.02, 0.2];
const AWAY_S: [f64; 2] = [0.2, 2.0];
/// Offset of an edge's clock at its start, within what fusion corrects, and time until it is set right. A clock that is set
/// farther off is refused, which is no small fault.
const OFF_MS: [f64; 2] = [-80.0, 80.0];
const SET_AFTER_S: [f64; 2] = [5.0, 60.0];

/// Causes the faults, and counts them.
pub(super) struct SmallFaults {
    rng: ChaCha8Rng,
    usual: Impairment,
    next: Duration,
    /// End of each link's loss.
    lossy_until: Vec<Option<Duration>>,
    /// End of each edge's downtime.
    away_until: Vec<Option<Duration>>,
    cuts: u32,
    lossy: u32,
    /// Edges that were started again, each with a clock that is off and then set right.
    restarts: u32,
}

enum SmallFault {
    Cut,
    Lossy,
    Restart,
}

impl SmallFaults {
    /// For a venue of `n` viewpoints with `usual` links.
    pub(super) fn new(seed: u64, usual: Impairment, n: usize) -> Self {
        Self {
            rng: ChaCha8Rng::seed_from_u64(seed),
            usual,
            next: SETTLE,
            lossy_until: vec![None; n],
            away_until: vec![None; n],
            cuts: 0,
            lossy: 0,
            restarts: 0,
        }
    }

    /// Causes the faults that are due after `elapsed`.
    ///
    /// # Errors
    /// A node cannot be started or ended.
    pub(super) fn update(&mut self, live: &mut LiveVenue, elapsed: Duration) -> anyhow::Result<()> {
        for i in 0..self.away_until.len() {
            if self.lossy_until[i].is_some_and(|until| until <= elapsed) {
                self.lossy_until[i] = None;
                live.relays[i].set_both(self.usual);
            }
            if self.away_until[i].is_some_and(|until| until <= elapsed) {
                self.away_until[i] = None;
                self.start(live, i)?;
            }
        }
        if elapsed < self.next {
            return Ok(());
        }
        self.next = elapsed + self.span(EVERY_S);
        // The last edge runs as long as the venue, so that growth shows.
        let kind = match self.rng.random_range(0..3u8) {
            0 => SmallFault::Cut,
            1 => SmallFault::Lossy,
            _ => SmallFault::Restart,
        };
        let n = self.away_until.len();
        let most = if matches!(kind, SmallFault::Restart) {
            n.saturating_sub(1).max(1)
        } else {
            n
        };
        let i = self.rng.random_range(0..most);
        self.act(live, (kind, i), elapsed)
    }

    fn act(
        &mut self,
        live: &mut LiveVenue,
        (kind, i): (SmallFault, usize),
        elapsed: Duration,
    ) -> anyhow::Result<()> {
        match kind {
            SmallFault::Cut => {
                self.cuts += 1;
                live.relays[i].cut(self.span(CUT_S));
            }
            SmallFault::Lossy => {
                self.lossy += 1;
                self.lossy_until[i] = Some(elapsed + self.span(LOSSY_S));
                live.relays[i].set_both(Impairment {
                    loss: self.between(LOSS),
                    ..self.usual
                });
            }
            SmallFault::Restart => {
                if let Some(edge) = live.edges[i].take() {
                    self.restarts += 1;
                    self.away_until[i] = Some(elapsed + self.span(AWAY_S));
                    edge.kill()?;
                }
            }
        }
        Ok(())
    }

    fn start(&mut self, live: &mut LiveVenue, i: usize) -> anyhow::Result<()> {
        let off_ms = self.between(OFF_MS).round();
        let (off, by) = (format!("{off_ms:.0}"), format!("{:.0}", -off_ms));
        let after = format!("{:.0}", self.between(SET_AFTER_S));
        let arguments = [
            ["--clock-shift-ms", &off],
            ["--clock-set-after-s", &after],
            ["--clock-set-by-ms", &by],
        ];
        live.start_edge(i, None, &arguments.concat())?;
        Ok(())
    }

    fn between(&mut self, range: [f64; 2]) -> f64 {
        self.rng.random_range(range[0]..range[1])
    }

    fn span(&mut self, seconds: [f64; 2]) -> Duration {
        Duration::from_secs_f64(self.between(seconds))
    }
}

impl fmt::Display for SmallFaults {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} links cut and {} lossy for a moment, {} edges started again with clocks that were off and then set right",
            self.cuts, self.lossy, self.restarts
        )
    }
}
