//! The scene of a crowd: a field sized for its people, each of whom walks an own path.

use std::fmt::{self, Write as _};
use std::path::Path;

use farfield_proto::toml_file::FileError;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::VenueSize;
use crate::embedded;
use crate::scene::Scene;

/// Ticks per second.
pub const RATE_HZ: f64 = 60.0;
/// Floor area per person, square metres.
const AREA_M2: f64 = 20.0;
/// Ratio of the field's length to its width.
const ASPECT: f64 = 1.5;
/// Smallest field, metres.
const SMALLEST_M: [f64; 2] = [12.0, 8.0];
/// Distance of the cameras from the field, relative to its length. One camera then sees the whole
/// field, also from the middle of its long side.
const SETBACK_OF_LENGTH: f64 = 0.5;
/// Smallest distance of paths from the field's edge, metres.
const EDGE_M: f64 = 1.0;
/// Largest distance of a start from the middle of the person's part of the field, relative to the
/// size of that part.
const SCATTER: f64 = 0.2;
/// Minimum number of corners of a path.
const CORNERS: usize = 12;
/// Smallest mean distance between corners, metres; random points of the smallest field give 4.
const FROM_CORNER_TO_CORNER_M: f64 = 3.0;
/// Slowest and fastest person, metres per second.
const SPEEDS_M_S: [f64; 2] = [1.0, 5.0];
/// Shortest and tallest person, metres.
const STATURES_M: [f64; 2] = [1.6, 1.95];
/// The clips, each with its largest speed, metres per second.
const CLIPS: [(f64, &str); 3] = [(2.0, "walk"), (3.0, "jog"), (f64::INFINITY, "run")];
/// Seed of all draws.
const SEED: u64 = 17;

/// The scene of `size` with `ticks` ticks; deterministic.
///
/// # Errors
/// [`FileError`] for more people, viewpoints or ticks than a scene allows.
pub(super) fn crowd_scene(size: VenueSize, ticks: u32) -> Result<Scene, FileError> {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _infallible = write_scene(&mut text, size, ticks);
    embedded::with_clips(&text, Path::new("scenes/crowd.toml"))
}

fn write_scene(text: &mut String, size: VenueSize, ticks: u32) -> fmt::Result {
    let [length_m, width_m] = field_m(size.people);
    writeln!(
        text,
        "rate_hz = {RATE_HZ:?}\nseconds = {:?}\nseed = {SEED}\nsize_m = [{length_m:.1}, {width_m:.1}]\n\n\
         [cameras]\nviewpoints = {}\nper_viewpoint = 1\nheight_m = 4.0\nsetback_m = {:.1}\n\n\
         [faults]\nprofile = \"standard\"",
        f64::from(ticks) / RATE_HZ,
        size.viewpoints,
        SETBACK_OF_LENGTH * length_m,
    )?;
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let half_m = [length_m / 2.0 - EDGE_M, width_m / 2.0 - EDGE_M];
    for person in 0..size.people {
        let speed_m_s: f64 = rng.random_range(SPEEDS_M_S[0]..SPEEDS_M_S[1]);
        let stature_m: f64 = rng.random_range(STATURES_M[0]..STATURES_M[1]);
        let clip = CLIPS.iter().find(|(up_to, _)| speed_m_s < *up_to);
        let clip = clip.map_or("run", |(_, clip)| clip);
        let at_m = first_place_m(person, size.people, half_m, &mut rng);
        write!(
            text,
            "\n[[person]]\nname = \"{}\"\nclips = [\"../clips/{clip}.bvh\"]\nat_m = {at_m:.2?}\n\
             heading_rad = 0.0\nheight_m = {stature_m:.2}\n\n[person.path]\nspeed_m_s = {speed_m_s:.2}\n\
             points_m = [{at_m:.2?}",
            person + 1,
        )?;
        let way_m = speed_m_s * f64::from(ticks) / RATE_HZ;
        let corners = (way_m / FROM_CORNER_TO_CORNER_M).ceil() as usize;
        for _ in 0..corners.max(CORNERS) {
            let corner_m = half_m.map(|half_m| rng.random_range(-half_m..half_m));
            write!(text, ", {corner_m:.2?}")?;
        }
        writeln!(text, "]")?;
    }
    Ok(())
}

/// Length and width of the field of `people`, metres.
fn field_m(people: usize) -> [f64; 2] {
    let length_m = (ASPECT * AREA_M2 * people as f64).sqrt();
    [
        length_m.max(SMALLEST_M[0]),
        (length_m / ASPECT).max(SMALLEST_M[1]),
    ]
}

/// The start of `person` of `people`: each has its own part of the field, so people never start
/// inside each other.
fn first_place_m(person: usize, people: usize, half_m: [f64; 2], rng: &mut ChaCha8Rng) -> [f64; 2] {
    let columns = ((people as f64 * ASPECT).sqrt().ceil() as usize).max(1);
    let rows = people.div_ceil(columns);
    let mut place_m = |index: usize, count: usize, half_m: f64| {
        let middle = index as f64 + 0.5 + rng.random_range(-SCATTER..SCATTER);
        half_m * (2.0 * middle / count as f64 - 1.0)
    };
    [
        place_m(person % columns, columns, half_m[0]),
        place_m(person / columns, rows, half_m[1]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_has_room_for_its_people_and_is_never_tiny() {
        for (people, expected_m) in [(2, SMALLEST_M), (30, [30.0, 20.0])] {
            let [length_m, width_m] = field_m(people);
            assert!((length_m - expected_m[0]).abs() < 1e-9, "{length_m}");
            assert!((width_m - expected_m[1]).abs() < 1e-9, "{width_m}");
        }
    }

    #[test]
    fn every_size_up_to_the_largest_makes_a_scene() {
        for (viewpoints, people) in [(2, 1), (4, 5), (12, 22), (28, 30), (64, 200)] {
            let size = VenueSize { viewpoints, people };
            let scene = crowd_scene(size, 120).unwrap();
            assert_eq!(scene.viewpoints().len(), viewpoints);
            assert_eq!(scene.cameras().len(), viewpoints);
            assert_eq!(scene.people().len(), people);
            assert_eq!(scene.ticks().end.0, 120);
        }
    }
}
