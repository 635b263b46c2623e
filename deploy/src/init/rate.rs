//! How many frames per second videos have, as their containers say.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};
use farfield_proto::plain_text::one_line;

use super::recordings::{Recording, RecordingKind};

/// The rate of the first video; `None` where there is none. Whether the others have the same is looked at afterwards.
///
/// # Errors
/// When ffprobe is not there, or the file is no video.
pub(crate) fn of_videos(recordings: &[Recording]) -> anyhow::Result<Option<f64>> {
    let Some(video) = recordings.iter().find(|it| it.kind == RecordingKind::Video) else {
        return Ok(None);
    };
    let path = &video.path;
    let (said, complaint) = asked(path)?;
    match said.lines().next().and_then(fraction) {
        Some(rate_hz) => Ok(Some(rate_hz)),
        None => bail!(
            "{} does not say how many frames per second it has: {complaint}",
            path.display()
        ),
    }
}

/// Rates that videos have; what says another says none.
const RATES_HZ: [f64; 2] = [1.0, 240.0];
/// Rate of a video that does not say.
const USUAL_HZ: f64 = 30.0;

/// Frames per second of a video whose container says `said`, where no more hangs on it than how many of them are looked at.
pub(crate) fn about(said: Option<f64>) -> f64 {
    let [least, most] = RATES_HZ;
    said.unwrap_or(USUAL_HZ).clamp(least, most)
}

/// What ffprobe says of the rate of the first video stream, and what it complains of.
fn asked(path: &Path) -> anyhow::Result<(String, String)> {
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-select_streams", "v:0", "-show_entries", "stream=avg_frame_rate", "-of", "csv=p=0"])
        .arg(input)
        .stdin(Stdio::null())
        .output()
        .context("starting `ffprobe`, to read the videos: install ffmpeg (`apt install ffmpeg`), or say `--rate HZ`")?;
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok((
        said,
        one_line(String::from_utf8_lossy(&output.stderr).trim()),
    ))
}

/// `60000/1001` and the like, above 0.
fn fraction(text: &str) -> Option<f64> {
    let (above, below) = text.trim().trim_end_matches(',').split_once('/')?;
    let value = above.parse::<f64>().ok()? / below.parse::<f64>().ok()?;
    (value.is_finite() && value > 0.0).then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_fractions() {
        assert!(fraction("60000/1001").is_some_and(|hz| (hz - 59.94).abs() < 1e-3));
        assert_eq!(fraction("0/0"), None);
        assert_eq!(fraction("x"), None);
    }
}
