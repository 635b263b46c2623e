//! Repeatability of joint angles: results of one recording, computed with other calibrations, other
//! networks or other viewpoints, compared with each other without a truth.
//!
//! ```text
//!   sd² = mean over people and ticks of the variance of an angle over the sessions
//! ```
//!
//! The variance is that of a sample (n - 1). A session has a constant offset, because its network's
//! keypoints are elsewhere, and an error that changes. The second is what remains without the mean
//! of each session over its ticks.

use std::collections::BTreeMap;
use std::fmt;
use std::io::BufRead;
use std::path::Path;

use farfield_fusion::assign::assign;
use farfield_fusion::body::skeleton::ANGLE_NAMES;
use farfield_proto::toml_file::FileError;
use serde::{Deserialize, Serialize};

use super::lines::unreadable;

/// Fewest ticks that two people share before they can be the same person, and that determine an
/// angle before it is reported.
const FEWEST_TICKS: usize = 10;
/// Difference of the angles of two people from which they are not the same person, radians: the
/// mean of all angles of one person in two sessions differs by less than half of it.
const STRANGERS_RAD: f64 = 0.3;
/// Angles and translations of the root that depend on the world of a calibration.
const ROOT: [&str; 4] = ["pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz"];

/// The angles of one tick in radians, in the order of [`compared`]; NaN where nothing determined one.
type Angles = Vec<f64>;

/// Names of the compared angles.
fn compared() -> impl Iterator<Item = &'static str> {
    let names = ANGLE_NAMES.iter().copied();
    names.filter(|name| !ROOT.contains(name))
}

/// The angles of one session by person and tick.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SessionAngles {
    people: BTreeMap<u32, BTreeMap<i64, Angles>>,
}

#[derive(Deserialize)]
struct Line {
    tick: i64,
    person: u32,
    angles: BTreeMap<String, f64>,
    #[serde(default)]
    unobserved: Vec<String>,
}

impl SessionAngles {
    /// Reads the lines of a `poses.jsonl`; `path` is only for errors.
    ///
    /// # Errors
    /// [`FileError`] with the first line that has no tick, person and angles.
    pub fn read(reader: impl BufRead, path: &Path) -> Result<Self, FileError> {
        let mut session = Self::default();
        for (index, text) in reader.lines().enumerate() {
            let error = |problem: String| FileError::new(path, problem).at_line(index + 1);
            let text = text.map_err(|e| error(unreadable(&e)))?;
            if text.trim().is_empty() {
                continue;
            }
            let line: Line = serde_json::from_str(&text)
                .map_err(|e| error(format!("{e}; expected a line of poses.jsonl with angles")))?;
            let angle = |name: &str| {
                let is_known = !line.unobserved.iter().any(|it| it == name);
                let value = line.angles.get(name).copied();
                value.filter(|_| is_known).unwrap_or(f64::NAN)
            };
            let person = session.people.entry(line.person).or_default();
            person.insert(line.tick, compared().map(angle).collect());
        }
        Ok(session)
    }

    /// How much speaks for one person: the sum over shared ticks of what the mean square difference
    /// of all angles is below that of strangers. A long track outweighs a short one that fits better.
    fn likeness(a: &BTreeMap<i64, Angles>, b: &BTreeMap<i64, Angles>) -> f64 {
        let shared = a.iter().filter_map(|(tick, a)| Some((a, b.get(tick)?)));
        let (mut likeness, mut ticks) = (0.0, 0);
        for (a, b) in shared {
            ticks += 1;
            let offs = a.iter().zip(b).map(|(a, b)| turned(a - b));
            let known = offs.filter(|off| off.is_finite());
            let (sum, n) = known.fold((0.0, 0.0), |(sum, n), off| (sum + off * off, n + 1.0));
            likeness += f64::max(STRANGERS_RAD * STRANGERS_RAD - sum / f64::max(n, 1.0), 0.0);
        }
        if ticks < FEWEST_TICKS { 0.0 } else { likeness }
    }
}

/// An angle difference between -π and π.
fn turned(rad: f64) -> f64 {
    rad - std::f64::consts::TAU * (rad / std::f64::consts::TAU).round()
}

/// Repeatability of one angle.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AngleRepeatability {
    /// Its name.
    pub angle: &'static str,
    /// Standard deviation over the sessions, degrees.
    pub sd_deg: f64,
    /// The same without the offset of each session, degrees.
    pub sd_without_offsets_deg: f64,
    /// People times ticks.
    pub n: usize,
}

/// Repeatability of all angles.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Repeatability {
    /// Number of sessions.
    pub sessions: usize,
    /// People of the first session that others have, too.
    pub people: usize,
    /// By angle; an angle that two sessions determine at few ticks only is left out.
    pub angles: Vec<AngleRepeatability>,
}

impl Repeatability {
    /// Compares `sessions`. A person of one session is the one of the first with the most similar
    /// angles.
    ///
    /// # Errors
    /// If no person of the first session is in another one.
    pub fn of(sessions: &[SessionAngles]) -> Result<Self, String> {
        let together = matched(sessions);
        let people = together.iter().filter(|tracks| tracks.len() > 1).count();
        if people == 0 {
            return Err(format!(
                "no person of the first session is in another at {FEWEST_TICKS} or more equal ticks with similar angles: expected results of one recording"
            ));
        }
        let angles = compared().enumerate().filter_map(|(angle, name)| {
            let (sd, n) = spread(&together, angle, false)?;
            let (without, _) = spread(&together, angle, true)?;
            Some(AngleRepeatability {
                angle: name,
                sd_deg: sd.to_degrees(),
                sd_without_offsets_deg: without.to_degrees(),
                n,
            })
        });
        Ok(Self {
            sessions: sessions.len(),
            people,
            angles: angles.collect(),
        })
    }
}

/// Per person of the first session, its track in each session that has it.
fn matched(sessions: &[SessionAngles]) -> Vec<Vec<&BTreeMap<i64, Angles>>> {
    let Some((first, others)) = sessions.split_first() else {
        return Vec::new();
    };
    let mut together: Vec<Vec<_>> = first.people.values().map(|track| vec![track]).collect();
    for other in others {
        let tracks: Vec<_> = other.people.values().collect();
        let firsts = first.people.values();
        let likeness: Vec<Vec<f64>> = firsts
            .map(|first| {
                tracks
                    .iter()
                    .map(|it| SessionAngles::likeness(first, it))
                    .collect()
            })
            .collect();
        let pairs = assign(together.len(), tracks.len(), |row, column| {
            -likeness[row][column]
        });
        for (row, column) in pairs.into_iter().enumerate() {
            if let Some(column) = column.filter(|&column| likeness[row][column] > 0.0) {
                together[row].push(tracks[column]);
            }
        }
    }
    together
}

/// Standard deviation of an angle over the sessions, radians, and the number of people and ticks.
fn spread(
    together: &[Vec<&BTreeMap<i64, Angles>>],
    angle: usize,
    without_offsets: bool,
) -> Option<(f64, usize)> {
    let (mut sum, mut n) = (0.0, 0);
    for tracks in together.iter().filter(|tracks| tracks.len() > 1) {
        // Relative to the first session, so that a full turn is no difference.
        let ticks = tracks[0].iter().filter_map(|(tick, first)| {
            let first = *first.get(angle)?;
            let of = |track: &&BTreeMap<i64, Angles>| {
                let value = track.get(tick).and_then(|it| it.get(angle));
                value.map_or(f64::NAN, |value| turned(value - first))
            };
            let offs: Vec<f64> = tracks.iter().map(of).collect();
            first.is_finite().then_some(offs)
        });
        let mut ticks: Vec<Vec<f64>> = ticks.collect();
        if without_offsets {
            for session in 0..tracks.len() {
                let known = ticks
                    .iter()
                    .map(|offs| offs[session])
                    .filter(|it| it.is_finite());
                let (total, count) = known.fold((0.0, 0.0), |(t, c), off| (t + off, c + 1.0));
                let mean = total / f64::max(count, 1.0);
                for offs in &mut ticks {
                    offs[session] -= mean;
                }
            }
        }
        for variance in ticks.iter().filter_map(|offs| sample_variance(offs)) {
            sum += variance;
            n += 1;
        }
    }
    (n >= FEWEST_TICKS).then(|| ((sum / n as f64).sqrt(), n))
}

/// Variance of the finite values, of two or more.
fn sample_variance(values: &[f64]) -> Option<f64> {
    let known = || values.iter().filter(|it| it.is_finite());
    let n = known().count() as f64;
    let mean = known().sum::<f64>() / n;
    let squares: f64 = known().map(|it| (it - mean) * (it - mean)).sum();
    (n >= 2.0).then(|| squares / (n - 1.0))
}

impl fmt::Display for Repeatability {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{} sessions, {} people: standard deviation of joint angles over the sessions, degrees\n",
            self.sessions, self.people
        )?;
        writeln!(
            f,
            "{:<24}{:>6}{:>18}{:>10}",
            "", "sd", "without offsets", "n"
        )?;
        for angle in &self.angles {
            writeln!(
                f,
                "{:<24}{:>6.2}{:>18.2}{:>10}",
                angle.angle, angle.sd_deg, angle.sd_without_offsets_deg, angle.n
            )?;
        }
        let n = self.angles.len().max(1) as f64;
        let mean = |of: fn(&AngleRepeatability) -> f64| self.angles.iter().map(of).sum::<f64>() / n;
        write!(
            f,
            "{:<24}{:>6.2}{:>18.2}",
            "mean",
            mean(|it| it.sd_deg),
            mean(|it| it.sd_without_offsets_deg)
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A session of two people, whose knees differ from each other's by 1 rad.
    fn session(ids: [u32; 2], knee_rad: impl Fn(i64) -> f64) -> SessionAngles {
        let line = |tick: i64, nth: usize| {
            let knee = knee_rad(tick) + nth as f64;
            serde_json::json!({
                "tick": tick,
                "person": ids[nth],
                "angles": {"knee_angle_l": knee, "hip_flexion_l": 0.5, "ankle_angle_l": 9},
                "unobserved": ["ankle_angle_l"],
            })
        };
        let lines = (0..40).flat_map(|tick| [line(tick, 0), line(tick, 1)]);
        let text = lines
            .map(|it| format!("{it}\n"))
            .collect::<Vec<_>>()
            .concat();
        SessionAngles::read(text.as_bytes(), Path::new("poses.jsonl")).unwrap()
    }

    fn knee(of: &Repeatability) -> &AngleRepeatability {
        let mut angles = of.angles.iter();
        angles.find(|it| it.angle == "knee_angle_l").unwrap()
    }

    #[test]
    fn offset_and_change_are_told_apart() {
        let motion = |tick: i64| (0.2 * tick as f64).sin();
        let trembling = |tick: i64| motion(tick) + 0.1 + if tick % 2 == 0 { 0.02 } else { -0.02 };
        // The same people under other numbers, in another order.
        let sessions = [session([1, 2], motion), session([7, 3], trembling)];
        let found = Repeatability::of(&sessions).unwrap();
        assert_eq!((found.people, knee(&found).n), (2, 80));
        // Of two values that differ by d, the variance is d²/2.
        let expected = |square: f64| (square / 2.0).sqrt().to_degrees();
        assert!((knee(&found).sd_deg - expected(0.1 * 0.1 + 0.02 * 0.02)).abs() < 1e-9);
        assert!((knee(&found).sd_without_offsets_deg - expected(0.02 * 0.02)).abs() < 1e-9);
        let names: Vec<&str> = found.angles.iter().map(|it| it.angle).collect();
        assert_eq!(names, ["hip_flexion_l", "knee_angle_l"]);
    }

    #[test]
    fn a_short_track_that_fits_better_does_not_replace_a_long_one() {
        let motion = |tick: i64| (0.2 * tick as f64).sin();
        let mut other = session([1, 2], |tick| motion(tick) + 0.05);
        let exact = session([1, 2], motion).people[&1].clone();
        other.people.insert(9, exact.into_iter().take(12).collect());
        let found = Repeatability::of(&[session([1, 2], motion), other]).unwrap();
        assert_eq!(knee(&found).n, 80);
        assert!((knee(&found).sd_deg - (0.05 / 2.0f64.sqrt()).to_degrees()).abs() < 1e-9);
    }

    #[test]
    fn equal_sessions_have_no_deviation_and_a_full_turn_is_none() {
        let turn = |tick: i64| (0.2 * tick as f64).sin() + std::f64::consts::TAU;
        let sessions = [
            session([1, 2], |tick| (0.2 * tick as f64).sin()),
            session([1, 2], turn),
        ];
        let found = Repeatability::of(&sessions).unwrap();
        assert!(found.angles.iter().all(|it| it.sd_deg < 1e-9));
    }

    #[test]
    fn sessions_of_other_recordings_are_refused() {
        let mut later = session([1, 2], |_| 0.0);
        for track in later.people.values_mut() {
            *track = std::mem::take(track)
                .into_iter()
                .map(|(tick, it)| (tick + 1000, it))
                .collect();
        }
        let error = Repeatability::of(&[session([1, 2], |_| 0.0), later]).unwrap_err();
        assert!(error.contains("equal ticks"), "{error}");
        let text = "{\"tick\":1,\"person\":1}\n";
        let error = SessionAngles::read(text.as_bytes(), Path::new("poses.jsonl")).unwrap_err();
        assert!(error.to_string().starts_with("poses.jsonl:1: "), "{error}");
    }
}
