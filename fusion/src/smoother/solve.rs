//! The pose with the smoothed joints: paper (14), a second time.
//!
//! As in a track, all 29 joints are targets, inside the range of motion, starting from the last
//! smoothed pose; standing feet stay where they were put down. The lengths are the newest ones of
//! the person.

use farfield_proto::id::PersonId;
use farfield_proto::message::PersonPose;
use nalgebra::Vector3;

use crate::body::ik::{IkSolver, Priors, Target};
use crate::body::skeleton::{
    Joint, Joints, Kinematics, N_JOINTS, Pose, Site, Skeleton, reported_angles,
};
use crate::estimate::estimator::TickSnapshot;
use crate::estimate::feet::Feet;
use crate::identity::track::Track;
use crate::method::Method;

/// Root mean square distance of the joints from the smoothed ones, metres, above which the pose is
/// solved again from another start.
const STUCK_M: f64 = 0.012;

/// Targets of a pose.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Aims {
    /// World, metres.
    pub(super) place_m: Joints,
    /// World, metres per second.
    pub(super) velocity_m_s: Joints,
    /// Per axis, m²; `None` while unknown.
    pub(super) variance_m2: [Option<f64>; N_JOINTS],
}

impl Default for Aims {
    fn default() -> Self {
        Self {
            place_m: [Vector3::zeros(); N_JOINTS],
            velocity_m_s: [Vector3::zeros(); N_JOINTS],
            variance_m2: [None; N_JOINTS],
        }
    }
}

/// One person's body and its last pose.
pub(super) struct Solver {
    id: PersonId,
    skeleton: Skeleton,
    sites: Vec<Option<Site>>,
    /// The last smoothed pose.
    last: Option<Pose>,
    feet: Feet,
    ik: IkSolver,
    kinematics: Kinematics,
    targets: Vec<Target>,
}

impl Solver {
    pub(super) fn new(track: &Track, method: &Method) -> Self {
        Self {
            id: track.id(),
            skeleton: track.estimator().body().skeleton.clone(),
            sites: track.estimator().body().sites.clone(),
            last: None,
            feet: Feet::above(method.floor_m),
            ik: IkSolver::new(&method.parameters.ik),
            kinematics: Kinematics::default(),
            targets: Vec::with_capacity(N_JOINTS),
        }
    }

    /// Updates the body and the id.
    pub(super) fn set_body(&mut self, track: &Track) {
        self.id = track.id();
        self.skeleton.clone_from(&track.estimator().body().skeleton);
        self.sites.clear();
        self.sites
            .extend_from_slice(&track.estimator().body().sites);
    }

    /// The body and its keypoint sites.
    pub(super) fn body(&self) -> (&Skeleton, &[Option<Site>]) {
        (&self.skeleton, &self.sites)
    }

    /// The pose of `moment`; snapshots come in order.
    pub(super) fn solve(
        &mut self,
        moment: &TickSnapshot,
        aims: &Aims,
        method: &Method,
    ) -> PersonPose {
        self.aim(aims, method);
        let last = self.last.unwrap_or(moment.pose);
        let (mut pose, misfit_m) = self.solve_from(&last, &last, method);
        if misfit_m > STUCK_M {
            let (other, other_m) = self.solve_from(&moment.pose, &last, method);
            if other_m < misfit_m {
                pose = other;
            }
        }
        self.last = Some(pose);
        self.skeleton.forward(&pose, &mut self.kinematics);
        self.published(moment, aims, &pose)
    }

    fn aim(&mut self, aims: &Aims, method: &Method) {
        self.feet
            .step(&aims.place_m, &aims.velocity_m_s, method.dt_s);
        let sigma_m = method.parameters.ik.joint_sigma_m;
        let feet = &self.feet;
        let weight = 1.0 / (sigma_m * sigma_m);
        let target = |(&joint, &place_m): (&Joint, &Vector3<f64>)| {
            let place_m = feet.place_of(joint).unwrap_or(place_m);
            Target::isotropic(&Site::at(joint), place_m, weight)
        };
        self.targets.clear();
        self.targets
            .extend(Joint::ALL.iter().zip(&aims.place_m).map(target));
    }

    /// The pose from the start `start`, and the root mean square distance of its joints from their
    /// targets, metres.
    fn solve_from(&mut self, start: &Pose, last: &Pose, method: &Method) -> (Pose, f64) {
        let priors = Priors::new(&method.parameters.ik, last, method.dt_s);
        let bounds = method.range_of_motion.as_ref();
        let pose = self
            .ik
            .fit(&self.skeleton, start, &self.targets, &priors, bounds);
        let body = self.ik.body();
        let apart =
            |target: &Target| (body.joint_m(target.joint) - target.position_m).norm_squared();
        let sum_m2: f64 = self.targets.iter().map(apart).sum();
        (pose, (sum_m2 / self.targets.len() as f64).sqrt())
    }

    /// The pose as it is published.
    fn published(&self, moment: &TickSnapshot, aims: &Aims, pose: &Pose) -> PersonPose {
        let to_f32 = |p: Vector3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        let site_m =
            |site: &Option<Site>| site.map_or(pose.root_m, |site| self.kinematics.site_m(&site));
        let is_known = aims.variance_m2.iter().all(Option::is_some);
        let variances_m2 = aims.variance_m2.iter().flatten().filter(|_| is_known);
        PersonPose {
            person: self.id,
            state: moment.state,
            joints_m: (self.kinematics.joints_m.iter())
                .map(|&joint_m| to_f32(joint_m))
                .collect(),
            keypoints_m: self.sites.iter().map(|site| to_f32(site_m(site))).collect(),
            sigma_m: variances_m2.map(|m2| m2.sqrt() as f32).collect(),
            angles: (reported_angles(pose).iter())
                .map(|angle| *angle as f32)
                .collect(),
            unobserved: moment.unobserved,
            views: moment.views,
        }
    }
}
