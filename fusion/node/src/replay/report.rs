//! The report of a replay, as text and as JSON.

use std::fmt::Write as _;
use std::io::{Read, Seek};
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::camera_agreement::AgreementReport;
use farfield_fusion::export::pose_files::Presence;
use farfield_fusion::export::summary::{EventCounts, Summary, TickSpan, TimingSummary};
use farfield_fusion::recording::reader::Recording;
use farfield_fusion::recording::replay::{Choice, ReplayTally};
use farfield_node::process::Ending;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use serde::Serialize;

use crate::output::exporter::Exported;
use crate::output::summary;

/// Most statures in a line.
const MAX_SHOWN: usize = 12;

/// A finished replay.
pub(super) struct Done {
    pub(super) ending: Ending,
    pub(super) choice: Choice,
    pub(super) tally: ReplayTally,
    pub(super) exported: Exported,
    pub(super) events: EventCounts,
    pub(super) agreement: AgreementReport,
    pub(super) elapsed_s: f64,
}

/// Facts about the file.
pub(super) struct FileFacts {
    file_whole: bool,
    read_bytes: u64,
    file_bytes: u64,
    damaged_chunks: u64,
    unreadable: u64,
    lost: u64,
}

impl FileFacts {
    pub(super) fn from_recording<R: Read + Seek>(recording: &Recording<R>) -> Self {
        let end = recording.end();
        Self {
            file_whole: end.whole,
            read_bytes: end.read_bytes,
            file_bytes: end.file_bytes,
            damaged_chunks: end.damaged_chunks,
            unreadable: recording.unreadable(),
            lost: recording.lost(),
        }
    }

    fn with(&self, done: &Done) -> ReplayFacts {
        let tally = &done.tally;
        ReplayFacts {
            all_sets: done.choice == Choice::All,
            file_whole: self.file_whole,
            read_bytes: self.read_bytes,
            file_bytes: self.file_bytes,
            damaged_chunks: self.damaged_chunks,
            unreadable: self.unreadable,
            lost: self.lost,
            sets: tally.sets,
            missing_sets: tally.missing,
            undecided_ticks: tally.undecided,
            far_decisions: tally.far,
            same_ticks: tally.same,
            different_ticks: tally.different,
            nobodys_patches: tally.nobodys,
        }
    }
}

/// The JSON report of a replay.
#[derive(Debug, Serialize)]
struct ReplayReport<'a> {
    /// As in `summary.json`.
    #[serde(flatten)]
    summary: &'a Summary,
    replay: ReplayFacts,
}

/// Facts about the recording.
#[derive(Debug, Serialize)]
struct ReplayFacts {
    /// Whether sets were used that fusion did not use then.
    all_sets: bool,
    /// Whether the file's end was written.
    file_whole: bool,
    /// Bytes of the file that were read.
    read_bytes: u64,
    /// Size of the file, bytes.
    file_bytes: u64,
    /// Skipped chunks with a wrong checksum.
    damaged_chunks: u64,
    /// Messages that could not be read.
    unreadable: u64,
    /// Messages that the recorder lost, by its own count.
    lost: u64,
    /// Sets that were used.
    sets: u64,
    /// Sets that fusion used then but that are not in the file.
    missing_sets: u64,
    /// Ticks for which the sets that fusion used are unknown.
    undecided_ticks: u64,
    /// Skipped decisions of ticks far from those of the run.
    far_decisions: u64,
    /// Ticks whose poses match the published ones bit for bit.
    same_ticks: u64,
    /// Ticks with other poses.
    different_ticks: u64,
    /// Patches of persons that the replay does not have.
    nobodys_patches: u64,
}

impl Done {
    /// The replay as JSON: its summary, and the facts about the recording.
    pub(super) fn json(&self, summary: &Summary, file: &FileFacts) -> anyhow::Result<String> {
        let report = ReplayReport {
            summary,
            replay: file.with(self),
        };
        let json = serde_json::to_string_pretty(&report).context("writing the summary")?;
        Ok(json + "\n")
    }

    /// For `summary.json`; the recording's ticks go from `first` to `last`.
    pub(super) fn summary(&self, venue: &Venue, [first, last]: [Tick; 2]) -> Summary {
        Summary {
            venue: venue.name.clone(),
            venue_hash: venue.hashes.venue.clone(),
            calibration_hash: venue.hashes.calibration.clone(),
            rate_hz: venue.rate_hz,
            complete: self.ending == Ending::Done && self.exported.missing().is_none(),
            ticks: TickSpan {
                first,
                end: last + 1,
                done: self.tally.ticks,
            },
            people: self.exported.people_of_summary(),
            events: self.events.clone(),
            agreement: self.agreement.clone(),
            versions: summary::versions(),
            timing: TimingSummary {
                elapsed_s: self.elapsed_s,
                ticks_per_s: self.tally.ticks as f64 / self.elapsed_s.max(1e-9),
                poses: self.exported.poses.clone(),
                ..TimingSummary::default()
            },
            ..Summary::default()
        }
    }

    /// The report as text; `smooth`: the poses of two passes are written.
    pub(super) fn words(&self, out: &Path, smooth: bool) -> String {
        let tally = &self.tally;
        let sets = match self.choice {
            Choice::Decided => "the sets that fusion used then",
            Choice::All => "all sets",
        };
        let published = match (tally.same, tally.different) {
            (0, 0) => "the published poses are not in the recording".to_owned(),
            (same, 0) => {
                format!("the poses of all {same} ticks match the published ones bit for bit")
            }
            (same, different) => format!(
                "the poses of {same} ticks match the published ones, those of {different} ticks differ"
            ),
        };
        let written = if smooth {
            "; the files contain those of two passes"
        } else {
            ""
        };
        let mut text = format!(
            "{} ticks solved from {sets} ({}), {} people, {:.0} ticks/s\n{published}{written}\n",
            tally.ticks,
            tally.sets,
            self.exported.people.len(),
            tally.ticks as f64 / self.elapsed_s.max(1e-9)
        );
        let on_people = self.agreement.lines_on_people(self.exported.people.len());
        let statures = statures(&self.exported.people);
        let on_people = statures.into_iter().chain(on_people);
        for line in on_people.chain(self.agreement.lines()) {
            text.push_str(&line);
            text.push('\n');
        }
        for (count, what) in [
            (
                tally.undecided,
                "ticks were solved from all of their sets: those that fusion used then are not in the recording",
            ),
            (
                tally.far,
                "decisions were skipped: their ticks are far from those of the run",
            ),
            (
                tally.missing,
                "sets that fusion used then are not in the recording",
            ),
            (tally.refused, "sets contradict another of their tick"),
            (
                tally.nobodys,
                "patches are of people that this replay does not have",
            ),
        ] {
            if count > 0 {
                // Writing to a String cannot fail.
                let _infallible = writeln!(text, "{count} {what}");
            }
        }
        text + &format!("results in {}\n", out.display())
    }
}

/// The statures of the people in a line: a user who knows them can check the scale of the calibration.
fn statures(people: &[Presence]) -> Option<String> {
    let known = people.iter().filter_map(|person| person.stature_m);
    let known: Vec<String> = known.map(|stature_m| format!("{stature_m:.2}")).collect();
    let shown = known.get(..MAX_SHOWN).unwrap_or(&known).join(", ");
    let more = if known.len() > MAX_SHOWN {
        format!(" and {} more", known.len() - MAX_SHOWN)
    } else {
        String::new()
    };
    (!known.is_empty())
        .then(|| format!("statures by link lengths, without shoes and hair: {shown} m{more}"))
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::PersonId;

    use super::*;

    #[test]
    fn statures_of_a_crowd_are_one_short_line() {
        let person = |id: u32| Presence {
            person: PersonId(id),
            first_tick: Tick(0),
            last_tick: Tick(9),
            ticks: 10,
            stature_m: (id != 2).then(|| 1.7 + 0.01 * f64::from(id)),
        };
        let line = |n: u32| statures(&(0..n).map(person).collect::<Vec<_>>());
        assert_eq!(line(0), None);
        let few = line(4).unwrap();
        assert!(few.ends_with(": 1.70, 1.71, 1.73 m"), "{few}");
        let many = line(20).unwrap();
        assert!(many.ends_with(", 1.82 m and 7 more"), "{many}");
    }
}
