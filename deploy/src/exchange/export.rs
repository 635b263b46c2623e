//! `farfield export RUN`: the poses of a run in the formats of other programs.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, ensure};
use clap::Args;
use farfield_export::axes::Preset;
use farfield_export::skeleton::{BoneNames, RestPose};
use farfield_export::timeline::Gaps;
use farfield_export::{
    Existing, ExportError, ExportRequest, Format, Lengths, Options, Written, export,
};
use farfield_fusion::export::salvage::SMOOTH;
use farfield_node::process::NodeError;
use farfield_proto::tick::{Tick, parse_range};
use indicatif::{HumanBytes, ProgressBar};
use serde::Serialize;

use crate::output;

/// What a run calls its poses, and what it says of itself.
const POSES: &str = "poses.jsonl";
const SUMMARY: &str = "summary.json";
/// Where files go, in the folder of the run.
const FOLDER: &str = "export";

/// What `farfield export` is told.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// The folder of a run, or one of its poses.jsonl.
    ///
    /// `RUN/smooth/poses.jsonl` are the smoothed poses. A recording is solved first: `farfield replay RECORDING --out RUN`.
    run: PathBuf,
    /// What to write, with commas: glb,c3d,csv, or all.
    ///
    /// bvh, glb, gltf, c3d, csv, csv-tidy, parquet, osim, trc, mot. TRC and MOT of the whole run are written by the run itself.
    #[arg(long, value_delimiter = ',', required = true, value_name = "FORMAT", value_parser = formats)]
    format: Vec<Formats>,
    /// Folder for the files. Default: RUN/export.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these people, by id.
    #[arg(long, value_delimiter = ',', value_name = "ID")]
    person: Vec<u32>,
    /// What a person is called in the files.
    #[arg(long, value_name = "ID=NAME", value_parser = called)]
    name: Vec<(u32, String)>,
    /// Only these ticks, B not among them.
    #[arg(long, value_parser = parse_range, value_name = "A..B", allow_hyphen_values = true)]
    ticks: Option<Range<Tick>>,
    /// Frames per second. Default: the venue's.
    #[arg(long, hide_short_help = true, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Gaps: keep, fill, or mark what is filled.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "keep",
        hide_default_value = true
    )]
    gaps: Gaps,
    /// Longest gap that is filled, seconds.
    #[arg(long, hide_short_help = true, value_name = "S", default_value_t = 1.0)]
    longest_gap_s: f64,
    /// Units and axes of blender, unreal, opensim, ...
    ///
    /// blender, unreal, unity, opensim, visual3d. Default: those of the format.
    #[arg(long, value_name = "PROGRAM")]
    preset: Option<Preset>,
    /// Names of bones as of unreal, mixamo, unity, vrm.
    #[arg(
        long,
        value_name = "PROGRAM",
        default_value = "farfield",
        hide_default_value = true
    )]
    names: BoneNames,
    /// How the skeleton rests: t-pose or a-pose.
    #[arg(
        long,
        hide_short_help = true,
        value_name = "POSE",
        default_value = "t-pose"
    )]
    rest: RestPose,
    /// How long bones are: settled or measured.
    ///
    /// settled: constant, as the run came to know the person, which retargeting expects; measured: as they were at each
    /// tick.
    #[arg(
        long,
        hide_short_help = true,
        value_name = "LENGTHS",
        default_value = "settled"
    )]
    lengths: Lengths,
    /// Replace files that are there already.
    #[arg(long)]
    replace: bool,
    /// Print what was written, or what went wrong, as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// What a word after `--format` means.
#[derive(Debug, Clone)]
struct Formats(Vec<Format>);

fn formats(word: &str) -> Result<Formats, String> {
    if word == "all" {
        return Ok(Formats(Format::ALL.map(|(_, format)| format).to_vec()));
    }
    word.parse().map(|format| Formats(vec![format]))
}

fn called(word: &str) -> Result<(u32, String), String> {
    let named = word
        .split_once('=')
        .and_then(|(id, name)| Some((id.parse().ok()?, name)));
    match named {
        Some((id, name)) if !name.trim().is_empty() => Ok((id, name.trim().to_owned())),
        _ => Err(format!(
            "found `{word}`, expected ID=NAME, for example 3=Ada"
        )),
    }
}

/// A file that was written, for programs.
#[derive(Debug, Serialize)]
struct WrittenFile<'a> {
    path: &'a Path,
    format: &'static str,
    people: &'a [u32],
    bytes: u64,
}

/// Writes the files, all or none, and prints which.
///
/// # Errors
/// [`NodeError::Refused`] where the run, the options or files that are there already are in the way, [`NodeError::Failed`]
/// when a file cannot be written.
pub(crate) fn export_run(args: &ExportArgs) -> Result<(), NodeError> {
    let request = request(args).map_err(NodeError::Refused)?;
    let bar = ProgressBar::new(0).with_message("people and formats");
    let written = export(&request, |step| {
        bar.set_length(step.of as u64);
        bar.set_position(step.done as u64);
    });
    bar.finish_and_clear();
    let written = written.map_err(node_error)?;
    let text = if args.json {
        let files: Vec<WrittenFile<'_>> = written.iter().map(WrittenFile::of).collect();
        serde_json::to_string_pretty(&files).map_err(NodeError::failed)? + "\n"
    } else {
        lines(&written)
    };
    output::print(&text).map_err(NodeError::Failed)
}

impl<'a> WrittenFile<'a> {
    fn of(written: &'a Written) -> Self {
        Self {
            path: &written.path,
            format: written.format.name(),
            people: &written.people,
            bytes: written.bytes,
        }
    }
}

fn lines(written: &[Written]) -> String {
    let mut text = String::new();
    for file in written {
        let who = match file.people.as_slice() {
            [one] => format!("person {one}"),
            all => format!("{} people", all.len()),
        };
        let bytes = HumanBytes(file.bytes);
        // Writing to a string does not fail.
        writeln!(text, "{}: {who}, {bytes}", file.path.display()).ok();
    }
    text
}

fn request(args: &ExportArgs) -> anyhow::Result<ExportRequest> {
    let (poses, folder) = poses_of(&args.run)?;
    let summary = summary_of(&folder)?;
    let mut formats: Vec<Format> = Vec::new();
    for format in args.format.iter().flat_map(|of| &of.0) {
        if !formats.contains(format) {
            formats.push(*format);
        }
    }
    let mut called = BTreeMap::new();
    for (id, name) in &args.name {
        if called.insert(*id, name.clone()).is_some() {
            bail!("--name: person {id} has two names");
        }
    }
    Ok(ExportRequest {
        poses,
        summary,
        out: args.out.clone().unwrap_or_else(|| folder.join(FOLDER)),
        formats,
        options: Options {
            people: args.person.clone(),
            called,
            ticks: args.ticks.as_ref().map(|ticks| ticks.start.0..ticks.end.0),
            rate_hz: args.rate_hz,
            gaps: args.gaps,
            lengths: args.lengths,
            rest: args.rest,
            names: args.names,
            preset: args.preset,
            longest_gap_s: args.longest_gap_s,
        },
        existing: if args.replace {
            Existing::Replace
        } else {
            Existing::Refuse
        },
    })
}

/// The poses, and the folder in which they are.
fn poses_of(run: &Path) -> anyhow::Result<(PathBuf, PathBuf)> {
    if run.extension().is_some_and(|it| it == "mcap") {
        let run = run.display();
        bail!(
            "{run}: a recording is solved first: farfield replay {run} --out RUN, then farfield export RUN"
        );
    }
    if run.is_dir() {
        let poses = run.join(POSES);
        ensure!(
            poses.is_file(),
            "{}: there is no {POSES} in it: expected the folder of a run",
            run.display()
        );
        return Ok((poses, run.to_owned()));
    }
    ensure!(
        run.is_file(),
        "{}: there is nothing of this name: expected the folder of a run",
        run.display()
    );
    let folder = run.parent().filter(|it| !it.as_os_str().is_empty());
    Ok((run.to_owned(), folder.unwrap_or(Path::new(".")).to_owned()))
}

/// What the run says of itself: beside the poses, or above those that were smoothed.
fn summary_of(folder: &Path) -> anyhow::Result<PathBuf> {
    let above = folder.file_name().is_some_and(|name| name == SMOOTH);
    let above = above.then(|| folder.join("..").join(SUMMARY));
    let places = [Some(folder.join(SUMMARY)), above];
    let found = places.into_iter().flatten().find(|path| path.is_file());
    found.ok_or_else(|| {
        anyhow!(
            "{}: there is no {SUMMARY} beside the poses: it says at which rate they are",
            folder.display()
        )
    })
}

fn node_error(error: ExportError) -> NodeError {
    match error {
        ExportError::Exists { path } => NodeError::Refused(anyhow!(
            "{} is there already: --replace replaces it",
            path.display()
        )),
        ExportError::Io { ref source, .. } if source.kind() != ErrorKind::NotFound => {
            NodeError::failed(error)
        }
        error => NodeError::refused(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_of_an_id() {
        assert_eq!(called("3=Ada L"), Ok((3, "Ada L".to_owned())));
        for word in ["3", "=Ada", "x=Ada", "3=", "3= "] {
            assert!(called(word).unwrap_err().contains("ID=NAME"), "{word}");
        }
    }

    #[test]
    fn a_recording_is_sent_to_replay_and_an_empty_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error = poses_of(Path::new("hall.mcap")).unwrap_err().to_string();
        assert!(error.contains("farfield replay hall.mcap"), "{error}");
        let error = poses_of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("there is no poses.jsonl"), "{error}");
        let error = summary_of(folder.path()).unwrap_err().to_string();
        assert!(error.contains("there is no summary.json"), "{error}");
    }

    #[test]
    fn all_formats_are_meant_by_one_word() {
        assert_eq!(formats("all").unwrap().0.len(), Format::ALL.len());
        assert!(formats("fbx").unwrap_err().contains("bvh"));
    }
}
