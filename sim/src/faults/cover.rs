//! Which keypoints are covered by bodies, as seen from one camera.

use nalgebra::Vector3;

use super::crowd::Subject;
use super::in_sight::Standpoint;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Cover {
    pub(super) by_own: bool,
    /// The other person whose body covers the keypoint: the one nearest to the camera.
    pub(super) by_other: Option<usize>,
}

impl Cover {
    pub(super) fn any(self) -> bool {
        self.by_own || self.by_other.is_some()
    }
}

/// All people who are present, seen from one position.
pub(super) struct Bodies<'a> {
    eye_m: Vector3<f64>,
    subjects: &'a [Option<Subject>],
    standpoint: Option<&'a Standpoint>,
    /// Sorted by the distance of the pelvis, nearest first.
    balls: Vec<BoundingBall>,
}

/// The bounding ball of a body, as a cone of sight.
struct BoundingBall {
    person: usize,
    /// Unit vector to its centre.
    direction: Vector3<f64>,
    /// Distance of the centre, metres.
    distance_m: f64,
    pelvis_m: f64,
    radius_m: f64,
    /// Sine and cosine of half the visual angle; `None` if the eye is inside the ball.
    half_angle: Option<(f64, f64)>,
}

impl<'a> Bodies<'a> {
    /// The present ones of `subjects`, from a camera at `eye_m` (world).
    pub(super) fn new(
        eye_m: Vector3<f64>,
        subjects: &'a [Option<Subject>],
        standpoint: Option<&'a Standpoint>,
    ) -> Self {
        let ball = |(person, subject): (usize, &'a Option<Subject>)| {
            let subject = subject.as_ref()?;
            let (center_m, radius_m) = subject.volume.bound_m;
            let sight = center_m - eye_m;
            let distance_m = sight.norm();
            let half_angle = (distance_m > radius_m).then(|| {
                let sin = radius_m / distance_m;
                (sin, (1.0 - sin * sin).sqrt())
            });
            Some(BoundingBall {
                person,
                direction: sight / distance_m.max(1e-9),
                distance_m,
                pelvis_m: (subject.torso_m - eye_m).norm(),
                radius_m,
                half_angle,
            })
        };
        let mut balls: Vec<BoundingBall> = subjects.iter().enumerate().filter_map(ball).collect();
        balls.sort_by(|a, b| a.pelvis_m.total_cmp(&b.pelvis_m));
        Self {
            eye_m,
            subjects,
            standpoint,
            balls,
        }
    }

    /// The other people who may cover a part of `person`, nearest first.
    pub(super) fn before(&self, person: usize) -> Vec<usize> {
        let Some(own) = self.balls.iter().find(|ball| ball.person == person) else {
            return Vec::new();
        };
        let others = self.balls.iter().filter(|ball| ball.person != person);
        let before =
            others.filter(|ball| ball.may_cover(own) && self.may_hide(ball.person, person));
        before.map(|ball| ball.person).collect()
    }

    fn may_hide(&self, other: usize, person: usize) -> bool {
        let (Some(at), Some(other), Some(person)) = (
            self.standpoint,
            &self.subjects[other],
            &self.subjects[person],
        ) else {
            return true;
        };
        at.may_hide(other, person)
    }

    /// What covers site `keypoint` of `person`; `before` comes from [`Self::before`].
    pub(super) fn cover(&self, person: usize, keypoint: usize, before: &[usize]) -> Cover {
        let Some(subject) = &self.subjects[person] else {
            return Cover::default();
        };
        let site_m = &subject.sites_m[keypoint];
        let covers = |other: usize| {
            let other = self.subjects[other].as_ref();
            other.is_some_and(|other| other.volume.covers(&self.eye_m, site_m, None))
        };
        Cover {
            by_own: subject.volume.covers(&self.eye_m, site_m, Some(keypoint)),
            by_other: before.iter().copied().find(|&other| covers(other)),
        }
    }
}

impl BoundingBall {
    /// Whether a line of sight to some point of `other` can meet this ball first.
    fn may_cover(&self, other: &Self) -> bool {
        let (Some((sin_a, cos_a)), Some((sin_b, cos_b))) = (self.half_angle, other.half_angle)
        else {
            return true;
        };
        let in_front = self.distance_m - self.radius_m < other.distance_m + other.radius_m;
        // Both half angles are below 90 degrees, so the cosine decreases over their sum.
        let cos_sum = cos_a * cos_b - sin_a * sin_b;
        in_front && self.direction.dot(&other.direction) >= cos_sum
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::standing;
    use super::*;

    #[test]
    fn the_coarse_test_keeps_every_person_who_covers() {
        let places = (0..6).flat_map(|i| (0..6).map(move |j| (i, j)));
        let at = |(i, j): (i32, i32)| Some(standing(f64::from(i) * 0.7, f64::from(j) * 0.45));
        let subjects: Vec<Option<Subject>> = places.map(at).collect();
        for eye_m in [
            Vector3::new(-4.0, 1.0, 2.5),
            Vector3::new(1.0, -0.3, 1.0),
            Vector3::new(2.0, 1.0, 12.0),
        ] {
            let bodies = Bodies::new(eye_m, &subjects, None);
            let mut skipped = 0;
            for (person, subject) in subjects.iter().enumerate() {
                let before = bodies.before(person);
                for q in (0..subjects.len()).filter(|q| *q != person && !before.contains(q)) {
                    skipped += 1;
                    let other = &subjects[q].as_ref().unwrap().volume;
                    let mut sites = subject.as_ref().unwrap().sites_m.iter();
                    assert!(!sites.any(|site_m| other.covers(&eye_m, site_m, None)));
                }
            }
            assert!(skipped > 100, "{skipped} of 1260");
        }
    }

    #[test]
    fn the_nearest_covering_person_is_reported() {
        let subjects: Vec<Option<Subject>> = vec![
            Some(standing(0.0, 0.0)),
            Some(standing(-1.0, 0.0)),
            None,
            Some(standing(-3.0, 0.0)),
        ];
        let bodies = Bodies::new(Vector3::new(-6.0, 0.0, 1.0), &subjects, None);
        assert_eq!(bodies.before(0), [3, 1]);
        assert_eq!(bodies.cover(0, 11, &bodies.before(0)).by_other, Some(3));
        assert_eq!(bodies.cover(3, 11, &bodies.before(3)).by_other, None);
    }
}
