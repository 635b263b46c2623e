//! What a demo says before it begins.

use std::fmt::{self, Write as _};
use std::path::Path;
use std::time::Duration;

use farfield_edge::inference::NetworkError;
use farfield_edge::node::Networks;
use farfield_proto::tick::Tick;

use super::play::Play;

/// What reads the pictures.
pub(super) struct PictureBackend {
    /// Which it is, in its own words.
    pub(super) line: String,
    /// Whether it is the fall-back.
    is_slow: bool,
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
            is_slow: networks.is_slow,
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
        if backend.is_slow {
            writeln!(
                text,
                "with ONNX Runtime a tick takes about a third of the time"
            )?;
        }
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

/// What the network has to do, as far as that is known before the first tick.
fn cost(play: &Play, crop_time: Option<Duration>) -> String {
    let Some(crop_time) = crop_time else {
        return String::new();
    };
    let crops = play.scene.people().len() * play.scene.viewpoints().len();
    let crop_ms = crop_time.as_secs_f64() * 1e3;
    format!(
        ": {crops} crops a tick, {crop_ms:.1} ms each when nothing else runs; how long it takes is told as soon as it is \
         known"
    )
}

/// Where the pictures are that were drawn.
pub(super) fn pictures(out: &Path, ticks: &[Tick]) -> String {
    let names = ticks.iter().map(|tick| {
        let picture = out.join(format!("overlay_*_{tick}.png"));
        format!("skeletons over the pictures: {}\n", picture.display())
    });
    names.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pictures_are_named() {
        assert_eq!(
            pictures(Path::new("out"), &[Tick(150)]),
            "skeletons over the pictures: out/overlay_*_150.png\n"
        );
        assert_eq!(pictures(Path::new("out"), &[]), "");
    }
}
