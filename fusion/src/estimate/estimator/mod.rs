//! One person from tick to tick: from the patches of all views to the skeleton of the tick and the
//! prediction for the next.
//!
//! Each stage of a tick is a method, because persons interact between some of them (the occlusion
//! weights need all predictions) and because each is timed. An estimator owns its buffers: in
//! steady state a tick allocates only its messages (boxes, poses). Identity is decided in
//! [`crate::identity`].

mod meeting;
mod output;
mod stages;

use nalgebra::Vector3;

pub use self::output::{BodyAhead, TickSnapshot};
use super::evidence::{PatchReader, View};
use super::feet::Feet;
use super::joint_filter::JointFilter;
use super::lattice::LatticeSearch;
use super::left_right_swap::LeftRightSwaps;
use super::occlusion::{BodyCapsules, CapsuleSet};
use super::predict::Motion;
use super::uncertainty::{Uncertainty, UncertaintySnapshot};
use crate::body::ik::{IkSolver, Target};
use crate::body::measured::MeasuredBody;
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Joint, Joints, Kinematics, N_JOINTS, Pose, Skeleton};
use crate::boxes::Boxes;
use crate::method::Method;

/// The evidence of one person in the views of a tick.
pub struct Evidence {
    views: Vec<View>,
    /// How many of `views` are of this tick.
    n_views: usize,
    reader: PatchReader,
    swaps: LeftRightSwaps,
    search: LatticeSearch,
    /// People who may hide the person in the current view, and their capsules.
    occluders: Vec<(usize, CapsuleSet)>,
    /// Predicted keypoints at the tick, world, metres.
    predicted_m: Vec<Vector3<f64>>,
    /// Results of the lattice search, by keypoint.
    pub(crate) estimates: Vec<KeypointEstimate>,
}

impl Evidence {
    fn new(method: &Method) -> Self {
        let n_keypoints = method.sites.len();
        Self {
            views: Vec::new(),
            n_views: 0,
            reader: PatchReader::default(),
            swaps: LeftRightSwaps::new(&method.keypoints),
            search: LatticeSearch::new(&method.keypoints),
            occluders: Vec::new(),
            predicted_m: Vec::with_capacity(n_keypoints),
            estimates: Vec::with_capacity(n_keypoints),
        }
    }
}

/// Pose and motion of one person, with their uncertainty.
pub struct PoseEstimate {
    /// Q of (14).
    pub(crate) pose: Pose,
    /// Result of the first inverse kinematics, without bounds.
    free_pose: Pose,
    unobserved: u64,
    motion: Motion,
    filter: JointFilter,
    /// Time since the last measured pose, seconds.
    elapsed_s: f64,
    /// Joints predicted for the current tick.
    ahead_m: Joints,
    targets: Vec<Target>,
    kinematics: Kinematics,
    measured_m: Joints,
    solver: IkSolver,
    feet: Feet,
    /// Displacement of the targets of the second inverse kinematics at this tick.
    push_m: Joints,
    uncertainty: Uncertainty,
    boxes: Boxes,
}

impl PoseEstimate {
    fn new(skeleton: &Skeleton, pose: &Pose, method: &Method) -> Self {
        let n_keypoints = method.sites.len();
        let mut kinematics = Kinematics::default();
        skeleton.forward(pose, &mut kinematics);
        let joints_m = joints_of(&kinematics);
        Self {
            pose: *pose,
            free_pose: *pose,
            unobserved: 0,
            motion: Motion::at_rest(joints_m),
            filter: JointFilter::new(&joints_m),
            elapsed_s: 0.0,
            ahead_m: joints_m,
            targets: Vec::with_capacity(n_keypoints.max(N_JOINTS)),
            kinematics,
            measured_m: joints_m,
            solver: IkSolver::new(&method.parameters.ik),
            feet: Feet::above(method.floor_m),
            push_m: [Vector3::zeros(); N_JOINTS],
            uncertainty: Uncertainty::default(),
            boxes: Boxes::default(),
        }
    }
}

/// One person, followed from tick to tick.
pub struct Estimator {
    pub(crate) evidence: Evidence,
    pub(crate) body: MeasuredBody,
    pub(crate) estimate: PoseEstimate,
}

impl AsRef<Self> for Estimator {
    fn as_ref(&self) -> &Self {
        self
    }
}

impl Estimator {
    /// A person with the body `skeleton` in `pose`.
    pub fn new(skeleton: Skeleton, pose: Pose, method: &Method) -> Self {
        Self {
            evidence: Evidence::new(method),
            estimate: PoseEstimate::new(&skeleton, &pose, method),
            body: MeasuredBody::new(skeleton, method.sites.clone()),
        }
    }

    /// The joints of the newest pose, world, metres.
    pub fn joints_m(&self) -> &Joints {
        self.estimate.motion.newest_m()
    }

    /// The newest pose.
    pub fn pose(&self) -> &Pose {
        &self.estimate.pose
    }

    /// The measured body: it stays the same from tick to tick.
    pub fn body(&self) -> &MeasuredBody {
        &self.body
    }

    /// Expected keypoints of the last tick, world, metres, by keypoint.
    pub fn predicted_m(&self) -> &[Vector3<f64>] {
        &self.evidence.predicted_m
    }

    /// Results of the lattice search of the last tick, by keypoint.
    pub fn estimates(&self) -> &[KeypointEstimate] {
        &self.evidence.estimates
    }

    /// The joints after the first inverse kinematics of the last tick, world, metres.
    pub fn measured_m(&self) -> &Joints {
        &self.estimate.measured_m
    }

    /// The joints after the filter of the last tick, world, metres.
    pub fn smoothed_m(&self) -> &Joints {
        self.estimate.filter.position_m()
    }

    /// Positions, velocities and history for predictions.
    pub fn motion(&self) -> &Motion {
        &self.estimate.motion
    }

    /// The keypoint sites of the newest pose, world, metres; the pelvis for a keypoint without a site.
    pub fn keypoints_m(&self) -> Vec<Vector3<f64>> {
        let (root_m, kinematics) = (self.estimate.pose.root_m, &self.estimate.kinematics);
        let sites = self.body.sites.iter();
        sites
            .map(|site| site.map_or(root_m, |site| kinematics.site_m(&site)))
            .collect()
    }

    /// How many viewpoints gave evidence at this tick.
    pub fn n_views(&self) -> u16 {
        let views = self.evidence.estimates.iter().map(|e| e.views);
        views.max().unwrap_or(0)
    }

    /// The body as an occluder of others at this tick.
    pub fn occluder(&self, method: &Method) -> BodyCapsules {
        BodyCapsules::from_joints(&self.estimate.ahead_m, &method.parameters.occlusion)
    }
}

fn joints_of(kinematics: &Kinematics) -> Joints {
    Joint::ALL.map(|joint| kinematics.joint_m(joint))
}

/// A pose with its uncertainty, to go back to.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RestartPoint {
    pose: Pose,
    known: UncertaintySnapshot,
}

impl Estimator {
    /// Starts over with another body and pose.
    pub(crate) fn restart(&mut self, skeleton: Skeleton, pose: &Pose) {
        self.body.skeleton = skeleton;
        self.restart_at(pose);
    }

    /// Starts over in another pose, with the same body.
    pub(crate) fn restart_at(&mut self, pose: &Pose) {
        let estimate = &mut self.estimate;
        estimate.pose = *pose;
        self.body
            .skeleton
            .forward(&estimate.pose, &mut estimate.kinematics);
        let joints_m = joints_of(&estimate.kinematics);
        estimate.motion = Motion::at_rest(joints_m);
        estimate.filter.reset(&joints_m);
        estimate.measured_m = joints_m;
    }

    /// Whether a search within `half_width_m` of the current keypoints reaches those of another
    /// `pose`.
    pub(crate) fn reaches(&self, pose: &Pose, half_width_m: f64) -> bool {
        let mut there = Kinematics::default();
        self.body.skeleton.forward(pose, &mut there);
        let sites = self.body.sites.iter().flatten();
        let mut off_m =
            sites.map(|site| there.site_m(site) - self.estimate.kinematics.site_m(site));
        off_m.all(|off_m| off_m.amax() < half_width_m)
    }

    /// Sets the velocity of the whole body, `velocity_m_s` (world).
    pub(crate) fn set_velocity(&mut self, velocity_m_s: Vector3<f64>) {
        let estimate = &mut self.estimate;
        estimate.filter.set_velocity(velocity_m_s);
        let joints_m = *estimate.filter.position_m();
        estimate
            .motion
            .push(&joints_m, estimate.filter.velocity_m_s());
    }

    /// Resets the uncertainty of the pose.
    pub(crate) fn forget_uncertainty(&mut self) {
        self.estimate.uncertainty.reset();
    }

    /// The current pose and its uncertainty.
    pub(crate) fn restart_point(&self) -> RestartPoint {
        RestartPoint {
            pose: self.estimate.pose,
            known: self.estimate.uncertainty.known(),
        }
    }

    /// Goes back to where it was `ago_s` seconds ago, as uncertain as if it had not been seen
    /// since.
    pub(crate) fn go_back_to(&mut self, before: &RestartPoint, ago_s: f64, method: &Method) {
        self.evidence.estimates.clear();
        self.restart_at(&before.pose);
        self.estimate.uncertainty.go_back_to(&before.known);
        self.update_uncertainty(ago_s, method);
    }
}
