//! A person's measured body: its links, and the sites of the network's keypoints.

use std::sync::Arc;

use super::keypoint_estimate::KeypointEstimate;
use super::prior::BodyPrior;
use super::remeasure::{Remeasure, RemeasureSchedule};
use super::sites::{SiteEvidence, SiteFit, without_offsets};
use super::skeleton::{Kinematics, Site, Skeleton};

/// A body, which stays the same from tick to tick and from life to life of a person.
#[derive(Debug, Clone)]
pub struct MeasuredBody {
    /// Link lengths, left and right equal.
    pub skeleton: Skeleton,
    /// Per keypoint of the network: its site on this person, if it has one.
    pub sites: Vec<Option<Site>>,
    /// The prior, if the person is a subject.
    pub(crate) known: Option<Arc<BodyPrior>>,
    /// Samples for the lengths.
    pub(crate) remeasure: Remeasure,
    /// State of the learned `sites`.
    site_fit: SiteFit,
}

impl MeasuredBody {
    /// A body with only `skeleton` known; `sites` are those of the network's card.
    pub fn new(skeleton: Skeleton, sites: Vec<Option<Site>>) -> Self {
        Self {
            skeleton,
            sites,
            known: None,
            remeasure: Remeasure::new(),
            site_fit: SiteFit::new(),
        }
    }

    /// Sets the turn of learning by the person's `number`, so that people who arrive together learn
    /// at different ticks.
    pub(crate) fn take_turn(&mut self, number: u32) {
        self.site_fit.take_turn(number);
    }

    /// Learns the keypoint sites from a tick, `dt_s` after the last; `of_card` are the sites of the
    /// network's card, `kinematics` those of the pose that fits `estimates`.
    pub(crate) fn learn_sites(
        &mut self,
        of_card: &[Option<Site>],
        estimates: &[KeypointEstimate],
        kinematics: &Kinematics,
        dt_s: f64,
    ) {
        let tick = SiteEvidence {
            of_card,
            estimates,
            body: kinematics,
            lengths: self.skeleton.proportions(),
            dt_s,
        };
        self.site_fit.learn(&mut self.sites, &tick);
    }

    /// Stores a tick's sample of the link lengths.
    pub(crate) fn note_lengths(
        &mut self,
        estimates: &[KeypointEstimate],
        kinematics: &Kinematics,
        schedule: &RemeasureSchedule<'_>,
    ) {
        let joints = || without_offsets(estimates, &self.sites, kinematics);
        self.remeasure.tick(joints, schedule);
    }

    /// Sets the prior `known`, and remeasures the samples with it.
    pub(crate) fn is_known(&mut self, known: Arc<BodyPrior>, schedule: &RemeasureSchedule<'_>) {
        self.known = Some(known);
        self.measure(schedule);
    }

    /// Remeasures the link lengths from the samples; they stay if the samples do not suffice.
    pub(crate) fn measure(&mut self, schedule: &RemeasureSchedule<'_>) {
        let measured = self.remeasure.measure(self.known.as_deref(), schedule);
        if let Some(skeleton) = measured {
            self.skeleton = skeleton;
        }
    }
}
