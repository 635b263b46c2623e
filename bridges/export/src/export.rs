//! One export: surveys the run, then reads it once per person and file; renames the files when all
//! are complete.

use std::collections::BTreeMap;
use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use farfield_fusion::export::unfinished::Unfinished;
use farfield_proto::toml_file::FileError;

use crate::edits::{EditList, Identities, RefusedEdit};
use crate::edits_file::EditsFile;
use crate::error::{ExportError, OptionField};
use crate::files;
use crate::formats::bvh::BvhWriter;
use crate::formats::c3d::C3dWriter;
use crate::formats::gltf::{Container, GltfPerson, GltfWriter};
use crate::formats::osim::write_model;
use crate::formats::parquet::ParquetWriter;
use crate::formats::table::{TidyWriter, WideWriter, point_names};
use crate::formats::trc_mot::{MotWriter, TrcWriter, has_angles};
use crate::options::{ExportRequest, Format, Options};
use crate::person_names::{PersonName, people_of};
use crate::profile::SubjectProfile;
use crate::run::line::for_each_pose;
use crate::run::{PersonSurvey, RunFacts, Sample, Survey};
use crate::subject::Subject;
use crate::timeline::{Clock, Frame, Resampler};
use crate::together::write_mcap;

/// Allowed frame rates, Hz.
const RATES_HZ: RangeInclusive<f64> = 0.5..=2000.0;
/// Allowed longest gaps, seconds; a longer absence is another visit.
const LONGEST_GAPS_S: RangeInclusive<f64> = 0.0..=3600.0;

/// Maximum number of frames per person: 46 hours at 60 Hz.
const MOST_FRAMES: u64 = 10_000_000;
/// Longest stretch without a pose at the end of a person's files, seconds.
const LONGEST_END_S: f64 = 3600.0;

/// A written file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// Its path.
    pub path: PathBuf,
    /// Its format.
    pub format: Format,
    /// The people in it.
    pub people: Vec<u32>,
    /// Its size, bytes.
    pub bytes: u64,
}

/// Progress of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Number of completed passes over the poses.
    pub done: usize,
    /// Total number: the survey, and one per person and format.
    pub of: usize,
}

/// Writes all requested files, or none.
///
/// # Errors
/// Errors in the run, the options or the files. Existing files stay unchanged, except those that
/// the error of a failed renaming lists.
pub fn export(
    request: &ExportRequest,
    mut progress: impl FnMut(Progress),
) -> Result<Vec<Written>, ExportError> {
    // Report existing files before reading poses for an hour, where names are already known.
    let shared = request.formats.iter().filter(|format| format.holds_all());
    for format in shared {
        files::check_target(&request.out.join(format.file_name("")), request.existing)?;
    }
    let run = Run::open(request)?;
    let mut step = Progress {
        done: 1,
        of: 1 + request.formats.len() * run.people.len(),
    };
    progress(step);
    let targets = run.targets();
    for (_, _, path) in &targets {
        files::check_target(path, request.existing)?;
    }
    files::make_folder(&request.out)?;
    let mut unfinished = Vec::new();
    for (format, people, path) in targets {
        let mut file = files::create(&path)?;
        run.write(format, &people, &mut file, &mut || {
            step.done += 1;
            progress(step);
        })?;
        files::complete(&mut file)?;
        unfinished.push((format, people, file));
    }
    for (_, _, file) in &unfinished {
        files::check_target(file.path(), request.existing)?;
    }
    let mut written: Vec<Written> = Vec::new();
    for (format, people, file) in unfinished {
        let named: Vec<PathBuf> = written.iter().map(|it| it.path.clone()).collect();
        let (path, bytes) = files::name(file, &named)?;
        written.push(Written {
            path,
            format,
            people,
            bytes,
        });
    }
    Ok(written)
}

/// A run during export.
struct Run<'a> {
    request: &'a ExportRequest,
    survey: Survey,
    identities: Identities,
    clock: Clock,
    /// The exported people with their names.
    people: BTreeMap<u32, PersonName>,
}

impl<'a> Run<'a> {
    fn open(request: &'a ExportRequest) -> Result<Self, ExportError> {
        let options = &request.options;
        if let Some(refusal) = request
            .formats
            .iter()
            .find_map(|format| options.refusal(*format))
        {
            return Err(ExportError::option(OptionField::Gaps, refusal));
        }
        let facts = RunFacts::parse(&files::read_text(&request.summary)?, &request.summary)?;
        let clock = clock_of(&facts, options)?;
        let ticks = clock.first..clock.end;
        let (mut survey, identities) =
            survey_run(&request.poses, request.edits.as_deref(), &ticks)?;
        let people = people_of(&survey, options, identities.names(), &ticks)?;
        let mut owners = BTreeMap::new();
        for path in &request.subjects {
            let profile = SubjectProfile::read(path)?;
            if let Some(other) = owners.insert(profile.name.clone(), path) {
                let problem = format!(
                    "found \"{}\", who has the profile {} too, expected one of each name",
                    profile.name,
                    other.display()
                );
                return Err(FileError::new(path, problem).at_field("name").into());
            }
            take_lengths(&mut survey, &people, path, profile)?;
        }
        for person in people.keys() {
            check_frames(*person, &clock_of_person(clock, survey.people.get(person)))?;
        }
        Ok(Self {
            request,
            survey,
            identities,
            clock,
            people,
        })
    }

    /// All files: format, people, path.
    fn targets(&self) -> Vec<(Format, Vec<u32>, PathBuf)> {
        let all: Vec<u32> = self.people.keys().copied().collect();
        let mut targets = Vec::new();
        for &format in &self.request.formats {
            let files: Vec<Vec<u32>> = if format.holds_all() {
                vec![all.clone()]
            } else {
                all.iter().map(|person| vec![*person]).collect()
            };
            for people in files {
                let word = people.first().map_or("", |person| self.word(*person));
                let path = self.request.out.join(format.file_name(word));
                targets.push((format, people, path));
            }
        }
        targets
    }

    fn word(&self, person: u32) -> &str {
        self.people.get(&person).map_or("", |name| &name.word)
    }

    fn subject(&self, person: u32) -> Option<Subject<'_>> {
        let survey = self.survey.people.get(&person)?;
        Some(Subject {
            id: person,
            name: &self.people.get(&person)?.name,
            survey,
            keypoints: &self.survey.keypoints,
            clock: clock_of_person(self.clock, Some(survey)),
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
            Format::Mcap => {
                let path = file.path().to_owned();
                write_mcap(self.request, &self.identities, &subjects, file, &path)?;
                for _ in &subjects {
                    done();
                }
                Ok(())
            }
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
        let path = file.path().to_owned();
        let error = |source| ExportError::io(&path, "writing", source);
        let mut writer = GltfWriter::default();
        for subject in subjects {
            let mut person = GltfPerson::new(*subject);
            self.for_each_frame(subject.id, |frame| {
                person.frame(&frame);
                Ok(())
            })?;
            writer.add(person).map_err(error)?;
            done();
        }
        let written = writer.finish(&mut *file, container);
        written.map_err(error)
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
                let name = format.file_name(self.word(person));
                let mut writer = TrcWriter::new(file, subject, &name).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))
            }
            Format::Mot => {
                // The header contains the number of rows, and absent frames have none.
                let mut n_rows = 0;
                self.for_each_frame(person, |frame| {
                    n_rows += u64::from(has_angles(&frame, &subject));
                    Ok(())
                })?;
                let mut writer = MotWriter::new(file, subject, n_rows).map_err(error)?;
                self.for_each_frame(person, |frame| writer.frame(&frame).map_err(error))
            }
            Format::Osim => write_model(file, &subject).map_err(error),
            // Formats of all people, handled by `write`.
            Format::Glb | Format::Gltf | Format::CsvTidy | Format::Parquet | Format::Mcap => Ok(()),
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
        let clock = clock_of_person(self.clock, self.survey.people.get(&person));
        let mut resampler =
            Resampler::new(clock, options.gaps, options.longest_gap_s, options.rest);
        let is_own =
            |tick: i64, shown: u32| shown == person && (clock.first..clock.end).contains(&tick);
        let poses = (files::open(path)?, path.as_path());
        for_each_pose(poses, &self.identities, is_own, |line| {
            let sample = Sample::from_line(&line, options.rest, &self.survey.keypoints);
            resampler.push(line.tick, sample, &mut each)
        })?;
        resampler.finish(each)
    }
}

fn clock_of(facts: &RunFacts, options: &Options) -> Result<Clock, ExportError> {
    let run = facts.ticks.first..facts.ticks.end;
    if run.is_empty() {
        let problem = format!("found ticks {run:?} of the run, expected one or more");
        return Err(ExportError::Options(problem));
    }
    let ticks = options.ticks.clone().unwrap_or_else(|| run.clone());
    if ticks.is_empty() || ticks.start < run.start || ticks.end > run.end {
        return Err(ExportError::option(
            OptionField::Ticks,
            format!("found ticks {ticks:?}, expected some of the run's {run:?}"),
        ));
    }
    if !LONGEST_GAPS_S.contains(&options.longest_gap_s) {
        let (found, [least, most]) = (options.longest_gap_s, ends(&LONGEST_GAPS_S));
        return Err(ExportError::option(
            OptionField::LongestGap,
            format!(
                "found {found} s as the longest gap that is filled, expected {least} to {most} s"
            ),
        ));
    }
    let rate_hz = options.rate_hz.unwrap_or(facts.rate_hz);
    if options.rate_hz.is_some() && !RATES_HZ.contains(&rate_hz) {
        let [least, most] = ends(&RATES_HZ);
        return Err(ExportError::option(
            OptionField::Rate,
            format!("found a rate of {rate_hz} Hz, expected {least} to {most} Hz"),
        ));
    }
    Ok(Clock {
        run_hz: facts.rate_hz,
        rate_hz,
        zero: run.start,
        first: ticks.start,
        end: ticks.end,
    })
}

fn ends(range: &RangeInclusive<f64>) -> [f64; 2] {
    [*range.start(), *range.end()]
}

/// The frames of one person; they end with the last pose if a long empty rest follows, as in TRC
/// files of live runs.
fn clock_of_person(clock: Clock, survey: Option<&PersonSurvey>) -> Clock {
    let last = survey
        .and_then(|survey| survey.present)
        .map(|(_, last)| last);
    let empty = last.filter(|last| (clock.end - last) as f64 / clock.run_hz > LONGEST_END_S);
    Clock {
        end: empty.map_or(clock.end, |last| last + 1),
        ..clock
    }
}

/// Refuses a number of frames that would fill a disk, since a summary may contain any number.
fn check_frames(person: u32, clock: &Clock) -> Result<(), ExportError> {
    let n_frames = clock.n_frames();
    if n_frames <= MOST_FRAMES {
        return Ok(());
    }
    Err(ExportError::Options(format!(
        "found {n_frames} frames of person {person}, expected at most {MOST_FRAMES}: export fewer ticks, or a lower rate"
    )))
}

/// Surveys a file of poses with its edits.
fn survey_run(
    poses: &Path,
    edits: Option<&Path>,
    ticks: &Range<i64>,
) -> Result<(Survey, Identities), ExportError> {
    let list = match edits {
        Some(path) => EditsFile::at(path.to_owned()).read()?,
        None => EditList::default(),
    };
    let in_file = |fault: RefusedEdit| fault.in_file(edits.unwrap_or(poses));
    let identities = list.identities(None).map_err(in_file)?;
    let survey = Survey::from_lines(files::open(poses)?, poses, ticks, &identities)?;
    // Check again, now that presence is known.
    list.identities(Some(&survey.roll)).map_err(in_file)?;
    Ok((survey, identities))
}

/// The profile of a person of `poses` with `edits`.
///
/// # Errors
/// Errors in the files; also if the person does not exist or has no name.
pub fn profile_of(poses: &Path, edits: &Path, person: u32) -> Result<SubjectProfile, ExportError> {
    let (survey, identities) = survey_run(poses, Some(edits), &(i64::MIN..i64::MAX))?;
    let known = survey.people.get(&person).ok_or_else(|| {
        ExportError::Options(format!(
            "found person {person}, expected one of {:?}",
            survey.people.keys().collect::<Vec<_>>()
        ))
    })?;
    let name = identities.names().get(&person).ok_or_else(|| {
        ExportError::Options(format!(
            "found no name of person {person}, expected one: profiles are found by name"
        ))
    })?;
    Ok(SubjectProfile::from_survey(known, name))
}

/// Gives the person with the profile's name the profile's lengths.
fn take_lengths(
    survey: &mut Survey,
    people: &BTreeMap<u32, PersonName>,
    path: &Path,
    profile: SubjectProfile,
) -> Result<(), ExportError> {
    let mut matching = people
        .iter()
        .filter(|(_, name)| name.name == profile.name)
        .map(|(person, _)| person);
    let (person, other) = (matching.next(), matching.next());
    if let Some((person, other)) = person.zip(other) {
        return Err(ExportError::option(
            OptionField::Subjects,
            format!(
                "{}: found persons {person} and {other} with the name {}, expected one",
                path.display(),
                profile.name
            ),
        ));
    }
    let person = person.and_then(|person| survey.people.get_mut(person));
    let person = person.ok_or_else(|| {
        let names: Vec<&str> = people.values().map(|it| it.name.as_str()).collect();
        ExportError::option(
            OptionField::Subjects,
            format!(
                "{}: no person is named {}, expected one of {}",
                path.display(),
                profile.name,
                names.join(", ")
            ),
        )
    })?;
    person.offsets = profile.offsets;
    Ok(())
}
