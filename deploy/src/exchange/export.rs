//! `farfield export RUN|RECORDING`: writes poses in the formats of other programs.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::io::ErrorKind;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use clap::Args;
use farfield_export::axes::Preset;
use farfield_export::skeleton::{BoneNames, RestPose};
use farfield_export::timeline::Gaps;
use farfield_export::{
    Existing, ExportError, ExportRequest, Format, Lengths, OptionField, Options, Written, export,
};
use farfield_node::files::load_venue;
use farfield_node::process::{NodeError, say};
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::{Tick, parse_range};
use indicatif::{HumanBytes, ProgressBar};
use serde::{Deserialize, Serialize};
use tempfile::TempDir;

use super::place::{POSES, Place, SUMMARY};
use super::recorded::RecordedRun;
use super::target::check_folder;
use crate::output;

/// Arguments of `farfield export`.
#[derive(Debug, Args)]
pub(crate) struct ExportArgs {
    /// The folder of a run, its poses.jsonl, or a recording.
    ///
    /// `RUN/smooth/poses.jsonl` has the smoothed poses. A recording exports its published poses; `farfield replay`
    /// computes new ones.
    run: PathBuf,
    /// Formats, separated by commas: glb,c3d,csv; or all.
    ///
    /// bvh, glb, gltf, c3d, csv, csv-tidy, parquet, mcap (for Foxglove), osim, trc, mot. A run writes TRC and MOT of
    /// all its ticks itself.
    #[arg(long, value_delimiter = ',', required = true, value_name = "FORMAT", value_parser = formats)]
    format: Vec<Formats>,
    /// Folder for the files. Default: RUN/export.
    ///
    /// For a recording `hall.mcap`: `hall-export` next to it.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Only these people, by id.
    #[arg(long, value_delimiter = ',', value_name = "ID")]
    person: Vec<u32>,
    /// Name of a person in the files.
    #[arg(long, value_name = "ID=NAME", value_parser = called)]
    name: Vec<(u32, String)>,
    /// Only these ticks; B is excluded.
    #[arg(long, value_parser = parse_range, value_name = "A..B", allow_hyphen_values = true)]
    ticks: Option<Range<Tick>>,
    /// Frames per second. Default: the venue's.
    #[arg(long, hide_short_help = true, value_name = "HZ")]
    rate_hz: Option<f64>,
    /// Gaps: keep, fill, or mark filled ones.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "keep",
        hide_default_value = true
    )]
    gaps: Gaps,
    /// Longest gap to fill, seconds.
    #[arg(long, hide_short_help = true, value_name = "S", default_value_t = 1.0)]
    longest_gap_s: f64,
    /// Units and axes of blender, unreal, opensim, ...
    ///
    /// blender, unreal, unity, opensim, visual3d. Default: those of the format.
    #[arg(long, value_name = "PROGRAM")]
    preset: Option<Preset>,
    /// Bone names as in unreal, mixamo, unity, vrm.
    #[arg(
        long,
        value_name = "PROGRAM",
        default_value = "farfield",
        hide_default_value = true
    )]
    names: BoneNames,
    /// Rest pose of the skeleton: t-pose or a-pose.
    #[arg(
        long,
        hide_short_help = true,
        value_name = "POSE",
        default_value = "t-pose"
    )]
    rest: RestPose,
    /// Bone lengths: settled or measured.
    ///
    /// settled: constant, as measured by the end of the run, which retargeting needs; measured: the value at each tick.
    #[arg(
        long,
        hide_short_help = true,
        value_name = "LENGTHS",
        default_value = "settled"
    )]
    lengths: Lengths,
    /// The profile of a person, saved by `farfield people`.
    ///
    /// A person of that name gets the profile's lengths in skeletons instead of those measured in this run.
    #[arg(long, hide_short_help = true, value_name = "FILE")]
    subject: Vec<PathBuf>,
    /// Ignore names and edits of people.
    ///
    /// These come from `farfield people` or the page, in a file next to the run or recording.
    #[arg(long, hide_short_help = true)]
    without_edits: bool,
    /// Venue file with the cameras for mcap.
    ///
    /// Default: venue/venue.toml in the folder of the run, as `farfield demo` writes it; without one mcap has no
    /// cameras.
    #[arg(long, hide_short_help = true, value_name = "VENUE")]
    venue: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    replace: bool,
    /// Print the written files or the error as JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// The formats of a word after `--format`.
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

/// A written file, as JSON.
#[derive(Debug, Serialize)]
struct WrittenFile<'a> {
    path: &'a Path,
    format: &'static str,
    people: &'a [u32],
    bytes: u64,
}

/// Writes all files or none, and prints them.
///
/// # Errors
/// [`NodeError::Refused`] for errors of the run or the options, or if files already exist; [`NodeError::Failed`] when a
/// file cannot be written.
pub(crate) fn export_run(args: &ExportArgs) -> Result<(), NodeError> {
    let place = Place::find(&args.run).map_err(NodeError::Refused)?;
    let out = args.out.clone().unwrap_or_else(|| place.export_folder());
    check_folder("--out", &out).map_err(NodeError::Refused)?;
    let is_new = !out.exists();
    if args.venue.is_some() && matches!(place, Place::Recording(_)) {
        return Err(NodeError::refused(anyhow!(
            "--venue: {} contains its venue",
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
        // It was created for the temporary files of a recording; with other files in it, it stays.
        drop(fs::remove_dir(&out));
    }
    written
}

/// The content of a recording.
struct ReadOut {
    /// Its poses in the form of a run, in a temporary folder.
    folder: TempDir,
    cameras: Vec<CameraModel>,
}

/// Extracts a recording into a temporary folder inside `out`.
fn recorded(place: &Place, out: &Path) -> Result<Option<ReadOut>, NodeError> {
    let Place::Recording(path) = place else {
        return Ok(None);
    };
    let recorded = RecordedRun::open(path).map_err(NodeError::Refused)?;
    say(format_args!(
        "{}: the published poses, of each person from the confirmation on (a replay also has earlier ones)",
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
            "{}: {n_edits} names and edits in force (--without-edits ignores them)",
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

/// The request; `read` is the content of a recording, `out` the folder for the files.
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
            let cameras = has_cameras.then(|| cameras_of_run(given, summary));
            let cameras = cameras.transpose()?.unwrap_or_default();
            (poses.clone(), summary.clone(), cameras)
        }
        (Place::InProgress { run, .. }, _) => bail!(
            "{}: the run is still in progress: export it after its end, or export its recording (`--record`) now",
            run.display()
        ),
        (Place::Recording(_), Some(read)) => {
            let folder = read.folder.path();
            let cameras = read.cameras.clone();
            (folder.join(POSES), folder.join(SUMMARY), cameras)
        }
        (Place::Recording(path), None) => bail!("{}: it was not read", path.display()),
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
            "{} already exists: --replace replaces it",
            path.display()
        )),
        ExportError::Option { field, ref problem } => {
            NodeError::Refused(anyhow!("{}: {problem}", option(field)))
        }
        // Data that a format cannot hold is refused.
        ExportError::Io { ref source, .. }
            if ![ErrorKind::NotFound, ErrorKind::InvalidInput].contains(&source.kind()) =>
        {
            NodeError::failed(error)
        }
        error => NodeError::refused(error),
    }
}

/// The command line option of a field.
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

/// The venue in the folder of a demo or a simulation.
const VENUE: &str = "venue/venue.toml";

/// The hashes in a summary.
#[derive(Debug, Deserialize)]
struct Hashes {
    calibration_hash: Option<String>,
}

/// The cameras of the run with this `summary`, from the `given` venue or from the one in its folder.
///
/// # Errors
/// When the venue or the summary cannot be read, or the given venue has another calibration.
fn cameras_of_run(given: Option<&Path>, summary: &Path) -> anyhow::Result<Vec<CameraModel>> {
    // Smoothed poses are in a subfolder of their run.
    let own = summary.parent().unwrap_or(Path::new(".")).join(VENUE);
    let Some(path) = given.or(own.is_file().then_some(&*own)) else {
        return Ok(Vec::new());
    };
    let venue = load_venue(path)?;
    let reading = || format!("reading {}", summary.display());
    let text = fs::read_to_string(summary).with_context(reading)?;
    let hashes: Hashes = serde_json::from_str(&text).with_context(reading)?;
    let is_same = hashes
        .calibration_hash
        .is_none_or(|hash| hash == venue.hashes.calibration);
    ensure!(
        is_same || given.is_none(),
        "--venue: {}: found another calibration than in the run, expected the unchanged venue",
        path.display()
    );
    let cameras = venue.cameras.into_iter().filter(|_| is_same);
    Ok(cameras.map(|camera| camera.model).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_needs_an_id() {
        assert_eq!(called("3=Ada L"), Ok((3, "Ada L".to_owned())));
        for word in ["3", "=Ada", "x=Ada", "3=", "3= "] {
            assert!(called(word).unwrap_err().contains("ID=NAME"), "{word}");
        }
    }

    #[test]
    fn errors_of_options_name_the_option() {
        let error = ExportError::Option {
            field: OptionField::Rate,
            problem: "found a rate of 0 Hz".to_owned(),
        };
        assert!(matches!(
            node_error(error),
            NodeError::Refused(error) if error.to_string() == "--rate-hz: found a rate of 0 Hz"
        ));
    }

    #[test]
    fn all_stands_for_all_formats() {
        assert_eq!(formats("all").unwrap().0.len(), Format::ALL.len());
        assert!(formats("fbx").unwrap_err().contains("bvh"));
    }
}
