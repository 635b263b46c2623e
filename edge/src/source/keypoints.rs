//! Files of 2D keypoint candidates, one JSON line per tick. They allow fusion of recordings that
//! exist only as keypoints.
//!
//! Lines name their own ticks, so the venue's `first_tick` does not shift them. Ticks are in order
//! and without gaps. Unknown fields are ignored, because other tools also write these files.

mod contents;
mod leaps;
mod repeats;

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::ops::Range;
use std::path::Path;

use farfield_proto::frames::Pixel;
use farfield_proto::keypoints::COCO23;
use farfield_proto::tick::Tick;
use serde_json::Value;

pub use self::contents::KeypointContents;
use self::leaps::LeapCounter;
use self::repeats::RepeatCounter;
use super::{
    ExpectedSource, Frame, FrameContent, FrameSource, KeypointCandidate, KeypointFrame, MAX_TICK,
    SourceError, SourceInfo,
};

/// Longest accepted line, bytes. 100 people with 17 candidates each take 60 kB.
const MAX_LINE_BYTES: u64 = 1 << 22;
/// UTF-8 text may begin with this mark; some editors on Windows write it.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// Scores from 1 to this value are read as 1: `OpenPose` exceeds 1 by a few percent. Higher scores
/// have another scale.
const MAX_SCORE: f64 = 1.25;

/// Score from which a keypoint counts as reliable. Networks give hidden or cut-off keypoints lower
/// scores and arbitrary positions.
const SURE: f64 = 0.3;

/// Largest accepted coordinate; sums of coordinates within it stay exact.
const MAX_PX: f64 = 1e12;

pub(super) fn probe(path: &Path, expected: &ExpectedSource) -> Result<SourceInfo, SourceError> {
    let mut lines = KeypointLines::open(path, expected)?;
    let Some((first, frame)) = lines.next()? else {
        return Err(SourceError::Unreadable {
            at: expected.at.clone(),
            problem: "it has no lines".to_owned(),
        });
    };
    let mut last = first;
    let mut contents = KeypointContents::new(expected.size_px);
    let (mut leaps, mut repeats) = (LeapCounter::new(expected.rate_hz), RepeatCounter::default());
    let mut add = |frame: KeypointFrame| {
        contents.add(&frame);
        leaps.add(&frame);
        repeats.add(frame);
    };
    add(frame);
    while let Some((tick, frame)) = lines.next()? {
        last = tick;
        add(frame);
    }
    contents.check(expected)?;
    Ok(SourceInfo {
        ticks: Some(first..last + 1),
        repeats: repeats.report(),
        contents: Some(contents),
        leaps: leaps.report(),
        ..SourceInfo::default()
    })
}

pub(super) fn open(
    path: &Path,
    expected: &ExpectedSource,
    from: Tick,
) -> Result<KeypointSource, SourceError> {
    let ticks = probe(path, expected)?.ticks.unwrap_or(from..from);
    let mut lines = KeypointLines::open(path, expected)?;
    for _ in 0..expected.skip(&ticks, from)? {
        lines.next()?;
    }
    Ok(KeypointSource {
        lines,
        ticks,
        read: 0,
    })
}

/// Reads a keypoint file tick by tick.
#[derive(Debug)]
pub(super) struct KeypointSource {
    lines: KeypointLines,
    ticks: Range<Tick>,
    read: u64,
}

impl FrameSource for KeypointSource {
    fn next_frame(&mut self) -> Result<Option<Frame>, SourceError> {
        match self.lines.next()? {
            Some((tick, keypoints)) => {
                self.read += 1;
                Ok(Some(Frame {
                    tick,
                    capture_offset_us: 0,
                    content: FrameContent::Keypoints(keypoints),
                }))
            }
            None if self
                .lines
                .last
                .is_some_and(|last| last + 1 < self.ticks.end) =>
            {
                Err(SourceError::Ended {
                    at: self.lines.expected.at.clone(),
                    read: self.read,
                    expected: Some((self.ticks.end - self.ticks.start).unsigned_abs()),
                    tool_output: String::new(),
                })
            }
            None => Ok(None),
        }
    }
}

/// The checked lines of a keypoint file.
#[derive(Debug)]
struct KeypointLines {
    reader: BufReader<File>,
    expected: ExpectedSource,
    line: usize,
    last: Option<Tick>,
    text: Vec<u8>,
}

impl KeypointLines {
    fn open(path: &Path, expected: &ExpectedSource) -> Result<Self, SourceError> {
        let not_there = |problem: std::io::Error| SourceError::NotThere {
            at: expected.at.clone(),
            problem: problem.to_string(),
        };
        let file = File::open(path).map_err(not_there)?;
        if file.metadata().map_err(not_there)?.is_dir() {
            return Err(not_there(std::io::ErrorKind::IsADirectory.into()));
        }
        let reader = BufReader::new(file);
        Ok(Self {
            reader,
            expected: expected.clone(),
            line: 0,
            last: None,
            text: Vec::new(),
        })
    }

    /// The next line that is not blank; `None` at the end of the file.
    fn next(&mut self) -> Result<Option<(Tick, KeypointFrame)>, SourceError> {
        while self.read_line()? {
            if self.text.iter().all(u8::is_ascii_whitespace) {
                continue;
            }
            let parsed = std::str::from_utf8(&self.text)
                .map_err(|problem| {
                    let what =
                        "a line of JSON: is it a video (`kind = \"video\"`) or another file?";
                    FieldError::new("", format!("not text ({problem}), expected {what}"))
                })
                .and_then(|text| parse_line(text, self.expected.keypoints))
                .and_then(|(tick, frame)| self.follow(tick).map(|()| (tick, frame)));
            return match parsed {
                Ok(found) => Ok(Some(found)),
                Err(wrong) => Err(self.at_line(wrong)),
            };
        }
        Ok(None)
    }

    /// Reads a line into `text`; `false` at the end of the file.
    fn read_line(&mut self) -> Result<bool, SourceError> {
        self.text.clear();
        self.line += 1;
        let mut bounded = self.reader.by_ref().take(MAX_LINE_BYTES);
        let n = bounded
            .read_until(b'\n', &mut self.text)
            .map_err(|problem| SourceError::Unreadable {
                at: self.expected.at.clone(),
                problem: problem.to_string(),
            })?;
        if n as u64 == MAX_LINE_BYTES {
            let problem = format!("the line is longer than {MAX_LINE_BYTES} bytes");
            return Err(self.at_line(FieldError::new("", problem)));
        }
        if self.line == 1 && self.text.starts_with(BYTE_ORDER_MARK) {
            self.text.drain(..BYTE_ORDER_MARK.len());
        }
        Ok(n > 0)
    }

    /// Checks that `tick` comes right after the last one.
    fn follow(&mut self, tick: Tick) -> Result<(), FieldError> {
        if let Some(last) = self.last
            && tick != last + 1
        {
            let problem = match tick - last {
                0 => format!("found {tick} twice"),
                ..0 => format!("found {tick} after {last}: ticks must be in order"),
                _ => format!("found {tick} after {last}: there must be no gap"),
            };
            return Err(FieldError::new("tick", problem));
        }
        self.last = Some(tick);
        Ok(())
    }

    fn at_line(&self, wrong: FieldError) -> SourceError {
        SourceError::Line {
            at: self.expected.at.clone(),
            line: self.line,
            field: (!wrong.field.is_empty()).then_some(wrong.field),
            problem: wrong.problem,
        }
    }
}

/// An error in one field of a line.
#[derive(Debug)]
struct FieldError {
    /// Empty for the whole line.
    field: String,
    problem: String,
}

impl FieldError {
    fn new(field: impl Into<String>, problem: impl Into<String>) -> Self {
        Self {
            field: field.into(),
            problem: problem.into(),
        }
    }
}

fn parse_line(text: &str, n_keypoints: usize) -> Result<(Tick, KeypointFrame), FieldError> {
    // Without its newline: a truncated line ends where its text ends.
    let value: Value = serde_json::from_str(text.trim_end())
        .map_err(|problem| FieldError::new("", json_problem(&problem)))?;
    let Value::Object(line) = &value else {
        return Err(wrong_kind("", &value, "an object"));
    };
    let tick = line.get("tick").ok_or_else(|| missing("tick"))?;
    let tick = tick
        .as_i64()
        .filter(|t| (-MAX_TICK..=MAX_TICK).contains(t))
        .ok_or_else(|| {
            let expected = format!("a tick between {} and {MAX_TICK}", -MAX_TICK);
            wrong_kind("tick", tick, &expected)
        })?;
    let persons = match line.get("persons") {
        None => return Err(missing("persons")),
        Some(value) => parse_persons(value, n_keypoints)?,
    };
    let peaks = match line.get("peaks") {
        None | Some(Value::Null) => peaks_of(&persons, n_keypoints),
        Some(value) => parse_peaks(value, n_keypoints)?,
    };
    Ok((Tick(tick), KeypointFrame { persons, peaks }))
}

/// The message of `serde_json` without its line number, which is always 1 here.
fn json_problem(problem: &serde_json::Error) -> String {
    if problem.is_eof() {
        return "not JSON: the line ends early".to_owned();
    }
    let text = problem.to_string();
    let reason = text.split(" at line ").next().unwrap_or_default();
    match problem.column() {
        0 => format!("not JSON: {reason}"),
        column => format!("not JSON at column {column}: {reason}"),
    }
}

fn parse_persons(
    value: &Value,
    n_keypoints: usize,
) -> Result<Vec<Vec<Option<KeypointCandidate>>>, FieldError> {
    let persons = array("persons", value)?;
    let mut parsed = Vec::with_capacity(persons.len());
    for (i, person) in persons.iter().enumerate() {
        let field = format!("persons[{i}].keypoints");
        let keypoints = array(
            &field,
            person.get("keypoints").ok_or_else(|| missing(&field))?,
        )?;
        check_count(&field, keypoints, n_keypoints)?;
        let candidates = keypoints
            .iter()
            .enumerate()
            .map(|(k, keypoint)| match keypoint {
                Value::Null => Ok(None),
                found => parse_candidate(|| format!("{field}[{k}]"), found).map(Some),
            });
        parsed.push(candidates.collect::<Result<_, _>>()?);
    }
    Ok(parsed)
}

fn parse_peaks(
    value: &Value,
    n_keypoints: usize,
) -> Result<Vec<Vec<KeypointCandidate>>, FieldError> {
    let keypoints = array("peaks", value)?;
    check_count("peaks", keypoints, n_keypoints)?;
    let mut parsed = Vec::with_capacity(keypoints.len());
    for (k, candidates) in keypoints.iter().enumerate() {
        let field = format!("peaks[{k}]");
        let candidates = array(&field, candidates)?.iter().enumerate();
        let candidates =
            candidates.map(|(i, found)| parse_candidate(|| format!("{field}[{i}]"), found));
        parsed.push(candidates.collect::<Result<_, _>>()?);
    }
    Ok(parsed)
}

/// The candidates of each keypoint in the grouped persons.
fn peaks_of(
    persons: &[Vec<Option<KeypointCandidate>>],
    n_keypoints: usize,
) -> Vec<Vec<KeypointCandidate>> {
    (0..n_keypoints)
        .map(|k| persons.iter().filter_map(|person| person[k]).collect())
        .collect()
}

fn parse_candidate(
    field: impl Fn() -> String,
    value: &Value,
) -> Result<KeypointCandidate, FieldError> {
    let numbers: Option<Vec<f64>> = value
        .as_array()
        .and_then(|v| v.iter().map(Value::as_f64).collect());
    let Some(&[x, y, score]) = numbers.as_deref() else {
        return Err(wrong_kind(&field(), value, "[x, y, score]"));
    };
    // serde_json refuses NaN and numbers that overflow.
    if x.abs().max(y.abs()) > MAX_PX {
        return Err(FieldError::new(
            field(),
            format!("found ({x:?}, {y:?}), expected pixels"),
        ));
    }
    if !(0.0..=MAX_SCORE).contains(&score) {
        let problem = format!("found a score of {score:?}, expected 0 to 1");
        return Err(FieldError::new(field(), problem));
    }
    Ok(KeypointCandidate {
        position: Pixel::new(x, y),
        score: score.min(1.0) as f32,
    })
}

fn array<'a>(field: &str, value: &'a Value) -> Result<&'a [Value], FieldError> {
    match value {
        Value::Array(items) => Ok(items),
        other => Err(wrong_kind(field, other, "an array")),
    }
}

fn check_count(field: &str, keypoints: &[Value], n_keypoints: usize) -> Result<(), FieldError> {
    if keypoints.len() == n_keypoints {
        return Ok(());
    }
    let with_feet = if keypoints.len() == COCO23.len() {
        ", or `keypoints = \"coco23\"` in the venue file"
    } else {
        ""
    };
    let problem = format!(
        "found {} keypoints, expected {n_keypoints}{with_feet}",
        keypoints.len()
    );
    Err(FieldError::new(field, problem))
}

fn missing(field: &str) -> FieldError {
    FieldError::new(field, "missing")
}

fn wrong_kind(field: &str, found: &Value, expected: &str) -> FieldError {
    /// Long enough to recognise the value.
    const SHOWN_CHARS: usize = 40;
    let text = found.to_string();
    let shown: String = text.chars().take(SHOWN_CHARS).collect();
    let dots = if shown.len() < text.len() { "..." } else { "" };
    FieldError::new(field, format!("found {shown}{dots}, expected {expected}"))
}

#[cfg(test)]
#[path = "keypoints_tests.rs"]
mod tests;
