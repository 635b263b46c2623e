//! Small things that go wrong at random moments while a venue runs: links, edges, clocks. The same seed gives the same ones.

use std::fmt;
use std::time::Duration;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::live_venue::LiveVenue;
use crate::relay::Impairment;

/// Nothing goes wrong for so long: people are found.
const SETTLE: Duration = Duration::from_secs(15);
/// From one fault to the next, seconds.
const EVERY_S: [f64; 2] = [5.0, 15.0];
/// How long a link is cut, how long and how lossy it is, and how long an edge is away.
const CUT_S: [f64; 2] = [0.1, 1.5];
const LOSSY_S: [f64; 2] = [1.0, 5.0];
const LOSS: [f64; 2] = [0.02, 0.2];
const AWAY_S: [f64; 2] = [0.2, 2.0];
/// How far the clock of an edge is off when it starts again, within what fusion corrects, and when it is set right. One that
/// is set farther off is refused until it is right: that is no small fault.
const OFF_MS: [f64; 2] = [-80.0, 80.0];
const SET_AFTER_S: [f64; 2] = [5.0, 60.0];

/// Who does them, and what was done.
pub(super) struct SmallFaults {
    rng: ChaCha8Rng,
    usual: Impairment,
    next: Duration,
    /// Until when each link is lossy.
    lossy_until: Vec<Option<Duration>>,
    /// Until when each edge is away.
    away_until: Vec<Option<Duration>>,
    cuts: u32,
    lossy: u32,
    /// Edges that were started again, each with a clock that is off and then set right.
    restarts: u32,
}

/// One thing that goes wrong.
enum SmallFault {
    Cut,
    Lossy,
    Restart,
}

impl SmallFaults {
    /// In a venue of `n` viewpoints whose links are `usual`.
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

    /// Does what is due after `elapsed`.
    ///
    /// # Errors
    /// A node that cannot be started or ended.
    pub(super) fn look(&mut self, live: &mut LiveVenue, elapsed: Duration) -> anyhow::Result<()> {
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
        // The last edge lives as long as the venue, so that what grows is seen.
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
