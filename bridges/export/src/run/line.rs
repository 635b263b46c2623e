//! One line of `poses.jsonl`.

use std::fmt;
use std::io::{self, BufRead, Read as _};
use std::path::Path;

use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint, N_JOINTS};
use farfield_proto::message::PersonState;
use farfield_proto::toml_file::FileError;
use nalgebra::Vector3;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};

use crate::edits::Identities;
use crate::skeleton::Angles;

/// Maximum size of a line, bytes; far more than a run writes.
const LONGEST_LINE: u64 = 1 << 20;
/// Maximum coordinate, metres.
const FARTHEST_M: f64 = 1e6;

/// A person at a tick, as in `poses.jsonl`.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseLine {
    /// The tick.
    pub tick: i64,
    /// The person's id.
    pub person: u32,
    /// Phase of the track.
    pub state: PersonState,
    /// The 29 joints in the world, metres.
    pub joints_m: [Vector3<f64>; N_JOINTS],
    /// The network's keypoints in the world, metres, by name, in the order of the line.
    pub keypoints_m: Vec<(String, Vector3<f64>)>,
    /// Standard deviation per axis of each joint, metres; NaN if missing in the line.
    pub sigma_m: Option<[f64; N_JOINTS]>,
    /// The 40 reported angles.
    pub angles: Angles,
    /// Bit per reported angle: set if this tick's keypoints do not determine it and a prior does.
    pub unobserved: u64,
    /// Number of views that took part.
    pub views: u32,
}

#[derive(serde::Deserialize)]
struct Head {
    tick: i64,
    person: u32,
}

#[derive(serde::Deserialize)]
struct Raw {
    tick: i64,
    person: u32,
    state: PersonState,
    joints: Entries<[f64; 3]>,
    keypoints: Entries<[f64; 3]>,
    sigma_m: Option<Entries<f64>>,
    angles: Entries<f64>,
    #[serde(default)]
    unobserved: Vec<String>,
    #[serde(default)]
    views: u32,
}

/// The entries of an object, in order.
struct Entries<V>(Vec<(String, V)>);

impl<V: Copy> Entries<V> {
    fn get(&self, name: &str) -> Option<V> {
        let found = self.0.iter().find(|(known, _)| known == name);
        found.map(|(_, value)| *value)
    }
}

impl<'de, V: Deserialize<'de>> Deserialize<'de> for Entries<V> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder<V>(std::marker::PhantomData<V>);
        impl<'de, V: Deserialize<'de>> Visitor<'de> for InOrder<V> {
            type Value = Entries<V>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut entries = Vec::new();
                while let Some(entry) = map.next_entry()? {
                    entries.push(entry);
                }
                Ok(Entries(entries))
            }
        }
        deserializer.deserialize_map(InOrder(std::marker::PhantomData))
    }
}

/// The invalid field, if known, and the problem.
type Fault = (Option<String>, String);

impl PoseLine {
    /// Parses only tick and person of the line `text`, line `number` of `path`.
    ///
    /// # Errors
    /// The line and the problem.
    pub fn parse_head(text: &str, path: &Path, number: usize) -> Result<(i64, u32), FileError> {
        let head: Head =
            serde_json::from_str(text).map_err(|e| refuse((None, e.to_string()), path, number))?;
        Ok((head.tick, head.person))
    }

    /// Parses the line `text`, line `number` of `path`.
    ///
    /// # Errors
    /// The line, the field, what was found and what was expected.
    pub fn parse(text: &str, path: &Path, number: usize) -> Result<Self, FileError> {
        Self::read(text).map_err(|fault| refuse(fault, path, number))
    }

    fn read(text: &str) -> Result<Self, Fault> {
        let raw: Raw = serde_json::from_str(text).map_err(|e| (None, e.to_string()))?;
        let mut joints_m = [Vector3::zeros(); N_JOINTS];
        for (joint, at_m) in Joint::ALL.into_iter().zip(&mut joints_m) {
            let field = || format!("joints.{}", joint.name());
            let found = raw.joints.get(joint.name());
            let found = found
                .ok_or_else(|| (Some(field()), "missing, expected three numbers".to_owned()))?;
            *at_m = point(found).map_err(|problem| (Some(field()), problem))?;
        }
        for (k, (name, _)) in raw.keypoints.0.iter().enumerate() {
            check_name(name, &raw.keypoints.0[..k])?;
        }
        let keypoints_m = raw
            .keypoints
            .0
            .into_iter()
            .map(|(name, at)| match point(at) {
                Ok(at_m) => Ok((name, at_m)),
                Err(problem) => Err((Some(format!("keypoints.{name}")), problem)),
            });
        let keypoints_m = keypoints_m.collect::<Result<_, Fault>>()?;
        let mut angles = [0.0; ANGLE_NAMES.len()];
        for (name, angle) in ANGLE_NAMES.iter().zip(&mut angles) {
            let found = raw.angles.get(name);
            *angle = found.filter(|a| a.abs() < FARTHEST_M).ok_or_else(|| {
                let problem = match found {
                    Some(a) => format!("found {a}, expected a number below {FARTHEST_M}"),
                    None => "missing, expected a number".to_owned(),
                };
                (Some(format!("angles.{name}")), problem)
            })?;
        }
        let mut unobserved = 0;
        for name in &raw.unobserved {
            let angle = ANGLE_NAMES.iter().position(|known| known == name);
            let angle = angle.ok_or_else(|| {
                let problem = format!("found {name:?}, expected names of angles");
                (Some("unobserved".to_owned()), problem)
            })?;
            unobserved |= 1 << angle;
        }
        let sigma_m = raw
            .sigma_m
            .map(|sigmas| Joint::ALL.map(|joint| sigmas.get(joint.name()).unwrap_or(f64::NAN)));
        Ok(Self {
            tick: raw.tick,
            person: raw.person,
            state: raw.state,
            joints_m,
            keypoints_m,
            sigma_m,
            angles,
            unobserved,
            views: raw.views,
        })
    }
}

/// Checks a keypoint name, which becomes a column, label and marker: unique and without control
/// characters.
fn check_name(name: &str, before: &[(String, [f64; 3])]) -> Result<(), Fault> {
    let found = if name.trim().is_empty() {
        "an empty name".to_owned()
    } else if name.chars().any(char::is_control) {
        format!("the name {name:?} with control characters")
    } else if before.iter().any(|(known, _)| known == name) {
        format!("the name `{name}` twice")
    } else {
        return Ok(());
    };
    let problem = format!("found {found}, expected names of keypoints, each once");
    Err((Some("keypoints".to_owned()), problem))
}

fn point(at: [f64; 3]) -> Result<Vector3<f64>, String> {
    if at.iter().all(|v| v.abs() < FARTHEST_M) {
        return Ok(Vector3::from(at));
    }
    Err(format!(
        "found {at:?}, expected three numbers below {FARTHEST_M}"
    ))
}

fn refuse(fault: Fault, path: &Path, number: usize) -> FileError {
    let (field, problem) = fault;
    let error = FileError::new(path, problem).at_line(number);
    match field {
        Some(field) => error.at_field(field),
        None => error,
    }
}

/// Calls `each` with every line of `file` (at `path`) without its end, and its number from 1. Blank
/// lines are skipped.
///
/// # Errors
/// Reading errors, lines that are too long or not UTF-8, and errors of `each`.
pub fn for_each_line<E: From<FileError>>(
    mut file: impl BufRead,
    path: &Path,
    mut each: impl FnMut(&str, usize) -> Result<(), E>,
) -> Result<(), E> {
    let mut bytes = Vec::new();
    for number in 1.. {
        bytes.clear();
        let read = (&mut file).take(LONGEST_LINE).read_until(b'\n', &mut bytes);
        let read = read.map_err(|e: io::Error| FileError::new(path, format!("reading: {e}")))?;
        if read == 0 {
            break;
        }
        let at = |problem: &str| FileError::new(path, problem).at_line(number);
        if read as u64 == LONGEST_LINE && bytes.last() != Some(&b'\n') {
            return Err(at(&format!(
                "found more than {LONGEST_LINE} bytes, expected a line of a pose"
            ))
            .into());
        }
        let text = std::str::from_utf8(&bytes)
            .map_err(|_| at("found bytes that are no UTF-8, expected text"))?;
        let text = text.trim();
        if !text.is_empty() {
            each(text, number)?;
        }
    }
    Ok(())
}

/// Calls `each` with every pose of `file` (at `path`) for which `wanted` holds for tick and person.
/// Persons are edited by `identities`, for `wanted` and in the line. Of other poses only tick and
/// person are parsed.
///
/// # Errors
/// As [`for_each_line`], for invalid lines, and errors of `each`.
pub(crate) fn for_each_pose<E: From<FileError>>(
    (file, path): (impl BufRead, &Path),
    identities: &Identities,
    wanted: impl Fn(i64, u32) -> bool,
    mut each: impl FnMut(PoseLine) -> Result<(), E>,
) -> Result<(), E> {
    for_each_line(file, path, |text, number| {
        let (tick, id) = PoseLine::parse_head(text, path, number)?;
        let person = identities.person_at(tick, id);
        let Some(person) = person.filter(|person| wanted(tick, *person)) else {
            return Ok(());
        };
        let line = PoseLine::parse(text, path, number)?;
        each(PoseLine { person, ..line })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        PoseLine::parse(text, Path::new("poses.jsonl"), 7)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn a_missing_joint_is_refused_by_name() {
        let text = r#"{"tick":1,"person":2,"state":"tracked","joints":{"pelvis":[0,0,1]},"keypoints":{},"angles":{}}"#;
        assert_eq!(
            refused(text),
            "poses.jsonl:7: `joints.spine`: missing, expected three numbers"
        );
    }

    #[test]
    fn coordinates_out_of_range_are_refused() {
        let text = r#"{"tick":1,"person":2,"state":"tracked","joints":{"pelvis":[0,0,1e300]},"keypoints":{},"angles":{}}"#;
        assert!(refused(text).contains("`joints.pelvis`: found [0.0, 0.0, 1e300], expected"));
    }

    #[test]
    fn invalid_json_is_refused_with_its_line() {
        assert!(refused("{").starts_with("poses.jsonl:7: "));
        assert!(refused("[]").starts_with("poses.jsonl:7: "));
    }

    #[test]
    fn invalid_keypoint_names_are_refused() {
        let whole = crate::fixture::json(&crate::fixture::line_at(1, 0));
        for (name, found) in [
            ("", "found an empty name"),
            ("a\\tb", "control characters"),
            ("left_knee", "found the name `left_knee` twice"),
        ] {
            let (head, rest) = whole.split_once("\"keypoints\":").unwrap();
            let rest = rest.replacen("\"nose\":", &format!("\"{name}\":"), 1);
            let refused = refused(&format!("{head}\"keypoints\":{rest}"));
            assert!(
                refused.contains("`keypoints`: ") && refused.contains(found),
                "{refused}"
            );
        }
    }

    #[test]
    fn unobserved_angles_are_listed_by_name() {
        let whole = crate::fixture::json(&crate::fixture::line_at(1, 0));
        let with =
            |names: &str| whole.replace("\"unobserved\":[]", &format!("\"unobserved\":[{names}]"));
        let read = |text: &str| PoseLine::parse(text, Path::new("poses.jsonl"), 7);
        let line = read(&with("\"pelvis_list\"")).unwrap();
        assert_eq!(line.unobserved, 0b10);
        assert!(refused(&with("\"tail\"")).contains("`unobserved`: found \"tail\", expected"));
    }

    #[test]
    fn an_endless_line_is_refused() {
        let file = io::BufReader::new(io::repeat(b'x'));
        let refused = for_each_line(file, Path::new("p"), |_, _| Ok::<_, FileError>(()));
        assert!(refused.unwrap_err().to_string().contains("found more than"));
    }
}
