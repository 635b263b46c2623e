//! The skeletons of single ticks over the picture of every camera.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use anyhow::Context as _;
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

/// What of a line of `poses.jsonl` is drawn.
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

/// Writes `overlay_<camera>_<tick>.png` for every camera of the venue and every tick, with the poses of a file, the truth's too;
/// ticks are in order, and `picture` draws.
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

/// The poses of `ticks`, of which some may have none.
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
        // Lines of others may be without keypoints.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_persons_of_the_ticks_are_read_from_the_recording() {
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
        assert_eq!(persons.len(), 2, "nobody is there at tick 3");
        assert_eq!((ids(4), ids(5)), (vec![1], vec![1, 2]));
        assert_eq!(
            persons[&Tick(5)][0].joints_m[Joint::Pelvis.index()].map(f64::to_bits),
            [1.0f64, 2.0, 0.9].map(f64::to_bits)
        );
    }

    #[test]
    fn what_keypoints_do_not_show_or_nobody_knows_any_more_is_a_guess() {
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
}
