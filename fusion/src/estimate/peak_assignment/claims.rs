//! Who may own the peaks of one kind of joint in one view, and which peaks there are.

use std::ops::Range;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Matrix3x4, Vector2, Vector3};

use crate::estimate::estimator::Estimator;
use crate::estimate::evidence::{View, bilinear};
use crate::estimate::occlusion::BodyCapsules;
use crate::method::Method;

/// Joints whose left and right are taken for one another: both sides are one kind.
const SIDED: [&str; 6] = ["shoulder", "elbow", "wrist", "hip", "knee", "ankle"];
/// Lowest peak that counts, as cells have it: 0.1.
const LEAST_PEAK: u8 = 25;
/// Least height that a cost is made of: a map may miss what is there.
const LEAST_HEIGHT: f64 = 0.1;
/// Peaks of two maps closer than this are one, cells.
const ONE_PLACE_CELLS: f64 = 1.5;
/// Most peaks of one claim.
const MAX_PEAKS: usize = 6;

/// Keypoints whose peaks may be taken for one another.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct JointKind {
    keypoints: Vec<usize>,
}

impl JointKind {
    /// The kinds of a network's keypoints, in the order of their first keypoint.
    pub(super) fn of(keypoints: &KeypointSet) -> Vec<Self> {
        let mut kinds: Vec<(&str, Self)> = Vec::new();
        for (index, name) in keypoints.names().iter().enumerate() {
            let side = name.strip_prefix("left_").or(name.strip_prefix("right_"));
            let kind = side.filter(|joint| SIDED.contains(joint)).unwrap_or(name);
            match kinds.iter_mut().find(|(known, _)| *known == kind) {
                Some((_, known)) => known.keypoints.push(index),
                None => kinds.push((
                    kind,
                    Self {
                        keypoints: vec![index],
                    },
                )),
            }
        }
        kinds.into_iter().map(|(_, kind)| kind).collect()
    }
}

/// Somebody who is in the view.
#[derive(Debug, Clone, Copy)]
struct Claimant {
    track: usize,
    view: usize,
    /// Whether anybody else comes near in the view.
    crowded: bool,
}

/// One keypoint of one person.
#[derive(Debug, Clone)]
struct Claim {
    track: usize,
    view: usize,
    keypoint: usize,
    predicted_m: Vector3<f64>,
    /// Expected error of the prediction, metres.
    sigma_m: f64,
    eye_m: Vector3<f64>,
    cell_from_world: Matrix3x4<f64>,
    /// The prediction in the map.
    cell: Vector2<f64>,
    /// Metres per cell at the prediction.
    cell_m: f64,
    /// Whether another's prediction is in reach, or this in another's.
    meets: bool,
    /// Its peaks.
    peaks: Range<usize>,
}

/// A peak in the map of a claim.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClaimedPeak {
    pub(super) claim: usize,
    pub(super) place: usize,
    pub(super) cell: Vector2<f64>,
    /// 0 to 1.
    pub(super) height: f64,
    /// Distance of its ray from the claim's prediction, metres.
    off_m: f64,
}

/// A physical peak: the ray on which it lies, world.
#[derive(Debug, Clone, Copy)]
struct ClaimedPlace {
    eye_m: Vector3<f64>,
    direction: Vector3<f64>,
    /// On the ray, at the depth of the claim that showed it first.
    point_m: Vector3<f64>,
    /// How near another peak must be to be the same, metres.
    width_m: f64,
}

/// The claims of one kind at one viewpoint, with their peaks.
#[derive(Debug, Clone, Default)]
pub(super) struct Claims {
    members: Vec<Claimant>,
    all: Vec<Claim>,
    peaks: Vec<ClaimedPeak>,
    places: Vec<ClaimedPlace>,
}

impl Claims {
    /// Finds who is in the views of `viewpoint`, and who is near somebody there.
    pub(super) fn meet(
        &mut self,
        viewpoint: ViewpointIndex,
        tracks: &[impl AsRef<Estimator>],
        bodies: &[BodyCapsules],
    ) {
        self.members.clear();
        for (track, person) in tracks.iter().map(AsRef::as_ref).enumerate() {
            let view = person.views().iter().position(|v| v.viewpoint == viewpoint);
            self.members.extend(view.map(|view| Claimant {
                track,
                view,
                crowded: false,
            }));
        }
        for i in 0..self.members.len() {
            let me = self.members[i];
            let eye_m = tracks[me.track].as_ref().views()[me.view].center_m();
            for j in 0..i {
                let other = self.members[j].track;
                if bodies[me.track].overlaps(&bodies[other], eye_m) {
                    self.members[i].crowded = true;
                    self.members[j].crowded = true;
                }
            }
        }
    }

    /// Gathers the claims of `kind` that come near another.
    pub(super) fn gather(
        &mut self,
        kind: &JointKind,
        tracks: &[impl AsRef<Estimator>],
        method: &Method,
    ) {
        self.all.clear();
        for member in &self.members {
            if !member.crowded && kind.keypoints.len() < 2 {
                continue;
            }
            for &keypoint in &kind.keypoints {
                self.all
                    .extend(Claim::new(member, keypoint, tracks, method));
            }
        }
        // The corner of a face of the lattice.
        let reach_m = method.parameters.lattice.half_width_m * 2.0f64.sqrt();
        for i in 0..self.all.len() {
            for j in 0..i {
                let (a, b) = (&self.all[i], &self.all[j]);
                if a.reaches(b, reach_m) || b.reaches(a, reach_m) {
                    self.all[i].meets = true;
                    self.all[j].meets = true;
                }
            }
        }
        self.all.retain(|claim| claim.meets);
        self.peaks.clear();
        for (index, claim) in self.all.iter_mut().enumerate() {
            let first = self.peaks.len();
            let view = &tracks[claim.track].as_ref().views()[claim.view];
            find_peaks(view, claim, reach_m, index, &mut self.peaks);
            claim.peaks = first..self.peaks.len();
        }
    }

    /// Groups the peaks by the places that they show; whether any place is shown twice.
    pub(super) fn find_places(&mut self) -> bool {
        self.places.clear();
        let mut contested = false;
        for peak in &mut self.peaks {
            let claim = &self.all[peak.claim];
            let Some(direction) = claim.direction_of(peak.cell) else {
                continue;
            };
            let depth_m = (claim.predicted_m - claim.eye_m).dot(&direction);
            let point_m = claim.eye_m + direction * depth_m;
            peak.off_m = (point_m - claim.predicted_m).norm();
            let place = ClaimedPlace {
                eye_m: claim.eye_m,
                direction,
                point_m,
                width_m: ONE_PLACE_CELLS * claim.cell_m,
            };
            if let Some(known) = place.among(&self.places) {
                peak.place = known;
                contested = true;
            } else {
                peak.place = self.places.len();
                self.places.push(place);
            }
        }
        contested
    }

    pub(super) fn n_claims(&self) -> usize {
        self.all.len()
    }

    pub(super) fn n_places(&self) -> usize {
        self.places.len()
    }

    pub(super) fn peaks(&self) -> &[ClaimedPeak] {
        &self.peaks
    }

    /// Track, view and keypoint of a claim.
    pub(super) fn whose(&self, claim: usize) -> (usize, usize, usize) {
        let claim = &self.all[claim];
        (claim.track, claim.view, claim.keypoint)
    }

    /// The peak (cells, height) of a claim at a place, if its map shows one.
    pub(super) fn peak_of(&self, claim: usize, place: usize) -> Option<&ClaimedPeak> {
        let peaks = &self.peaks[self.all[claim].peaks.clone()];
        peaks.iter().find(|peak| peak.place == place)
    }

    /// The negative log likelihood that `place` is the keypoint of `claim`.
    pub(super) fn cost(&self, claim: usize, place: usize, tracks: &[impl AsRef<Estimator>]) -> f64 {
        let (me, it) = (&self.all[claim], &self.places[place]);
        let (off_m, height) = self.peak_of(claim, place).map_or_else(
            || {
                let view = &tracks[me.track].as_ref().views()[me.view];
                let nearest_m = it.nearest_to(me.predicted_m);
                let height = me.cell_of(nearest_m).map_or(0.0, |cell| {
                    bilinear(view.cells(me.keypoint), view.map_size(), cell)
                });
                ((nearest_m - me.predicted_m).norm(), height)
            },
            |peak| (peak.off_m, peak.height),
        );
        let apart = off_m / me.sigma_m;
        0.5 * apart * apart - libm::log(height.max(LEAST_HEIGHT))
    }
}

impl Claim {
    /// `None` where the view knows nothing about the keypoint.
    fn new(
        member: &Claimant,
        keypoint: usize,
        tracks: &[impl AsRef<Estimator>],
        method: &Method,
    ) -> Option<Self> {
        let track = tracks[member.track].as_ref();
        let view = &track.views()[member.view];
        let predicted_m = *view.predicted_m.get(keypoint)?;
        if !predicted_m.iter().all(|v| v.is_finite()) {
            return None;
        }
        let contact = &method.parameters.contact;
        let seen = track
            .estimates()
            .get(keypoint)
            .is_some_and(|e| e.views >= 2);
        let cell_from_world = view.cell_from_world(keypoint);
        let mut claim = Self {
            track: member.track,
            view: member.view,
            keypoint,
            predicted_m,
            sigma_m: if seen {
                contact.seen_sigma_m
            } else {
                contact.unseen_sigma_m
            },
            eye_m: view.center_m(),
            cell_from_world,
            cell: Vector2::zeros(),
            cell_m: 0.0,
            meets: false,
            peaks: 0..0,
        };
        claim.cell = claim.cell_of(predicted_m)?;
        if !view.knows(keypoint, claim.cell) {
            return None;
        }
        let depth_m = (cell_from_world * predicted_m.push(1.0)).z;
        let focal_cells = cell_from_world.fixed_view::<2, 3>(0, 0)
            - claim.cell * cell_from_world.fixed_view::<1, 3>(2, 0);
        claim.cell_m = depth_m * 2.0f64.sqrt() / focal_cells.norm();
        Some(claim)
    }

    /// Where a point (world, metres) is in the map; `None` behind the camera.
    fn cell_of(&self, point_m: Vector3<f64>) -> Option<Vector2<f64>> {
        let h = self.cell_from_world * point_m.push(1.0);
        (h.z > 0.0).then(|| Vector2::new(h.x, h.y) / h.z)
    }

    /// The direction, world, unit, in which a cell of the map lies.
    fn direction_of(&self, cell: Vector2<f64>) -> Option<Vector3<f64>> {
        // The rows of a pinhole's matrix are what a ray is at right angles to: cell x is where
        // (row 0 - x row 2) vanishes, and y likewise.
        let row = |i: usize| self.cell_from_world.fixed_view::<1, 3>(i, 0).transpose();
        let across = row(0) - row(2) * cell.x;
        let down = row(1) - row(2) * cell.y;
        let direction = across.cross(&down).try_normalize(f64::MIN_POSITIVE)?;
        Some(direction * direction.dot(&row(2)).signum())
    }

    /// Whether the keypoint of `other` is seen within `reach_m` of this one.
    fn reaches(&self, other: &Self, reach_m: f64) -> bool {
        let cell = self.cell_of(other.predicted_m);
        cell.is_some_and(|cell| (cell - self.cell).norm() * self.cell_m < reach_m)
    }
}

impl ClaimedPlace {
    /// Which of the known places this is.
    fn among(&self, known: &[Self]) -> Option<usize> {
        let apart = known.iter().map(|place| place.apart_m(self)).enumerate();
        let (nearest, apart_m) = apart.min_by(|a, b| a.1.total_cmp(&b.1))?;
        (apart_m <= self.width_m.max(known[nearest].width_m)).then_some(nearest)
    }

    fn nearest_to(&self, point_m: Vector3<f64>) -> Vector3<f64> {
        self.eye_m + self.direction * (point_m - self.eye_m).dot(&self.direction)
    }

    fn distance_m(&self, point_m: Vector3<f64>) -> f64 {
        (self.nearest_to(point_m) - point_m).norm()
    }

    /// How far two rays pass each other where either was found: cameras of one viewpoint stand close
    /// together, but not in one spot.
    fn apart_m(&self, other: &Self) -> f64 {
        let apart_m = self.distance_m(other.point_m);
        apart_m.min(other.distance_m(self.point_m))
    }
}

/// The highest peaks in the map of `claim` within `reach_m` of its prediction.
fn find_peaks(
    view: &View,
    claim: &Claim,
    reach_m: f64,
    index: usize,
    peaks: &mut Vec<ClaimedPeak>,
) {
    let (width, height) = view.map_size();
    let cells = view.cells(claim.keypoint);
    let first = peaks.len();
    for (start, row) in view.rows_near(claim.keypoint, claim.cell, reach_m / claim.cell_m) {
        for (offset, &value) in row.iter().enumerate() {
            let cell = start + offset;
            if value < LEAST_PEAK || !is_highest(cells, (width, height), cell) {
                continue;
            }
            let peak = ClaimedPeak {
                claim: index,
                place: usize::MAX,
                cell: top_of(cells, (width, height), cell),
                height: f64::from(value) / 255.0,
                off_m: f64::INFINITY,
            };
            let own = &peaks[first..];
            let at = first + own.iter().take_while(|p| p.height >= peak.height).count();
            peaks.insert(at, peak);
            peaks.truncate(first + MAX_PEAKS);
        }
    }
}

/// The top of a peak whose highest cell is `cell`: of a parabola through its neighbours per axis.
fn top_of(cells: &[u8], (width, height): (usize, usize), cell: usize) -> Vector2<f64> {
    let (x, y) = (cell % width, cell / width);
    let value = |x: usize, y: usize| f64::from(cells[y * width + x]);
    let shift = |before: f64, after: f64| {
        let bend = 2.0 * value(x, y) - before - after;
        if bend > 0.0 {
            (0.5 * (after - before) / bend).clamp(-0.5, 0.5)
        } else {
            0.0
        }
    };
    let (left, right) = (
        value(x.saturating_sub(1), y),
        value((x + 1).min(width - 1), y),
    );
    let (above, below) = (
        value(x, y.saturating_sub(1)),
        value(x, (y + 1).min(height - 1)),
    );
    Vector2::new(
        x as f64 + shift(left, right),
        y as f64 + shift(above, below),
    )
}

/// Whether none of a cell's neighbours is higher; of a plateau, its first cell counts.
fn is_highest(cells: &[u8], (width, height): (usize, usize), cell: usize) -> bool {
    let (x, y) = (cell % width, cell / width);
    let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
    let mut rows = y.saturating_sub(1)..=(y + 1).min(height - 1);
    rows.all(|y| {
        columns.clone().all(|x| {
            let other = y * width + x;
            cells[other] < cells[cell] || (cells[other] == cells[cell] && other >= cell)
        })
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::meeting_fixture::{LEFT_WRIST, MeetingFixture};
    use super::*;

    #[test]
    fn coco_has_eleven_kinds_and_six_of_them_have_sides() {
        let kinds = JointKind::of(&KeypointSet::coco17());
        let sided = kinds.iter().filter(|kind| kind.keypoints.len() == 2);
        assert_eq!((kinds.len(), sided.count()), (11, 6));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        /// The ray of a point's cell goes through the point, whichever camera looks.
        #[test]
        fn the_ray_of_a_cell_is_projection_undone(
            camera in 0usize..4, off in prop::array::uniform3(-0.5f64..0.5),
        ) {
            let mut meeting = MeetingFixture::of(&[[0.3, -0.2, 0.8]]);
            meeting.begin();
            let drawn = meeting.as_they_are(0);
            meeting.show(0, camera, &drawn);
            meeting.place();
            let member = Claimant { track: 0, view: 0, crowded: true };
            let claim = Claim::new(&member, LEFT_WRIST, &meeting.tracks, &meeting.method).unwrap();
            let point_m = claim.predicted_m + Vector3::from(off);
            let direction = claim.direction_of(claim.cell_of(point_m).unwrap()).unwrap();
            let from_eye_m = point_m - claim.eye_m;
            prop_assert!((from_eye_m - direction * from_eye_m.norm()).norm() < 1e-9);
            // A cell is as wide as it is said to be, across the line of sight.
            let beside_m = claim.predicted_m + direction.cross(&Vector3::z()).normalize() * 0.01;
            let cells = (claim.cell_of(beside_m).unwrap() - claim.cell).norm();
            prop_assert!((cells * claim.cell_m - 0.01).abs() < 0.001);
        }
    }
}
