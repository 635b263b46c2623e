//! How many frames per second videos have, as their containers say.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context as _, bail};

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
    let (said, complaint) = asked(path, "stream=avg_frame_rate", "say `--rate HZ`")?;
    match said.lines().next().and_then(fraction) {
        Some(rate_hz) => Ok(Some(rate_hz)),
        None => bail!(
            "{} does not say how many frames per second it has: {complaint}",
            path.display()
        ),
    }
}

/// Width and height of a video's pictures.
///
/// # Errors
/// When ffprobe is not there, or the file is no video.
pub(crate) fn size_px(path: &Path) -> anyhow::Result<[u32; 2]> {
    let (said, complaint) = asked(path, "stream=width,height", "give pictures")?;
    let sides = said.lines().next().and_then(|line| line.split_once(','));
    let side = |word: &str| word.trim().trim_end_matches(',').parse::<u32>().ok();
    match sides.and_then(|(width, height)| Some([side(width)?, side(height)?])) {
        Some(size_px) if !size_px.contains(&0) => Ok(size_px),
        _ => bail!(
            "{} does not say how large its pictures are: {complaint}",
            path.display()
        ),
    }
}

/// What ffprobe says of `entries` of the first video stream, and what it complains of; `else_do` is what helps without it.
fn asked(path: &Path, entries: &str, else_do: &str) -> anyhow::Result<(String, String)> {
    let mut input = std::ffi::OsString::from("file:");
    input.push(path);
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-select_streams", "v:0", "-show_entries", entries, "-of", "csv=p=0"])
        .arg(input)
        .stdin(Stdio::null())
        .output()
        .with_context(|| {
            format!("starting `ffprobe`, to read the videos: install ffmpeg (`apt install ffmpeg`), or {else_do}")
        })?;
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    Ok((
        said,
        String::from_utf8_lossy(&output.stderr).trim().to_owned(),
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
