//! The claims on peaks of one kind of joint in one view, and the peaks.

use std::ops::Range;

use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use nalgebra::{Vector2, Vector3};

use super::claim::{Claim, Claimant};
use super::groups::Groups;
use crate::estimate::estimator::Estimator;
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
