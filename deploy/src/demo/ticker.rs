//! What a demo shows of itself while it works, for whoever sees it for the first time: one line per
//! second of the people's time, and one per second of the reader's while theirs takes longer.

use std::time::Duration;

use farfield_edge::pipeline::BeyondView;
use farfield_fusion::node::{Body, Progress};
use farfield_proto::tick::Tick;
use tokio::time::Instant;

use super::live_error::mean_error_m;
use super::play::Play;
use crate::output;
use crate::run::{Follow, ProgressDetail, TimeLeft};

/// The longest time without a line.
const EVERY: Duration = Duration::from_secs(1);

/// Prints the lines on standard output.
pub(super) struct DemoTicker<'a> {
    play: &'a Play,
    /// When the last line was printed, how far the run was then, and how many bytes the edges had sent.
    last: Option<(Instant, Tick, u64)>,
    left: TimeLeft,
    /// A tick that no line has told of yet.
    untold: Option<Progress>,
}

impl<'a> DemoTicker<'a> {
    pub(super) fn new(play: &'a Play) -> Self {
        Self {
            play,
            last: None,
            left: TimeLeft::default(),
            untold: None,
        }
    }

    /// Whether a full second of the people's time ends with `tick`.
    fn is_full(&self, tick: Tick) -> bool {
        let rate_hz = self.play.scene.rate_hz();
        let second = |tick: Tick| tick.seconds(rate_hz).floor();
        second(tick + 1) > second(tick)
    }

    fn tell(&mut self, progress: &Progress, now: Instant) {
        let (since, from, bytes) = self
            .last
            .unwrap_or((now, progress.tick, progress.edge_bytes));
        self.last = Some((now, progress.tick, progress.edge_bytes));
        self.untold = None;
        let elapsed_s = now.duration_since(since).as_secs_f64();
        let ticks = (progress.tick - from).unsigned_abs() as f64;
        let rates = (elapsed_s > 0.0 && ticks > 0.0).then(|| Rates {
            ticks_per_s: ticks / elapsed_s,
            bytes_per_tick: progress.edge_bytes.saturating_sub(bytes) as f64 / ticks,
        });
        let done = (progress.tick + 1).0.unsigned_abs();
        let left = self.left.at(now, done, self.play.ticks.into());
        let line = line(self.play, progress.tick, &progress.bodies, rates, left);
        // The run goes on when nobody reads: its files are what counts.
        drop(output::print(&line));
    }
}

impl Follow for DemoTicker<'_> {
    fn detail(&self) -> ProgressDetail {
        ProgressDetail::Bodies
    }

    fn tick(&mut self, progress: &Progress) {
        let now = Instant::now();
        match self.last {
            None => {
                let done = (progress.tick + 1).0.unsigned_abs();
                self.left.at(now, done, self.play.ticks.into());
                self.last = Some((now, progress.tick, progress.edge_bytes));
            }
            Some((last, ..))
                if now.duration_since(last) >= EVERY || self.is_full(progress.tick) =>
            {
                self.tell(progress, now);
                return;
            }
            Some(_) => {}
        }
        self.untold = Some(progress.clone());
    }

    /// The demo has words of its own. Of those of its nodes it passes on what is not used of a camera's picture: no other
    /// word says that to whoever has drawn the scene.
    fn wants(&self, said: &str) -> bool {
        said.contains(BeyondView::WORDS)
    }

    fn finish(&mut self) {
        if let Some(progress) = self.untold.take() {
            self.tell(&progress, Instant::now());
        }
    }
}

/// What passes since the last line.
#[derive(Debug, Clone, Copy)]
struct Rates {
    ticks_per_s: f64,
    /// Payload that the edges send, over all links.
    bytes_per_tick: f64,
}

fn line(
    play: &Play,
    tick: Tick,
    bodies: &[Body],
    rates: Option<Rates>,
    left: Option<String>,
) -> String {
    let rate_hz = play.scene.rate_hz();
    let time_s = (tick + 1).seconds(rate_hz);
    let whole_s = f64::from(play.ticks) / rate_hz;
    let truth = play.joints_at(tick);
    let error = mean_error_m(bodies, &truth).map_or_else(
        || "none near the truth".to_owned(),
        |error_m| format!("{:3.0} mm off", error_m * 1e3),
    );
    let rates = rates.map_or_else(String::new, |rates| {
        let links = play.scene.viewpoints().len().max(1) as f64;
        format!(
            "   {:5.1} ticks/s   {:.0} kB/s per viewpoint",
            rates.ticks_per_s,
            rates.bytes_per_tick * rate_hz / links / 1e3
        )
    });
    let left = left.map_or_else(String::new, |left| format!("   {left}"));
    format!(
        "{time_s:6.1} of {whole_s:.1} s   {} of {} people tracked   {error}{rates}{left}\n",
        bodies.len(),
        truth.len(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn play() -> Play {
        let scene = farfield_sim::embedded::scene("court").unwrap();
        Play {
            scene: scene.into(),
            ticks: 300,
            is_last: true,
            venue: "venue.toml".into(),
        }
    }

    #[test]
    fn a_line_says_when_who_how_well_how_fast_and_how_much() {
        let play = play();
        let true_joints = play.joints_at(Tick(29));
        let shifted = |(person, joints): (u32, &farfield_fusion::body::skeleton::Joints)| Body {
            person,
            joints_m: joints
                .iter()
                .map(|m| [m.x as f32, m.y as f32, m.z as f32 + 0.02])
                .collect(),
        };
        let bodies: Vec<Body> = (1..).zip(&true_joints).map(shifted).collect();
        let rates = Rates {
            ticks_per_s: 12.34,
            bytes_per_tick: 8000.0,
        };
        assert_eq!(
            line(
                &play,
                Tick(29),
                &bodies,
                Some(rates),
                Some("about 20 s left".to_owned())
            ),
            "   1.0 of 10.0 s   4 of 4 people tracked    20 mm off    12.3 ticks/s   60 kB/s per viewpoint   about 20 s left\n"
        );
        assert_eq!(
            line(&play, Tick(29), &[], None, None),
            "   1.0 of 10.0 s   0 of 4 people tracked   none near the truth\n"
        );
    }

    #[test]
    fn seconds_of_the_scene_are_full_at_their_last_tick() {
        let play = play();
        let ticker = DemoTicker::new(&play);
        let full: Vec<i64> = (0..90).filter(|&tick| ticker.is_full(Tick(tick))).collect();
        assert_eq!(full, [29, 59, 89]);
    }
}
