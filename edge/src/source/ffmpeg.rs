//! The child process that decodes: start, messages and end.
//!
//! `ffmpeg-sidecar` finds and starts the program. Its event loop is not used, because it copies
//! every frame.

use std::collections::{BTreeMap, VecDeque};
use std::ffi::OsString;
use std::io::{self, BufRead as _, BufReader, Read};
use std::path::Path;
use std::process::{ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::thread::JoinHandle;

use farfield_proto::plain_text::one_line;
use farfield_proto::secrets::Secrets;
use ffmpeg_sidecar::child::FfmpegChild;
use ffmpeg_sidecar::command::FfmpegCommand;
use ffmpeg_sidecar::paths::ffmpeg_path;

use super::decoded_pictures::YUV_FORMATS;
use super::frame_times::{FrameTimeReader, FrameTimes, frame_times};
use super::sender_clock::SenderClock;
use super::video_format::VideoFormat;
use super::{SourceError, SourceOrigin};
use crate::picture::ColourMatrix;

/// Input devices of ffmpeg that a URL may begin with, as in `avfoundation:0`.
const DEVICES: [&str; 6] = [
    "v4l2",
    "avfoundation",
    "dshow",
    "decklink",
    "x11grab",
    "lavfi",
];

/// Arguments for a recording. The prefix prevents that a name with a colon is read as a URL.
pub(super) fn file_input(path: &Path) -> Vec<OsString> {
    let mut url = OsString::from("file:");
    url.push(path);
    vec!["-i".into(), url]
}

/// Arguments for a live source: an RTSP or other stream, `/dev/video0`, or `DEVICE:INPUT` with one
/// of ffmpeg's input devices. The venue's `options` override the defaults.
pub(super) fn live_input(url: &str, options: &BTreeMap<String, String>) -> Vec<OsString> {
    let mut all = BTreeMap::from([("fflags", "nobuffer"), ("flags", "low_delay")]);
    let device = url
        .split_once(':')
        .filter(|(device, _)| DEVICES.contains(device));
    let input = if let Some((device, input)) = device {
        all.insert("f", device);
        input
    } else {
        if url.starts_with("/dev/video") {
            all.insert("f", "v4l2");
        } else if url.starts_with("rtsp") {
            // UDP loses packets, and with them slices of the picture.
            all.insert("rtsp_transport", "tcp");
        }
        url
    };
    all.extend(
        options
            .iter()
            .map(|(name, value)| (name.as_str(), value.as_str())),
    );
    let words = all
        .iter()
        .flat_map(|(name, value)| [format!("-{name}").into(), value.into()]);
    words.chain(["-i".into(), input.into()]).collect()
}

/// What to decode.
pub(super) enum Wanted {
    /// A recording without its first frames, and its storage format.
    After(u64, VideoFormat),
    /// A live source with frame times: the secrets of its URL, and the reader of the camera's
    /// clock.
    Timed(Secrets, Option<SenderClock>),
}

impl Wanted {
    /// Arguments for the filters and the output.
    fn output(&self) -> Vec<String> {
        let mut filters: Vec<String> = match self {
            Self::After(skip, format) => {
                let [before, after] = format.filters();
                let select = (*skip > 0).then(|| format!("select=gte(n\\,{skip})"));
                [before, select, after].into_iter().flatten().collect()
            }
            Self::Timed(..) => vec!["showinfo=checksum=0".to_owned()],
        };
        let coding = match self {
            Self::After(_, format) if format.is_rgb => "-pix_fmt rgb24 -c:v ppm -f image2pipe -",
            Self::After(..) | Self::Timed(..) => {
                filters.push(YUV_FORMATS.to_owned());
                "-f yuv4mpegpipe -"
            }
        };
        let filters = if filters.is_empty() {
            Vec::new()
        } else {
            vec!["-vf".to_owned(), filters.join(",")]
        };
        let coding = coding.split(' ').map(str::to_owned);
        filters.into_iter().chain(coding).collect()
    }
}

/// A running ffmpeg and its outputs.
pub(super) struct Decoding {
    pub(super) ffmpeg: Ffmpeg,
    /// Its pictures; see [`super::decoded_pictures::PictureReader`].
    pub(super) stdout: ChildStdout,
    /// Their times, if requested.
    pub(super) times: Option<FrameTimes>,
    /// The colour matrix until the times report one.
    pub(super) matrix: ColourMatrix,
}

/// A running ffmpeg. Dropping it ends the process.
pub(super) struct Ffmpeg {
    child: FfmpegChild,
    messages: Option<JoinHandle<String>>,
    /// Relates the times of pictures to the camera's clock. It is dropped after the process, which
    /// writes to it.
    sender_clock: Option<SenderClock>,
}

impl Ffmpeg {
    /// Starts to decode `input`.
    pub(super) fn spawn(
        input: Vec<OsString>,
        wanted: Wanted,
        at: &SourceOrigin,
    ) -> Result<Decoding, SourceError> {
        let mut command = FfmpegCommand::new();
        command.args(["-nostdin", "-hide_banner", "-nostats", "-loglevel"]);
        // The filter's lines have the level `info`; errors are then recognised by a word in each
        // line.
        command.arg(match wanted {
            Wanted::After(..) => "error",
            Wanted::Timed(..) => "level+info",
        });
        command.args(input);
        command.args(["-map", "0:v:0", "-fps_mode", "passthrough"]);
        command.args(wanted.output());
        if let Wanted::Timed(_, Some(sender_clock)) = &wanted {
            command.args(sender_clock.output());
        }
        own_process_group(&mut command);
        let mut child = command
            .spawn()
            .map_err(|problem| start_problem(at, "ffmpeg", &problem))?;
        drop(child.take_stdin());
        let (Some(stdout), Some(stderr)) = (child.take_stdout(), child.take_stderr()) else {
            return Err(SourceError::Unreadable {
                at: at.clone(),
                problem: "ffmpeg was started without its pipes".to_owned(),
            });
        };
        let (messages, times, matrix, sender_clock) = match wanted {
            Wanted::After(_, format) => {
                let messages = collect_messages(stderr);
                (messages, None, format.matrix_read(), None)
            }
            Wanted::Timed(secrets, sender_clock) => {
                let (reader, times) = frame_times();
                let messages = collect_timed_messages(stderr, reader, secrets);
                let matrix = ColourMatrix::default();
                (messages, Some(times), matrix, sender_clock)
            }
        };
        let ffmpeg = Self {
            child,
            messages: Some(messages),
            sender_clock,
        };
        Ok(Decoding {
            ffmpeg,
            stdout,
            times,
            matrix,
        })
    }

    /// The camera's Unix time of a time stamp, microseconds; `None` if unknown.
    pub(super) fn unix_us(&self, stamp_us: i64) -> Option<i64> {
        let offset_us = self.sender_clock.as_ref()?.offset_us()?;
        Some(stamp_us.saturating_add(offset_us))
    }

    /// Waits for the end; returns whether it succeeded, and its messages.
    pub(super) fn finish(&mut self) -> (bool, String) {
        let success = self
            .child
            .as_inner_mut()
            .wait()
            .is_ok_and(|status| status.success());
        let messages = self.messages.take().and_then(|thread| thread.join().ok());
        (
            success,
            message_suffix("ffmpeg", &messages.unwrap_or_default()),
        )
    }

    #[cfg(test)]
    pub(super) fn id(&mut self) -> u32 {
        self.child.as_inner().id()
    }

    /// Ends the process.
    pub(super) fn kill(&mut self) {
        // This fails only if the process has already ended.
        self.child.kill().ok();
    }

    /// Ends the process and waits for its end.
    pub(super) fn stop(&mut self) {
        self.kill();
        self.child.as_inner_mut().wait().ok();
        if let Some(thread) = self.messages.take() {
            thread.join().ok();
        }
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Whether the installed ffmpeg has the filter `name`. The list is read once.
pub(super) fn has_filter(name: &str) -> bool {
    static FILTERS: OnceLock<String> = OnceLock::new();
    let filters = FILTERS.get_or_init(|| {
        let mut ffmpeg = Command::new(ffmpeg_path());
        let listed = ffmpeg
            .args(["-hide_banner", "-loglevel", "error", "-filters"])
            .stdin(Stdio::null())
            .output();
        listed.map_or_else(
            |_| String::new(),
            |it| String::from_utf8_lossy(&it.stdout).into_owned(),
        )
    });
    // A line is like ` .SC zscale            V->V       Apply resizing`.
    let mut names = filters
        .lines()
        .filter_map(|line| line.split_whitespace().nth(1));
    names.any(|it| it == name)
}

/// Ctrl-C in a terminal reaches a whole process group. Without its own group, ffmpeg would end
/// before the node decides how to stop.
fn own_process_group(command: &mut FfmpegCommand) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command.as_inner_mut(), 0);
    #[cfg(not(unix))]
    let _ = command;
}

/// The error for a program that failed to start.
pub(super) fn start_problem(
    at: &SourceOrigin,
    tool: &'static str,
    problem: &io::Error,
) -> SourceError {
    match problem.kind() {
        io::ErrorKind::NotFound => SourceError::ToolMissing {
            at: at.clone(),
            tool,
        },
        _ => SourceError::Unreadable {
            at: at.clone(),
            problem: format!("`{tool}` cannot be started: {problem}"),
        },
    }
}

/// Reads the standard error of a program on a thread, so that the program never blocks, and keeps
/// the last lines.
pub(super) fn collect_messages(stderr: impl Read + Send + 'static) -> JoinHandle<String> {
    collect(stderr, |line| Some(line.to_owned()))
}

/// The same for an ffmpeg that also writes frame times; of the other lines only errors are lines.
fn collect_timed_messages(
    stderr: impl Read + Send + 'static,
    mut reader: FrameTimeReader,
    secrets: Secrets,
) -> JoinHandle<String> {
    collect(stderr, move |line| {
        if reader.read(line) {
            return None;
        }
        let line = secrets.mask(line);
        let mut levels = ["[error] ", "[fatal] ", "[panic] "].into_iter();
        levels.find_map(|level| line.contains(level).then(|| line.replacen(level, "", 1)))
    })
}

/// Keeps the last results of `worth_keeping`.
fn collect(
    stderr: impl Read + Send + 'static,
    mut worth_keeping: impl FnMut(&str) -> Option<String> + Send + 'static,
) -> JoinHandle<String> {
    /// The last lines explain why a decoder failed.
    const MAX_LINES: usize = 3;
    const MAX_CHARS: usize = 400;
    // Longer than any URL: a part of a secret is also secret.
    const LINE_BYTES: u64 = 1 << 16;
    std::thread::spawn(move || {
        let mut stderr = BufReader::new(stderr);
        let mut lines = VecDeque::new();
        let mut line = Vec::new();
        while stderr
            .by_ref()
            .take(LINE_BYTES)
            .read_until(b'\n', &mut line)
            .is_ok_and(|n| n > 0)
        {
            let text = worth_keeping(String::from_utf8_lossy(&line).trim());
            line.clear();
            if let Some(text) = text.filter(|text| !text.is_empty() && lines.back() != Some(text)) {
                lines.push_back(text.chars().take(MAX_CHARS).collect());
            }
            if lines.len() > MAX_LINES {
                lines.pop_front();
            }
        }
        // ffmpeg repeats URLs with passwords, and text from the camera.
        one_line(&Vec::from(lines).join("; "))
    })
}

/// A program's messages as the end of an error message; empty without messages.
pub(super) fn message_suffix(tool: &str, messages: &str) -> String {
    if messages.is_empty() {
        return String::new();
    }
    let hint = if messages.contains("fps_mode") {
        " (ffmpeg 5.1 or later is needed)"
    } else {
        ""
    };
    format!("; {tool} says: {messages}{hint}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn live_urls_choose_their_input_device() {
        let usual = "-fflags nobuffer -flags low_delay";
        for (url, args) in [
            (
                "rtsp://cam/1",
                format!("{usual} -rtsp_transport tcp -i rtsp://cam/1"),
            ),
            ("/dev/video0", format!("-f v4l2 {usual} -i /dev/video0")),
            ("avfoundation:0", format!("-f avfoundation {usual} -i 0")),
            ("http://cam/mjpg", format!("{usual} -i http://cam/mjpg")),
        ] {
            let found = live_input(url, &BTreeMap::new());
            assert_eq!(found.join(&OsString::from(" ")), OsString::from(args));
        }
    }

    #[test]
    fn options_of_the_venue_override_the_defaults() {
        let options = [("hwaccel", "vaapi"), ("rtsp_transport", "udp")];
        let options = options.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let found = live_input("rtsp://cam/1", &options.into());
        let expected =
            "-fflags nobuffer -flags low_delay -hwaccel vaapi -rtsp_transport udp -i rtsp://cam/1";
        assert_eq!(found.join(&OsString::from(" ")), OsString::from(expected));
    }
}
