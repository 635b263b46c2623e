//! Uncertainty of a pose: one standard deviation per joint and axis, sqrt(trace/3) of the
//! covariance.
//!
//! It has four sources, all as variance per axis:
//!
//! - The views of this tick (`observation`), carried through the skeleton to all joints by
//!   [`JointSpread`]: an unseen joint is connected to seen ones, and is somewhere in its range of
//!   motion. Errors that last for seconds (this person's hips relative to the network's,
//!   body proportions) are added, because they do not average out. So is the misfit: if the pose is
//!   farther from the keypoints than their uncertainty, one of the two is wrong.
//! - The variance when the joint was last seen, and its growth since (`drift`); it is used if it is
//!   less. It grows limb by limb, and for the whole body while fewer than two views show the
//!   person. It starts when two views last showed the person or, without any view, when any did,
//!   whichever is less. A person that flickers between one view and none is as uncertain as with
//!   one view.
//! - Disagreement of the views (`disagreement`): cameras that do not agree make all joints
//!   uncertain. If they show single keypoints elsewhere, these are as uncertain as the places are
//!   apart.
//! - The last variance: the filter needs time to return, and so does the variance.
//!
//! Errors of a network last for seconds, so earlier ticks do not reduce the variance of a tick:
//! this is no Kalman filter. The numbers are chosen so that 68 % of the errors per axis lie within
//! one sigma, not so that sigma is their root mean square: errors of keypoints have longer tails
//! than a normal distribution.

mod disagreement;
mod drift;
mod observation;

pub(crate) use disagreement::SeenPose;
pub use disagreement::weigh_views;
pub(crate) use observation::BodyObservation;

use crate::body::ik::JointSpread;
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Joint, Joints, Kinematics, N_JOINTS, Site};
use drift::LastSeen;

/// Share of the misfit between pose and keypoints that is an error of the pose.
const MISFIT_SHARE: f64 = 0.5;
/// Averaging time of the misfit, seconds.
const MISFIT_S: f64 = 0.25;
/// Time constant of the return to a joint that is seen again, seconds.
const RETURN_S: f64 = 0.05;

/// The evidence of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MadeOf {
    /// Two or more viewpoints.
    Views,
    /// One viewpoint: the distance of the body follows only from its size.
    OneView,
    /// None: it is predicted.
    Motion,
}

impl MadeOf {
    /// The evidence in `estimates`: at least `enough` keypoints that two viewpoints agree on, or
    /// that any shows.
    pub fn from_estimates(estimates: &[KeypointEstimate], enough: usize) -> Self {
        let seen_by = |views: u16| {
            let seen = |e: &&KeypointEstimate| e.weight > 0.0 && e.views >= views;
            estimates.iter().filter(seen).count() >= enough
        };
        if seen_by(2) {
            Self::Views
        } else if seen_by(1) {
            Self::OneView
        } else {
            Self::Motion
        }
    }
}

/// Input of one tick, for one person.
#[derive(Debug, Clone, Copy)]
pub struct TickEvidence<'a> {
    /// The keypoints from the views.
    pub estimates: &'a [KeypointEstimate],
    /// The keypoint sites of this person.
    pub sites: &'a [Option<Site>],
    /// The published pose.
    pub body: &'a Kinematics,
    /// Its velocity, metres per second.
    pub velocity_m_s: &'a Joints,
    /// The evidence of the pose.
    pub made_of: MadeOf,
    /// Factor on the variance because views show the person elsewhere, at least 1; `None` if no
    /// view counts.
    pub variance_factor: Option<f64>,
    /// Time since the last tick, seconds.
    pub dt_s: f64,
    /// Decay time of the velocity of a coasting person, seconds.
    pub coast_decay_s: f64,
}

/// The uncertainty of one person's joints, from tick to tick. A step allocates nothing.
#[derive(Debug, Clone)]
pub struct Uncertainty {
    spread: JointSpread,
    /// Whether the person was seen since the start.
    is_known: bool,
    /// Per axis.
    variance_m2: [f64; N_JOINTS],
    /// Variance from the views of the last tick alone, without lasting errors; infinite without
    /// views.
    of_tick_m2: [f64; N_JOINTS],
    /// Mean square distance per axis between the keypoint on a joint and the pose.
    misfit_m2: [f64; N_JOINTS],
    /// When two views last showed the person, and when any did.
    by_two: LastSeen,
    by_any: LastSeen,
    /// Recent factor on the variance from views that do not fit.
    variance_factor: f64,
    /// The evidence of the last pose.
    made_of: MadeOf,
    /// Upper limit of the variance of the body's carried place.
    at_most_m2: f64,
    /// Variance of the body's carried place.
    carried_off_m2: f64,
    /// Of the pelvis, when the person was last seen.
    speed_m_s: f64,
}

impl Default for Uncertainty {
    fn default() -> Self {
        Self {
            spread: JointSpread::default(),
            is_known: false,
            variance_m2: [0.0; N_JOINTS],
            of_tick_m2: [f64::INFINITY; N_JOINTS],
            misfit_m2: [0.0; N_JOINTS],
            by_two: LastSeen::default(),
            by_any: LastSeen::default(),
            variance_factor: 1.0,
            made_of: MadeOf::Views,
            at_most_m2: 0.0,
            carried_off_m2: 0.0,
            speed_m_s: 0.0,
        }
    }
}

impl Uncertainty {
    /// Per joint one standard deviation per axis, metres; `None` until the person was seen.
    pub fn sigma_m(&self) -> Option<[f64; N_JOINTS]> {
        let variance_m2 = self.variance_m2()?;
        Some(variance_m2.map(f64::sqrt))
    }

    /// Per joint the variance per axis, m²; `None` until the person was seen.
    pub fn variance_m2(&self) -> Option<[f64; N_JOINTS]> {
        let factor = self.variance_factor;
        self.is_known
            .then(|| self.variance_m2.map(|variance_m2| factor * variance_m2))
    }

    /// Per joint the variance per axis from the views of the last tick alone, m²: without earlier
    /// ticks, and without lasting errors. Infinite without views.
    pub fn of_tick_m2(&self) -> [f64; N_JOINTS] {
        let factor = self.variance_factor;
        self.of_tick_m2.map(|variance_m2| factor * variance_m2)
    }

    /// Upper limit of the distance, per axis, of an unseen body from its carried place, metres.
    pub fn adrift_m(&self) -> f64 {
        match self.made_of {
            MadeOf::Motion => self.at_most_m2.sqrt(),
            MadeOf::Views | MadeOf::OneView => 0.0,
        }
    }

    /// Standard deviation, per axis, of an unseen body's place from its carried one, metres.
    pub fn carried_off_m(&self) -> f64 {
        match self.made_of {
            MadeOf::Motion => self.carried_off_m2.sqrt(),
            MadeOf::Views | MadeOf::OneView => 0.0,
        }
    }

    /// The evidence of the last pose.
    pub fn made_of(&self) -> MadeOf {
        self.made_of
    }

    /// Forgets the state.
    pub fn reset(&mut self) {
        self.is_known = false;
        self.misfit_m2 = [0.0; N_JOINTS];
        self.variance_factor = 1.0;
    }

    /// Updates the state by one tick.
    pub fn step(&mut self, tick: &TickEvidence<'_>) {
        let before = std::mem::replace(&mut self.made_of, tick.made_of);
        if (before == MadeOf::Views) != (tick.made_of == MadeOf::Views) {
            self.by_two = LastSeen::now(&self.variance_m2, self.speed_m_s);
            self.by_any = self.by_two;
        }
        match tick.made_of {
            MadeOf::Views => self.by_two.stay(tick.dt_s),
            MadeOf::OneView => self.by_two.lose(tick.dt_s, false),
            MadeOf::Motion => {
                self.by_two.lose(tick.dt_s, true);
                self.by_any.lose(tick.dt_s, true);
                self.at_most_m2 = self.by_any.at_most_m2(tick.coast_decay_s);
            }
        }
        self.of_tick_m2 = [f64::INFINITY; N_JOINTS];
        match tick.made_of {
            MadeOf::Motion => self.coast(tick.coast_decay_s),
            MadeOf::Views | MadeOf::OneView => self.see(tick),
        }
        if tick.made_of != MadeOf::Motion {
            self.speed_m_s = tick.velocity_m_s[Joint::Pelvis.index()].norm();
        }
    }

    fn coast(&mut self, coast_decay_s: f64) {
        let seen = [&self.by_two, &self.by_any].map(|seen| (seen, seen.body_m2(coast_decay_s)));
        let [(_, by_two_m2), (_, by_any_m2)] = seen;
        self.carried_off_m2 = by_two_m2.min(by_any_m2);
        for joint in Joint::ALL {
            let [by_two_m2, by_any_m2] =
                seen.map(|(seen, body_m2)| seen.ahead_m2(joint, body_m2, self.speed_m_s));
            self.variance_m2[joint.index()] = by_two_m2.min(by_any_m2);
        }
    }

    fn see(&mut self, tick: &TickEvidence<'_>) {
        let mut seen_m2 = self.seen_m2(tick);
        if tick.made_of == MadeOf::OneView {
            for variance_m2 in &mut seen_m2 {
                *variance_m2 *= observation::ONE_VIEW_M2;
            }
            for variance_m2 in &mut self.of_tick_m2 {
                *variance_m2 *= observation::ONE_VIEW_M2;
            }
            // Only what this view knows: the variance of two views continues to grow.
            self.by_any = LastSeen::now(&seen_m2, self.speed_m_s);
        }
        if !self.is_known {
            self.variance_m2 = seen_m2;
            self.by_two = LastSeen::now(&seen_m2, self.speed_m_s);
            self.by_any = self.by_two;
            self.is_known = true;
            return;
        }
        let lag = libm::exp(-2.0 * tick.dt_s / RETURN_S);
        // Zero while two views show the person.
        let body_m2 = self.by_two.body_m2(tick.coast_decay_s);
        for (i, joint) in Joint::ALL.into_iter().enumerate() {
            let ahead_m2 = self.by_two.ahead_m2(joint, body_m2, self.speed_m_s);
            self.variance_m2[i] = seen_m2[i].min(ahead_m2).max(self.variance_m2[i] * lag);
            if seen_m2[i] <= ahead_m2 && tick.made_of == MadeOf::Views {
                self.by_two.see(joint, self.variance_m2[i]);
            }
        }
        self.split(tick);
    }

    /// If views show a keypoint at two places, the earlier state may be of the wrong one.
    fn split(&mut self, tick: &TickEvidence<'_>) {
        for (estimate, site) in tick.estimates.iter().zip(tick.sites) {
            let Some(site) = site.filter(|_| estimate.split_m2 > 0.0) else {
                continue;
            };
            let foot = observation::FEET.iter().find(|foot| foot[0] == site.joint);
            for joint in foot.map_or(std::slice::from_ref(&site.joint), |foot| &foot[..]) {
                let variance_m2 = &mut self.variance_m2[joint.index()];
                *variance_m2 = variance_m2.max(estimate.split_m2);
            }
        }
    }

    /// The variance of each joint from this tick alone, with lasting errors.
    fn seen_m2(&mut self, tick: &TickEvidence<'_>) -> [f64; N_JOINTS] {
        let observation = BodyObservation {
            estimates: tick.estimates,
            sites: tick.sites,
            body: tick.body,
        };
        let mut seen_m2 = observation.variances_m2(&mut self.spread, MadeOf::Views);
        if let Some(factor) = tick.variance_factor {
            let keep = 1.0 - libm::exp(-tick.dt_s / MISFIT_S);
            self.variance_factor += keep * (factor - self.variance_factor);
        }
        self.of_tick_m2 = seen_m2;
        self.compare(tick);
        let misfits_m2 = self.misfit_m2.iter().zip(Joint::ALL);
        for (variance_m2, (misfit_m2, joint)) in seen_m2.iter_mut().zip(misfits_m2) {
            *variance_m2 += observation::sigma_m(joint).powi(2);
            *variance_m2 += MISFIT_SHARE * (misfit_m2 - *variance_m2).max(0.0);
        }
        seen_m2
    }

    /// Updates the misfit of the pose and the keypoints that two or more views show.
    fn compare(&mut self, tick: &TickEvidence<'_>) {
        let keep = 1.0 - libm::exp(-tick.dt_s / MISFIT_S);
        for (estimate, site) in tick.estimates.iter().zip(tick.sites) {
            if let Some(site) = site
                && estimate.views >= 2
                && estimate.weight > 0.0
            {
                let off_m = estimate.position_m - tick.body.site_m(site);
                let misfit_m2 = &mut self.misfit_m2[site.joint.index()];
                *misfit_m2 += keep * (off_m.norm_squared() / 3.0 - *misfit_m2);
            }
        }
    }
}

/// The uncertainty of a person at a tick.
#[derive(Debug, Clone, Copy)]
pub struct UncertaintySnapshot {
    was_seen: bool,
    variance_m2: [f64; N_JOINTS],
    by_two: LastSeen,
    by_any: LastSeen,
    made_of: MadeOf,
    speed_m_s: f64,
    variance_factor: f64,
}

impl Uncertainty {
    /// The current uncertainty.
    pub fn known(&self) -> UncertaintySnapshot {
        UncertaintySnapshot {
            was_seen: self.is_known,
            variance_m2: self.variance_m2,
            by_two: self.by_two,
            by_any: self.by_any,
            made_of: self.made_of,
            speed_m_s: self.speed_m_s,
            variance_factor: self.variance_factor,
        }
    }

    /// Restores `known`. A step with the time since then makes it as uncertain as if nothing had
    /// been seen.
    pub fn go_back_to(&mut self, known: &UncertaintySnapshot) {
        self.is_known = known.was_seen;
        self.variance_m2 = known.variance_m2;
        self.by_two = known.by_two;
        self.by_any = known.by_any;
        self.made_of = known.made_of;
        self.speed_m_s = known.speed_m_s;
        self.variance_factor = known.variance_factor;
        self.misfit_m2 = [0.0; N_JOINTS];
    }
}

#[cfg(test)]
mod tests;
