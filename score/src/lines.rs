//! Reads `poses.jsonl` and `truth.jsonl`: one line per tick and person.
//!
//! Only scored data are stored, so an hour of people fits in memory. Unused fields are not checked; a used field that is
//! invalid is refused with its line and name. Points under unknown names are not compared; their names are collected.

use std::collections::BTreeMap;
use std::io::{self, BufRead};
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

use farfield_proto::message::PersonState;
use farfield_proto::tick::Tick;
use farfield_proto::toml_file::FileError;
use nalgebra::Vector3;
use serde::{Deserialize as _, Serialize};
use serde_json::{Map, Value};

use super::names::{NameGroup, UnknownNames};
use super::points::{HEAD_POINTS, JointDetail, LIMB_POINTS, PointSet, ScoredBody, Sureness};
use farfield_fusion::body::skeleton::{Joint, N_JOINTS};

/// What the lines are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LinesRole {
    /// Poses: keypoints are taken from `keypoints` alone.
    Poses,
    /// A truth: a keypoint that is not under `keypoints` is taken from `joints`, because a truth with one kind of point
    /// lists it there only (Shelf).
    Truth,
}

/// Whether a truth contains all people.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TruthExtent {
    /// All people at every tick: a person who is left out was absent.
    #[default]
    Whole,
    /// Some people at some ticks: a person who is left out may have been present.
    Partial,
}

impl FromStr for TruthExtent {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "whole" => Ok(Self::Whole),
            "partial" => Ok(Self::Partial),
            _ => Err(format!("`{name}` is not one of whole, partial")),
        }
    }
}

/// A gap of a person in a file: the file has the person before and after.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct TruthHole {
    /// The id of the person.
    pub person: u32,
    /// The last tick before the gap.
    pub after: Tick,
    /// The first tick after the gap.
    pub until: Tick,
}

/// The people of one file, by tick and id.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseLines {
    points: PointSet,
    people: BTreeMap<Tick, BTreeMap<u32, ScoredBody>>,
    unknown: UnknownNames,
}

impl PoseLines {
    /// Reads all lines of `reader`; errors name `path`. Lines outside `ticks` are checked but not stored. The lines may be in
    /// any order.
    ///
    /// # Errors
    /// [`FileError`] at the first line that cannot be read, lacks `tick` or `person`, holds a point
    /// that is not three numbers, or repeats a person at a tick.
    pub fn read(
        reader: impl BufRead,
        path: &Path,
        role: LinesRole,
        points: PointSet,
        ticks: Option<&Range<Tick>>,
    ) -> Result<Self, FileError> {
        let mut people: BTreeMap<Tick, BTreeMap<u32, ScoredBody>> = BTreeMap::new();
        let mut unknown = UnknownNames::default();
        for (index, text) in reader.lines().enumerate() {
            let line = index + 1;
            let text = text.map_err(|e| FileError::new(path, unreadable(&e)).at_line(line))?;
            if text.trim().is_empty() {
                continue;
            }
            let parsed = parse_line(&text, role, points, &mut unknown)
                .map_err(|fault| fault.at(path, line))?;
            if ticks.is_some_and(|range| !range.contains(&parsed.tick)) {
                continue;
            }
            let at_tick = people.entry(parsed.tick).or_default();
            if at_tick.insert(parsed.person, parsed.body).is_some() {
                let problem = format!("found {} twice at tick {}", parsed.person, parsed.tick);
                return Err(LineFault {
                    field: Some("person".to_owned()),
                    problem,
                }
                .at(path, line));
            }
        }
        Ok(Self {
            points,
            people,
            unknown,
        })
    }

    /// Lines that were never written: `people` by tick and id, gathered with `points`.
    pub fn from_people(
        points: PointSet,
        people: BTreeMap<Tick, BTreeMap<u32, ScoredBody>>,
    ) -> Self {
        Self {
            points,
            people,
            unknown: UnknownNames::default(),
        }
    }

    /// The set of points that was read.
    pub fn points(&self) -> PointSet {
        self.points
    }

    /// The first gap of a person who is present before and after it.
    pub fn first_hole(&self) -> Option<TruthHole> {
        let mut last: BTreeMap<u32, Tick> = BTreeMap::new();
        let mut people = self.people.iter();
        people.find_map(|(&until, bodies)| {
            let mut holes = bodies.keys().filter_map(|&person| {
                let after = last.insert(person, until)?;
                (until - after > 1).then_some(TruthHole {
                    person,
                    after,
                    until,
                })
            });
            let first = holes.next();
            // Run to the end: all people of the tick must be recorded in `last`.
            holes.for_each(drop);
            first
        })
    }

    /// The ticks with people, ascending.
    pub fn ticks(&self) -> impl Iterator<Item = Tick> {
        self.people.keys().copied()
    }

    /// The people at `tick`, `None` when there are none.
    pub fn people_at(&self, tick: Tick) -> Option<&BTreeMap<u32, ScoredBody>> {
        self.people.get(&tick)
    }

    /// Whether there are no people.
    pub fn is_empty(&self) -> bool {
        self.people.is_empty()
    }

    /// Whether any person has a scored point.
    pub fn has_points(&self) -> bool {
        let mut bodies = self.people.values().flat_map(BTreeMap::values);
        bodies.any(|body| body.points_m.iter().any(Option::is_some))
    }

    /// The names of the scored points that any person has.
    pub fn known_points(&self) -> Vec<&'static str> {
        let is_known = |slot: usize| {
            let mut bodies = self.people.values().flat_map(BTreeMap::values);
            bodies.any(|body| body.points_m[slot].is_some())
        };
        let names = LIMB_POINTS.into_iter().chain(HEAD_POINTS).enumerate();
        let known = names.filter(|(slot, _)| is_known(*slot));
        known.map(|(_, name)| name).collect()
    }

    /// Unknown point names, also those of lines outside the ticks.
    pub fn unknown(&self) -> &UnknownNames {
        &self.unknown
    }
}

pub(crate) fn unreadable(error: &io::Error) -> String {
    if error.kind() == io::ErrorKind::InvalidData {
        return "found bytes that are no UTF-8, expected a line of JSON".to_owned();
    }
    error.to_string()
}

struct ParsedLine {
    tick: Tick,
    person: u32,
    body: ScoredBody,
}

/// A fault of a line whose number is added later.
struct LineFault {
    field: Option<String>,
    problem: String,
}

impl LineFault {
    fn at(self, path: &Path, line: usize) -> FileError {
        let error = FileError::new(path, self.problem).at_line(line);
        match self.field {
            Some(field) => error.at_field(field),
            None => error,
        }
    }

    fn expected(field: &str, value: Option<&Value>, expected: &str) -> Self {
        let problem = match value {
            Some(value) => format!("found {}, expected {expected}", brief(value)),
            None => format!("missing, expected {expected}"),
        };
        Self {
            field: Some(field.to_owned()),
            problem,
        }
    }
}

fn brief(value: &Value) -> String {
    match value {
        Value::Object(_) => "an object".to_owned(),
        Value::Array(items) => format!("a list of {}", items.len()),
        Value::Null | Value::Bool(_) | Value::Number(_) | Value::String(_) => value.to_string(),
    }
}

fn parse_line(
    text: &str,
    role: LinesRole,
    points: PointSet,
    unknown: &mut UnknownNames,
) -> Result<ParsedLine, LineFault> {
    let value: Value = serde_json::from_str(text).map_err(|e| LineFault {
        field: None,
        problem: format!("not JSON: {e}; expected a line per tick and person, as in poses.jsonl"),
    })?;
    let object = value.as_object().ok_or_else(|| LineFault {
        field: None,
        problem: format!("found {}, expected an object", brief(&value)),
    })?;
    let integer = |field| {
        let value = object.get(field);
        value
            .and_then(Value::as_i64)
            .ok_or_else(|| LineFault::expected(field, value, "a whole number"))
    };
    let tick = Tick(integer("tick")?);
    let person = u32::try_from(integer("person")?)
        .map_err(|_| LineFault::expected("person", object.get("person"), "a number from 0"))?;
    let joints = read_points(object.get("joints"), "joints")?;
    let keypoints = read_points(object.get("keypoints"), "keypoints")?;
    unknown.note(NameGroup::Joints, joints.keys().copied());
    // Extra keypoints matter only if keypoints are compared, or if a truth has no others.
    let is_strange = || !NameGroup::Keypoints.knows_any(keypoints.keys().copied());
    if points != PointSet::Joints || role == LinesRole::Truth && is_strange() {
        unknown.note(NameGroup::Keypoints, keypoints.keys().copied());
    }
    let point = |name: &str| match (points, role) {
        (PointSet::Joints, _) => joints.get(name).copied(),
        (_, LinesRole::Poses) => keypoints.get(name).copied(),
        (_, LinesRole::Truth) => keypoints.get(name).or_else(|| joints.get(name)).copied(),
    };
    let mut body = ScoredBody::gather(points, point, |name| joints.get(name).copied());
    body.set_sites(|name| keypoints.get(name).copied());
    body.is_tentative = role == LinesRole::Poses
        && state_of(object).is_some_and(|state| state == PersonState::Tentative);
    let sureness = match role {
        LinesRole::Poses => read_sureness(object, unknown)?,
        LinesRole::Truth => None,
    };
    if sureness.is_some() || role == LinesRole::Truth && !joints.is_empty() {
        let detail = JointDetail::gather(|name| joints.get(name).copied(), sureness);
        body.detail = Some(Box::new(detail));
    }
    Ok(ParsedLine { tick, person, body })
}

/// The state of a line's pose, if valid.
fn state_of(object: &Map<String, Value>) -> Option<PersonState> {
    let state = object.get("state")?;
    PersonState::deserialize(state).ok()
}

fn read_sureness(
    object: &Map<String, Value>,
    unknown: &mut UnknownNames,
) -> Result<Option<Sureness>, LineFault> {
    let sigmas = match object.get("sigma_m") {
        None | Some(Value::Null) => return Ok(None),
        Some(Value::Object(sigmas)) => sigmas,
        other => {
            return Err(LineFault::expected(
                "sigma_m",
                other,
                "an object of lengths",
            ));
        }
    };
    unknown.note(NameGroup::Sigmas, sigmas.keys().map(String::as_str));
    let mut sigma_m = [f32::NAN; N_JOINTS];
    for (name, value) in sigmas {
        let sigma = value.as_f64().filter(|sigma| *sigma >= 0.0);
        let sigma = sigma.ok_or_else(|| {
            LineFault::expected(
                &format!("sigma_m.{name}"),
                Some(value),
                "a length in metres",
            )
        })?;
        if let Some(joint) = Joint::from_name(name) {
            sigma_m[joint.index()] = sigma as f32;
        }
    }
    let words = "tentative, tracked or coasting";
    let views = object.get("views");
    let n_views = views
        .and_then(Value::as_u64)
        .and_then(|n| u16::try_from(n).ok());
    Ok(Some(Sureness {
        state: state_of(object)
            .ok_or_else(|| LineFault::expected("state", object.get("state"), words))?,
        views: n_views.ok_or_else(|| LineFault::expected("views", views, "a number from 0"))?,
        sigma_m,
    }))
}

fn read_points<'a>(
    group: Option<&'a Value>,
    field: &str,
) -> Result<BTreeMap<&'a str, Vector3<f64>>, LineFault> {
    let object = match group {
        None | Some(Value::Null) => return Ok(BTreeMap::new()),
        Some(Value::Object(object)) => object,
        other => return Err(LineFault::expected(field, other, "an object of points")),
    };
    let known = object.iter().filter(|(_, value)| !value.is_null());
    known
        .map(|(name, value)| {
            let point = point_of(value).ok_or_else(|| {
                LineFault::expected(&format!("{field}.{name}"), Some(value), "three numbers")
            })?;
            Ok((name.as_str(), point))
        })
        .collect()
}

fn point_of(value: &Value) -> Option<Vector3<f64>> {
    let [x, y, z] = value.as_array()?.as_slice() else {
        return None;
    };
    Some(Vector3::new(x.as_f64()?, y.as_f64()?, z.as_f64()?))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str, role: LinesRole, points: PointSet) -> Result<PoseLines, String> {
        PoseLines::read(
            text.as_bytes(),
            Path::new("truth.jsonl"),
            role,
            points,
            None,
        )
        .map_err(|e| e.to_string())
    }

    fn refused(text: &str) -> String {
        read(text, LinesRole::Truth, PointSet::Joints).unwrap_err()
    }

    #[test]
    fn errors_name_file_line_and_field() {
        let good = "{\"tick\": 1, \"person\": 1}\n";
        assert_eq!(
            refused(&format!("{good}{{\"tick\": 2}}")),
            "truth.jsonl:2: `person`: missing, expected a whole number"
        );
        assert_eq!(
            refused("{\"tick\": 1.5, \"person\": 1}"),
            "truth.jsonl:1: `tick`: found 1.5, expected a whole number"
        );
        assert_eq!(
            refused("{\"tick\": 1, \"person\": -1}"),
            "truth.jsonl:1: `person`: found -1, expected a number from 0"
        );
        assert_eq!(
            refused("{\"tick\": 1, \"person\": 1, \"joints\": {\"nose\": [1, 2]}}"),
            "truth.jsonl:1: `joints.nose`: found a list of 2, expected three numbers"
        );
        assert_eq!(
            refused(&format!("{good}{good}")),
            "truth.jsonl:2: `person`: found 1 twice at tick 1"
        );
        assert!(refused("{\"tick\": 1, \"per").starts_with("truth.jsonl:1: not JSON: EOF"));
    }

    #[test]
    fn a_pose_with_sigmas_needs_state_and_views() {
        let line = |rest: &str| {
            let text = format!("{{\"tick\": 1, \"person\": 1, {rest}}}");
            read(&text, LinesRole::Poses, PointSet::Joints)
        };
        let good = line("\"sigma_m\": {\"nose\": 0.01}, \"state\": \"coasting\", \"views\": 1");
        let recording = good.unwrap();
        let body = &recording.people_at(Tick(1)).unwrap()[&1];
        let sureness = body.detail.as_ref().unwrap().sureness.as_ref().unwrap();
        assert_eq!((sureness.state, sureness.views), (PersonState::Coasting, 1));
        assert!((sureness.sigma_m[Joint::Nose.index()] - 0.01).abs() < 1e-6);
        assert!(
            line("\"views\": 1").unwrap().people_at(Tick(1)).unwrap()[&1]
                .detail
                .is_none()
        );
        assert_eq!(
            line("\"sigma_m\": {\"nose\": -1}").unwrap_err(),
            "truth.jsonl:1: `sigma_m.nose`: found -1, expected a length in metres"
        );
        assert_eq!(
            line("\"sigma_m\": {}, \"state\": \"lost\"").unwrap_err(),
            "truth.jsonl:1: `state`: found \"lost\", expected tentative, tracked or coasting"
        );
    }

    #[test]
    fn only_a_gap_between_two_ticks_of_a_person_is_a_hole() {
        let line = |tick: i64, person: u32| format!("{{\"tick\": {tick}, \"person\": {person}}}\n");
        let hole = |text: &str, ticks: Option<Range<Tick>>| {
            let (role, points) = (LinesRole::Truth, PointSet::Joints);
            let read = PoseLines::read(
                text.as_bytes(),
                Path::new("t"),
                role,
                points,
                ticks.as_ref(),
            );
            read.unwrap().first_hole()
        };
        let whole: String = (0..4)
            .map(|t| line(t, 1))
            .chain([line(2, 2), line(3, 2)])
            .collect();
        assert_eq!(hole(&whole, None), None);
        let holes = [line(0, 1), line(1, 1), line(1, 2), line(4, 1), line(4, 2)].concat();
        let expected = TruthHole {
            person: 1,
            after: Tick(1),
            until: Tick(4),
        };
        assert_eq!(hole(&holes, None), Some(expected));
        assert_eq!(hole(&holes, Some(Tick(0)..Tick(2))), None);
    }

    #[test]
    fn unknown_names_are_collected_for_the_compared_groups() {
        let text = "{\"tick\": 1, \"person\": 1, \"joints\": {\"hip_l\": [1, 2, 3], \"nose\": [1, 2, 3], \"LKnee\": null}, \
                    \"keypoints\": {\"left_thumb\": [1, 2, 3]}, \"sigma_m\": {\"hip_r\": 0.1}, \"state\": \"tracked\", \"views\": 4}";
        let unknown = |role, points| read(text, role, points).unwrap().unknown().to_string();
        let thumb = "`joints.hip_l`, `keypoints.left_thumb`";
        assert_eq!(unknown(LinesRole::Truth, PointSet::Joints), thumb);
        let hips = "`joints.hip_l`, `sigma_m.hip_r`";
        assert_eq!(unknown(LinesRole::Poses, PointSet::Joints), hips);
        assert_eq!(
            unknown(LinesRole::Poses, PointSet::Keypoints),
            format!("{thumb}, `sigma_m.hip_r`")
        );
    }

    #[test]
    fn only_keypoints_of_a_truth_fall_back_on_its_joints() {
        let text = "{\"tick\": 1, \"person\": 1, \"joints\": {\"left_hip\": [1, 2, 3]}}";
        let hip = |role, points| {
            let recording = read(text, role, points).unwrap();
            recording.people_at(Tick(1)).unwrap()[&1].points_m[6]
        };
        assert!(hip(LinesRole::Truth, PointSet::Keypoints).is_some());
        assert!(hip(LinesRole::Poses, PointSet::Keypoints).is_none());
        assert!(hip(LinesRole::Poses, PointSet::Joints).is_some());
    }
}
