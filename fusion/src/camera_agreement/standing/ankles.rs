//! Heights of the ankles of standing people above the floor. They reveal a floor that is 0.1 m off.
//!
//! If a network ends at the ankles, heels and toes depend on priors and are up to 0.09 m too low.
//! Ankles are observed. The lower ankle is that of the standing foot; of people who walk and play
//! it is on the ground in a quarter of all instants.

use farfield_proto::id::PersonId;
use farfield_proto::order_statistics::percentile;

use crate::body::skeleton::{Joint, Joints};

/// Number of people that are kept, and of instants of each.
const MAX_PEOPLE: usize = 16;
const MAX_INSTANTS: usize = 64;
/// Least number of instants of a person who counts.
const MIN_INSTANTS: usize = 12;
/// Height of the ankle of a standing foot, metres. In simulated scenes the lower quartile of a
/// person was 0.05 to 0.105.
const ANKLE_M: f64 = 0.07;
/// Least depth of all feet under the floor that is reported, metres. With the calibration of the
/// Shelf they are up to 0.08 too low.
const MIN_UNDER_M: f64 = 0.1;
/// Least height of all feet above the floor that is reported, metres. On a treadmill that is not a
/// raised stage they were 0.08 too high.
const MIN_ABOVE_M: f64 = 0.12;
/// Largest difference between the median and the lowest tenth of the heights of a person above
/// the floor, metres. People who jump and run have larger ones.
const MAX_RANGE_M: f64 = 0.05;

/// The ankle heights of several people.
#[derive(Debug, Clone, Default)]
pub(super) struct AnkleHeights {
    people: Vec<PersonHeights>,
    instants: u64,
}

/// The heights of the lower ankle of a standing person above the floor, metres.
#[derive(Debug, Clone)]
struct PersonHeights {
    id: PersonId,
    heights_m: Vec<f64>,
    newest: u64,
}

impl AnkleHeights {
    /// People with these ids and heights of the feet above the floor, metres.
    #[cfg(test)]
    pub(super) fn from_feet(people: impl Iterator<Item = (u32, f64)>) -> Self {
        let mut all = Self::default();
        for (id, feet_m) in people {
            for _ in 0..MIN_INSTANTS {
                all.add(PersonId(id), feet_m + ANKLE_M);
            }
        }
        all
    }

    /// Adds the height of the lower ankle of a person above a floor at `floor_m`.
    pub(super) fn note(&mut self, id: PersonId, joints_m: &Joints, floor_m: f64) {
        let z_m = |joint: Joint| joints_m[joint.index()].z;
        let height_m = z_m(Joint::LeftAnkle).min(z_m(Joint::RightAnkle)) - floor_m;
        if height_m.is_finite() {
            self.add(id, height_m);
        }
    }

    fn add(&mut self, id: PersonId, height_m: f64) {
        self.instants += 1;
        let newest = self.instants;
        if let Some(known) = self.people.iter_mut().find(|known| known.id == id) {
            super::push_newest(&mut known.heights_m, height_m, MAX_INSTANTS);
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
        self.people.push(PersonHeights {
            id,
            heights_m,
            newest,
        });
    }

    /// The height of standing feet above the floor, metres, if all people are clearly under or
    /// above it. The height is that of the person nearest to the floor.
    pub(super) fn above_floor_m(&self) -> Option<f64> {
        let sorted = |known: &PersonHeights| {
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
            range_m.is_some_and(|(low_m, half_m)| half_m - low_m <= MAX_RANGE_M)
        };
        if highest_m < -MIN_UNDER_M {
            Some(highest_m)
        } else if lowest_m > MIN_ABOVE_M && known.iter().all(is_constant) {
            Some(lowest_m)
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reported height of people who walk at `floors_m` and lift the lower ankle by up to
    /// `lift_m`.
    fn reported_m(floors_m: &[f64], lift_m: f64) -> Option<f64> {
        let mut all = AnkleHeights::default();
        for (id, floor_m) in (1..).zip(floors_m) {
            for instant in 0..40 {
                let lifted = f64::from(instant % 8) / 7.0;
                all.add(PersonId(id), floor_m + 0.06 + lift_m * lifted);
            }
        }
        all.above_floor_m()
    }

    #[test]
    fn a_floor_that_is_a_decimetre_off_is_reported_to_a_few_centimetres() {
        for floor_m in [-0.2, -0.13, 0.15, 0.2] {
            let above_m = reported_m(&[floor_m, floor_m + 0.01], 0.03).unwrap();
            assert!((above_m - floor_m).abs() < 0.03, "{floor_m}: {above_m}");
        }
    }

    #[test]
    fn right_floors_several_floors_and_jumping_people_are_not_reported() {
        for floor_m in [-0.08, -0.03, 0.0, 0.05, 0.1] {
            assert_eq!(reported_m(&[floor_m], 0.05), None, "{floor_m}");
        }
        // A person on a treadmill, and another one who stands lower.
        assert_eq!(reported_m(&[0.2, -0.2], 0.03), None);
        assert_eq!(reported_m(&[0.15], 0.5), None);
        assert_eq!(reported_m(&[], 0.0), None);
    }
}
