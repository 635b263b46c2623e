//! One person: its estimate and its identity.

use farfield_proto::id::{CameraIndex, PersonId};
use farfield_proto::message::{PersonBoxes, PersonPose, PersonState};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::memory::{Candidate, Departed};
use super::phase::{self, Coverage, Phase, Showable, published};
use super::poster::Stillness;
use super::shown::ShownPeople;
use super::tentative::{TentativeTick, Votes};
use super::whereabouts::{LastSeen, Whereabouts};
use crate::align::TickGroup;
use crate::body::keypoint_estimate::KeypointEstimate;
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
        (method, finds_people): (&Method, bool),
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
