//! A person's measured body: its links, and the sites of the network's keypoints.
//!
//! # Repeated measurement of the link lengths during the first seconds
//!
//! The errors of a network's keypoints last for seconds: a knee that is seen 20 mm too low is seen
//! so for a while, and lengths from the ticks before the confirmation alone would keep that error
//! forever. So the keypoints of all later ticks are sampled. The lengths are fitted to them again
//! 2, 4, 8, ... seconds after the confirmation, until `births.measure_s`; from then on they do not
//! change.

use std::sync::Arc;

use farfield_proto::venue::parameters::IkParameters;

use super::fit::fit_known;
use super::observed::{KeypointEstimate, ObservedJoints};
use super::prior::BodyPrior;
use super::proportions::KnownBody;
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

/// Most samples; when they are reached, every second one is dropped and the step doubles.
const MAX_SAMPLES: usize = 64;
/// Initial ticks between samples, at any rate.
const FIRST_STRIDE: u32 = 5;
/// Ticks with fewer points are not used.
const MIN_POINTS: usize = 8;

/// Samples of a person's lengths.
#[derive(Debug, Clone)]
pub(crate) struct Remeasure {
    samples: Vec<ObservedJoints>,
    stride: u32,
    lived_ticks: u32,
    next_s: f64,
    /// Whether a measurement is due.
    is_due: bool,
}

/// When and how lengths are remeasured.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RemeasureSchedule<'a> {
    /// Tick period, seconds.
    pub(crate) dt_s: f64,
    /// End of the measurements after the confirmation, seconds.
    pub(crate) measure_s: f64,
    /// Parameters of the fit.
    pub(crate) ik: &'a IkParameters,
}

impl Remeasure {
    pub(crate) fn new() -> Self {
        Self {
            samples: Vec::with_capacity(MAX_SAMPLES),
            stride: FIRST_STRIDE,
            lived_ticks: 0,
            next_s: 2.0,
            is_due: false,
        }
    }

    pub(crate) fn tick(
        &mut self,
        observe: impl FnOnce() -> ObservedJoints,
        schedule: &RemeasureSchedule<'_>,
    ) {
        if self.is_over(schedule) {
            return;
        }
        self.lived_ticks += 1;
        if self.lived_ticks.is_multiple_of(self.stride) {
            let observed = observe();
            if observed.count() >= MIN_POINTS {
                self.keep(observed);
            }
        }
        if f64::from(self.lived_ticks) * schedule.dt_s >= self.next_s {
            self.next_s *= 2.0;
            self.is_due = true;
        }
    }

    /// Whether a measurement is due.
    pub(crate) fn is_due(&self) -> bool {
        self.is_due
    }

    /// Whether the body will not be measured again.
    pub(crate) fn is_over(&self, schedule: &RemeasureSchedule<'_>) -> bool {
        self.next_s > schedule.measure_s
    }

    /// The body from the samples, with the prior `known`; `None` if they do not suffice.
    pub(crate) fn measure(
        &mut self,
        known: Option<&BodyPrior>,
        schedule: &RemeasureSchedule<'_>,
    ) -> Option<Skeleton> {
        self.is_due = false;
        let seen_s = f64::from(self.lived_ticks) * schedule.dt_s;
        let known = known.map(|prior| KnownBody { prior, seen_s });
        // The pose of the fit is not used: the track has a better one.
        fit_known(&self.samples, known, schedule.ik, None)
            .ok()
            .map(|body| body.skeleton)
    }

    fn keep(&mut self, observed: ObservedJoints) {
        if self.samples.len() == MAX_SAMPLES {
            let mut index = 0;
            self.samples.retain(|_| {
                index += 1;
                index % 2 == 0
            });
            self.stride *= 2;
        }
        self.samples.push(observed);
    }
}
