//! One export: the run is surveyed, then read once more per person and file; files get their names when all are whole.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;

use crate::error::ExportError;
use crate::files::{self, Unfinished};
use crate::formats::bvh::BvhWriter;
use crate::formats::c3d::C3dWriter;
use crate::formats::gltf::{Container, GltfPerson, GltfWriter};
use crate::formats::osim::write_model;
use crate::formats::parquet::ParquetWriter;
use crate::formats::table::{TidyWriter, WideWriter, point_names};
use crate::formats::trc_mot::{MotWriter, TrcWriter};
use crate::options::{ExportRequest, Format, Options};
use crate::run::line::for_each_line;
use crate::run::{PoseLine, RunFacts, Sample, Survey};
use crate::subject::Subject;
use crate::timeline::{Clock, Frame, Resampler};

/// Frame rates beyond these are refused, Hz.
const RATES_HZ: std::ops::RangeInclusive<f64> = 0.5..=2000.0;
/// Longest gaps beyond these are refused, seconds: what is longer is no gap, it is another visit.
const LONGEST_GAPS_S: std::ops::RangeInclusive<f64> = 0.0..=3600.0;

/// A file that was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Where it is.
    pub path: PathBuf,
    /// What it is.
    pub format: Format,
    /// Who is in it.
    pub people: Vec<u32>,
    /// Its bytes.
    pub bytes: u64,
}

/// How far an export has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Readings of the poses that are done.
    pub done: usize,
    /// Of so many: the survey, and one per person and format.
    pub of: usize,
}

/// Writes what is asked for; all files, or none.
///
/// # Errors
/// What of the run, the options or the files is wrong. Files that were there before are as they were.
pub fn export(
    request: &ExportRequest,
    mut progress: impl FnMut(Progress),
) -> Result<Vec<Written>, ExportError> {
    let run = Run::open(request)?;
    let mut step = Progress {
        done: 1,
        of: 1 + request.formats.len() * run.people.len(),
    };
    progress(step);
    files::make_folder(&request.out)?;
    let mut unfinished = Vec::new();
    for &format in &request.formats {
        let everybody: Vec<u32> = run.people.keys().copied().collect();
        let files: Vec<Vec<u32>> = if format.holds_all() {
            vec![everybody]
        } else {
            everybody.into_iter().map(|person| vec![person]).collect()
        };
        for people in files {
            let who = people.first().map_or("", |person| run.name(*person));
            let path = request.out.join(format.file_name(who));
            let mut file = Unfinished::create(path, request.existing)?;
            run.write(format, &people, &mut file, &mut || {
                step.done += 1;
                progress(step);
            })?;
            file.complete()?;
            unfinished.push((format, people, file));
        }
    }
    let name = |(format, people, file): (Format, Vec<u32>, Unfinished)| {
        let (path, bytes) = file.name()?;
        Ok(Written {
            path,
            format,
            people,
            bytes,
        })
    };
    unfinished.into_iter().map(name).collect()
}

/// A run that is being exported.
struct Run<'a> {
    request: &'a ExportRequest,
    survey: Survey,
    clock: Clock,
    /// Who is exported, and what they are called.
    people: BTreeMap<u32, String>,
}

impl<'a> Run<'a> {
    fn open(request: &'a ExportRequest) -> Result<Self, ExportError> {
        let options = &request.options;
        if let Some(refusal) = request
            .formats
            .iter()
            .find_map(|format| options.refusal(*format))
        {
            return Err(ExportError::Options(refusal));
        }
        let facts = RunFacts::parse(&files::read_text(&request.summary)?, &request.summary)?;
        let clock = clock_of(&facts, options)?;
        let ticks = clock.first..clock.end;
        let survey = Survey::of(files::open(&request.poses)?, &request.poses, &ticks)?;
        let people = people_of(&survey, options, &ticks)?;
        Ok(Self {
            request,
            survey,
            clock,
            people,
        })
    }

    fn name(&self, person: u32) -> &str {
        self.people.get(&person).map_or("", String::as_str)
    }

    fn subject(&self, person: u32) -> Option<Subject<'_>> {
        Some(Subject {
            id: person,
            name: self.name(person),
            survey: self.survey.people.get(&person)?,
            keypoints: &self.survey.keypoints,
            clock: self.clock,
            options: &self.request.options,
        })
    }

    /// Writes one file; calls `done` after each person.
    fn write(
        &self,
        format: Format,
        people: &[u32],
        file: &mut Unfinished,
        done: &mut dyn FnMut(),
    ) -> Result<(), ExportError> {
        let subjects = people.iter().filter_map(|person| self.subject(*person));
        let subjects: Vec<Subject<'_>> = subjects.collect();
        match format {
            Format::Glb => self.write_gltf(&subjects, file, Container::Binary, done),
            Format::Gltf => self.write_gltf(&subjects, file, Container::Json, done),
            Format::CsvTidy | Format::Parquet => self.write_table(format, &subjects, file, done),
            _ => subjects.into_iter().try_for_each(|subject| {
                self.write_person(format, subject, file)?;
                done();
                Ok(())
            }),
        }
    }

    fn write_gltf(
        &self,
        subjects: &[Subject<'_>],
        file: &mut Unfinished,
        container: Container,
        done: &mut dyn FnMut(),
    ) -> Result<(), ExportError> {
        let mut writer = GltfWriter::default();
        for subject in subjects {
            let mut person = GltfPerson::new(*subject);
            self.for_each_frame(subject.id, |frame| {
                person.frame(&frame);
                Ok(())
            })?;
            writer.add(person).map_err(|source| file.error(source))?;
            done();
        }
        let written = writer.finish(&mut *file, container);
        written.map_err(|source| file.error(source))
    }

    /// Writes a table of all people.
    fn write_table(
        &self,
        format: Format,
        subjects: &[Subject<'_>],
        file: &mut Unfinished,
        done: &mut dyn FnMut(),
    ) -> Result<(), ExportError> {
        let path = file.path().to_owned();
        let error = |source| ExportError::io(&path, "writing", source);
        let Some(first) = subjects.first() else {
            return Ok(());
        };
        if format == Format::Parquet {
            let mut writer = ParquetWriter::new(file, first).map_err(error)?;
            for subject in subjects {
                self.for_each_frame(subject.id, |frame| {
                    writer.frame(subject, &frame).map_err(error)
                })?;
                done();
            }
            return writer.finish().map_err(error);
        }
        let names = point_names(&self.survey.keypoints);
        let mut writer = TidyWriter::new(file);
        for subject in subjects {
            self.for_each_frame(subject.id, |frame| {
                writer.frame(subject, &names, &frame).map_err(error)
            })?;
            done();
        }
        writer.finish().map_err(error)
    }

    /// Writes the file of one person.
    fn write_person(
        &self,
        format: Format,
        subject: Subject<'_>,
        file: &mut Unfinished,
    ) -> Result<(), ExportError> {
        let path = file.path().to_owned();
        let error = |source| ExportError::io(&path, "writing", source);
        let person = subject.id;
        match format {
            Format::Bvh => {
                let mut writer = BvhWriter::new(file, subject).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))
            }
            Format::C3d => {
                let mut writer = C3dWriter::new(file, subject).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))?;
                writer.finish().map_err(error)
            }
            Format::Csv => {
                let mut writer = WideWriter::new(file, subject).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))?;
                writer.finish().map_err(error)
            }
            Format::Trc => {
                let name = format.file_name(subject.name);
                let mut writer = TrcWriter::new(file, subject, &name).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))
            }
            Format::Mot => {
                // The head counts the rows, and absent frames have none.
                let mut n_rows = 0;
                self.for_each_frame(person, |frame| {
                    n_rows += u64::from(frame.pose.is_some());
                    Ok(())
                })?;
                let mut writer = MotWriter::new(file, subject, n_rows).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))
            }
            Format::Osim => write_model(file, &subject).map_err(error),
            // Of all people, which `write` has told from these.
            Format::Glb | Format::Gltf | Format::CsvTidy | Format::Parquet => Ok(()),
        }
    }

    /// Calls `each` with every frame of one person, in order.
    fn for_each_frame(
        &self,
        person: u32,
        mut each: impl FnMut(Frame) -> Result<(), ExportError>,
    ) -> Result<(), ExportError> {
        let options = &self.request.options;
        let path = &self.request.poses;
        let mut resampler = Resampler::new(
            self.clock,
            options.gaps,
            options.longest_gap_s,
            options.rest,
        );
        for_each_line(files::open(path)?, path, |text, number| {
            let (tick, of) = PoseLine::parse_head(text, path, number)?;
            if of != person || !(self.clock.first..self.clock.end).contains(&tick) {
                return Ok(());
            }
            let line = PoseLine::parse(text, path, number)?;
            let sample = Sample::of(&line, options.rest, &self.survey.keypoints);
            resampler.push(tick, sample, &mut each)
        })?;
        resampler.finish(each)
    }
}

fn clock_of(facts: &RunFacts, options: &Options) -> Result<Clock, ExportError> {
    let run = facts.ticks.first..facts.ticks.end;
    let ticks = options.ticks.clone().unwrap_or_else(|| run.clone());
    if ticks.is_empty() || ticks.start < run.start || ticks.end > run.end {
        return Err(ExportError::Options(format!(
            "found ticks {}..{}, expected some of the run's {}..{}",
            ticks.start, ticks.end, run.start, run.end
        )));
    }
    if !LONGEST_GAPS_S.contains(&options.longest_gap_s) {
        return Err(ExportError::Options(format!(
            "found {} s as the longest gap that is filled, expected {} to {} s",
            options.longest_gap_s,
            LONGEST_GAPS_S.start(),
            LONGEST_GAPS_S.end()
        )));
    }
    let rate_hz = options.rate_hz.unwrap_or(facts.rate_hz);
    if options.rate_hz.is_some() && !RATES_HZ.contains(&rate_hz) {
        return Err(ExportError::Options(format!(
            "found a rate of {rate_hz} Hz, expected {} to {} Hz",
            RATES_HZ.start(),
            RATES_HZ.end()
        )));
    }
    Ok(Clock {
        run_hz: facts.rate_hz,
        rate_hz,
        zero: run.start,
        first: ticks.start,
        end: ticks.end,
    })
}

/// Who is exported, and what they are called.
fn people_of(
    survey: &Survey,
    options: &Options,
    ticks: &Range<i64>,
) -> Result<BTreeMap<u32, String>, ExportError> {
    let known: Vec<u32> = survey.people.keys().copied().collect();
    let asked = if options.people.is_empty() {
        &known
    } else {
        &options.people
    };
    let mut people = BTreeMap::new();
    for person in asked {
        if !known.contains(person) {
            return Err(ExportError::Options(format!(
                "found person {person}, expected one of {known:?}"
            )));
        }
        let name = options
            .called
            .get(person)
            .map_or_else(|| person.to_string(), |name| file_word(name));
        if let Some((other, _)) = people.iter().find(|(_, taken)| **taken == name) {
            return Err(ExportError::Options(format!(
                "persons {other} and {person} are both called `{name}`"
            )));
        }
        people.insert(*person, name);
    }
    if people.is_empty() {
        return Err(ExportError::Options(format!(
            "nobody is there in ticks {}..{}",
            ticks.start, ticks.end
        )));
    }
    Ok(people)
}

/// `name` as a part of a file's name: what is no letter, digit, `-` or `_` becomes `_`.
fn file_word(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || c == '-' {
            c
        } else {
            '_'
        }
    };
    name.chars().take(64).map(safe).collect()
}
