//! Skeletons of single ticks over the images of every camera, and the choice of these ticks.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::ops::Range;
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context as _, bail};
use farfield_fusion::body::determined::{UNKNOWN_M, determined_joints};
use farfield_fusion::body::skeleton::{Joint, sites_of};
use farfield_fusion::export::unfinished::write_whole;
use farfield_proto::id::PersonId;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::plain_text::file_stem;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Venue, VenueCamera};
use image::{ImageFormat, RgbImage};
use serde::Deserialize;
use serde_json::Value;

use super::DrawnPerson;

/// The fields of a line of `poses.jsonl` that are drawn.
#[derive(Debug, Deserialize)]
struct DrawnPoseLine {
    tick: Tick,
    person: u32,
    joints: BTreeMap<String, [f64; 3]>,
    #[serde(default)]
    keypoints: BTreeMap<String, Value>,
    #[serde(default)]
    sigma_m: BTreeMap<String, f32>,
}

/// Writes `overlay_<camera>_<tick>.png` for every camera and every tick, with the poses or true poses of a file.
/// `ticks` are in order; `picture` draws.
pub(crate) fn draw_poses(
    (venue, ticks, poses): (&Venue, &[Tick], &Path),
    out: &Path,
    picture: impl Fn(&VenueCamera, Tick, &[DrawnPerson]) -> anyhow::Result<RgbImage>,
) -> anyhow::Result<()> {
    if ticks.is_empty() {
        return Ok(());
    }
    let recorded = recorded(poses, ticks)?;
    for &tick in ticks {
        let persons = recorded.get(&tick).map_or(&[][..], Vec::as_slice);
        for camera in &venue.cameras {
            let name = file_stem(camera.model.name());
            let path = out.join(format!("overlay_{name}_{tick}.png"));
            let image = picture(camera, tick, persons)?;
            let bytes = png(&image).with_context(|| format!("encoding {}", path.display()))?;
            write_whole(path.clone(), &bytes)
                .with_context(|| format!("writing {}", path.display()))?;
        }
    }
    Ok(())
}

fn png(image: &RgbImage) -> anyhow::Result<Vec<u8>> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    Ok(bytes.into_inner())
}

/// The poses of `ticks`; ticks without poses are missing.
fn recorded(path: &Path, ticks: &[Tick]) -> anyhow::Result<BTreeMap<Tick, Vec<DrawnPerson>>> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let mut persons: BTreeMap<Tick, Vec<DrawnPerson>> = BTreeMap::new();
    for line in BufReader::new(file).lines() {
        let line = line.with_context(|| format!("reading {}", path.display()))?;
        let line: DrawnPoseLine =
            serde_json::from_str(&line).with_context(|| format!("reading {}", path.display()))?;
        // Lines are sorted by tick.
        if ticks.last().is_none_or(|&last| line.tick > last) {
            break;
        }
        if ticks.contains(&line.tick) {
            persons.entry(line.tick).or_default().push(person(&line));
        }
    }
    Ok(persons)
}

fn person(line: &DrawnPoseLine) -> DrawnPerson {
    let joint = |joint: &Joint| {
        let at_m = line.joints.get(joint.name());
        at_m.copied().unwrap_or([f64::NAN; 3])
    };
    let keypoints = KeypointSet::new(line.keypoints.keys().cloned().collect());
    let is_determined = determined_joints(&sites_of(&keypoints, &BTreeMap::new()));
    let is_guess = |(joint, is_determined): (Joint, bool)| {
        let sigma_m = line.sigma_m.get(joint.name());
        // Lines of other programs can lack keypoints.
        (!is_determined && !keypoints.is_empty())
            || sigma_m.is_some_and(|&sigma_m| sigma_m > UNKNOWN_M)
    };
    DrawnPerson {
        id: PersonId(line.person),
        joints_m: Joint::ALL.iter().map(joint).collect(),
        is_guess: Joint::ALL
            .into_iter()
            .zip(is_determined)
            .map(is_guess)
            .collect(),
    }
}

/// Ticks of the command line: numbers separated by commas.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TickList(pub(crate) Vec<Tick>);

impl FromStr for TickList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let tick = |part: &str| {
            let number = part.trim().parse().map(Tick);
            number.map_err(|_| format!("`{part}` is not a tick, expected a number"))
        };
        text.split(',')
            .map(tick)
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

/// The requested ticks, in order; without any, the middle tick.
///
/// # Errors
/// Names a tick outside `ticks`.
pub(crate) fn overlay_ticks(
    requested: Option<TickList>,
    ticks: &Range<Tick>,
) -> anyhow::Result<Vec<Tick>> {
    let middle = ticks.start + (ticks.end - ticks.start) / 2;
    let mut drawn = requested.map_or_else(|| vec![middle], |list| list.0);
    drawn.sort_unstable();
    drawn.dedup();
    let outside = drawn.iter().find(|tick| !ticks.contains(tick));
    if let Some(tick) = outside {
        bail!(
            "`--overlay` {tick} is outside the ticks of the run, {}..{}",
            ticks.start,
            ticks.end
        );
    }
    Ok(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_persons_of_the_requested_ticks_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses.jsonl");
        let line = |tick: i64, person: u32| {
            format!(
                "{{\"tick\":{tick},\"person\":{person},\"state\":\"tracked\",\"joints\":{{\"pelvis\":[1.0,2.0,0.9]}},\"views\":4}}\n"
            )
        };
        std::fs::write(
            &path,
            [line(4, 1), line(5, 1), line(5, 2), line(6, 1)].concat(),
        )
        .unwrap();
        let persons = recorded(&path, &[Tick(3), Tick(4), Tick(5)]).unwrap();
        let ids = |tick| {
            persons[&Tick(tick)]
                .iter()
                .map(|p| p.id.0)
                .collect::<Vec<_>>()
        };
        assert_eq!(persons.len(), 2, "tick 3 has no person");
        assert_eq!((ids(4), ids(5)), (vec![1], vec![1, 2]));
        assert_eq!(
            persons[&Tick(5)][0].joints_m[Joint::Pelvis.index()].map(f64::to_bits),
            [1.0f64, 2.0, 0.9].map(f64::to_bits)
        );
    }

    #[test]
    fn joints_without_keypoints_or_with_high_sigma_are_guesses() {
        let line = |keypoints: &str, sigma_m: f64| {
            let text = format!(
                "{{\"tick\":4,\"person\":1,\"joints\":{{}},\"keypoints\":{{{keypoints}}},\
                 \"sigma_m\":{{\"left_knee\":{sigma_m}}}}}"
            );
            person(&serde_json::from_str(&text).unwrap())
        };
        let ankles = "\"left_ankle\":[0,0,0],\"right_ankle\":[0,0,0]";
        let is_guess = |person: &DrawnPerson, joint: Joint| person.is_guess[joint.index()];
        let seen = line(ankles, 0.02);
        assert!(!is_guess(&seen, Joint::LeftKnee) && is_guess(&seen, Joint::LeftToe));
        assert!(is_guess(&line(ankles, 0.2), Joint::LeftKnee));
        assert!(!is_guess(&line("", 0.02), Joint::LeftToe));
    }

    #[test]
    fn the_middle_tick_is_drawn_unless_others_are_requested() {
        let ticks = Tick(0)..Tick(120);
        let named = |named: &[i64]| TickList(named.iter().copied().map(Tick).collect());
        assert_eq!(overlay_ticks(None, &ticks).unwrap(), [Tick(60)]);
        assert_eq!(
            overlay_ticks(Some(named(&[119, 3, 3])), &ticks).unwrap(),
            [Tick(3), Tick(119)]
        );
        let error = overlay_ticks(Some(named(&[3, 120])), &ticks).unwrap_err();
        assert!(error.to_string().contains("120"), "{error}");
    }
}
