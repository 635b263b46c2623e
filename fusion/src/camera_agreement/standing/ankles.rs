//! How high the ankles of those who stand are above the floor: what tells a floor that is a hand's breadth off.
//!
//! Heels and toes hang from priors where a network ends at the ankles, and are up to 0.09 m too low then. Ankles are seen. The
//! lower of two ankles is that of the foot that stands; who walks and plays has it there in a quarter of all instants.

use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::percentile;

use crate::body::skeleton::{Joint, Joints};

/// People who are kept, the newest, and instants of each, the newest.
const MAX_PEOPLE: usize = 16;
const MAX_INSTANTS: usize = 64;
/// Least instants of somebody who counts.
const MIN_INSTANTS: usize = 12;
/// How high the ankle of a foot that stands is, metres: in simulated scenes the lower quarter of a person was 0.05 to 0.105.
const ANKLE_M: f64 = 0.07;
/// How far under the floor the ankles of everybody must be for it to be elsewhere, metres: by the calibration of the Shelf they
/// are up to 0.08 too low.
const UNDER_M: f64 = 0.1;
/// The same above it: on a treadmill that is no stage they were 0.08 too high.
const ABOVE_M: f64 = 0.12;
/// By how much more than in the lowest tenth of instants the ankles of somebody may be in half of them who stands above the
/// floor, metres: who jumps and runs is there and in the air.
const CONSTANT_M: f64 = 0.05;

/// Of several people.
#[derive(Debug, Clone, Default)]
pub(super) struct AnkleHeights {
    people: Vec<OfPerson>,
    instants: u64,
}

/// The lower ankle of somebody who stands, above the floor, metres.
#[derive(Debug, Clone)]
struct OfPerson {
    id: PersonId,
    heights_m: Vec<f64>,
    newest: u64,
}

impl AnkleHeights {
    /// People, by id, whose feet are so high above the floor, metres.
    #[cfg(test)]
    pub(super) fn of(people: impl Iterator<Item = (u32, f64)>) -> Self {
        let mut all = Self::default();
        for (id, feet_m) in people {
            for _ in 0..MIN_INSTANTS {
                all.keep(PersonId(id), feet_m + ANKLE_M);
            }
        }
        all
    }

    /// Keeps how high the lower ankle of somebody is above a floor at `floor_m`.
    pub(super) fn note(&mut self, id: PersonId, joints_m: &Joints, floor_m: f64) {
        let of = |joint: Joint| joints_m[joint.index()].z;
        let height_m = of(Joint::LeftAnkle).min(of(Joint::RightAnkle)) - floor_m;
        if height_m.is_finite() {
            self.keep(id, height_m);
        }
    }

    fn keep(&mut self, id: PersonId, height_m: f64) {
        self.instants += 1;
        let newest = self.instants;
        if let Some(known) = self.people.iter_mut().find(|known| known.id == id) {
            super::keep(&mut known.heights_m, height_m, MAX_INSTANTS);
            known.newest = newest;
            return;
        }
        let mut heights_m = Vec::with_capacity(MAX_INSTANTS);
        if self.people.len() == MAX_PEOPLE {
            let people = self.people.iter().enumerate();
            let oldest = people.min_by_key(|(_, known)| known.newest);
            if let Some((oldest, _)) = oldest {
                heights_m = self.people.remove(oldest).heights_m;
                heights_m.clear();
            }
        }
        heights_m.push(height_m);
        self.people.push(OfPerson {
            id,
            heights_m,
            newest,
        });
    }

    /// How high the feet of those who stand are above the floor, metres, where all are clearly under it or above it: of the
    /// highest of them where all are under it, of the lowest where all are above.
    pub(super) fn elsewhere_m(&self) -> Option<f64> {
        let sorted = |known: &OfPerson| {
            let mut heights_m = known.heights_m.clone();
            heights_m.sort_by(f64::total_cmp);
            heights_m
        };
        let known: Vec<Vec<f64>> = self
            .people
            .iter()
            .filter(|known| known.heights_m.len() >= MIN_INSTANTS)
            .map(sorted)
            .collect();
        let stands_m = |heights_m: &Vec<f64>| Some(percentile(heights_m, 0.25)? - ANKLE_M);
        let feet_m = || known.iter().filter_map(stands_m);
        let highest_m = feet_m().max_by(f64::total_cmp)?;
        let lowest_m = feet_m().min_by(f64::total_cmp)?;
        let is_constant = |heights_m: &Vec<f64>| {
            let range_m = percentile(heights_m, 0.1).zip(percentile(heights_m, 0.5));
            range_m.is_some_and(|(low_m, half_m)| half_m - low_m <= CONSTANT_M)
        };
        if highest_m < -UNDER_M {
            Some(highest_m)
        } else if lowest_m > ABOVE_M && known.iter().all(is_constant) {
            Some(lowest_m)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is told of people who walk where their floor is so high, and lift the lower ankle by up to so much.
    fn told_m(floors_m: &[f64], lift_m: f64) -> Option<f64> {
        let mut all = AnkleHeights::default();
        for (id, floor_m) in (1..).zip(floors_m) {
            for instant in 0..40 {
                let lifted = f64::from(instant % 8) / 7.0;
                all.keep(PersonId(id), floor_m + 0.06 + lift_m * lifted);
            }
        }
        all.elsewhere_m()
    }

    #[test]
    fn a_floor_that_is_a_hands_breadth_off_is_told_to_a_few_centimetres() {
        for floor_m in [-0.2, -0.13, 0.15, 0.2] {
            let found_m = told_m(&[floor_m, floor_m + 0.01], 0.03).unwrap();
            assert!((found_m - floor_m).abs() < 0.03, "{floor_m}: {found_m}");
        }
    }

    #[test]
    fn nothing_is_said_of_a_right_floor_of_several_and_of_who_jumps() {
        for floor_m in [-0.08, -0.03, 0.0, 0.05, 0.1] {
            assert_eq!(told_m(&[floor_m], 0.05), None, "{floor_m}");
        }
        // A treadmill, and somebody beside it who stands lower.
        assert_eq!(told_m(&[0.2, -0.2], 0.03), None);
        assert_eq!(told_m(&[0.15], 0.5), None);
        assert_eq!(told_m(&[], 0.0), None);
    }
}
