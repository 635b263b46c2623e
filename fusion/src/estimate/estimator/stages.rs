//! The stages of a tick, in the order in which they are called.
//!
//! # Coasting: prediction while too few views show a person or a limb
//!
//! Without evidence the filter's velocity carries the body and decays. One viewpoint alone gives
//! the place of a body across its rays and, by its known lengths, roughly its distance: that steers
//! it. An unseen limb keeps the body's motion, and its own velocity relative to the body decays.

use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::message::PersonPatch;
use nalgebra::Vector3;

use super::{Estimator, Evidence, joints_of};
use crate::body::ik::{Priors, Target};
use crate::body::measured::RemeasureSchedule;
use crate::body::prior::BodyPrior;
use crate::body::skeleton::{Joint, Joints, Kinematics, Pose, Site};
use crate::estimate::evidence::View;
use crate::estimate::keypoint_targets::aim_at_keypoints;
use crate::estimate::occlusion::{BodyCapsules, view_weight};
use crate::estimate::uncertainty::{MadeOf, weigh_views};
use crate::method::Method;

/// Root mean square distance of the second inverse kinematics' joints from the smoothed ones,
/// metres, above which it is solved again from another start.
const STUCK_M: f64 = 0.012;
/// Longest time without a measurement that allows the next pose to differ more, seconds: one round
/// of turns on a slow link, or at a slow edge. After a longer time the place is unknown, and the
/// shape as good as any.
const MOST_UNMEASURED_S: f64 = 0.25;

impl Estimator {
    /// Begins a tick: predicts the joints and removes the last tick's views.
    pub fn begin(&mut self, method: &Method) {
        let estimate = &mut self.estimate;
        estimate.motion.predict(
            1.0,
            method.dt_s,
            &method.parameters.prediction,
            &mut estimate.ahead_m,
        );
        let unmeasured_s = estimate.filter.unmeasured_s().min(MOST_UNMEASURED_S);
        estimate.elapsed_s = method.dt_s + unmeasured_s;
        self.evidence.n_views = 0;
    }

    /// Adds the patch of one viewpoint; returns whether it was used. A patch is dropped if it
    /// cannot be read, if its maps do not fit the venue's keypoints or its network's size, or if it
    /// is the viewpoint's second.
    pub fn see(
        &mut self,
        patch: &PersonPatch,
        viewpoint: ViewpointIndex,
        camera: &CameraModel,
        method: &Method,
    ) -> bool {
        let seen = &self.evidence.views[..self.evidence.n_views];
        let is_second = seen.iter().any(|view| view.viewpoint == viewpoint);
        if is_second || !method.takes(&patch.maps) {
            return false;
        }
        if self.evidence.views.len() == self.evidence.n_views {
            self.evidence.views.push(View::default());
        }
        let view = &mut self.evidence.views[self.evidence.n_views];
        let taken = view
            .fill(&mut self.evidence.reader, patch, viewpoint, camera)
            .is_ok();
        view.peak_sigma_of_width = method.peak_sigma_of_width;
        self.evidence.n_views += usize::from(taken);
        taken
    }

    /// Sets where each view's keypoints are expected at its own capture instant, and their
    /// occlusion weights behind the `bodies` of all persons; `own` is the index of this one.
    pub fn place_views(&mut self, bodies: &[BodyCapsules], own: usize, method: &Method) {
        let mut at_capture_m = self.estimate.ahead_m;
        let Evidence {
            views,
            n_views,
            occluders,
            ..
        } = &mut self.evidence;
        for view in &mut views[..*n_views] {
            let horizon = 1.0 + view.capture_offset_s / method.dt_s;
            self.estimate.motion.predict(
                horizon,
                method.dt_s,
                &method.parameters.prediction,
                &mut at_capture_m,
            );
            for (k, site) in self.body.sites.iter().enumerate() {
                if let Some(site) = site {
                    let expected_m = site_near(&self.estimate.kinematics, site, &at_capture_m);
                    view.expect(k, expected_m);
                }
            }
            let eye_m = view.center_m();
            let sight = view.sight();
            occluders.clear();
            let others = bodies.iter().enumerate().filter(|(i, _)| *i != own);
            let hiding = others.map(|(i, body)| (i, body.may_hide(&eye_m, &sight)));
            occluders.extend(hiding.filter(|(_, capsules)| !capsules.is_empty()));
            if occluders.is_empty() {
                continue;
            }
            for k in 0..view.n_keypoints() {
                if let Some(expected) = view.expected(k) {
                    view.occlusion[k] = view_weight(
                        eye_m,
                        expected.position_m,
                        occluders
                            .iter()
                            .map(|&(i, capsules)| (&bodies[i], capsules)),
                        &method.parameters.occlusion,
                    );
                }
            }
        }
        self.evidence.predicted_m.clear();
        let predicted = |site: &Option<Site>| {
            site.map_or_else(Vector3::zeros, |site| {
                site_near(&self.estimate.kinematics, &site, &self.estimate.ahead_m)
            })
        };
        self.evidence
            .predicted_m
            .extend(self.body.sites.iter().map(predicted));
    }

    /// Finds the most probable keypoint positions, paper (6)-(9).
    pub fn search(&mut self, method: &Method) {
        let views = &mut self.evidence.views[..self.evidence.n_views];
        let mut lattice = method.parameters.lattice.clone();
        let drifted_m = lattice.prior_speed_m_s * self.estimate.elapsed_s;
        lattice.prior_sigma_m = lattice.prior_sigma_m.max(drifted_m);
        self.evidence.search.search(
            views,
            &self.evidence.predicted_m,
            &lattice,
            &mut self.evidence.estimates,
        );
        weigh_views(
            views,
            &self.evidence.predicted_m,
            &method.relative_sigmas,
            &mut self.evidence.estimates,
        );
    }

    /// First inverse kinematics, paper (10)-(12): the joints that fit the keypoints, without range of motion.
    pub fn fit_keypoints(&mut self, method: &Method) {
        let (estimate, body) = (&mut self.estimate, &self.body);
        let targets = &mut estimate.targets;
        aim_at_keypoints(&self.evidence.estimates, &body.sites, method, targets);
        let priors = Priors::new(&method.parameters.ik, &estimate.pose, estimate.elapsed_s);
        let solution =
            estimate
                .solver
                .solve(&body.skeleton, &estimate.pose, targets, &priors, None);
        estimate.unobserved = solution.unobserved;
        estimate.free_pose = solution.pose;
        estimate.kinematics.clone_from(estimate.solver.body());
        estimate.measured_m = joints_of(&estimate.kinematics);
    }

    /// Learns the keypoint sites from the first inverse kinematics of this tick.
    pub fn learn_sites(&mut self, method: &Method) {
        self.body.learn_sites(
            &method.sites,
            &self.evidence.estimates,
            &self.estimate.kinematics,
            method.dt_s,
        );
    }

    /// Second inverse kinematics, paper (14)-(15): all 29 smoothed joints, inside the range of
    /// motion.
    pub fn fit_joints(&mut self, method: &Method) {
        let sigma_m = method.parameters.ik.joint_sigma_m;
        let weight = 1.0 / (sigma_m * sigma_m);
        self.estimate.targets.clear();
        let (smoothed_m, velocity_m_s) = (
            self.estimate.filter.position_m(),
            self.estimate.filter.velocity_m_s(),
        );
        self.estimate
            .feet
            .step(smoothed_m, velocity_m_s, method.dt_s);
        let (feet, push_m) = (&self.estimate.feet, &self.estimate.push_m);
        self.estimate
            .targets
            .extend(
                Joint::ALL
                    .iter()
                    .zip(smoothed_m)
                    .map(|(&joint, &position_m)| {
                        let place_m = feet.place_of(joint).unwrap_or(position_m);
                        let pushed_m = place_m + push_m[joint.index()];
                        Target::isotropic(&Site::at(joint), pushed_m, weight)
                    }),
            );
        let last = self.estimate.pose;
        let misfit_m = self.fit_joints_from(&last, &last, method);
        if misfit_m > STUCK_M && method.range_of_motion.is_some() {
            // An arm that straightened and bent again may have come out backwards. No path leads
            // back to the bounds from there, but one does from the same arm with its elbow turned
            // around.
            let stuck = self.estimate.pose;
            let free = self.estimate.free_pose.with_elbows_forward();
            let other_m = self.fit_joints_from(&free, &last, method);
            if other_m >= misfit_m {
                self.estimate.pose = stuck;
                self.body
                    .skeleton
                    .forward(&stuck, &mut self.estimate.kinematics);
            }
        }
        let joints_m = joints_of(&self.estimate.kinematics);
        self.estimate
            .motion
            .push(&joints_m, self.estimate.filter.velocity_m_s());
        self.update_uncertainty(method.dt_s, method);
    }

    /// Solves for the smoothed joints from `start` and takes the pose. Returns the distance of its
    /// joints from them, root mean square, metres.
    fn fit_joints_from(&mut self, start: &Pose, last: &Pose, method: &Method) -> f64 {
        let elapsed_s = match self.made_of(method) {
            MadeOf::Motion => method.dt_s,
            MadeOf::OneView | MadeOf::Views => self.estimate.elapsed_s,
        };
        let priors = Priors::new(&method.parameters.ik, last, elapsed_s);
        let bounds = method.range_of_motion.as_ref();
        let estimate = &mut self.estimate;
        estimate.pose = estimate.solver.fit(
            &self.body.skeleton,
            start,
            &estimate.targets,
            &priors,
            bounds,
        );
        estimate.kinematics.clone_from(estimate.solver.body());
        let apart = |target: &Target| {
            (estimate.kinematics.joint_m(target.joint) - target.position_m).norm_squared()
        };
        (estimate.targets.iter().map(apart).sum::<f64>() / estimate.targets.len() as f64).sqrt()
    }

    /// Stores what this tick measures of the link lengths.
    pub fn note_lengths(&mut self, method: &Method) {
        self.body.note_lengths(
            &self.evidence.estimates,
            &self.estimate.kinematics,
            &schedule(method),
        );
    }

    /// Remeasures the link lengths; the pose stays, and the next tick fits it.
    pub fn remeasure(&mut self, method: &Method) {
        self.body.measure(&schedule(method));
    }

    /// Sets the prior of a known body: measures it with that, now and from now on.
    pub(crate) fn is_known(&mut self, known: Arc<BodyPrior>, method: &Method) {
        self.body.is_known(known, &schedule(method));
    }

    /// Whether the body will not be measured again.
    pub(crate) fn is_measured(&self, method: &Method) -> bool {
        self.body.remeasure.is_over(&schedule(method))
    }
}

/// When and how the bodies of a venue are remeasured.
fn schedule(method: &Method) -> RemeasureSchedule<'_> {
    RemeasureSchedule {
        dt_s: method.dt_s,
        measure_s: method.parameters.births.measure_s,
        ik: &method.parameters.ik,
    }
}

/// The place of a site of a predicted joint: the joint as predicted, the offset as last turned.
fn site_near(kinematics: &Kinematics, site: &Site, joints_m: &Joints) -> Vector3<f64> {
    joints_m[site.joint.index()] + kinematics.rotation(site.joint.link()) * site.offset_m
}

impl Estimator {
    /// The evidence of this tick.
    pub fn made_of(&self, method: &Method) -> MadeOf {
        MadeOf::from_estimates(&self.evidence.estimates, method.enough_keypoints())
    }

    /// Largest possible distance, per axis, of an unseen person from its carried place, metres.
    pub fn adrift_m(&self) -> f64 {
        self.estimate.uncertainty.adrift_m()
    }

    /// Standard deviation of that distance, per axis, metres.
    pub fn carried_off_m(&self) -> f64 {
        self.estimate.uncertainty.carried_off_m()
    }

    /// Low-pass filter on the innovation, paper (13). Without evidence a person, or a limb, coasts.
    pub fn smooth(&mut self, method: &Method) {
        let parameters = &method.parameters.smoothing;
        if self.made_of(method) == MadeOf::Motion {
            self.estimate.filter.coast(method.dt_s, parameters);
            return;
        }
        self.estimate
            .filter
            .step(&self.estimate.measured_m, method.dt_s, parameters);
        let unseen = self.unseen_ends();
        if unseen != 0 {
            let carried = |joint: Joint| unseen >> joint.index() & 1 == 1;
            self.estimate
                .filter
                .decay_towards(Joint::Pelvis, carried, method.dt_s, parameters);
        }
    }

    /// The elbows, wrists, knees and ankles, with the joints beyond them, whose keypoint no view
    /// supports and that carry no supported one: one bit per joint.
    fn unseen_ends(&self) -> u64 {
        let supported = |joint: Joint| {
            let mut own = self.body.sites.iter().zip(&self.evidence.estimates);
            own.any(|(site, e)| site.is_some_and(|site| site.joint == joint) && e.weight > 0.0)
        };
        let mut unseen = 0;
        for (middle, end, rest) in LIMBS {
            let end_unseen = !supported(end);
            if end_unseen {
                for joint in rest.iter().chain([&end]) {
                    unseen |= 1 << joint.index();
                }
            }
            if end_unseen && !supported(middle) {
                unseen |= 1 << middle.index();
            }
        }
        unseen
    }
}

/// Middle and end of each limb, and the joints fixed to the end.
const LIMBS: [(Joint, Joint, &[Joint]); 4] = [
    (Joint::LeftElbow, Joint::LeftWrist, &[Joint::LeftHand]),
    (Joint::RightElbow, Joint::RightWrist, &[Joint::RightHand]),
    (
        Joint::LeftKnee,
        Joint::LeftAnkle,
        &[Joint::LeftHeel, Joint::LeftToe],
    ),
    (
        Joint::RightKnee,
        Joint::RightAnkle,
        &[Joint::RightHeel, Joint::RightToe],
    ),
];
