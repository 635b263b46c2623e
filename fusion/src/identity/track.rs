//! One person from tick to tick: from the patches of all views to the skeleton of the tick and the
//! prediction for the next.
//!
//! The stages of a tick are methods of their own, because persons meet between some of them (the
//! occlusion weights need everybody's prediction) and because each is timed. A track owns every
//! buffer it needs: in steady state a tick allocates nothing but the messages it makes (boxes, poses).

mod coasting;
mod identity;
mod meeting;
mod moment;

use farfield_proto::camera::CameraModel;
use farfield_proto::id::{PersonId, ViewpointIndex};
use farfield_proto::message::PersonPatch;
use farfield_proto::patch::Decoder;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::body::ik::{IkSolver, Priors, Target};
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::Joints;
use crate::body::skeleton::{Joint, Kinematics, N_JOINTS, Pose, Site, Skeleton};
use crate::boxes::Boxes;
use crate::estimate::evidence::View;
use crate::estimate::joint_filter::Smoother;
use crate::estimate::lattice::LatticeSearch;
use crate::estimate::occlusion::{Body, view_weight};
use crate::estimate::predict::Motion;
use crate::estimate::uncertainty::{Uncertainty, weigh_views};

use self::identity::Apart;
pub use self::moment::Moment;
use super::memory::LastSeen;
use super::trial::Trial;
use crate::body::remeasure::{Pace, Remeasure};
use crate::body::sites::{learn, without_offsets};
use crate::estimate::feet::Feet;
use crate::estimate::keypoint_targets::aim_at_keypoints;
use crate::estimate::left_right_swap::Exchanges;
use crate::identity::phase::Life;
use crate::identity::tentative::TentativeTick;
use crate::method::{Method, VenueView};

/// Root mean square distance of the second inverse kinematics' joints from the smoothed ones, metres,
/// from which it is solved a second time from elsewhere.
const STUCK_M: f64 = 0.012;

/// One person.
pub struct Track {
    pub(crate) id: PersonId,
    /// By which the edges know the person; it stays when the person is recognised.
    pub(crate) wire_id: PersonId,
    pub(crate) life: Life,
    pub(crate) skeleton: Skeleton,
    /// Q of (14).
    pub(crate) pose: Pose,
    /// What the first inverse kinematics found, without bounds.
    free_pose: Pose,
    pub(crate) unobserved: u64,
    pub(crate) motion: Motion,
    pub(crate) smoother: Smoother,
    /// Joints predicted for the tick being worked on.
    pub(crate) ahead_m: Joints,
    views: Vec<View>,
    n_views: usize,
    pub(crate) estimates: Vec<KeypointEstimate>,
    targets: Vec<Target>,
    pub(crate) kinematics: Kinematics,
    measured_m: Joints,
    /// Predicted keypoints at the tick.
    predicted_m: Vec<Vector3<f64>>,
    exchanges: Exchanges,
    search: LatticeSearch,
    solver: IkSolver,
    decoder: Decoder,
    pub(crate) boxes: Boxes,
    remeasure: Remeasure,
    /// Where the keypoints sit on this person.
    pub(crate) sites: Vec<Option<Site>>,
    feet: Feet,
    /// By how much the aims of the second inverse kinematics move at this tick.
    push_m: Joints,
    pub(crate) uncertainty: Uncertainty,
    pub(crate) tentative: Vec<TentativeTick>,
    pub(crate) trial: Trial,
    /// Ticks of life so far, an earlier life's too.
    pub(crate) lived_ticks: u32,
    pub(crate) last_seen: Option<LastSeen>,
    apart: Option<Apart>,
    /// The pelvis at birth, world, metres, and how fast it moved there, metres per second.
    pub(crate) born_m: Vector3<f64>,
    pub(crate) born_m_s: Vector3<f64>,
    /// Where and when it was sighted first, if it has been born anew since.
    sighted_first: Option<(Tick, Vector3<f64>)>,
    /// What the last tick changed of those before.
    told_anew: Vec<Moment>,
    mistaken_since: Option<Tick>,
}

impl Track {
    /// A person with the body `skeleton` in `pose`.
    pub fn new(id: PersonId, life: Life, skeleton: Skeleton, pose: Pose, method: &Method) -> Self {
        let mut kinematics = Kinematics::default();
        skeleton.forward(&pose, &mut kinematics);
        let joints_m = joints_of(&kinematics);
        let n_keypoints = method.sites.len();
        Self {
            id,
            wire_id: id,
            life,
            skeleton,
            pose,
            free_pose: pose,
            unobserved: 0,
            motion: Motion::at_rest(joints_m),
            smoother: Smoother::new(&joints_m),
            ahead_m: joints_m,
            views: Vec::new(),
            n_views: 0,
            estimates: Vec::with_capacity(n_keypoints),
            targets: Vec::with_capacity((2 * n_keypoints).max(N_JOINTS)),
            kinematics,
            measured_m: joints_m,
            predicted_m: Vec::with_capacity(n_keypoints),
            exchanges: Exchanges::new(&method.keypoints),
            search: LatticeSearch::new(&method.keypoints),
            solver: IkSolver::new(&method.parameters.ik),
            decoder: Decoder::new(),
            boxes: Boxes::default(),
            remeasure: Remeasure::new(),
            sites: method.sites.clone(),
            feet: Feet::default(),
            push_m: [Vector3::zeros(); N_JOINTS],
            uncertainty: Uncertainty::default(),
            tentative: Vec::new(),
            trial: Trial::default(),
            lived_ticks: 0,
            last_seen: None,
            apart: None,
            born_m: pose.root_m,
            born_m_s: Vector3::zeros(),
            sighted_first: None,
            told_anew: Vec::new(),
            mistaken_since: None,
        }
    }

    /// Who.
    pub fn id(&self) -> PersonId {
        self.id
    }

    /// The joints of the newest pose, world, metres.
    pub fn joints_m(&self) -> &Joints {
        self.motion.newest_m()
    }

    /// Whether the person is not confirmed yet.
    pub fn is_tentative(&self) -> bool {
        self.life.is_tentative()
    }

    /// The body: link lengths that stay the same from tick to tick.
    pub fn skeleton(&self) -> &Skeleton {
        &self.skeleton
    }

    /// Where the keypoints sit on this person, by keypoint.
    pub fn sites(&self) -> &[Option<Site>] {
        &self.sites
    }

    /// Where the keypoints of the last tick were expected, world, metres, by keypoint.
    pub fn predicted_m(&self) -> &[Vector3<f64>] {
        &self.predicted_m
    }

    /// What the lattice search of the last tick found, by keypoint.
    pub fn estimates(&self) -> &[KeypointEstimate] {
        &self.estimates
    }

    /// The joints after the first inverse kinematics of the last tick, world, metres.
    pub fn measured_m(&self) -> &Joints {
        &self.measured_m
    }

    /// The joints after the filter of the last tick, world, metres.
    pub fn smoothed_m(&self) -> &Joints {
        self.smoother.position_m()
    }

    /// Positions, velocities and history that predictions start from.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The keypoint sites of the newest pose, world, metres; the pelvis for a keypoint without a site.
    pub fn keypoints_m(&self) -> Vec<Vector3<f64>> {
        let site_m = |site: &Option<Site>| {
            site.map_or(self.pose.root_m, |site| self.kinematics.site_m(&site))
        };
        self.sites.iter().map(site_m).collect()
    }

    /// How many viewpoints gave evidence at this tick.
    pub fn n_views(&self) -> u16 {
        self.estimates.iter().map(|e| e.views).max().unwrap_or(0)
    }

    /// Begins a tick: predicts the joints and forgets the last tick's views.
    pub fn begin(&mut self, method: &Method) {
        self.motion.predict(
            1.0,
            method.dt_s,
            &method.parameters.prediction,
            &mut self.ahead_m,
        );
        self.n_views = 0;
    }

    /// Forgets what the last tick changed of those before.
    pub fn forget_changes(&mut self) {
        self.told_anew.clear();
        self.mistaken_since = None;
    }

    /// The body as others are occluded by it at this tick.
    pub fn body(&self, method: &Method) -> Body {
        Body::from_joints(&self.ahead_m, &method.parameters.occlusion)
    }

    /// Takes the patch of one viewpoint; returns whether it was taken. A patch that cannot be read,
    /// whose maps do not fit the venue's keypoints, or that is the viewpoint's second is dropped.
    pub fn see(
        &mut self,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        camera: &CameraModel,
        method: &Method,
    ) -> bool {
        let seen = &self.views[..self.n_views];
        let is_second = seen.iter().any(|view| view.viewpoint == viewpoint);
        if is_second || usize::from(patch.maps.keypoints) != method.sites.len() {
            return false;
        }
        if self.views.len() == self.n_views {
            self.views.push(View::default());
        }
        let view = &mut self.views[self.n_views];
        let taken = view
            .fill(&mut self.decoder, patch, viewpoint, camera)
            .is_ok();
        view.peak_sigma_of_width = method.peak_sigma_of_width;
        self.n_views += usize::from(taken);
        taken
    }

    /// Takes every patch of this person that `group` holds; returns how many could not be used.
    pub fn see_all(&mut self, group: &TickGroup, cameras: &[VenueView], method: &Method) -> u32 {
        let (id, mut unusable) = (self.wire_id, 0);
        for set in &group.patch_sets {
            for patch in set.persons.iter().filter(|patch| patch.person == id) {
                let camera = cameras.get(usize::from(patch.camera.0));
                let own = camera.filter(|camera| camera.viewpoint == set.viewpoint);
                let taken =
                    own.is_some_and(|own| self.see(patch, set.viewpoint, &own.model, method));
                unusable += u32::from(!taken);
            }
        }
        unusable
    }

    /// Says where each view's keypoints are expected at its own capture instant, and what they are
    /// worth behind the bodies of `others`.
    pub fn place_views<'a>(
        &mut self,
        others: &(impl Iterator<Item = &'a Body> + Clone),
        method: &Method,
    ) {
        let mut at_capture_m = self.ahead_m;
        for view in &mut self.views[..self.n_views] {
            let horizon = 1.0 + view.capture_offset_s / method.dt_s;
            self.motion.predict(
                horizon,
                method.dt_s,
                &method.parameters.prediction,
                &mut at_capture_m,
            );
            for (k, site) in self.sites.iter().enumerate() {
                let Some(site) = site else { continue };
                let expected_m = site_near(&self.kinematics, site, &at_capture_m);
                view.predicted_m[k] = expected_m;
                view.occlusion[k] = view_weight(
                    view.center_m(),
                    expected_m,
                    others.clone(),
                    &method.parameters.occlusion,
                );
            }
        }
        self.predicted_m.clear();
        let predicted = |site: &Option<Site>| {
            site.map_or_else(Vector3::zeros, |site| {
                site_near(&self.kinematics, &site, &self.ahead_m)
            })
        };
        self.predicted_m.extend(self.sites.iter().map(predicted));
    }

    /// Finds the most probable keypoint positions, paper (6)-(9).
    pub fn search(&mut self, method: &Method) {
        let views = &self.views[..self.n_views];
        self.search.search(
            views,
            &self.predicted_m,
            &method.parameters.lattice,
            &mut self.estimates,
        );
        weigh_views(
            views,
            &self.predicted_m,
            &method.relative_sigmas,
            &mut self.estimates,
        );
    }

    /// First inverse kinematics, paper (10)-(12): the joints that fit the keypoints, without range of motion.
    pub fn fit_keypoints(&mut self, method: &Method) {
        aim_at_keypoints(&self.estimates, &self.sites, method, &mut self.targets);
        let priors = Priors::new(&method.parameters.ik, &self.pose, method.dt_s);
        let solution = self
            .solver
            .solve(&self.skeleton, &self.pose, &self.targets, &priors, None);
        self.unobserved = solution.unobserved;
        self.free_pose = solution.pose;
        self.skeleton.forward(&solution.pose, &mut self.kinematics);
        self.measured_m = joints_of(&self.kinematics);
        if !self.life.is_tentative() {
            learn(
                &mut self.sites,
                &method.sites,
                &self.estimates,
                &self.kinematics,
                method.dt_s,
            );
        }
    }

    /// Second inverse kinematics, paper (14)-(15): all 29 smoothed joints, inside the range of motion.
    pub fn fit_joints(&mut self, method: &Method) {
        let sigma_m = method.parameters.ik.joint_sigma_m;
        let weight = 1.0 / (sigma_m * sigma_m);
        self.targets.clear();
        let (smoothed_m, velocity_m_s) = (self.smoother.position_m(), self.smoother.velocity_m_s());
        self.feet.step(smoothed_m, velocity_m_s, method.dt_s);
        let (feet, push_m) = (&self.feet, &self.push_m);
        self.targets.extend(
            Joint::ALL
                .iter()
                .zip(smoothed_m)
                .map(|(&joint, &position_m)| Target {
                    joint,
                    offset_m: Vector3::zeros(),
                    position_m: feet.place_of(joint).unwrap_or(position_m) + push_m[joint.index()],
                    weight,
                    across: None,
                }),
        );
        let last = self.pose;
        let misfit_m = self.fit_joints_from(&last, &last, method);
        if misfit_m > STUCK_M && method.range_of_motion.is_some() {
            // An arm that straightened and bent again may have come out behind: no way leads back to
            // the bounds from there, but from the same arm with its elbow turned about.
            let stuck = self.pose;
            let free = self.free_pose.with_elbows_forward();
            let other_m = self.fit_joints_from(&free, &last, method);
            if other_m >= misfit_m {
                self.pose = stuck;
            }
        }
        self.skeleton.forward(&self.pose, &mut self.kinematics);
        let joints_m = joints_of(&self.kinematics);
        self.motion.push(&joints_m, self.smoother.velocity_m_s());
        self.doubt(method.dt_s, method);
    }

    /// Solves for the smoothed joints from `start`; takes the pose, and returns how far its joints are
    /// from them, root mean square, metres.
    fn fit_joints_from(&mut self, start: &Pose, last: &Pose, method: &Method) -> f64 {
        let priors = Priors::new(&method.parameters.ik, last, method.dt_s);
        let bounds = method.range_of_motion.as_ref();
        self.pose = self
            .solver
            .solve(&self.skeleton, start, &self.targets, &priors, bounds)
            .pose;
        self.skeleton.forward(&self.pose, &mut self.kinematics);
        let apart = |target: &Target| {
            (self.kinematics.joint_m(target.joint) - target.position_m).norm_squared()
        };
        (self.targets.iter().map(apart).sum::<f64>() / self.targets.len() as f64).sqrt()
    }

    /// Measures the link lengths anew when it is time to; the pose stays, and the next tick fits it.
    pub(crate) fn remeasure(&mut self, method: &Method) {
        let (estimates, sites, kinematics) = (&self.estimates, &self.sites, &self.kinematics);
        let pace = Pace {
            dt_s: method.dt_s,
            measure_s: method.parameters.births.measure_s,
            ik: &method.parameters.ik,
        };
        let joints = || without_offsets(estimates, sites, kinematics);
        if let Some(skeleton) = self.remeasure.tick(joints, &pace) {
            self.skeleton = skeleton;
        }
    }
}

/// A site's place for predicted joints: the joint as predicted, the offset as it last was turned.
fn site_near(kinematics: &Kinematics, site: &Site, joints_m: &Joints) -> Vector3<f64> {
    joints_m[site.joint.index()] + kinematics.rotation(site.joint.link()) * site.offset_m
}

fn joints_of(kinematics: &Kinematics) -> Joints {
    Joint::ALL.map(|joint| kinematics.joint_m(joint))
}
