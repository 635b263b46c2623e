//! The introduction of a demo, and its final lines on images.

use std::fmt::{self, Write as _};
use std::path::Path;
use std::time::Duration;

use farfield_edge::inference::NetworkError;
use farfield_edge::node::Networks;
use farfield_proto::tick::Tick;

use super::play::Play;

/// The backend that runs the network on images.
pub(super) struct ImageBackend {
    /// Its description.
    pub(super) line: String,
    /// Whether it is the slow fallback.
    is_slow: bool,
    /// Time for one crop; `None` without images.
    pub(super) crop_time: Option<Duration>,
}

impl ImageBackend {
    /// Measures the network with one or two crops, and drops it.
    ///
    /// # Errors
    /// When the backend fails.
    pub(super) fn measure(mut networks: Networks) -> Result<Self, NetworkError> {
        Ok(Self {
            crop_time: networks.crop_time()?,
            is_slow: networks.is_slow,
            line: networks.backend,
        })
    }
}

/// Scene, backend, length, and the meaning of the lines that follow.
pub(super) fn introduction(play: &Play, backend: &ImageBackend, out: &Path) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _infallible = write(&mut text, play, backend, out);
    text
}

fn write(text: &mut String, play: &Play, backend: &ImageBackend, out: &Path) -> fmt::Result {
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
         viewpoint and fusion are separate processes, connected by Zenoh over loopback",
        scene.people().len(),
        scene.cameras().len(),
        scene.viewpoints().len()
    )?;
    if backend.crop_time.is_some() {
        writeln!(text, "{}", backend.line)?;
        if backend.is_slow {
            writeln!(
                text,
                "ONNX Runtime would reduce the time per tick to about a third"
            )?;
        }
    } else {
        writeln!(
            text,
            "no images and no network: maps are made from the truth, with typical faults of networks"
        )?;
    }
    let rate_hz = scene.rate_hz();
    let seconds = f64::from(play.ticks) / rate_hz;
    write!(text, "{} ticks, {seconds:.1} s at {rate_hz} Hz", play.ticks)?;
    writeln!(text, "{}", cost(play, backend.crop_time))?;
    if !play.is_last {
        writeln!(text, "repeats until Ctrl-C")?;
    }
    writeln!(text, "results go to {}", out.display())?;
    writeln!(
        text,
        "each line: time in the scene; people tracked; mean error of their limb joints; \
         speed ({rate_hz} ticks/s is real time); data that one viewpoint would send at {rate_hz} Hz"
    )
}

/// The work of the network, as far as known before the first tick.
fn cost(play: &Play, crop_time: Option<Duration>) -> String {
    let Some(crop_time) = crop_time else {
        return String::new();
    };
    let crops = play.scene.people().len() * play.scene.viewpoints().len();
    let crop_ms = crop_time.as_secs_f64() * 1e3;
    format!(
        ": {crops} crops per tick, {crop_ms:.1} ms each if nothing else runs; the time left is shown as soon as it is known"
    )
}

/// The paths of the drawn images.
pub(super) fn images(out: &Path, ticks: &[Tick]) -> String {
    let names = ticks.iter().map(|tick| {
        let image = out.join(format!("overlay_*_{tick}.png"));
        format!("skeletons over the images: {}\n", image.display())
    });
    names.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_images_are_listed() {
        assert_eq!(
            images(Path::new("out"), &[Tick(150)]),
            "skeletons over the images: out/overlay_*_150.png\n"
        );
        assert_eq!(images(Path::new("out"), &[]), "");
    }
}
