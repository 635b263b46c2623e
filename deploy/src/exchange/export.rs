//! `farfield export RUN|RECORDING`: poses in the formats of other programs.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use clap::Args;
use farfield_export::axes::Preset;
use farfield_export::skeleton::{BoneNames, RestPose};
use farfield_export::timeline::Gaps;
use farfield_export::{
    Existing, ExportError, ExportRequest, Format, Lengths, OptionField, Options, Written, export,
};
use farfield_node::process::{NodeError, say};
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::{Tick, parse_range};
use indicatif::{HumanBytes, ProgressBar};
use serde::Serialize;
use tempfile::TempDir;

use super::cameras;
use super::place::{POSES, Place, SUMMARY};
use super::recorded::RecordedRun;
use super::target::check_folder;
use crate::output;

/// What `farfield export` is told.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// The folder of a run, its poses.jsonl, or a recording.
    ///
    /// `RUN/smooth/poses.jsonl` are the smoothed poses. Of a recording the poses are taken that were published; `farfield replay`
    /// solves it again.
    run: PathBuf,
    /// What to write, with commas: glb,c3d,csv, or all.
    ///
    /// bvh, glb, gltf, c3d, csv, csv-tidy, parquet, mcap (for Foxglove), osim, trc, mot. TRC and MOT of the whole run are written by the run itself.
    #[arg(long, value_delimiter = ',', required = true, value_name = "FORMAT", value_parser = formats)]
    format: Vec<Formats>,
    /// Folder for the files. Default: RUN/export.
    ///
    /// Of a recording `hall.mcap`: `hall-export` beside it.
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
    /// The profile of a person, as `farfield people` saves it.
    ///
    /// Whoever is called as it says has its lengths in skeletons, not those that this run came to know.
    #[arg(long, hide_short_help = true, value_name = "FILE")]
    subject: Vec<PathBuf>,
    /// Export people as they were found.
    ///
    /// Names and edits that `farfield people` or the page have left beside the run or recording are not looked at.
    #[arg(long, hide_short_help = true)]
    without_edits: bool,
    /// Venue file, whose cameras mcap shows.
    ///
    /// Default: venue/venue.toml in the folder of the run, as `farfield demo` leaves it; without one there are no cameras.
    #[arg(long, hide_short_help = true, value_name = "VENUE")]
    venue: Option<PathBuf>,
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
    let place = Place::of(&args.run).map_err(NodeError::Refused)?;
    let out = args.out.clone().unwrap_or_else(|| place.export_folder());
    check_folder("--out", &out).map_err(NodeError::Refused)?;
    let is_new = !out.exists();
    if args.venue.is_some() && matches!(place, Place::Recording(_)) {
        return Err(NodeError::refused(anyhow!(
            "--venue: {} has its venue in it",
            args.run.display()
        )));
    }
    let read = recorded(&place, &out).inspect_err(|_| {
        if is_new {
            drop(fs::remove_dir(&out));
        }
    })?;
    let request = request(args, &place, read.as_ref(), out.clone());
    let written = request
        .map_err(NodeError::Refused)
        .and_then(|request| write(args, &place, &request));
    drop(read);
    if is_new && written.is_err() {
        // Made for what was read of a recording; one with files in it stays.
        drop(fs::remove_dir(&out));
    }
    written
}

/// What was read of a recording.
struct ReadOut {
    /// Its poses as those of a run, in a folder that goes when they are exported.
    folder: TempDir,
    cameras: Vec<CameraModel>,
}

/// Reads a recording out into a folder inside of `out`.
fn recorded(place: &Place, out: &Path) -> Result<Option<ReadOut>, NodeError> {
    let Place::Recording(path) = place else {
        return Ok(None);
    };
    let recorded = RecordedRun::open(path).map_err(NodeError::Refused)?;
    say(format_args!(
        "{}: the poses as they were published, of each person from the confirmation on (a replay has what was before, too)",
        path.display()
    ));
    let folder = recorded.as_run(out).map_err(NodeError::Failed)?;
    let cameras = recorded.cameras();
    Ok(Some(ReadOut { folder, cameras }))
}

fn write(args: &ExportArgs, place: &Place, request: &ExportRequest) -> Result<(), NodeError> {
    let edits = place.edits();
    let n_edits = match request.edits {
        Some(_) => place.read_edits().map_err(node_error)?.in_force().len(),
        None => 0,
    };
    if n_edits > 0 {
        say(format_args!(
            "{}: {n_edits} names and edits in force (--without-edits leaves them out)",
            edits.path().display()
        ));
    }
    let bar = ProgressBar::new(0).with_message("people and formats");
    let written = export(request, |step| {
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

/// What is asked for; `read` was read of a recording, `out` takes the files.
fn request(
    args: &ExportArgs,
    place: &Place,
    read: Option<&ReadOut>,
    out: PathBuf,
) -> anyhow::Result<ExportRequest> {
    let mut formats: Vec<Format> = Vec::new();
    for format in args.format.iter().flat_map(|of| &of.0) {
        if !formats.contains(format) {
            formats.push(*format);
        }
    }
    let has_cameras = formats.contains(&Format::Mcap);
    let (poses, summary, cameras) = match (place, read) {
        (Place::Run { poses, summary, .. }, _) => {
            let given = args.venue.as_deref();
            let cameras = has_cameras.then(|| cameras::of_run(given, summary));
            let cameras = cameras.transpose()?.unwrap_or_default();
            (poses.clone(), summary.clone(), cameras)
        }
        (Place::GoingOn { run, .. }, _) => bail!(
            "{}: its run goes on: export it when it has ended, or what of it is recorded (`--record`) now",
            run.display()
        ),
        (Place::Recording(_), Some(read)) => {
            let folder = read.folder.path();
            let cameras = read.cameras.clone();
            (folder.join(POSES), folder.join(SUMMARY), cameras)
        }
        (Place::Recording(path), None) => bail!("{}: nothing was read of it", path.display()),
    };
    let mut called = BTreeMap::new();
    for (id, name) in &args.name {
        if called.insert(*id, name.clone()).is_some() {
            bail!("--name: person {id} has two names");
        }
    }
    Ok(ExportRequest {
        cameras,
        poses,
        summary,
        edits: (!args.without_edits).then(|| place.edits().path().to_owned()),
        subjects: args.subject.clone(),
        out,
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

pub(super) fn node_error(error: ExportError) -> NodeError {
    match error {
        ExportError::Exists { path } => NodeError::Refused(anyhow!(
            "{} is there already: --replace replaces it",
            path.display()
        )),
        ExportError::Option { field, ref problem } => {
            NodeError::Refused(anyhow!("{}: {problem}", option(field)))
        }
        // What a format has no room for is refused.
        ExportError::Io { ref source, .. }
            if ![ErrorKind::NotFound, ErrorKind::InvalidInput].contains(&source.kind()) =>
        {
            NodeError::failed(error)
        }
        error => NodeError::refused(error),
    }
}

/// By which option it is said.
fn option(field: OptionField) -> &'static str {
    match field {
        OptionField::People => "--person",
        OptionField::Called => "--name",
        OptionField::Ticks => "--ticks",
        OptionField::Rate => "--rate-hz",
        OptionField::Gaps => "--gaps",
        OptionField::LongestGap => "--longest-gap-s",
        OptionField::Subjects => "--subject",
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
    fn what_does_not_fit_is_refused_with_the_option_that_says_it() {
        let error = ExportError::Option {
            field: OptionField::Rate,
            problem: "found a rate of 0 Hz".to_owned(),
        };
        assert!(matches!(
            node_error(error),
            NodeError::Refused(told) if told.to_string() == "--rate-hz: found a rate of 0 Hz"
        ));
    }

    #[test]
    fn all_formats_are_meant_by_one_word() {
        assert_eq!(formats("all").unwrap().0.len(), Format::ALL.len());
        assert!(formats("fbx").unwrap_err().contains("bvh"));
    }
}
