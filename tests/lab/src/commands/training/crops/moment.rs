//! Positions and postures: one person in the middle and others around it.

use std::f64::consts::TAU;

use farfield_sim::body::Build;
use farfield_sim::motion::Clip;
use nalgebra::Vector3;
use rand::RngExt as _;
use rand_chacha::ChaCha8Rng;

use crate::commands::training::people::{Person, TrainingMoment};

/// Draws a moment: the person of the crop comes first, then the others.
pub(crate) fn draw(clips: &[Clip], rng: &mut ChaCha8Rng) -> TrainingMoment {
    let field_m = [rng.random_range(5.0..40.0), rng.random_range(4.0..25.0)];
    let middle = field_m.map(|side| rng.random_range(-0.5..0.5) * side);
    let others = match rng.random_range(0..100) {
        0..40 => 0,
        40..70 => 1,
        70..85 => 2,
        85..95 => 3,
        _ => 4,
    };
    let kit = Build::from_seed(1.75, rng.random());
    let in_kit = rng.random_bool(0.3);
    let mut people = Vec::with_capacity(1 + others);
    for n in 0..=others {
        let place = if n == 0 {
            Vector3::new(middle[0], middle[1], 0.0)
        } else {
            let (distance_m, bearing) = (rng.random_range(0.3..1.5), rng.random_range(0.0..TAU));
            Vector3::new(
                middle[0] + distance_m * f64::cos(bearing),
                middle[1] + distance_m * f64::sin(bearing),
                0.0,
            )
        };
        let kit = in_kit.then_some(&kit);
        people.push(Person::draw(clips, place, kit, rng));
    }
    TrainingMoment {
        people,
        things: Vec::new(),
        field_m,
    }
}
