//! All people at one moment after another, from one pass over the poses: for formats in order of
//! time.
//!
//! A person's frames are known late if a gap may still be filled or the filter looks ahead. So each
//! person has a queue, limited by the longest gap and the filter's width. A moment is emitted when
//! the frames of all people are known.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Write};
use std::path::Path;

use crate::edits::Identities;
use crate::error::ExportError;
use crate::files;
use crate::formats::foxglove::{Body, FoxgloveWriter, Stamp};
use crate::options::ExportRequest;
use crate::run::Sample;
use crate::run::line::for_each_pose;
use crate::skeleton::Bone;
use crate::subject::Subject;
use crate::timeline::{Clock, Frame, Resampler};

/// Aligns the frames of several people.
#[derive(Debug)]
pub(crate) struct Together {
    people: BTreeMap<u32, Track>,
    n_frames: u64,
    next: u64,
    /// The latest tick whose poses have started to arrive.
    now: Option<i64>,
}

#[derive(Debug)]
struct Track {
    resampler: Resampler,
    waiting: VecDeque<Frame>,
}

impl Together {
    /// For these people, whose frames follow `clock`.
    pub(crate) fn new(
        persons: impl IntoIterator<Item = u32>,
        clock: Clock,
        resampler: impl Fn(Clock) -> Resampler,
    ) -> Self {
        let track = |person| {
            let track = Track {
                resampler: resampler(clock),
                waiting: VecDeque::new(),
            };
            (person, track)
        };
        Self {
            people: persons.into_iter().map(track).collect(),
            n_frames: clock.n_frames(),
            next: 0,
            now: None,
        }
    }

    /// Adds a pose; ticks must increase, people of a tick may come in any order. Emits the moments
    /// that are final.
    ///
    /// # Errors
    /// Errors of `each`.
    pub(crate) fn push(
        &mut self,
        tick: i64,
        person: u32,
        sample: Sample,
        mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        if self.now.replace(tick) != Some(tick) {
            for track in self.people.values_mut() {
                let waiting = &mut track.waiting;
                track.resampler.pass(tick, |frame| {
                    waiting.push_back(frame);
                    Ok::<(), ExportError>(())
                })?;
            }
        }
        if let Some(track) = self.people.get_mut(&person) {
            let waiting = &mut track.waiting;
            track.resampler.push(tick, sample, |frame| {
                waiting.push_back(frame);
                Ok::<(), ExportError>(())
            })?;
        }
        self.emit(&mut each)
    }

    /// Emits the remaining moments.
    ///
    /// # Errors
    /// Errors of `each`.
    pub(crate) fn finish(
        mut self,
        mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        // One frame of all people at a time, since an hour without people may remain.
        while self.next < self.n_frames {
            for track in self.people.values_mut() {
                if track.waiting.is_empty() {
                    track.waiting.push_back(track.resampler.take());
                }
            }
            self.emit(&mut each)?;
        }
        Ok(())
    }

    fn emit(
        &mut self,
        each: &mut impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        while self.next < self.n_frames && self.people.values().all(|it| !it.waiting.is_empty()) {
            let people = self.people.iter_mut();
            let moment: Vec<(u32, Frame)> = people
                .filter_map(|(person, track)| Some((*person, track.waiting.pop_front()?)))
                .collect();
            self.next += 1;
            each(&moment)?;
        }
        Ok(())
    }
}

/// Writes MCAP for Foxglove to `out` (at `path`); `identities` map the poses to the subjects.
pub(crate) fn write_mcap(
    request: &ExportRequest,
    identities: &Identities,
    subjects: &[Subject<'_>],
    out: impl Write,
    path: &Path,
) -> Result<(), ExportError> {
    // The person who is present longest determines the end of the file.
    let Some(clock) = subjects.iter().map(|it| it.clock).max_by_key(|it| it.end) else {
        return Ok(());
    };
    let error = |source: io::Error| ExportError::io(path, "writing", source);
    let persons = subjects.iter().map(|it| it.id);
    let start = Stamp::from_seconds(clock.seconds(0));
    let writer = FoxgloveWriter::new(out, persons, &request.cameras, clock.rate_hz, start);
    let mut writer = writer.map_err(error)?;
    for_each_moment(request, identities, subjects, clock, |moment| {
        write_moment(&mut writer, subjects, request, moment).map_err(error)
    })?;
    writer.finish().map_err(error)
}

fn for_each_moment(
    request: &ExportRequest,
    identities: &Identities,
    subjects: &[Subject<'_>],
    clock: Clock,
    mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let (options, path) = (&request.options, &request.poses);
    let resampler =
        |clock| Resampler::new(clock, options.gaps, options.longest_gap_s, options.rest);
    let mut together = Together::new(subjects.iter().map(|it| it.id), clock, resampler);
    let is_present = |tick: i64, person: u32| {
        (clock.first..clock.end).contains(&tick) && subjects.iter().any(|it| it.id == person)
    };
    // All subjects belong to one run and have the same keypoints.
    let keypoints = subjects.first().map_or(&[][..], |it| it.keypoints);
    let poses = (files::open(path)?, path.as_path());
    for_each_pose(poses, identities, is_present, |line| {
        let sample = Sample::from_line(&line, options.rest, keypoints);
        together.push(line.tick, line.person, sample, &mut each)
    })?;
    together.finish(each)
}

fn write_moment<W: Write>(
    writer: &mut FoxgloveWriter<W>,
    subjects: &[Subject<'_>],
    request: &ExportRequest,
    moment: &[(u32, Frame)],
) -> io::Result<()> {
    let Some((_, any)) = moment.first() else {
        return Ok(());
    };
    let present = moment.iter().filter_map(|(person, frame)| {
        let (sample, _) = frame.pose.as_ref()?;
        let subject = subjects.iter().find(|it| it.id == *person)?;
        Some((subject, sample))
    });
    let present: Vec<_> = present
        .map(|(subject, sample)| {
            let joints_m = sample.joints_m(request.options.rest);
            (subject, sample, joints_m, label(subject))
        })
        .collect();
    let bodies: Vec<Body<'_>> = present
        .iter()
        .map(|(subject, sample, joints_m, name)| Body {
            id: subject.id,
            name,
            state: sample.state,
            views: sample.views,
            joints_m,
            pelvis: &sample.motion.rotations[Bone::Hips.index()],
            angles: &sample.angles,
            unobserved: sample.unobserved,
        })
        .collect();
    let tick = any.position.round() as i64;
    writer.moment(Stamp::from_seconds(any.time_s), tick, &bodies)
}

/// Text above a head: the name, or `person_3` as in live streams.
fn label(subject: &Subject<'_>) -> String {
    if subject.name == subject.id.to_string() {
        format!("person_{}", subject.id)
    } else {
        subject.name.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};
    use std::fs;

    use super::*;
    use crate::edits::Change;
    use crate::fixture::{RUN_HZ, poses_jsonl, sample_at, summary_json};
    use crate::skeleton::RestPose;
    use crate::timeline::Gaps;
    use crate::{EditsFile, Existing, Format, Options, Written, export};

    /// People present at every moment, and the largest delay of a moment; person 2 is absent in
    /// ticks 20 to 39.
    fn moments(gaps: Gaps, rate_hz: f64, longest_gap_s: f64) -> (Vec<Vec<u32>>, i64) {
        let clock = Clock {
            run_hz: RUN_HZ,
            rate_hz,
            zero: 0,
            first: 0,
            end: 60,
        };
        let resampler = |clock| Resampler::new(clock, gaps, longest_gap_s, RestPose::TPose);
        let mut together = Together::new([1, 2], clock, resampler);
        let (mut found, mut latest) = (Vec::new(), 0);
        for tick in 0..60 {
            for person in [1, 2] {
                if person == 1 || !(20..40).contains(&tick) {
                    let sample = sample_at(tick as f64 / RUN_HZ);
                    let mut each = |moment: &[(u32, Frame)]| {
                        let present = moment.iter().filter(|(_, frame)| frame.pose.is_some());
                        found.push(present.map(|(person, _)| *person).collect());
                        latest = latest.max(tick - moment[0].1.position.floor() as i64);
                        Ok(())
                    };
                    together.push(tick, person, sample, &mut each).unwrap();
                }
            }
        }
        let last = together.finish(|moment| {
            let present = moment.iter().filter(|(_, frame)| frame.pose.is_some());
            found.push(present.map(|(person, _)| *person).collect());
            Ok(())
        });
        last.unwrap();
        (found, latest)
    }

    #[test]
    fn absent_people_do_not_delay_others() {
        let (found, latest) = moments(Gaps::Keep, RUN_HZ, 1.0);
        let expected: Vec<Vec<u32>> = (0..60)
            .map(|tick| {
                if (20..40).contains(&tick) {
                    vec![1]
                } else {
                    vec![1, 2]
                }
            })
            .collect();
        assert_eq!(found, expected);
        assert!(latest <= 2, "{latest} ticks");
    }

    #[test]
    fn moments_wait_only_for_gaps_that_may_be_filled() {
        let (found, _) = moments(Gaps::Fill, RUN_HZ, 1.0);
        assert_eq!(found, vec![vec![1, 2]; 60]);
        let (found, latest) = moments(Gaps::Fill, RUN_HZ, 0.1);
        assert_eq!(
            found.iter().filter(|present| present.len() == 1).count(),
            20
        );
        assert!(latest <= 8, "{latest} ticks");
    }

    #[test]
    fn a_look_ahead_filter_gives_the_same_frames() {
        let (found, latest) = moments(Gaps::Keep, 20.0, 1.0);
        let expected: Vec<Vec<u32>> = (0..20)
            .map(|frame| {
                if (20..40).contains(&(3 * frame)) {
                    vec![1]
                } else {
                    vec![1, 2]
                }
            })
            .collect();
        assert_eq!(found, expected);
        assert!(latest <= 11, "{latest} ticks");
    }

    const N_TICKS: i64 = 50;
    /// The tick at which people exchange ids.
    const SPLIT: i64 = 25;

    /// Pelvis along the world's y, millimetres, by person and tick. Id `n` of the poses stands at
    /// `n` metres.
    type Places = BTreeMap<(u32, i64), i64>;

    fn millimetres(metres: f64) -> i64 {
        (1000.0 * metres).round() as i64
    }

    /// All formats of persons 1, 2 and 5. From [`SPLIT`] on, 5 continues as 1, and 1 as the new
    /// person 7.
    fn exported(folder: &Path) -> Vec<Written> {
        let (poses, summary) = (folder.join("poses.jsonl"), folder.join("summary.json"));
        fs::write(&poses, poses_jsonl(&[1, 2, 5], N_TICKS)).unwrap();
        fs::write(&summary, summary_json(N_TICKS)).unwrap();
        let edits = EditsFile::of_run(folder);
        let split = |person, new| Change::Split {
            person,
            tick: SPLIT,
            new,
        };
        let merge = Change::Merge { person: 8, into: 1 };
        for change in [split(1, 7), split(5, 8), merge] {
            edits.add("now", None, |_| Ok(change)).unwrap();
        }
        let request = ExportRequest {
            poses,
            summary,
            edits: Some(edits.path().to_owned()),
            subjects: Vec::new(),
            cameras: Vec::new(),
            out: folder.join("out"),
            formats: Format::ALL.map(|(_, format)| format).to_vec(),
            options: Options::default(),
            existing: Existing::Refuse,
        };
        export(&request, |_| ()).unwrap()
    }

    /// The expected effect of the edits.
    fn expected() -> Places {
        let mut places = Places::new();
        for tick in 0..N_TICKS {
            let persons = if tick < SPLIT { [1, 2, 5] } else { [7, 2, 1] };
            for (id, person) in [1, 2, 5].into_iter().zip(persons) {
                // Person 2 is absent in between.
                if id != 2 || !(20..30).contains(&tick) {
                    places.insert((person, tick), 1000 * i64::from(id));
                }
            }
        }
        places
    }

    fn of_mcap(path: &Path) -> Places {
        let bytes = fs::read(path).unwrap();
        let messages = mcap::MessageStream::new(&bytes).unwrap();
        let angles = messages.filter_map(|message| {
            let message = message.unwrap();
            let person = message.channel.topic.strip_prefix("/person_")?;
            let person = person.strip_suffix("/angles")?.parse::<u32>().unwrap();
            let value: serde_json::Value = serde_json::from_slice(&message.data).unwrap();
            let y_m = value["pelvis_m"]["y"].as_f64().unwrap();
            Some(((person, value["tick"].as_i64().unwrap()), millimetres(y_m)))
        });
        angles.collect()
    }

    fn of_tidy_csv(path: &Path) -> Places {
        let mut reader = csv::Reader::from_path(path).unwrap();
        let head = reader.headers().unwrap().clone();
        let column = |name: &str| head.iter().position(|known| known == name).unwrap();
        let [item, tick, person, y_m] = ["item", "tick", "person", "y_m"].map(column);
        let rows = reader.into_records().map(Result::unwrap);
        let pelvises = rows.filter(|row| &row[item] == "pelvis");
        let place = |row: csv::StringRecord| {
            let number = |column: usize| row[column].parse::<f64>().unwrap();
            let person = row[person].parse::<u32>().unwrap();
            ((person, number(tick) as i64), millimetres(number(y_m)))
        };
        pelvises.map(place).collect()
    }

    fn of_mot(person: u32, path: &Path) -> Places {
        let text = fs::read_to_string(path).unwrap();
        let (_, table) = text.split_once("endheader\n").unwrap();
        let mut rows = table
            .lines()
            .map(|row| row.split('\t').collect::<Vec<&str>>());
        let head = rows.next().unwrap();
        // The ground's x is the world's y.
        let column = head.iter().position(|name| *name == "pelvis_tx").unwrap();
        let place = |row: Vec<&str>| {
            let number = |column: usize| row[column].parse::<f64>().unwrap();
            let tick = (RUN_HZ * number(0)).round() as i64;
            ((person, tick), millimetres(number(column)))
        };
        rows.map(place).collect()
    }

    #[test]
    fn every_format_contains_the_edited_people() {
        let folder = tempfile::tempdir().unwrap();
        let written = exported(folder.path());
        for (_, format) in Format::ALL {
            let files = written.iter().filter(|it| it.format == format);
            let people: BTreeSet<u32> = files.flat_map(|it| it.people.clone()).collect();
            assert_eq!(people, [1, 2, 5, 7].into(), "{format:?}");
        }
        let files_of = |format: Format| written.iter().filter(move |it| it.format == format);
        let expected = expected();
        for file in files_of(Format::Mcap) {
            assert_eq!(of_mcap(&file.path), expected);
        }
        for file in files_of(Format::CsvTidy) {
            assert_eq!(of_tidy_csv(&file.path), expected);
        }
        let motions = files_of(Format::Mot).flat_map(|file| of_mot(file.people[0], &file.path));
        assert_eq!(motions.collect::<Places>(), expected);
    }
}
