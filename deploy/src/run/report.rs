//! Results of a run, as text or as the JSON of `summary.json`.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_export::EditsFile;
use farfield_fusion::export::summary::{CameraSummary, Summary, TickSpan};
use farfield_proto::message::live::CameraHealth;
use farfield_proto::tick::Tick;

use super::progress::has_end;
use crate::output;

/// An edge is reported if it missed more than one in this many ticks.
const MISSED_ONE_IN: u64 = 20;
/// All stages of a tick together, as named in the summary.
const FUSION_STEP: &str = "fusion/step";

/// Prints the summary of the run in `out`. Prints nothing if there is none.
pub(super) fn print(out: &Path, json: bool) -> anyhow::Result<()> {
    let Some((summary, text)) = read(out)? else {
        return Ok(());
    };
    if json {
        return output::print(&text);
    }
    let names = names(out);
    output::print(&for_people(&summary, &names, &out.display().to_string()))
}

/// The ticks that the run in `out` has finished; `None` without a summary. An interrupted fusion finishes its current
/// tick without reporting it.
pub(crate) fn done(out: &Path) -> anyhow::Result<Option<Range<Tick>>> {
    let ticks = read(out)?.map(|(summary, _)| summary.ticks);
    Ok(ticks.map(|ticks| ticks.first..ticks.first + ticks.done.cast_signed()))
}

/// Checks that the cameras of the run in `out` agreed with each other.
///
/// # Errors
/// When they did not.
pub(super) fn check_agreement(out: &Path) -> anyhow::Result<()> {
    let summary = read(out)?.map(|(summary, _)| summary);
    let found: Vec<String> = summary
        .iter()
        .flat_map(|summary| &summary.agreement.disagreements)
        .map(|disagreement| disagreement.found.clone())
        .collect();
    anyhow::ensure!(
        found.is_empty(),
        "the cameras do not agree with each other or with the venue: {}",
        found.join("; ")
    );
    Ok(())
}

fn read(out: &Path) -> anyhow::Result<Option<(Summary, String)>> {
    let path = out.join("summary.json");
    if !path.exists() {
        return Ok(None);
    }
    let reading = || format!("reading {}", path.display());
    let text = std::fs::read_to_string(&path).with_context(reading)?;
    let summary = serde_json::from_str(&text).with_context(reading)?;
    Ok(Some((summary, text)))
}

/// Whether a killed node has left incomplete files.
pub(super) fn has_unfinished(out: &Path) -> bool {
    unfinished(out).is_ok_and(|files| !files.is_empty())
}

/// Removes the incomplete files of a run without a tick.
pub(super) fn discard_unfinished(out: &Path) {
    for path in unfinished(out).unwrap_or_default() {
        // Remaining files are reported as unfinished.
        drop(std::fs::remove_file(path));
    }
}

fn unfinished(out: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in out.read_dir()? {
        let path = entry?.path();
        if path.extension().is_some_and(|extension| extension == "tmp") {
            files.push(path);
        }
    }
    Ok(files)
}

/// Names of the people of the run; empty if the list cannot be read: an export reports why.
fn names(out: &Path) -> BTreeMap<u32, String> {
    let list = EditsFile::of_run(out).read().unwrap_or_default();
    let identities = list.identities(None).unwrap_or_default();
    identities.names_of_poses(identities.edited_ids())
}

/// Ticks done, and of how many if they had an end.
fn ticks_done(summary: &Summary) -> String {
    let TickSpan { first, end, done } = summary.ticks;
    match end - first {
        requested if !has_end(requested) => format!("{done} ticks from {first}"),
        // A live run that is stopped was requested only the ticks that its cameras had.
        requested if summary.complete || done >= requested.unsigned_abs() => {
            format!("{done} of {requested} ticks from {first}")
        }
        requested => format!("{done} of {requested} ticks from {first}, cut short"),
    }
}

fn for_people(summary: &Summary, names: &BTreeMap<u32, String>, out: &str) -> String {
    let mut text = String::new();
    let mut line = |shown: std::fmt::Arguments<'_>| {
        // Writing to a String cannot fail.
        let _infallible = writeln!(text, "{shown}");
    };
    line(format_args!(
        "{}: {}, {:.1} ticks/s",
        summary.venue,
        ticks_done(summary),
        summary.timing.ticks_per_s
    ));
    for person in &summary.people {
        line(format_args!(
            "person {}{}: ticks {} to {}, {} poses{}",
            person.person,
            names
                .get(&person.person)
                .map_or_else(String::new, |name| format!(" ({name})")),
            person.first_tick,
            person.last_tick,
            person.ticks,
            person
                .stature_m
                .map_or_else(String::new, |stature_m| format!(", {stature_m:.2} m tall"))
        ));
    }
    for shown in lines_on_people_and_nodes(summary) {
        line(format_args!("{shown}"));
    }
    let patches: u64 = summary.links.values().map(|link| link.patches).sum();
    let bytes: u64 = summary.links.values().map(|link| link.patch_bytes).sum();
    if patches > 0 {
        line(format_args!(
            "{:.0} bytes per person, view and tick",
            bytes as f64 / patches as f64
        ));
    }
    if let Some(step) = summary.timing.stages.get(FUSION_STEP) {
        line(format_args!(
            "fusion {:.1} ms per tick at the median, {:.1} at the 99th percentile",
            step.p50_us / 1000.0,
            step.p99_us / 1000.0
        ));
    }
    let shares = &summary.timing.look_share;
    let longest = shares.iter().max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((viewpoint, share)) = longest.filter(|(_, share)| **share > 0.0) {
        line(format_args!(
            "detection passes took up to {:.1} % of an edge's work ({viewpoint})",
            100.0 * share
        ));
    }
    if let Some(recording) = &summary.timing.recording {
        line(format_args!("recorded in {}", recording.file.display()));
        if recording.lost > 0 {
            line(format_args!(
                "{} messages are not in it: the disk was too slow",
                recording.lost
            ));
        }
        if recording.holes > 0 {
            line(format_args!("{} ticks are missing in it", recording.holes));
        }
        if let Some(failure) = &recording.failure {
            line(format_args!("error: {failure}"));
        }
    }
    line(format_args!("results in {out}"));
    text
}

/// Lines on detected people, on nodes with faults, and on the agreement of the cameras.
fn lines_on_people_and_nodes(summary: &Summary) -> Vec<String> {
    let agreement = &summary.agreement;
    let mut lines = match summary.people.len() {
        0 if no_camera_works(summary) => {
            vec!["no person was detected: no camera sent images".to_owned()]
        }
        found => agreement.lines_on_people(found),
    };
    lines.extend(lines_on_cameras(summary));
    lines.extend(lines_on_edges(summary));
    lines.extend(agreement.lines());
    lines
}

/// Whether it could not be opened at the end, or broke off. A silent camera may be a finished recording.
fn has_failed(camera: &CameraSummary) -> bool {
    camera.health == CameraHealth::Failed
}

/// Whether a live run ended without a single working camera.
fn no_camera_works(summary: &Summary) -> bool {
    let cameras = &summary.timing.cameras;
    !cameras.is_empty() && cameras.values().all(has_failed)
}

/// Cameras of a live run that sent no images at the end, and why.
fn lines_on_cameras(summary: &Summary) -> impl Iterator<Item = String> {
    let cameras = summary.timing.cameras.iter();
    let failed = cameras.filter(|(_, camera)| has_failed(camera));
    failed.map(|(name, camera)| {
        let reason = camera.reason.as_ref().map(|reason| format!(": {reason}"));
        let reason = reason.unwrap_or_default();
        format!("camera {name} sent no images at the end{reason}")
    })
}

/// Edges of a live run that were too slow for their ticks.
fn lines_on_edges(summary: &Summary) -> impl Iterator<Item = String> {
    let done = summary.ticks.done;
    let missed = summary.timing.missed_ticks.iter();
    missed.filter(move |(_, missed)| **missed * MISSED_ONE_IN > done).map(move |(edge, missed)| {
        format!(
            "edge {edge} missed {missed} of {done} ticks: its computer is too slow, or its network failed; run `farfield bench edge VENUE` on it to measure how many people it can track"
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_fusion::export::summary::{
        LinkSummary, PersonSummary, StageTiming, TimingSummary,
    };

    #[test]
    fn done_ticks_come_from_the_summary() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(done(folder.path()).unwrap(), None);
        let summary = Summary {
            ticks: TickSpan {
                first: Tick(5),
                end: Tick(20),
                done: 3,
            },
            ..Summary::default()
        };
        std::fs::write(folder.path().join("summary.json"), summary.to_json()).unwrap();
        assert_eq!(done(folder.path()).unwrap(), Some(Tick(5)..Tick(8)));
    }

    #[test]
    fn a_stopped_run_without_an_end_was_not_cut_short() {
        let shown = |end| {
            let ticks = TickSpan {
                first: Tick(0),
                end: Tick(end),
                done: 696,
            };
            ticks_done(&Summary {
                ticks,
                ..Summary::default()
            })
        };
        assert_eq!(shown(1 << 40), "696 ticks from 0");
        assert_eq!(shown(696), "696 of 696 ticks from 0");
        assert_eq!(shown(900), "696 of 900 ticks from 0, cut short");
    }

    #[test]
    fn text_shows_ticks_people_bytes_and_times() {
        let link = LinkSummary {
            patches: 10,
            patch_bytes: 4200,
            ..LinkSummary::default()
        };
        let step = StageTiming {
            p50_us: 3120.0,
            p99_us: 8960.0,
            p999_us: 8990.0,
            max_us: 9000.0,
        };
        let person = PersonSummary {
            person: 1,
            first_tick: Tick(3),
            last_tick: Tick(9),
            ticks: 7,
            stature_m: Some(1.784),
        };
        let summary = Summary {
            venue: "hall".to_owned(),
            ticks: TickSpan {
                first: Tick(0),
                end: Tick(20),
                done: 10,
            },
            people: vec![person],
            links: [("ne".to_owned(), link)].into(),
            timing: TimingSummary {
                stages: [(FUSION_STEP.to_owned(), step)].into(),
                look_share: [("ne".to_owned(), 0.024), ("sw".to_owned(), 0.012)].into(),
                ..TimingSummary::default()
            },
            ..Summary::default()
        };
        let text = for_people(&summary, &BTreeMap::new(), "out");
        assert!(text.contains("10 of 20 ticks from 0, cut short"), "{text}");
        assert!(text.contains("1: ticks 3 to 9, 7 poses, 1.78 m"), "{text}");
        for number in ["\n420 bytes", "fusion 3.1 ms", " 9.0 at", "2.4 %"] {
            assert!(text.contains(number), "{number}: {text}");
        }
    }

    #[test]
    fn without_a_working_camera_the_detector_is_not_suspected() {
        let camera = |health, reason: Option<&str>| CameraSummary {
            health,
            frames_per_s: 0.0,
            troubles: 1,
            reason: reason.map(str::to_owned),
        };
        let mut summary = Summary::default();
        let refused = camera(CameraHealth::Failed, Some("connection refused"));
        let cameras = &mut summary.timing.cameras;
        cameras.insert("ne".to_owned(), refused);
        assert!(no_camera_works(&summary));
        let text = for_people(&summary, &BTreeMap::new(), "out");
        assert!(!text.contains("detector"), "{text}");
        assert!(text.contains("camera ne ") && text.contains(": connection refused\n"));
        // A finished recording.
        let silent = camera(CameraHealth::Silent, None);
        summary.timing.cameras.insert("sw".to_owned(), silent);
        assert!(!no_camera_works(&summary));
        let text = for_people(&summary, &BTreeMap::new(), "out");
        assert!(text.contains("detector"), "{text}");
        assert!(text.contains("camera ne ") && !text.contains("camera sw"));
    }

    #[test]
    fn an_edge_that_missed_more_than_a_twentieth_of_its_ticks_is_reported() {
        let mut summary = Summary::default();
        summary.ticks.done = 100;
        let missed = [("ne", 5), ("sw", 6)].map(|(edge, missed)| (edge.to_owned(), missed));
        summary.timing.missed_ticks = missed.into();
        let named: Vec<String> = lines_on_edges(&summary).collect();
        assert_eq!(named.len(), 1);
        assert!(
            named[0].starts_with("edge sw missed 6 of 100 ticks"),
            "{named:?}"
        );
    }
}
