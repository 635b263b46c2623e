//! One keypoint of one person in one view: where it is expected, and which others are near it.

use std::ops::Range;

use nalgebra::{Matrix3x4, Vector2, Vector3};

use crate::estimate::estimator::Estimator;
use crate::estimate::evidence::ExpectedKeypoint;
use crate::method::Method;

/// Claims whose predictions are farther apart than so many windows' reaches share no peak: two
/// reaches, and some tolerance for one place.
const TOUCHING_REACHES: f64 = 2.25;
/// Far above the rounding error of the cosine between two unit vectors.
const COSINE_ROUNDING: f64 = 1e-9;

/// A person in the view.
#[derive(Debug, Clone)]
pub(super) struct Claimant {
    pub(super) track: usize,
    pub(super) view: usize,
    /// Whether another person is near in the view.
    pub(super) crowded: bool,
    /// Their claims of the current kind.
    pub(super) claims: Range<usize>,
}

/// One keypoint of one person.
#[derive(Debug, Clone)]
pub(super) struct Claim {
    pub(super) track: usize,
    pub(super) view: usize,
    pub(super) keypoint: usize,
    pub(super) expected: ExpectedKeypoint,
    /// Offset from there (metres, homogeneous) to homogeneous cells of its map.
    pub(super) cell_from_offset: Matrix3x4<f64>,
    /// Distance of the corner of a face of its lattice from its cell.
    pub(super) reach_cells: f64,
    /// Direction in which it is seen, world, unit.
    pub(super) direction: Vector3<f64>,
    /// Lower bound of the cosine of the angle to directions inside the window.
    pub(super) window_cosine: f64,
    /// Expected error of the prediction, metres.
    pub(super) sigma_m: f64,
    pub(super) eye_m: Vector3<f64>,
    /// Whether another's prediction is in reach, or this in another's.
    pub(super) meets: bool,
}

impl Claim {
    /// `None` if the view has no data about the keypoint.
    pub(super) fn new(
        member: &Claimant,
        keypoint: usize,
        tracks: &[impl AsRef<Estimator>],
        method: &Method,
    ) -> Option<Self> {
        let track = tracks[member.track].as_ref();
        let view = &track.views()[member.view];
        let expected = view.expected(keypoint)?;
        let contact = &method.parameters.contact;
        let reach_m = method.parameters.lattice.half_width_m * 2.0f64.sqrt();
        let seen = track
            .estimates()
            .get(keypoint)
            .is_some_and(|e| e.views >= 2);
        let (reach_cells, eye_m) = (reach_m / expected.cell_m, view.center_m());
        let corner_cells = 2.0f64.sqrt() * TOUCHING_REACHES * reach_cells;
        // The angle between two directions is at most the distance of their places in a picture
        // over the focal length.
        let window_rad = corner_cells / least_focal_length_cells(view.cell_from_world(keypoint));
        Some(Self {
            track: member.track,
            view: member.view,
            keypoint,
            direction: (expected.position_m - eye_m).normalize(),
            window_cosine: 1.0 - 0.5 * window_rad * window_rad - COSINE_ROUNDING,
            expected: *expected,
            cell_from_offset: view.cell_from_offset(keypoint, expected),
            reach_cells,
            sigma_m: if seen {
                contact.seen_sigma_m
            } else {
                contact.unseen_sigma_m
            },
            eye_m,
            meets: false,
        })
    }

    /// The homogeneous place of a point (world, metres) in the map.
    pub(super) fn project(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let offset_m = point_m - self.expected.position_m;
        self.cell_from_offset * offset_m.push(1.0)
    }

    /// The place of a point (world, metres) in the map; `None` behind the camera.
    pub(super) fn cell_of(&self, point_m: Vector3<f64>) -> Option<Vector2<f64>> {
        let h = self.project(&point_m);
        (h.z > 0.0).then(|| Vector2::new(h.x, h.y) / h.z)
    }

    /// The direction of a cell of the map, world, unit.
    pub(super) fn direction_of(&self, cell: Vector2<f64>) -> Option<Vector3<f64>> {
        // A ray is perpendicular to combinations of the rows of a pinhole's matrix: cell x is where
        // (row 0 - x row 2) vanishes, and likewise y.
        let m = &self.cell_from_offset;
        let row = |i: usize| Vector3::new(m[(i, 0)], m[(i, 1)], m[(i, 2)]);
        let across = row(0) - row(2) * cell.x;
        let down = row(1) - row(2) * cell.y;
        let direction = across.cross(&down).try_normalize(f64::MIN_POSITIVE)?;
        Some(direction * direction.dot(&row(2)).signum())
    }

    /// Whether certainly neither is in the window of the other; false is not certain.
    #[inline]
    pub(super) fn is_far_from(&self, other: &Self) -> bool {
        let cosine = self.direction.dot(&other.direction);
        cosine < self.window_cosine.min(other.window_cosine) && self.eye_m == other.eye_m
    }

    /// Whether the keypoint of `other` is within reach of this one, and whether their windows
    /// touch.
    #[inline]
    pub(super) fn reaches(&self, other: &Self) -> [bool; 2] {
        let h = self.project(&other.expected.position_m);
        let cell = &self.expected.cell;
        // Cells times a positive depth: a division for each pair of a crowd would be most of the
        // work.
        let apart = Vector2::new(h.x - cell.x * h.z, h.y - cell.y * h.z);
        let reach = self.reach_cells * h.z;
        let touching = TOUCHING_REACHES * reach;
        [
            h.z > 0.0 && apart.norm_squared() < reach * reach,
            h.z > 0.0 && apart.x.abs() < touching && apart.y.abs() < touching,
        ]
    }
}

/// The focal length of a map, cells, along the axis in which it is shorter.
///
/// ```text
///   M = A (r1, r2) + c r3,   M: the first two rows, rᵢ those of a rotation      A A' = [p q; q r]
/// ```
fn least_focal_length_cells(cell_from_world: &Matrix3x4<f64>) -> f64 {
    let row = |i: usize| cell_from_world.fixed_view::<1, 3>(i, 0).transpose();
    let ahead = row(2);
    let across = [row(0), row(1)].map(|row| row - ahead * row.dot(&ahead));
    let (p, q, r) = (
        across[0].norm_squared(),
        across[0].dot(&across[1]),
        across[1].norm_squared(),
    );
    let half = 0.5 * (p - r);
    let least = 0.5 * (p + r) - (half * half + q * q).sqrt();
    least.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::meeting_fixture::{LEFT_WRIST, MeetingFixture};
    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// The ray of a point's cell goes through the point, in every camera.
        #[test]
        fn the_ray_of_a_cell_inverts_the_projection(
            camera in 0usize..4, off in prop::array::uniform3(-0.5f64..0.5),
        ) {
            let mut meeting = MeetingFixture::at(&[[0.3, -0.2, 0.8]]);
            meeting.begin();
            let drawn = meeting.as_they_are(0);
            meeting.show(0, camera, &drawn);
            meeting.place();
            let member = Claimant { track: 0, view: 0, crowded: true, claims: 0..0 };
            let claim = Claim::new(&member, LEFT_WRIST, &meeting.tracks, &meeting.method).unwrap();
            let point_m = claim.expected.position_m + Vector3::from(off);
            let direction = claim.direction_of(claim.cell_of(point_m).unwrap()).unwrap();
            let from_eye_m = point_m - claim.eye_m;
            prop_assert!((from_eye_m - direction * from_eye_m.norm()).norm() < 1e-9);
            // A cell has the width `cell_m`, across the line of sight.
            let across_m = claim.expected.position_m + direction.cross(&Vector3::z()).normalize() * 0.01;
            let cells = (claim.cell_of(across_m).unwrap() - claim.expected.cell).norm();
            prop_assert!((cells * claim.expected.cell_m - 0.01).abs() < 0.001);
        }

        /// Claims that are certainly in neither's window are in none, wherever people stand.
        #[test]
        fn distant_claims_are_in_no_window(
            camera in 0usize..4, x in -3.5f64..3.5, y in -2.5f64..2.5, turn in -3.0f64..3.0,
        ) {
            let mut meeting = MeetingFixture::at(&[[0.3, -0.2, 0.8], [x, y, turn]]);
            meeting.begin();
            for person in 0..2 {
                let drawn = meeting.as_they_are(person);
                meeting.show(person, camera, &drawn);
            }
            meeting.place();
            let claims = |track: usize| {
                let member = Claimant { track, view: 0, crowded: true, claims: 0..0 };
                let of = |k| Claim::new(&member, k, &meeting.tracks, &meeting.method);
                (0..17).filter_map(of).collect::<Vec<Claim>>()
            };
            let (ones, others) = (claims(0), claims(1));
            for (one, other) in ones.iter().flat_map(|one| others.iter().map(move |other| (one, other))) {
                let near = one.reaches(other).contains(&true) || other.reaches(one).contains(&true);
                prop_assert!(!(near && one.is_far_from(other)));
            }
        }
    }
}
