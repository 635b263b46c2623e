//! The claims on peaks of one kind of joint in one view, and the peaks.

use std::ops::Range;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Matrix3x4, Vector2, Vector3};

use crate::estimate::estimator::Estimator;
use crate::estimate::evidence::ExpectedKeypoint;
use crate::estimate::occlusion::{BodyCapsules, SightCone};
use crate::method::Method;

/// Joints whose left and right are often swapped: both sides are one kind.
const SIDED: [&str; 6] = ["shoulder", "elbow", "wrist", "hip", "knee", "ankle"];
/// Least height in a cost: a map may lack a keypoint that is there.
const LEAST_HEIGHT: f64 = 0.1;
/// Peaks of two maps closer than this are one, cells.
const ONE_PLACE_CELLS: f64 = 1.5;

/// Keypoints whose peaks may be confused.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct JointKind {
    keypoints: Vec<usize>,
}

impl JointKind {
    /// The kinds of a network's keypoints, in the order of their first keypoint.
    pub(super) fn of_network(keypoints: &KeypointSet) -> Vec<Self> {
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

/// A claim of the current group.
#[derive(Debug, Clone)]
struct GroupClaim {
    /// Its index in the kind.
    of_kind: usize,
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
    /// On the ray, at the depth of the first claim that showed it.
    point_m: Vector3<f64>,
    /// Largest distance of another peak that is the same, metres.
    width_m: f64,
}

/// The claims of one kind at one viewpoint, and those of one group of them with their peaks.
#[derive(Debug, Clone, Default)]
pub(super) struct Claims {
    members: Vec<Claimant>,
    /// Pairs of members whose lattices may touch in the view.
    near: Vec<[usize; 2]>,
    cones: Vec<[SightCone; 2]>,
    of_kind: Vec<Claim>,
    groups: Groups,
    /// The claims of the current group.
    of_group: Vec<GroupClaim>,
    peaks: Vec<ClaimedPeak>,
    places: Vec<ClaimedPlace>,
}

impl Claims {
    /// Finds the people in the views of `viewpoint`, and who is near another there.
    pub(super) fn meet(
        &mut self,
        viewpoint: ViewpointIndex,
        tracks: &[impl AsRef<Estimator>],
        bodies: &[BodyCapsules],
        method: &Method,
    ) {
        self.members.clear();
        self.cones.clear();
        // The corners of two lattices about the ends of two bodies.
        let reach_m = method.parameters.lattice.half_width_m * 3.0f64.sqrt();
        for (track, person) in tracks.iter().map(AsRef::as_ref).enumerate() {
            let Some(view) = person.views().iter().position(|v| v.viewpoint == viewpoint) else {
                continue;
            };
            let eye_m = person.views()[view].center_m();
            self.cones
                .push([0.0, reach_m].map(|more_m| bodies[track].cone(&eye_m, more_m)));
            self.members.push(Claimant {
                track,
                view,
                crowded: false,
                claims: 0..0,
            });
        }
        self.near.clear();
        for (b, [of_b, around_b]) in self.cones.iter().enumerate() {
            for (a, [of_a, around_a]) in self.cones[..b].iter().enumerate() {
                if !around_b.overlaps(around_a) {
                    continue;
                }
                self.near.push([a, b]);
                if of_b.overlaps(of_a) {
                    self.members[a].crowded = true;
                    self.members[b].crowded = true;
                }
            }
        }
    }

    /// Gathers the claims of `kind` that are near another, in groups that share no peak; returns
    /// the number of groups.
    pub(super) fn gather(
        &mut self,
        kind: &JointKind,
        tracks: &[impl AsRef<Estimator>],
        method: &Method,
    ) -> usize {
        self.of_kind.clear();
        for member in &mut self.members {
            let first = self.of_kind.len();
            if member.crowded || kind.keypoints.len() >= 2 {
                for &keypoint in &kind.keypoints {
                    // Pushed one by one: an iterator copies each several times.
                    if let Some(claim) = Claim::new(member, keypoint, tracks, method) {
                        self.of_kind.push(claim);
                    }
                }
            }
            member.claims = first..self.of_kind.len();
        }
        self.groups.reset(self.of_kind.len());
        for member in &self.members {
            for b in member.claims.clone() {
                for a in member.claims.start..b {
                    compare(&mut self.of_kind, &mut self.groups, [a, b]);
                }
            }
        }
        for &[one, other] in &self.near {
            for a in self.members[one].claims.clone() {
                for b in self.members[other].claims.clone() {
                    compare(&mut self.of_kind, &mut self.groups, [a, b]);
                }
            }
        }
        self.groups.number(|claim| self.of_kind[claim].meets)
    }

    /// Selects one group of the gathered claims.
    pub(super) fn take(&mut self, group: usize, tracks: &[impl AsRef<Estimator>]) {
        self.of_group.clear();
        self.peaks.clear();
        for (index, of_kind) in self.groups.things(group).enumerate() {
            let claim = &self.of_kind[of_kind];
            let first = self.peaks.len();
            let view = &tracks[claim.track].as_ref().views()[claim.view];
            let peaks = view.peaks(claim.keypoint).as_slice().iter();
            self.peaks.extend(peaks.map(|peak| ClaimedPeak {
                claim: index,
                place: usize::MAX,
                cell: peak.cell,
                height: peak.height,
                off_m: f64::INFINITY,
            }));
            self.of_group.push(GroupClaim {
                of_kind,
                peaks: first..self.peaks.len(),
            });
        }
    }

    /// Groups the peaks by their places; returns whether any place is shown twice.
    pub(super) fn find_places(&mut self) -> bool {
        self.places.clear();
        let mut contested = false;
        for peak in &mut self.peaks {
            let claim = &self.of_kind[self.of_group[peak.claim].of_kind];
            let Some(direction) = claim.direction_of(peak.cell) else {
                continue;
            };
            let depth_m = (claim.expected.position_m - claim.eye_m).dot(&direction);
            let point_m = claim.eye_m + direction * depth_m;
            peak.off_m = (point_m - claim.expected.position_m).norm();
            let place = ClaimedPlace {
                eye_m: claim.eye_m,
                direction,
                point_m,
                width_m: ONE_PLACE_CELLS * claim.expected.cell_m,
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

    fn claim(&self, claim: usize) -> &Claim {
        &self.of_kind[self.of_group[claim].of_kind]
    }

    pub(super) fn n_claims(&self) -> usize {
        self.of_group.len()
    }

    pub(super) fn n_places(&self) -> usize {
        self.places.len()
    }

    pub(super) fn peaks(&self) -> &[ClaimedPeak] {
        &self.peaks
    }

    /// Track, view and keypoint of a claim.
    pub(super) fn whose(&self, claim: usize) -> (usize, usize, usize) {
        let claim = self.claim(claim);
        (claim.track, claim.view, claim.keypoint)
    }

    /// The peak (cells, height) of a claim at a place, if its map shows one.
    pub(super) fn peak_of(&self, claim: usize, place: usize) -> Option<&ClaimedPeak> {
        let peaks = &self.peaks[self.of_group[claim].peaks.clone()];
        peaks.iter().find(|peak| peak.place == place)
    }

    /// The negative log likelihood that `place` is the keypoint of `claim`. If the claim shows no
    /// peak, and the distance alone costs more than `most`, the map is not read: then the result is
    /// only a lower bound above `most`.
    pub(super) fn cost(
        &self,
        claim: usize,
        place: usize,
        tracks: &[impl AsRef<Estimator>],
        most: f64,
    ) -> f64 {
        let (me, it) = (self.claim(claim), &self.places[place]);
        let far = |off_m: f64| {
            let apart = off_m / me.sigma_m;
            0.5 * apart * apart
        };
        if let Some(peak) = self.peak_of(claim, place) {
            return far(peak.off_m) + unlikely(peak.height);
        }
        let nearest_m = it.nearest_to(me.expected.position_m);
        let far = far((nearest_m - me.expected.position_m).norm());
        if far > most {
            return far;
        }
        let view = &tracks[me.track].as_ref().views()[me.view];
        let map = view.map(me.keypoint);
        let height = me.cell_of(nearest_m).map_or(0.0, |cell| map.bilinear(cell));
        far + unlikely(height)
    }
}

/// The negative log of a height: never below zero.
fn unlikely(height: f64) -> f64 {
    -libm::log(height.clamp(LEAST_HEIGHT, 1.0))
}

/// Marks two claims that are near each other, and links them if their windows touch: then they may
/// share a peak.
fn compare(claims: &mut [Claim], groups: &mut Groups, [a, b]: [usize; 2]) {
    if claims[a].is_far_from(&claims[b]) {
        return;
    }
    // In a crowd, earlier pairs have settled most.
    if claims[a].meets && claims[b].meets && groups.are_linked(a, b) {
        return;
    }
    let [one, other] = [claims[a].reaches(&claims[b]), claims[b].reaches(&claims[a])];
    if one[0] || other[0] {
        claims[a].meets = true;
        claims[b].meets = true;
    }
    if one[1] || other[1] {
        groups.link(a, b);
    }
}

impl ClaimedPlace {
    /// The known place that is the same as this one.
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

    /// The distance at which two rays pass each other near either place: cameras of one viewpoint
    /// stand close together, but not in one spot.
    fn apart_m(&self, other: &Self) -> f64 {
        let apart_m = self.distance_m(other.point_m);
        apart_m.min(other.distance_m(self.point_m))
    }
}

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

/// Groups of things by their index.
#[derive(Debug, Clone, Default)]
pub(super) struct Groups {
    /// Per thing, an earlier one of its group, or itself.
    before: Vec<usize>,
    /// Per first thing of a group, the group's number.
    numbers: Vec<Option<usize>>,
    /// Group number and index of the included things, by group.
    things: Vec<(usize, usize)>,
    /// Per group, the end of its things.
    ends: Vec<usize>,
}

impl Groups {
    /// `n` things, each alone.
    pub(super) fn reset(&mut self, n: usize) {
        self.before.clear();
        self.before.extend(0..n);
    }

    /// Merges the groups of two things.
    pub(super) fn link(&mut self, a: usize, b: usize) {
        let (a, b) = (self.first_of(a), self.first_of(b));
        self.before[a.max(b)] = a.min(b);
    }

    /// Whether two things are in one group.
    pub(super) fn are_linked(&mut self, a: usize, b: usize) -> bool {
        self.first_of(a) == self.first_of(b)
    }

    /// Numbers the groups of the `included` things in the order of their first ones; returns how
    /// many there are.
    pub(super) fn number(&mut self, included: impl Fn(usize) -> bool) -> usize {
        self.numbers.clear();
        self.numbers.resize(self.before.len(), None);
        self.things.clear();
        self.ends.clear();
        for thing in (0..self.before.len()).filter(|thing| included(*thing)) {
            let first = self.first_of(thing);
            let number = *self.numbers[first].get_or_insert_with(|| {
                self.ends.push(0);
                self.ends.len() - 1
            });
            self.ends[number] += 1;
            self.things.push((number, thing));
        }
        let mut end = 0;
        for own in &mut self.ends {
            end += *own;
            *own = end;
        }
        // By group; within one, in the original order.
        self.things.sort_unstable();
        self.ends.len()
    }

    /// The included things of a group, in order.
    pub(super) fn things(&self, group: usize) -> impl Iterator<Item = usize> {
        let first = group.checked_sub(1).map_or(0, |before| self.ends[before]);
        let own = self.things[first..self.ends[group]].iter();
        own.map(|&(_, thing)| thing)
    }

    fn first_of(&mut self, mut thing: usize) -> usize {
        while self.before[thing] != thing {
            self.before[thing] = self.before[self.before[thing]];
            thing = self.before[thing];
        }
        thing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coco_has_eleven_kinds_and_six_with_sides() {
        let kinds = JointKind::of_network(&KeypointSet::coco17());
        let sided = kinds.iter().filter(|kind| kind.keypoints.len() == 2);
        assert_eq!((kinds.len(), sided.count()), (11, 6));
    }
}

#[cfg(test)]
mod claim_tests {
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
            let drawn = meeting.true_peaks(0);
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
                let drawn = meeting.true_peaks(person);
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

#[cfg(test)]
mod groups_tests {
    use super::*;

    #[test]
    fn indirect_links_make_one_group_and_excluded_things_none() {
        let mut groups = Groups::default();
        groups.reset(7);
        for [a, b] in [[5, 6], [0, 4], [4, 2], [6, 5]] {
            groups.link(a, b);
        }
        assert!(groups.are_linked(0, 2) && !groups.are_linked(0, 5));
        assert_eq!(groups.number(|thing| thing != 0 && thing != 3), 3);
        let things = |groups: &Groups, group| groups.things(group).collect::<Vec<_>>();
        let of_groups = [0, 1, 2].map(|group| things(&groups, group));
        assert_eq!(of_groups, [vec![1], vec![2, 4], vec![5, 6]]);
        groups.reset(2);
        assert_eq!(groups.number(|_| true), 2);
        assert_eq!([0, 1].map(|group| things(&groups, group)), [[0], [1]]);
    }
}
