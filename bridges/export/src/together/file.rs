//! One reading of a run's poses into one file of everybody that goes on in time.

use std::io::{self, Write};
use std::path::Path;

use super::Together;
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

/// Writes MCAP that Foxglove shows to `out`, which is called `path`; `identities` say who of the poses the subjects are.
pub(crate) fn write_mcap(
    request: &ExportRequest,
    identities: &Identities,
    subjects: &[Subject<'_>],
    (out, path): (impl Write, &Path),
) -> Result<(), ExportError> {
    // The one who is there longest decides where the file ends.
    let Some(clock) = subjects.iter().map(|it| it.clock).max_by_key(|it| it.end) else {
        return Ok(());
    };
    let error = |source: io::Error| ExportError::io(path, "writing", source);
    let persons = subjects.iter().map(|it| it.id);
    let start = Stamp::from_seconds(clock.seconds(0));
    let writer = FoxgloveWriter::new(out, persons, &request.cameras, clock.rate_hz, start);
    let mut writer = writer.map_err(error)?;
    for_each_moment((request, identities), subjects, clock, |moment| {
        write_moment(&mut writer, subjects, request, moment).map_err(error)
    })?;
    writer.finish().map_err(error)
}

fn for_each_moment(
    (request, identities): (&ExportRequest, &Identities),
    subjects: &[Subject<'_>],
    clock: Clock,
    mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let (options, path) = (&request.options, &request.poses);
    let resampler =
        |clock| Resampler::new(clock, options.gaps, options.longest_gap_s, options.rest);
    let mut together = Together::new(subjects.iter().map(|it| it.id), clock, resampler);
    let is_there = |tick: i64, person: u32| {
        (clock.first..clock.end).contains(&tick) && subjects.iter().any(|it| it.id == person)
    };
    // They are of one run, whose keypoints all of them have.
    let keypoints = subjects.first().map_or(&[][..], |it| it.keypoints);
    let poses = (files::open(path)?, path.as_path());
    for_each_pose(poses, identities, is_there, |line| {
        let sample = Sample::of(&line, options.rest, keypoints);
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
    let there = moment.iter().filter_map(|(person, frame)| {
        let (sample, _) = frame.pose.as_ref()?;
        let subject = subjects.iter().find(|it| it.id == *person)?;
        Some((subject, sample))
    });
    let there: Vec<_> = there
        .map(|(subject, sample)| {
            let joints_m = sample.joints_m(request.options.rest);
            (subject, sample, joints_m, label(subject))
        })
        .collect();
    let bodies: Vec<Body<'_>> = there
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

/// What is written above a head: the name, or `person_3`, as live streams say.
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
    use std::path::Path;

    use crate::edits::Change;
    use crate::fixture::{RUN_HZ, poses_jsonl, summary_json};
    use crate::{EditsFile, Existing, ExportRequest, Format, Options, Written, export};

    const N_TICKS: i64 = 50;
    /// When people take each other's place.
    const SPLIT: i64 = 25;

    /// By person and tick, along the world's y: where the pelvis is, millimetres. Who has id `n` in the poses stands at `n` metres.
    type Places = BTreeMap<(u32, i64), i64>;

    fn millimetres(metres: f64) -> i64 {
        (1000.0 * metres).round() as i64
    }

    /// Everything of persons 1, 2 and 5, of whom 5 goes on as 1 from [`SPLIT`] on, and 1 as somebody new: 7.
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

    /// What the edits come to.
    fn expected() -> Places {
        let mut places = Places::new();
        for tick in 0..N_TICKS {
            let persons = if tick < SPLIT { [1, 2, 5] } else { [7, 2, 1] };
            for (id, person) in [1, 2, 5].into_iter().zip(persons) {
                // Person 2 is away between.
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
    fn every_format_has_the_people_whom_splits_and_merges_make() {
        let folder = tempfile::tempdir().unwrap();
        let written = exported(folder.path());
        for (_, format) in Format::ALL {
            let files = written.iter().filter(|it| it.format == format);
            let people: BTreeSet<u32> = files.flat_map(|it| it.people.clone()).collect();
            assert_eq!(people, [1, 2, 5, 7].into(), "{format:?}");
        }
        let of = |format: Format| written.iter().filter(move |it| it.format == format);
        let expected = expected();
        for file in of(Format::Mcap) {
            assert_eq!(of_mcap(&file.path), expected);
        }
        for file in of(Format::CsvTidy) {
            assert_eq!(of_tidy_csv(&file.path), expected);
        }
        let motions = of(Format::Mot).flat_map(|file| of_mot(file.people[0], &file.path));
        assert_eq!(motions.collect::<Places>(), expected);
    }
}
