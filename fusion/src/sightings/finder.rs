//! Finds new persons: bodies that several viewpoints see and that are not tracked yet.
//!
//! # Bodies from sightings of people outside the field, whose rays meet inside it
//!
//! Groups compete for their witnesses (module `association`) only with rays that meet
//! in the field, because a crowd around it has far more rays that do not. So people who wait
//! outside the field take no witness out of a group, and two views of two of them can form a body
//! in the field. A small group is therefore compared with the others again, wherever rays meet.
//! Members that fit a person elsewhere better are removed.

use std::cmp::Reverse;
use std::collections::BTreeSet;

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::Sighting;
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::Vector3;

use super::agreement::{Gates, agree};
use super::association::associate;
use super::attention::Attention;
use super::contradiction::DetectionPass;
pub use super::explanation::KnownBody;
use super::explanation::{Explanation, body_distance_m};
use super::plausibility::is_plausible;
use super::rays::{SightedBody, witnesses};
pub use super::reconstruction::SightedKeypoint;
use super::reconstruction::{Reconstruction, reconstruct};
use crate::body::observed::{KeypointEstimate, ObservedJoints};
use crate::body::skeleton::{Joint, Site};

/// How far outside the field a body's middle may be, metres: its keypoints are a few centimetres
/// off.
const FIELD_SLACK_M: f64 = 0.1;

/// A person that at least two viewpoints see.
#[derive(Debug, Clone, PartialEq)]
pub struct SightedPerson {
    /// Per keypoint of the network, if at least two viewpoints agree on it.
    pub keypoints_m: Vec<Option<SightedKeypoint>>,
    /// How many viewpoints see the person.
    pub views: u16,
}

impl SightedPerson {
    /// The sighted keypoints, weighted by their scores. `sites` are those of the network's
    /// keypoints; of two keypoints on one joint the first is used.
    pub fn observed(&self, sites: &[Option<Site>]) -> ObservedJoints {
        let mut observed = ObservedJoints::default();
        for (site, point) in sites.iter().zip(&self.keypoints_m) {
            if let (Some(site), Some(point)) = (site, point)
                && observed.point(site.joint).is_none()
            {
                observed.set_site(site, point.position_m, point.score);
            }
        }
        observed
    }

    /// The sighted keypoints in the form of lattice estimates.
    pub(crate) fn estimates(&self) -> Vec<KeypointEstimate> {
        let unsupported = KeypointEstimate::unsupported(Vector3::repeat(f64::NAN), 0.0);
        let estimate = |point: &Option<SightedKeypoint>| {
            point.as_ref().map_or_else(
                || unsupported.clone(),
                |p| KeypointEstimate {
                    position_m: p.position_m,
                    support: p.score,
                    weight: p.score,
                    views: p.views,
                    ..unsupported.clone()
                },
            )
        };
        self.keypoints_m.iter().map(estimate).collect()
    }
}

/// Finds persons among the sightings of one tick.
#[derive(Debug, Clone)]
pub struct PersonFinder {
    cameras: Vec<(ViewpointIndex, CameraModel)>,
    keypoints: KeypointSet,
    gates: Gates,
    min_score: f64,
    explained_m: f64,
    attention: Attention,
}

/// A group inside the field with the proportions of a body, and the other viewpoints that miss it.
struct BodyGroup {
    members: Vec<usize>,
    missed_by: Vec<ViewpointIndex>,
    is_person: bool,
}

impl PersonFinder {
    /// `cameras` are those of the venue, in the order of their indices.
    pub fn new(
        cameras: Vec<(ViewpointIndex, CameraModel)>,
        keypoints: KeypointSet,
        field: &Field,
        parameters: &BirthParameters,
    ) -> Self {
        let gates = Gates {
            ray_distance_m: parameters.ray_distance_m,
            min_keypoints: parameters.min_keypoints as usize,
            field_min_m: Vector3::from(field.min_m),
            field_max_m: Vector3::from(field.max_m),
        };
        let viewpoints = cameras.iter().map(|camera| usize::from(camera.0.0) + 1);
        Self {
            attention: Attention::new(viewpoints.max().unwrap_or(0)),
            cameras,
            keypoints,
            gates,
            min_score: parameters.min_score,
            explained_m: parameters.explained_m,
        }
    }

    /// The pass of `sightings` of one tick; `detected` states per camera whether its detector ran.
    pub(crate) fn detection_pass(
        &self,
        sightings: &[Sighting],
        detected: Vec<bool>,
    ) -> DetectionPass {
        let n_keypoints = self.keypoints.len();
        let witnesses = witnesses(sightings, &self.cameras, n_keypoints, self.min_score);
        DetectionPass::new(witnesses, detected)
    }

    /// The persons in `sightings` of one tick, of all cameras, that are not `tracked`. Best
    /// supported first.
    pub fn find(&mut self, sightings: &[Sighting], tracked: &[KnownBody]) -> Vec<SightedPerson> {
        let pass = self.detection_pass(sightings, vec![true; self.cameras.len()]);
        let tracked = self.explain(&pass, tracked.to_vec());
        self.find_in(&pass, &tracked, tracked.bodies.len())
    }

    /// Which witnesses of a pass `bodies` explain.
    pub(crate) fn explain(&self, pass: &DetectionPass, bodies: Vec<KnownBody>) -> Explanation {
        Explanation::new(&pass.witnesses, bodies, self.explained_m)
    }

    /// As [`Self::find`]. Only the first `n_people` bodies of the explanation are people; the
    /// others are posters and do not count as seen or missed people.
    pub(crate) fn find_in(
        &mut self,
        pass: &DetectionPass,
        explanation: &Explanation,
        n_people: usize,
    ) -> Vec<SightedPerson> {
        let all = &pass.witnesses;
        let Explanation {
            bodies: tracked,
            by: explained,
        } = explanation;
        let free: Vec<usize> = (0..all.len()).filter(|&w| explained[w].is_none()).collect();
        let mut bodies = Vec::new();
        let groups = associate(all, &free, &self.gates, |group| {
            let body = self.body_group(group, pass, &self.gates);
            let is_person = body.as_ref().is_some_and(|body| body.is_person);
            bodies.extend(body);
            is_person
        });
        bodies.retain(|body| !body.is_person || groups.iter().any(|g| g.members == body.members));
        let people = &tracked[..n_people.min(tracked.len())];
        self.learn(pass, people, explained, bodies);
        let is_new = |group: &Reconstruction| {
            !tracked
                .iter()
                .any(|body| body_distance_m(group, body).is_some_and(|d| d < self.explained_m))
        };
        groups
            .into_iter()
            .filter(is_new)
            .filter_map(|group| self.without_outsiders(group, pass, &free))
            .map(SightedPerson::from)
            .collect()
    }

    /// The one body that `sightings` of one tick agree on, of one person and each of a different
    /// viewpoint. `None` if as many of them agree on another.
    pub(crate) fn agreed(&self, sightings: &[Sighting]) -> Option<SightedPerson> {
        if sightings.len() < 2 {
            return None;
        }
        let pass = self.detection_pass(sightings, vec![true; self.cameras.len()]);
        let all: Vec<usize> = (0..pass.witnesses.len()).collect();
        let mut groups = associate(&pass.witnesses, &all, &self.gates, |group| {
            self.body_group(group, &pass, &self.gates).is_some()
        });
        groups.sort_by_key(|group| Reverse(group.members.len()));
        let mut groups = groups.into_iter();
        let (best, next) = (groups.next()?, groups.next());
        let is_clear = next.is_none_or(|next| next.members.len() < best.members.len());
        is_clear.then(|| best.into())
    }

    /// Witnesses that are seen well but that no body explains.
    pub(crate) fn unexplained<'a>(
        &self,
        pass: &'a DetectionPass,
        explanation: &'a Explanation,
    ) -> impl Iterator<Item = &'a SightedBody> {
        let explained = &explanation.by;
        let min_keypoints = self.gates.min_keypoints;
        let seen_well = move |w: &SightedBody| w.rays.iter().flatten().count() >= min_keypoints;
        let witnesses = pass.witnesses.iter().zip(explained);
        witnesses.filter_map(move |(w, by)| (by.is_none() && seen_well(w)).then_some(w))
    }

    /// The votes on a tentative `body` of the viewpoints that see any person: how many see it, and
    /// the weight of those that should and do not.
    pub(crate) fn verdicts(&self, pass: &DetectionPass, body: &KnownBody) -> (u32, f64) {
        let explanation = self.explain(pass, vec![body.clone()]);
        let (mut seen, mut missed_by) = (0, Vec::new());
        for &viewpoint in pass.viewpoints() {
            let mut own = pass.witnesses.iter().zip(&explanation.by);
            if own.any(|(w, by)| by.is_some() && w.viewpoint == viewpoint) {
                seen += 1;
            } else if pass.is_missed_by(viewpoint, &self.cameras, &body.keypoints_m) {
                missed_by.push(viewpoint);
            }
        }
        let missed = self.attention.weight_of_all(&missed_by, seen as usize);
        (seen, missed)
    }

    /// The body of a group inside the field of `gates`. Whether it is a person depends on the
    /// weight of the silent viewpoints. Removes keypoints from the group that do not fit the body.
    fn body_group(
        &self,
        group: &mut Reconstruction,
        pass: &DetectionPass,
        gates: &Gates,
    ) -> Option<BodyGroup> {
        let mut body = self.observed(&group.keypoints_m);
        let cut_before = body.count();
        if !is_plausible(&mut body) {
            return None;
        }
        if body.count() < cut_before {
            self.keep_only(&body, &mut group.keypoints_m);
        }
        let points = group.keypoints_m.iter().flatten();
        let points: Vec<Vector3<f64>> = points.map(|k| k.position_m).collect();
        if points.len() < gates.min_keypoints {
            return None;
        }
        let middle = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        if !gates.inside(&middle, FIELD_SLACK_M) {
            return None;
        }
        let missed_by = missed_by(&self.cameras, group, &points, pass);
        let seen_by = group.members.len();
        Some(BodyGroup {
            members: group.members.clone(),
            is_person: self.attention.weight_of_all(&missed_by, seen_by) < seen_by as f64,
            missed_by,
        })
    }

    /// Updates what each viewpoint saw and missed in a pass: the `tracked`, the found people, and
    /// the groups that silent viewpoints rejected. No witness counts twice.
    fn learn(
        &mut self,
        pass: &DetectionPass,
        tracked: &[KnownBody],
        explained: &[Option<usize>],
        mut bodies: Vec<BodyGroup>,
    ) {
        self.attention.fade();
        let explanations = explained.iter().zip(&pass.witnesses);
        let seen: BTreeSet<(usize, ViewpointIndex)> = explanations
            .filter_map(|(by, witness)| Some(((*by)?, witness.viewpoint)))
            .collect();
        for (t, body) in tracked.iter().enumerate() {
            for &viewpoint in pass.viewpoints() {
                if seen.contains(&(t, viewpoint)) {
                    self.attention.saw(viewpoint);
                } else if pass.is_missed_by(viewpoint, &self.cameras, &body.keypoints_m) {
                    self.attention.missed(viewpoint);
                }
            }
        }
        bodies.sort_by(|a, b| {
            let key = |body: &BodyGroup| {
                let most = Reverse(body.members.len());
                (!body.is_person, most, body.missed_by.len())
            };
            key(a).cmp(&key(b)).then_with(|| a.members.cmp(&b.members))
        });
        let mut counted: BTreeSet<usize> = BTreeSet::new();
        for group in &bodies {
            if group.members.iter().any(|member| counted.contains(member)) {
                continue;
            }
            counted.extend(&group.members);
            for &member in &group.members {
                self.attention.saw(pass.witnesses[member].viewpoint);
            }
            for &viewpoint in &group.missed_by {
                self.attention.missed(viewpoint);
            }
        }
    }

    fn observed(&self, keypoints_m: &[Option<SightedKeypoint>]) -> ObservedJoints {
        let mut body = ObservedJoints::default();
        for (name, point) in self.keypoints.names().iter().zip(keypoints_m) {
            if let (Some(joint), Some(point)) = (Joint::from_name(name), point) {
                body.set(joint, point.position_m, point.score);
            }
        }
        body
    }

    fn keep_only(&self, body: &ObservedJoints, keypoints_m: &mut [Option<SightedKeypoint>]) {
        for (name, point) in self.keypoints.names().iter().zip(keypoints_m) {
            if Joint::from_name(name).is_some_and(|joint| body.point(joint).is_none()) {
                *point = None;
            }
        }
    }
}

/// The other viewpoints that should see the body of `group` and do not.
fn missed_by(
    cameras: &[(ViewpointIndex, CameraModel)],
    group: &Reconstruction,
    points_m: &[Vector3<f64>],
    pass: &DetectionPass,
) -> Vec<ViewpointIndex> {
    let members = group.members.iter().map(|&m| pass.witnesses[m].viewpoint);
    let others = pass.viewpoints().iter().copied();
    others
        .filter(|viewpoint| !members.clone().any(|member| member == *viewpoint))
        .filter(|&viewpoint| pass.is_missed_by(viewpoint, cameras, points_m))
        .collect()
}

impl From<Reconstruction> for SightedPerson {
    fn from(group: Reconstruction) -> Self {
        Self {
            keypoints_m: group.keypoints_m,
            views: group.members.len() as u16,
        }
    }
}

/// Only groups of at most this many viewpoints are checked: in any crowd rays of so many meet by
/// chance.
const FEW: usize = 3;
/// The same as a share of the viewpoints that see any person: with many viewpoints, rays of more
/// meet by chance. A body that most of them see is a person.
const FEW_SHARE: f64 = 0.5;

impl PersonFinder {
    /// `group` without members that fit a body of the `free` witnesses of `pass` outside the field
    /// better; `None` if no person is left.
    fn without_outsiders(
        &self,
        group: Reconstruction,
        pass: &DetectionPass,
        free: &[usize],
    ) -> Option<Reconstruction> {
        let few = FEW_SHARE * pass.viewpoints().len() as f64;
        if group.members.len() > FEW && group.members.len() as f64 > few {
            return Some(group);
        }
        let members = group.members.iter().copied();
        let own = members.filter(|&member| !self.is_outsiders(member, &group, pass, free));
        let own: Vec<usize> = own.collect();
        if own.len() == group.members.len() {
            return Some(group);
        }
        let mut left = reconstruct(
            &pass.witnesses,
            &own,
            self.gates.point_distance_m(),
            self.gates.min_keypoints,
        )?;
        let body = self.body_group(&mut left, pass, &self.gates)?;
        body.is_person.then_some(left)
    }

    /// Whether the best group of `member`, when rays may meet anywhere, shares no other member with
    /// `group`.
    fn is_outsiders(
        &self,
        member: usize,
        group: &Reconstruction,
        pass: &DetectionPass,
        free: &[usize],
    ) -> bool {
        let (all, gates) = (&pass.witnesses, self.gates.anywhere());
        let near = free.iter().copied();
        let near = near.filter(|&w| w == member || agree(&all[w], &all[member], &gates));
        let near: Vec<usize> = near.collect();
        let groups = associate(all, &near, &gates, |group| {
            let body = self.body_group(group, pass, &gates);
            body.is_some_and(|body| body.is_person)
        });
        let winner = groups.iter().find(|g| g.members.contains(&member));
        let is_shared = |m: &usize| *m != member && group.members.contains(m);
        winner.is_some_and(|winner| !winner.members.iter().any(is_shared))
    }
}

#[cfg(test)]
mod tests;
