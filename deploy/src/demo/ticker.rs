//! The lines that a demo prints while it runs: one per second of scene time, and one per second of real time if the run
//! is slower.

use std::time::Duration;

use farfield_fusion_node::{Body, Progress};
use farfield_node::process::LineKind;
use farfield_proto::tick::Tick;
use tokio::time::Instant;

use super::play::Play;
use super::score::mean_error_m;
use crate::output;
use crate::run::{Follow, ProgressDetail, TimeLeft};

/// The longest time without a line.
const LINE_INTERVAL: Duration = Duration::from_secs(1);

/// Prints the lines on standard output.
pub(super) struct DemoTicker<'a> {
    play: &'a Play,
    /// Time, tick and bytes sent by edges at the last line.
    last: Option<(Instant, Tick, u64)>,
    left: TimeLeft,
    /// The newest tick without a line.
    pending: Option<Progress>,
}

impl<'a> DemoTicker<'a> {
    pub(super) fn new(play: &'a Play) -> Self {
        Self {
            play,
            last: None,
            left: TimeLeft::default(),
            pending: None,
        }
    }

    /// Whether `tick` is the last of a second of scene time.
    fn is_full(&self, tick: Tick) -> bool {
        let rate_hz = self.play.scene.rate_hz();
        let second = |tick: Tick| tick.seconds(rate_hz).floor();
        second(tick + 1) > second(tick)
    }

    fn print_progress(&mut self, progress: &Progress, now: Instant) {
        let (since, from, bytes) = self
            .last
            .unwrap_or((now, progress.tick, progress.edge_bytes));
        self.last = Some((now, progress.tick, progress.edge_bytes));
        self.pending = None;
        let elapsed_s = now.duration_since(since).as_secs_f64();
        let ticks = (progress.tick - from).unsigned_abs() as f64;
        let rates = (elapsed_s > 0.0 && ticks > 0.0).then(|| Rates {
            ticks_per_s: ticks / elapsed_s,
            bytes_per_tick: progress.edge_bytes.saturating_sub(bytes) as f64 / ticks,
        });
        let done = (progress.tick + 1).0.unsigned_abs();
        let left = self.left.at(now, done, self.play.ticks.into());
        let line = line(self.play, progress.tick, &progress.bodies, rates, left);
        // The run continues without a reader, for its files.
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
                if now.duration_since(last) >= LINE_INTERVAL || self.is_full(progress.tick) =>
            {
                self.print_progress(progress, now);
                return;
            }
            Some(_) => {}
        }
        self.pending = Some(progress.clone());
    }

    /// Of the nodes' lines the demo prints only those on unused parts of a camera's pictures, which the author of a
    /// scene needs.
    fn wants(&self, kind: LineKind) -> bool {
        kind == LineKind::UnusedPictures
    }

    fn finish(&mut self) {
        if let Some(progress) = self.pending.take() {
            self.print_progress(&progress, Instant::now());
        }
    }
}

/// Rates since the last line.
#[derive(Debug, Clone, Copy)]
struct Rates {
    ticks_per_s: f64,
    /// Payload sent by the edges, over all links.
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
        || "no pose near the truth".to_owned(),
        |error_m| format!("{:3.0} mm error", error_m * 1e3),
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
    fn a_line_has_time_people_error_speed_and_bytes() {
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
            "   1.0 of 10.0 s   4 of 4 people tracked    20 mm error    12.3 ticks/s   60 kB/s per viewpoint   about 20 s left\n"
        );
        assert_eq!(
            line(&play, Tick(29), &[], None, None),
            "   1.0 of 10.0 s   0 of 4 people tracked   no pose near the truth\n"
        );
    }

    #[test]
    fn a_second_is_full_at_its_last_tick() {
        let play = play();
        let ticker = DemoTicker::new(&play);
        let full: Vec<i64> = (0..90).filter(|&tick| ticker.is_full(Tick(tick))).collect();
        assert_eq!(full, [29, 59, 89]);
    }
}
