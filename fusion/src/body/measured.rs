//! A person's body as far as it is measured: its links, and where the network's keypoints sit on it.

use std::sync::Arc;

use super::keypoint_estimate::KeypointEstimate;
use super::prior::BodyPrior;
use super::remeasure::{Remeasure, RemeasureSchedule};
use super::sites::{SiteEvidence, SiteFit, without_offsets};
use super::skeleton::{Kinematics, Site, Skeleton};

/// A body, which is the same from tick to tick and from life to life of a person.
#[derive(Debug, Clone)]
pub struct MeasuredBody {
    /// Link lengths, left and right equal.
    pub skeleton: Skeleton,
    /// Per keypoint of the network: where it sits on this person, if anywhere.
    pub sites: Vec<Option<Site>>,
    /// What is known of it beside, where it is a subject's.
    pub(crate) known: Option<Arc<BodyPrior>>,
    /// What its lengths are still measured from.
    pub(crate) remeasure: Remeasure,
    /// What `sites` are learned from.
    site_fit: SiteFit,
}

impl MeasuredBody {
    /// A body of which nothing is known but `skeleton`; `sites` are those of the network's card.
    pub fn new(skeleton: Skeleton, sites: Vec<Option<Site>>) -> Self {
        Self {
            skeleton,
            sites,
            known: None,
            remeasure: Remeasure::new(),
            site_fit: SiteFit::new(),
        }
    }

    /// Learns in its turn among those who came together, by its `number`.
    pub(crate) fn take_turn(&mut self, number: u32) {
        self.site_fit.take_turn(number);
    }

    /// Learns from a tick where the keypoints sit, `dt_s` after the last; `of_card` are the sites of the
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

    /// Keeps what a tick says of the link lengths.
    pub(crate) fn note_lengths(
        &mut self,
        estimates: &[KeypointEstimate],
        kinematics: &Kinematics,
        schedule: &RemeasureSchedule<'_>,
    ) {
        let joints = || without_offsets(estimates, &self.sites, kinematics);
        self.remeasure.tick(joints, schedule);
    }

    /// It is the body `known`: what was seen of it so far is measured with that.
    pub(crate) fn is_known(&mut self, known: Arc<BodyPrior>, schedule: &RemeasureSchedule<'_>) {
        self.known = Some(known);
        self.measure(schedule);
    }

    /// Measures the link lengths anew, with what was kept; they stay where that does not show any.
    pub(crate) fn measure(&mut self, schedule: &RemeasureSchedule<'_>) {
        let measured = self.remeasure.measure(self.known.as_deref(), schedule);
        if let Some(skeleton) = measured {
            self.skeleton = skeleton;
        }
    }
}
