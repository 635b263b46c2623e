//! How sure a pose is: one standard deviation per joint and axis, sqrt(trace/3) of the covariance.
//!
//! Four things are known of a joint at a tick, all as variance per axis:
//!
//! * what the views of this tick tell (`views`), carried through the skeleton to all joints by
//!   [`JointSpread`]: a joint that no keypoint shows hangs from those that are seen, and is somewhere in
//!   its range of motion. What stays the same for seconds (`lasting`: where this person's hips are
//!   against what a network calls hips, how it is built) is added: it does not average out. So is what
//!   the pose cannot follow: where it lies farther from the keypoints than they are unsure, one of the
//!   two is wrong;
//! * what was known when the joint was last seen, and how far it may have gone since (`drift`): it is
//!   taken where it is less. It grows limb by limb, and with the whole body while fewer than two views
//!   show the person: from when two views did, or, where nothing does, from when any did, whichever is
//!   less. Who flickers between one view and none is as unsure as with one view;
//! * what its views show elsewhere (`disagreement`): cameras that do not agree make nobody sure. Where they show single
//!   keypoints elsewhere, these are as unsure as the places are apart (`split`);
//! * how far off the pose was a moment ago: the filter takes its time to come back, and so does this.
//!
//! Errors of a network last for seconds, so a tick does not become surer by the ticks before it: this
//! is no Kalman filter. The numbers are chosen so that 68 % of the errors per axis lie within one
//! sigma, not so that sigma is their root mean square: errors of keypoints have longer tails than a
//! normal distribution.

mod disagreement;
mod drift;
mod known;
mod last_seen;
mod lasting;
mod observation;
mod split;
mod views;

pub(crate) use disagreement::SeenPose;
pub use known::UncertaintySnapshot;
pub(crate) use observation::BodyObservation;
pub use split::weigh_views;

use self::last_seen::LastSeen;

use crate::body::ik::JointSpread;
use crate::body::keypoint_estimate::KeypointEstimate;
use crate::body::skeleton::Joints;
use crate::body::skeleton::{Joint, Kinematics, N_JOINTS, Site};

/// Share of the misfit between pose and keypoints that is the pose's error.
const MISFIT_SHARE: f64 = 0.5;
/// Over which the misfit is averaged, seconds.
const MISFIT_S: f64 = 0.25;
/// How fast the pose comes back to what is seen again, seconds.
const RETURN_S: f64 = 0.05;

/// What the pose of a tick was made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MadeOf {
    /// What two viewpoints and more showed.
    Views,
    /// What one viewpoint showed: how far away the body is follows from its size alone.
    OneView,
    /// Nothing: it was carried on.
    Motion,
}

impl MadeOf {
    /// What a tick is made of that brought `estimates`: with at least `enough` keypoints that two viewpoints
    /// agree on, or that any shows.
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

/// What a tick brought, for one person.
#[derive(Debug, Clone, Copy)]
pub struct TickEvidence<'a> {
    /// What the views told of the keypoints.
    pub estimates: &'a [KeypointEstimate],
    /// Where the keypoints sit on this person.
    pub sites: &'a [Option<Site>],
    /// The published pose.
    pub body: &'a Kinematics,
    /// Its velocity, metres per second.
    pub velocity_m_s: &'a Joints,
    /// What the pose was made of.
    pub made_of: MadeOf,
    /// By what the variance is larger because views show the person elsewhere, at least 1; `None`: none tells.
    pub variance_factor: Option<f64>,
    /// Time since the last tick, seconds.
    pub dt_s: f64,
    /// With which the velocity of a coasting person fades, seconds.
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
    /// What the views of the last tick alone knew, without what no tick can know; infinite without any.
    of_tick_m2: [f64; N_JOINTS],
    /// Mean square distance per axis between the keypoint on a joint and the pose.
    misfit_m2: [f64; N_JOINTS],
    /// When two views last showed the person, and when any did.
    by_two: LastSeen,
    by_any: LastSeen,
    /// By what views that do not fit made the variance larger lately.
    variance_factor: f64,
    /// What the last pose was made of.
    made_of: MadeOf,
    /// How far the body as a whole may at most be from where it is carried.
    at_most_m2: f64,
    /// How far it is from there: the variance.
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

    /// Per joint how sure the views of the last tick alone were of it, variance per axis, m²: without the
    /// ticks before, and without what is the same in all ticks. Infinite where they said nothing.
    pub fn of_tick_m2(&self) -> [f64; N_JOINTS] {
        let factor = self.variance_factor;
        self.of_tick_m2.map(|variance_m2| factor * variance_m2)
    }

    /// How far, per axis, the body as a whole may at most be from where it is carried since nothing shows it, metres.
    pub fn adrift_m(&self) -> f64 {
        match self.made_of {
            MadeOf::Motion => self.at_most_m2.sqrt(),
            MadeOf::Views | MadeOf::OneView => 0.0,
        }
    }

    /// How far, per axis, the body as a whole is from where it is carried since nothing shows it, metres: one standard
    /// deviation.
    pub fn carried_off_m(&self) -> f64 {
        match self.made_of {
            MadeOf::Motion => self.carried_off_m2.sqrt(),
            MadeOf::Views | MadeOf::OneView => 0.0,
        }
    }

    /// What the last pose was made of.
    pub fn made_of(&self) -> MadeOf {
        self.made_of
    }

    /// Forgets what is known.
    pub fn reset(&mut self) {
        self.is_known = false;
        self.misfit_m2 = [0.0; N_JOINTS];
        self.variance_factor = 1.0;
    }

    /// Takes in one tick.
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
            // What it knows by itself: what two views knew before goes on growing.
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
        // Nothing while two views show the person.
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

    /// Where views show a keypoint at two places, what was known before may be of the wrong one.
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

    /// What this tick alone knows of each joint, and what it cannot know.
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
            *variance_m2 += lasting::sigma_m(joint).powi(2);
            *variance_m2 += MISFIT_SHARE * (misfit_m2 - *variance_m2).max(0.0);
        }
        seen_m2
    }

    /// Notes how far the pose is from the keypoints that two views and more show.
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

#[cfg(test)]
mod tests;
