//! One person: its estimate and its identity.
//!
//! At its confirmation, a tentative person's lengths are estimated from all its ticks. The ticks are
//! then solved again, so that the lengths are the same from the first published pose
//! to the last.

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{PersonBoxes, PersonPose, PersonState};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::known::{Candidate, Departed};
use super::phase::{self, Coverage, Phase, Showable, published};
use super::poster::Stillness;
use super::shown::ShownPeople;
use super::whereabouts::{LastSeen, Whereabouts};
use crate::align::TickGroup;
use crate::body::fit::{PoseFinder, fit};
use crate::body::observed::{KeypointEstimate, ObservedJoints};
use crate::body::skeleton::{Joint, Pose, Skeleton};
use crate::estimate::estimator::{BodyAhead, Estimator, RestartPoint, TickSnapshot};
use crate::estimate::uncertainty::MadeOf;
use crate::method::{Method, VenueView};

/// Greatest uncertainty, per axis, of a lost person's place at which its crops are still used,
/// metres. Crops are cut at that place and show any person there. Beyond this limit, sightings
/// decide the identity.
const ADRIFT_M: f64 = 0.15;

/// One person: the estimator has evidence, body and estimate; [`TrackIdentity`] has the rest.
pub struct Track {
    pub(crate) identity: TrackIdentity,
    pub(crate) estimator: Estimator,
}

/// The identity of a track, and the inputs of decisions about it.
#[derive(Debug)]
pub struct TrackIdentity {
    pub(crate) id: PersonId,
    /// The person's id on the edges; it stays when the person is recognised.
    pub(crate) wire_id: PersonId,
    /// The only place where a phase is stored; only events change it.
    pub(crate) phase: Phase,
    /// Counts of evidence: see [`Track::count`].
    pub(crate) coverage: Coverage,
    pub(crate) tentative: TentativeRecord,
    /// Ticks of life so far, also those of an earlier life.
    pub(crate) lived_ticks: u32,
    /// Where it was last surely itself.
    pub(crate) last_seen: Option<LastSeen>,
    /// Where it last stood alone.
    pub(crate) alone: Option<Alone>,
    /// Changes of the last tick to earlier ones.
    pub(crate) changed: ChangedTicks,
}

/// Data of a tentative person besides its pose; empty once it is confirmed.
#[derive(Debug, Clone, Default)]
pub(crate) struct TentativeRecord {
    pub(crate) ticks: Vec<TentativeTick>,
    pub(crate) votes: Votes,
    /// Of [`Self::ticks`], once there are enough.
    pub(crate) stillness: Option<Stillness>,
    /// When and where it was first sighted, if it has been reinitiated since.
    pub(crate) first: Option<(Tick, Vector3<f64>)>,
    /// The known skeleton, from its recognition until its ticks are solved again.
    pub(crate) known: Option<Skeleton>,
    /// The pelvis at the last sighting, world, metres.
    pub(crate) place_m: Vector3<f64>,
    /// The velocity at the last sighting, world, metres per second.
    pub(crate) velocity_m_s: Vector3<f64>,
}

impl TentativeRecord {
    /// Begins with a sighting; the votes continue.
    pub(crate) fn begin(&mut self, tick: Tick, estimates: Vec<KeypointEstimate>) {
        self.stillness = None;
        self.ticks.clear();
        self.ticks.push(TentativeTick { tick, estimates });
    }

    /// Adds a tick with its estimates.
    pub(crate) fn push(&mut self, tick: Tick, estimates: Vec<KeypointEstimate>, method: &Method) {
        self.ticks.push(TentativeTick { tick, estimates });
        let births = &method.parameters.births;
        if self.ticks.len() >= births.confirm_ticks(1.0 / method.dt_s) as usize {
            self.stillness = Stillness::from_ticks(&self.ticks, &method.relative_sigmas);
        }
    }
}

/// The state of a person when it stood alone.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Alone {
    pub(crate) tick: Tick,
    pub(crate) restart_point: RestartPoint,
}

/// Changes of a tick to earlier ones.
#[derive(Debug, Default)]
pub(crate) struct ChangedTicks {
    /// The ticks that were solved again.
    pub(crate) solved: Vec<TickSnapshot>,
    /// Evidence after this tick belonged to another person.
    pub(crate) mistaken_since: Option<Tick>,
}

impl AsRef<Estimator> for Track {
    fn as_ref(&self) -> &Estimator {
        &self.estimator
    }
}

impl Track {
    /// A person in `phase` with the body `skeleton` in `pose`.
    pub(crate) fn new(
        id: PersonId,
        phase: Phase,
        (skeleton, pose): (Skeleton, Pose),
        method: &Method,
    ) -> Self {
        let mut estimator = Estimator::new(skeleton, pose, method);
        estimator.body.take_turn(id.0);
        Self {
            identity: TrackIdentity {
                id,
                wire_id: id,
                phase,
                coverage: Coverage::default(),
                tentative: TentativeRecord::default(),
                lived_ticks: 0,
                last_seen: None,
                alone: None,
                changed: ChangedTicks::default(),
            },
            estimator,
        }
    }

    /// The id.
    pub fn id(&self) -> PersonId {
        self.identity.id
    }

    /// The person's id on the edges. It equals [`Self::id`] until the person is recognised as an
    /// earlier one. Then only [`Self::id`] changes.
    pub fn wire_id(&self) -> PersonId {
        self.identity.wire_id
    }

    /// The estimator.
    pub fn estimator(&self) -> &Estimator {
        &self.estimator
    }

    /// Whether the person is not confirmed yet.
    pub fn is_tentative(&self) -> bool {
        self.identity.phase.is_tentative()
    }

    /// Whether the first crops of a tentative person are still on the way.
    pub(crate) fn is_awaited(&self) -> bool {
        phase::is_awaited(self.identity.phase, self.identity.coverage)
    }

    /// Whether one viewpoint has led it since two saw it.
    pub(crate) fn is_led(&self) -> bool {
        let coverage = self.identity.coverage;
        coverage.unseen < coverage.since_two
    }

    /// The earlier ticks that were solved again at the last tick, after a confirmation.
    pub fn solved_again(&self) -> &[TickSnapshot] {
        &self.identity.changed.solved
    }

    /// Set if the last tick showed that the evidence after this tick belonged to another person.
    pub fn mistaken_since(&self) -> Option<Tick> {
        self.identity.changed.mistaken_since
    }

    /// Begins a tick, and clears the changes of the last one.
    pub fn begin(&mut self, method: &Method) {
        self.identity.changed.solved.clear();
        self.identity.changed.mistaken_since = None;
        self.estimator.begin(method);
    }

    /// Reads every patch of this person in `group`; returns how many could not be used. A lost
    /// person that may be elsewhere reads none if sightings can find it (`finds_people`).
    pub fn see_all(
        &mut self,
        group: &TickGroup,
        cameras: &[VenueView],
        method: &Method,
        finds_people: bool,
    ) -> u32 {
        let (id, mut unusable) = (self.identity.wire_id, 0);
        if finds_people && self.is_adrift() {
            return 0;
        }
        let estimator = &mut self.estimator;
        for set in &group.patch_sets {
            for patch in set.persons.iter().filter(|patch| patch.person == id) {
                let camera = cameras.get(usize::from(patch.camera.0));
                let own = camera.filter(|camera| camera.viewpoint == set.viewpoint);
                let taken =
                    own.is_some_and(|own| estimator.see(patch, set.viewpoint, &own.model, method));
                unusable += u32::from(!taken);
            }
        }
        unusable
    }

    /// Whether it is lost, and may be elsewhere than carried.
    pub(crate) fn is_adrift(&self) -> bool {
        self.identity.phase.is_lost() && self.estimator.adrift_m() > ADRIFT_M
    }

    /// First inverse kinematics; also learns the keypoint sites of a confirmed person.
    pub fn fit_keypoints(&mut self, method: &Method) {
        self.estimator.fit_keypoints(method);
        if !self.is_tentative() {
            self.estimator.learn_sites(method);
        }
    }

    /// The pose as it is published.
    pub fn published(&self) -> PersonPose {
        self.estimator.published(self.identity.id, self.state())
    }

    /// Fills `made` with the boxes of the person in the cameras of each of `viewpoints` (of the
    /// venue's `cameras`), so many ticks after the newest pose; `None` if no camera will see it.
    pub fn boxes<'a>(
        &mut self,
        viewpoints: impl Iterator<Item = (&'a [CameraIndex], i64)>,
        cameras: &[VenueView],
        method: &Method,
        made: &mut Vec<Option<PersonBoxes>>,
    ) {
        made.clear();
        let mut ahead: Option<(i64, BodyAhead)> = None;
        for (own, ticks) in viewpoints {
            // Usually all viewpoints have one horizon.
            let (_, ahead) = match ahead.take_if(|(of, _)| *of == ticks) {
                Some(same) => ahead.insert(same),
                None => ahead.insert((ticks, self.estimator.ahead(ticks as f64, method))),
            };
            let own = own.iter().filter_map(|&index| {
                let camera = cameras.get(usize::from(index.0))?;
                Some((index, &camera.model))
            });
            let boxes = self.estimator.boxes(own, ahead);
            made.push((!boxes.is_empty()).then_some(PersonBoxes {
                person: self.identity.wire_id,
                cameras: boxes,
            }));
        }
    }

    /// Writes the result of the last tick, `tick`, to `into`. Allocates only while `into` grows.
    pub fn write_snapshot(&self, tick: Tick, into: &mut TickSnapshot) {
        self.estimator.write_snapshot(tick, self.state(), into);
    }

    fn state(&self) -> PersonState {
        published(self.identity.phase, self.identity.coverage)
    }

    /// The person as a candidate for comparison; `None` if it was never seen.
    pub(crate) fn candidate(&self, rate_hz: f64, shown: &ShownPeople) -> Option<Candidate> {
        let identity = &self.identity;
        let skeleton = &self.estimator.body.skeleton;
        let lived_s = f64::from(identity.lived_ticks) / rate_hz;
        Some(Candidate {
            shown: shown.places_of(identity.wire_id),
            ..Candidate::new(identity.id, identity.last_seen?, skeleton, lived_s)
        })
    }

    /// The data of a person that leaves at tick `gone`; `None` if it was never seen.
    pub(crate) fn departed(&self, gone: Tick, rate_hz: f64) -> Option<Departed> {
        Some(Departed {
            id: self.identity.id,
            wire_id: self.identity.wire_id,
            last_seen: self.identity.last_seen?,
            gone,
            is_missed: false,
            body: self.estimator.body.clone(),
            lived_s: f64::from(self.identity.lived_ticks) / rate_hz,
        })
    }

    /// Counts the tick that was just solved. `showable`: which evidence it could give about a body
    /// with these keypoints (world, metres).
    pub(crate) fn count(
        &mut self,
        tick: Tick,
        method: &Method,
        showable: impl FnOnce(&[Vector3<f64>]) -> Showable,
    ) {
        let made_of = self.estimator.made_of(method);
        let showable = match made_of {
            MadeOf::Views => Showable::BY_ALL,
            MadeOf::OneView | MadeOf::Motion => showable(&self.estimator.keypoints_m()),
        };
        let identity = &mut self.identity;
        identity.lived_ticks = identity.lived_ticks.saturating_add(1);
        identity.coverage.count(made_of, showable);
        if identity.phase.is_tentative() {
            let estimates = self.estimator.estimates().to_vec();
            identity.tentative.push(tick, estimates, method);
        }
    }

    /// Records that the person was seen well at `tick`, where it is.
    pub(crate) fn is_seen_at(&mut self, tick: Tick) {
        self.identity.last_seen = Some(LastSeen {
            tick,
            whereabouts: self.whereabouts(),
        });
    }

    /// Place and velocity of the filter.
    pub(crate) fn whereabouts(&self) -> Whereabouts {
        let estimator = &self.estimator;
        let velocity_m_s = estimator.motion().velocity_m_s()[Joint::Pelvis.index()];
        Whereabouts::at(estimator.pose().root_m)
            .facing_as(estimator.joints_m())
            .moving(&velocity_m_s)
    }

    /// Records that no other person is near at `tick`.
    pub(crate) fn is_alone_at(&mut self, tick: Tick) {
        self.identity.alone = Some(Alone {
            tick,
            restart_point: self.estimator.restart_point(),
        });
    }
}

impl Track {
    /// Takes the id and the body of `known`, who was here before. The poses so far must be solved
    /// again.
    pub(crate) fn take_identity_of(&mut self, known: Departed, rate_hz: f64) {
        self.identity.id = known.id;
        self.identity.lived_ticks += known.lived_ticks(rate_hz);
        let body = &mut self.estimator.body;
        body.sites = known.body.sites;
        body.remeasure = known.body.remeasure;
        body.known = known.body.known;
        self.identity.tentative.known = Some(known.body.skeleton);
    }

    /// Estimates the body and returns the poses of the tentative ticks, in order. The phase is
    /// already that of a confirmed person. A recognised person keeps the known body.
    pub(crate) fn solve_again(&mut self, method: &Method) -> Vec<(Tick, PersonPose)> {
        let record = std::mem::take(&mut self.identity.tentative);
        let ticks = record.ticks;
        // The fit returns the pose of its last tick: in reverse order, that is the first sighting.
        let backwards: Vec<ObservedJoints> = ticks
            .iter()
            .rev()
            .map(|t| ObservedJoints::from_estimates(&t.estimates, &method.sites))
            .collect();
        let ik = &method.parameters.ik;
        let bounds = method.range_of_motion.as_ref();
        // If the fit fails, the first body stays: it fitted the first sighting.
        let (skeleton, pose) = fit(&backwards, ik, bounds).map_or_else(
            |_| {
                let estimator = &self.estimator;
                (estimator.body.skeleton.clone(), *estimator.pose())
            },
            |body| (body.skeleton, body.pose),
        );
        let as_known = record.known.and_then(|skeleton| {
            let mut finder = PoseFinder::new(ik, bounds);
            let pose = finder.find(&skeleton, backwards.last()?)?;
            Some((skeleton, pose))
        });
        let (skeleton, pose) = as_known.unwrap_or((skeleton, pose));
        let estimator = &mut self.estimator;
        estimator.restart(skeleton, &pose);
        if record.velocity_m_s != Vector3::zeros() {
            estimator.set_velocity(record.velocity_m_s);
        }
        estimator.forget_uncertainty();
        // The people who are near now are no evidence about earlier ticks.
        estimator.push(None);
        ticks
            .iter()
            .enumerate()
            .map(|(index, tick)| self.replay(index, tick, method))
            .collect()
    }

    fn replay(
        &mut self,
        index: usize,
        tick: &TentativeTick,
        method: &Method,
    ) -> (Tick, PersonPose) {
        let estimates = &mut self.estimator.evidence.estimates;
        estimates.clone_from(&tick.estimates);
        // At the first sighting the pose is the fit itself: there is nothing to smooth with.
        self.estimator.begin(method);
        self.fit_keypoints(method);
        if index > 0 {
            self.estimator.smooth(method);
        }
        self.estimator.fit_joints(method);
        let mut moment = TickSnapshot::default();
        self.estimator
            .write_snapshot(tick.tick, PersonState::Tentative, &mut moment);
        self.identity.changed.solved.push(moment);
        let id = self.identity.id;
        let pose = self.estimator.published(id, PersonState::Tentative);
        (tick.tick, pose)
    }
}

/// Detection passes before contradictions can end a tentative track: detectors sometimes miss
/// people.
const MIN_PASSES: u32 = 3;
/// Least time span of hips for a velocity, seconds: two points with errors of 50 mm each give it
/// within 0.7 m/s, and there are more than two.
const LEAST_TIME_S: f64 = 0.1;

/// The keypoint positions of one tick of a tentative person.
#[derive(Debug, Clone)]
pub(crate) struct TentativeTick {
    pub(crate) tick: Tick,
    pub(crate) estimates: Vec<KeypointEstimate>,
}

/// Velocity of a person from `seen` (time in seconds, joints), world, metres per second: the slope
/// of the least-squares line through the middles of the hips. A filter that began without a
/// velocity has only half of it by then.
pub(crate) fn velocity_m_s(seen: &[(f64, ObservedJoints)]) -> Option<Vector3<f64>> {
    let hips = [Joint::LeftHip, Joint::RightHip];
    let middles = seen
        .iter()
        .filter_map(|(at_s, joints)| Some((*at_s, joints.middle_m(hips)?)));
    let (first, last) = (middles.clone().next()?, middles.clone().next_back()?);
    if last.0 - first.0 < LEAST_TIME_S {
        return None;
    }
    // Relative to the first, so that no digits are lost far from the origin and late in a run.
    let points = middles.map(|(at_s, middle_m)| (at_s - first.0, middle_m - first.1));
    let (mut n, mut t, mut t2) = (0.0, 0.0, 0.0);
    let (mut x, mut xt) = (Vector3::zeros(), Vector3::zeros());
    for (at_s, offset_m) in points {
        n += 1.0;
        t += at_s;
        t2 += at_s * at_s;
        x += offset_m;
        xt += offset_m * at_s;
    }
    Some((xt * n - x * t) / (t2 * n - t * t))
}

/// Results of the detection passes since an initiation.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Votes {
    pub(crate) passes: u32,
    /// Viewpoints that saw it, summed over the passes.
    pub(crate) seen: u32,
    /// Viewpoints that should have seen it and did not, weighted by what their silence is worth
    /// (`crate::sightings::attention`), summed over the passes.
    pub(crate) missed: f64,
}

impl Votes {
    /// Counts one pass: how many viewpoints saw the body, and how many should have seen it and did
    /// not. A pass without either does not count.
    pub(crate) fn count(&mut self, seen: u32, missed: f64) {
        if seen == 0 && missed <= 0.0 {
            return;
        }
        self.passes += 1;
        self.seen += seen;
        self.missed += missed;
    }

    /// Whether the viewpoints contradict the body.
    pub(crate) fn are_against(&self) -> bool {
        self.passes >= MIN_PASSES && self.missed >= f64::from(self.seen)
    }
}

#[cfg(test)]
mod tentative_tests {
    use super::*;

    #[test]
    fn contradictions_end_a_tentative_track_but_single_misses_do_not() {
        let mut votes = Votes::default();
        votes.count(2, 1.0);
        votes.count(1, 3.0);
        assert!(!votes.are_against());
        votes.count(2, 1.0);
        assert!(votes.are_against());
        let mut votes = Votes::default();
        for _ in 0..10 {
            votes.count(2, 1.0);
        }
        assert!(!votes.are_against());
    }

    #[test]
    fn velocity_is_that_of_the_hips_and_needs_several_ticks() {
        let hips = |at_s: f64| {
            let x_m = 4.0 * at_s;
            let points = [
                ("left_hip", [x_m, 0.1, 0.9]),
                ("right_hip", [x_m, -0.1, 0.9]),
            ];
            (at_s, ObservedJoints::from_named(points))
        };
        let seen: Vec<_> = (0..12)
            .map(|tick| hips(1e3 + f64::from(tick) / 60.0))
            .collect();
        let velocity_m_s = velocity_m_s(&seen).unwrap();
        assert!((velocity_m_s - Vector3::new(4.0, 0.0, 0.0)).norm() < 1e-6);
        assert_eq!(super::velocity_m_s(&seen[..6]), None);
        assert_eq!(super::velocity_m_s(&[]), None);
        let nothing = |at_s| (at_s, ObservedJoints::from_named([]));
        assert_eq!(super::velocity_m_s(&[nothing(0.0), nothing(1.0)]), None);
    }

    #[test]
    fn passes_without_votes_contradict_no_track() {
        let mut votes = Votes::default();
        for _ in 0..3 {
            votes.count(0, 0.0);
        }
        assert!(!votes.are_against());
    }
}
