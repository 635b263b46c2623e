//! One person: how it is followed, and who it is.

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

/// How far somebody lost may be from where it is carried, per axis, for its crops to be its own, metres. They are cut
/// there, and show whoever is there: farther away, it is for the sightings to say who is who.
const ADRIFT_M: f64 = 0.15;

/// One person. Evidence, body and estimate are the estimator's; who it is, is [`TrackIdentity`].
pub struct Track {
    pub(crate) identity: TrackIdentity,
    pub(crate) estimator: Estimator,
}

/// Who a track is, and all that decides it.
#[derive(Debug)]
pub struct TrackIdentity {
    pub(crate) id: PersonId,
    /// By which the edges know the person; it stays when the person is recognised.
    pub(crate) wire_id: PersonId,
    /// The only place where a phase is stored; changed by events alone.
    pub(crate) phase: Phase,
    /// What ticks count: see [`Track::count`].
    pub(crate) coverage: Coverage,
    pub(crate) tentative: TentativeRecord,
    /// Ticks of life so far, an earlier life's too.
    pub(crate) lived_ticks: u32,
    /// Where it was surely itself.
    pub(crate) last_seen: Option<LastSeen>,
    /// Where it stood when nobody else was near for the last time.
    pub(crate) alone: Option<Alone>,
    /// What the last tick changed of those before.
    pub(crate) changed: ChangedTicks,
}

/// What is known of a tentative person beside its pose; empty once it is confirmed.
#[derive(Debug, Clone, Default)]
pub(crate) struct TentativeRecord {
    pub(crate) ticks: Vec<TentativeTick>,
    pub(crate) votes: Votes,
    /// Of [`Self::ticks`], once they are enough to tell.
    pub(crate) stillness: Option<Stillness>,
    /// Where and when it was sighted first, if it has been initiated anew since.
    pub(crate) first: Option<(Tick, Vector3<f64>)>,
    /// The skeleton that is known of it, from its recognition until its ticks are solved again.
    pub(crate) known: Option<Skeleton>,
    /// The pelvis when it was sighted last, world, metres.
    pub(crate) place_m: Vector3<f64>,
    /// How fast it moved when it was sighted last, world, metres per second.
    pub(crate) velocity_m_s: Vector3<f64>,
}

impl TentativeRecord {
    /// Begins with a sighting; what was voted of the body counts on.
    pub(crate) fn begin(&mut self, tick: Tick, estimates: Vec<KeypointEstimate>) {
        self.stillness = None;
        self.ticks.clear();
        self.ticks.push(TentativeTick { tick, estimates });
    }

    /// Keeps a tick with what was seen at it.
    pub(crate) fn push(&mut self, tick: Tick, estimates: Vec<KeypointEstimate>, method: &Method) {
        self.ticks.push(TentativeTick { tick, estimates });
        let births = &method.parameters.births;
        if self.ticks.len() >= births.confirm_ticks(1.0 / method.dt_s) as usize {
            self.stillness = Stillness::of(&self.ticks, &method.relative_sigmas);
        }
    }
}

/// A person when nobody else was near.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Alone {
    pub(crate) tick: Tick,
    pub(crate) restart_point: RestartPoint,
}

/// What a tick changed of those before.
#[derive(Debug, Default)]
pub(crate) struct ChangedTicks {
    /// Those that were solved again.
    pub(crate) solved: Vec<TickSnapshot>,
    /// What was seen after this tick was somebody else's.
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

    /// Who.
    pub fn id(&self) -> PersonId {
        self.identity.id
    }

    /// By which the edges know the person. It is [`Self::id`] until the person is recognised as somebody
    /// who was here before: then the id is that one's, and the edges need not know.
    pub fn wire_id(&self) -> PersonId {
        self.identity.wire_id
    }

    /// How the person is followed.
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

    /// Whether one viewpoint has led it on since two saw it.
    pub(crate) fn is_led(&self) -> bool {
        let coverage = self.identity.coverage;
        coverage.unseen < coverage.since_two
    }

    /// The ticks before the last one that were solved again at it: those of a person who was confirmed.
    pub fn solved_again(&self) -> &[TickSnapshot] {
        &self.identity.changed.solved
    }

    /// Set when the last tick showed that what was seen after the one given here was somebody else's.
    pub fn mistaken_since(&self) -> Option<Tick> {
        self.identity.changed.mistaken_since
    }

    /// Begins a tick, and forgets what the last one changed of those before.
    pub fn begin(&mut self, method: &Method) {
        self.identity.changed.solved.clear();
        self.identity.changed.mistaken_since = None;
        self.estimator.begin(method);
    }

    /// Takes every patch of this person that `group` holds; returns how many could not be used. Who has been lost for
    /// long enough to be elsewhere takes none where sightings can find it (`finds_people`).
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

    /// Whether it is lost, and may be elsewhere than where it is carried.
    pub(crate) fn is_adrift(&self) -> bool {
        self.identity.phase.is_lost() && self.estimator.adrift_m() > ADRIFT_M
    }

    /// First inverse kinematics; of who is confirmed it is learned where the keypoints sit.
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

    /// Fills `made` with where the person will be in the cameras of each of `viewpoints` (of the venue's `cameras`),
    /// so many ticks after the newest pose; `None` where none of them will see it.
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
            // Mostly all viewpoints have one horizon.
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

    /// Tells `into` what `tick`, the last one, came to. Allocates only while `into` grows.
    pub fn tell(&self, tick: Tick, into: &mut TickSnapshot) {
        self.estimator.tell(tick, self.state(), into);
    }

    fn state(&self) -> PersonState {
        published(self.identity.phase, self.identity.coverage)
    }

    /// Who it is, for comparison; `None` of who was never seen.
    pub(crate) fn candidate(&self, rate_hz: f64, shown: &ShownPeople) -> Option<Candidate> {
        let identity = &self.identity;
        let skeleton = &self.estimator.body.skeleton;
        let lived_s = f64::from(identity.lived_ticks) / rate_hz;
        Some(Candidate {
            shown: shown.of(identity.wire_id),
            ..Candidate::new(identity.id, identity.last_seen?, skeleton, lived_s)
        })
    }

    /// What is known of it, who goes at tick `gone`; `None` of who was never seen.
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

    /// Counts the tick that has just been solved. `showable`: what it could show of the body of these keypoints (world, metres).
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

    /// Notes that the person was seen well at `tick`, where it is.
    pub(crate) fn is_seen_at(&mut self, tick: Tick) {
        self.identity.last_seen = Some(LastSeen {
            tick,
            whereabouts: self.whereabouts(),
        });
    }

    /// Where it is, and how fast, as its filter says.
    pub(crate) fn whereabouts(&self) -> Whereabouts {
        let estimator = &self.estimator;
        let velocity_m_s = estimator.motion().velocity_m_s()[Joint::Pelvis.index()];
        Whereabouts::at(estimator.pose().root_m)
            .facing_as(estimator.joints_m())
            .moving(&velocity_m_s)
    }

    /// Notes that nobody else is near at `tick`.
    pub(crate) fn is_alone_at(&mut self, tick: Tick) {
        self.identity.alone = Some(Alone {
            tick,
            restart_point: self.estimator.restart_point(),
        });
    }
}
