//! What a demo says before it begins.

use std::fmt::{self, Write as _};
use std::path::Path;
use std::thread;
use std::time::Duration;

use farfield_edge::inference::NetworkError;
use farfield_edge::node::Networks;

use super::play::Play;

/// What a tick costs beside the network, as a share of it: rendering, fusion, and the processes that
/// wait for each other.
const BESIDE: f64 = 0.5;

/// What reads the pictures.
pub(super) struct PictureBackend {
    /// Which it is, in its own words.
    pub(super) line: String,
    /// What one crop takes; `None` when there are no pictures.
    pub(super) crop_time: Option<Duration>,
}

impl PictureBackend {
    /// Runs the network once or twice, and lets go of it.
    ///
    /// # Errors
    /// When the backend fails.
    pub(super) fn of(mut networks: Networks) -> Result<Self, NetworkError> {
        Ok(Self {
            crop_time: networks.crop_time()?,
            line: networks.backend,
        })
    }
}

/// Where and who, with what, how long, and what the lines that follow mean.
pub(super) fn beginning(play: &Play, backend: &PictureBackend, out: &Path) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _infallible = write(&mut text, play, backend, out);
    text
}

fn write(text: &mut String, play: &Play, backend: &PictureBackend, out: &Path) -> fmt::Result {
    let scene = &play.scene;
    let [x_m, y_m] = scene.size_m();
    let ball = if scene.ball_at(0.0).is_some() {
        " and a ball"
    } else {
        ""
    };
    writeln!(
        text,
        "{} simulated people{ball} on {x_m} m x {y_m} m, seen by {} cameras in {} viewpoints; each \
         viewpoint is a process of its own, and one is fusion, talking Zenoh over loopback",
        scene.people().len(),
        scene.cameras().len(),
        scene.viewpoints().len()
    )?;
    if backend.crop_time.is_some() {
        writeln!(text, "{}", backend.line)?;
    } else {
        writeln!(
            text,
            "no pictures and no network: maps are made from the truth, with the faults of networks"
        )?;
    }
    let rate_hz = scene.rate_hz();
    let seconds = f64::from(play.ticks) / rate_hz;
    write!(text, "{} ticks, {seconds:.1} s at {rate_hz} Hz", play.ticks)?;
    writeln!(text, "{}", cost(play, backend.crop_time))?;
    if !play.is_last {
        writeln!(text, "again and again until Ctrl-C")?;
    }
    writeln!(text, "results go to {}", out.display())?;
    writeln!(
        text,
        "below: time in the scene; people tracked; mean distance of their limb joints from the truth; \
         speed ({rate_hz} ticks/s is real time); what one viewpoint would send at {rate_hz} Hz"
    )
}

/// What the network makes of it on this machine.
fn cost(play: &Play, crop_time: Option<Duration>) -> String {
    let Some(crop_s) = crop_time.map(|time| time.as_secs_f64()) else {
        return String::new();
    };
    let viewpoints = play.scene.viewpoints().len();
    let cores = thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let crops = play.scene.people().len() * viewpoints;
    let tick_s = crops as f64 * crop_s * (1.0 + BESIDE) / cores.min(viewpoints).max(1) as f64;
    let crops = format!("{crops} crops a tick at {:.1} ms", crop_s * 1e3);
    let whole = span(f64::from(play.ticks) * tick_s);
    format!(", will take about {whole} here ({crops})")
}

/// A time as people say it when they do not know it exactly.
fn span(seconds: f64) -> String {
    if seconds < 90.0 {
        let tens = ((seconds / 10.0).ceil() * 10.0).max(10.0);
        format!("{tens:.0} s")
    } else {
        format!("{:.0} minutes", (seconds / 60.0).ceil())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_that_nobody_knows_exactly_is_round() {
        assert_eq!(span(0.2), "10 s");
        assert_eq!(span(41.0), "50 s");
        assert_eq!(span(95.0), "2 minutes");
    }
}
