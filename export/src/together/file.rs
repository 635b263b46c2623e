//! One reading of a run's poses into one file of everybody that goes on in time.

use std::io::{self, Write};
use std::path::Path;

use super::Together;
use crate::error::ExportError;
use crate::files;
use crate::formats::foxglove::{Body, FoxgloveWriter, Stamp};
use crate::options::ExportRequest;
use crate::run::line::for_each_line;
use crate::run::{PoseLine, Sample};
use crate::skeleton::Bone;
use crate::subject::Subject;
use crate::timeline::{Clock, Frame, Resampler};

/// Writes MCAP that Foxglove shows to `out`, which is called `path`.
pub(crate) fn write_mcap(
    request: &ExportRequest,
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
    for_each_moment(request, subjects, clock, |moment| {
        write_moment(&mut writer, subjects, request, moment).map_err(error)
    })?;
    writer.finish().map_err(error)
}

fn for_each_moment(
    request: &ExportRequest,
    subjects: &[Subject<'_>],
    clock: Clock,
    mut each: impl FnMut(&[(u32, Frame)]) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let (options, path) = (&request.options, &request.poses);
    let resampler =
        |clock| Resampler::new(clock, options.gaps, options.longest_gap_s, options.rest);
    let mut together = Together::new(subjects.iter().map(|it| it.id), clock, resampler);
    for_each_line(files::open(path)?, path, |text, number| {
        let (tick, person) = PoseLine::parse_head(text, path, number)?;
        let subject = subjects.iter().find(|it| it.id == person);
        let Some(subject) = subject.filter(|_| (clock.first..clock.end).contains(&tick)) else {
            return Ok(());
        };
        let line = PoseLine::parse(text, path, number)?;
        let sample = Sample::of(&line, options.rest, subject.keypoints);
        together.push(tick, person, sample, &mut each)
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
