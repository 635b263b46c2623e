//! People who are sighted or given by hand: waiting for their crops, lost, or new.

use farfield_proto::message::{MAX_PERSONS, Sighting};
use farfield_proto::tick::Tick;
use farfield_proto::venue::GivenPerson;
use nalgebra::Vector3;

use super::Registry;
use crate::align::TickGroup;
use crate::body::fit::{Fitted, PoseFinder, fit};
use crate::body::observed::ObservedJoints;
use crate::body::skeleton::Joint;
use crate::identity::decide::places;
use crate::identity::decide::sighted::{self, LostPerson, Taken};
use crate::identity::event::EventKind;
use crate::identity::facts::TrackFacts;
use crate::identity::recognise::{Appearance, Lengths};
use crate::identity::track::Track;
use crate::identity::whereabouts::Whereabouts;
use crate::method::Method;
use crate::sightings::contradiction::DetectionPass;
use crate::sightings::finder::{KnownBody, SightedPerson};

/// Distance from its carried place within which a sighted person is in place, metres, if its limbs
/// are, too: the lattice then finds it.
const IN_PLACE_M: f64 = 0.1;
/// Longest absence after which the displacement gives the speed, seconds: later, people have
/// turned.
const STRAIGHT_S: f64 = 1.5;

impl Registry {
    /// Processes the sightings of a tick. Returns how many could not be used: all of them if the
    /// tick has no detection pass.
    pub(super) fn take_in_sighted(&mut self, group: &TickGroup, method: &Method) -> u32 {
        let tick = group.tick;
        if !self.scheduler.is_pass(tick) {
            let sets = group.sighting_sets.iter();
            return sets.map(|set| set.sightings.len() as u32).sum();
        }
        let (pass, unusable) = self.pass(group, method.sites.len());
        self.finds_people |= !pass.witnesses.is_empty();
        // People who may be elsewhere explain no sighting.
        let explains = |track: &Track| !track.identity.phase.is_lost() && !track.is_awaited();
        let explanation = self.finder.explain(&pass, self.bodies(explains));
        let n_people = self.tracks.iter().filter(|track| explains(track)).count();
        let found = self.finder.find_in(&pass, &explanation, n_people);
        let found = self.reinitiate(found, tick, method);
        for track in self.tracks.iter_mut().filter(|t| t.is_tentative()) {
            let body = KnownBody {
                keypoints_m: track.estimator.keypoints_m(),
            };
            let votes = &mut track.identity.tentative.votes;
            let (seen, missed) = self.finder.verdicts(&pass, &body);
            votes.count(seen, missed);
        }
        for person in self.revive(found, tick, method) {
            self.initiate(&person, tick, method);
        }
        let bodies = self.bodies(|_| true);
        // At most passes both are the same.
        let explanation = if bodies == explanation.bodies {
            explanation
        } else {
            self.finder.explain(&pass, bodies)
        };
        let unexplained = self.finder.unexplained(&pass, &explanation);
        self.scheduler.record_unexplained(tick, unexplained);
        unusable
    }

    /// The sightings of all viewpoints, and how many could not be used.
    fn pass(&self, group: &TickGroup, n_keypoints: usize) -> (DetectionPass, u32) {
        let (mut sightings, mut unusable) = (Vec::<Sighting>::new(), 0);
        for set in &group.sighting_sets {
            for sighting in &set.sightings {
                let owner = self.viewpoint_of_camera.get(usize::from(sighting.camera.0));
                if owner == Some(&set.viewpoint) && sighting.keypoints.len() == n_keypoints {
                    sightings.push(sighting.clone());
                } else {
                    unusable += 1;
                }
            }
        }
        let requested = self
            .scheduler
            .runs_at(group.tick)
            .iter()
            .zip(&self.viewpoint_of_camera);
        let answered = |viewpoint| group.sighting_sets.iter().any(|s| s.viewpoint == viewpoint);
        let ran = requested.map(|(&requested, &viewpoint)| requested && answered(viewpoint));
        (
            self.finder.detection_pass(&sightings, ran.collect()),
            unusable,
        )
    }

    /// The bodies of the tracks that pass `is_included`, and the posters.
    fn bodies(&self, is_included: impl Fn(&Track) -> bool) -> Vec<KnownBody> {
        let people = self.tracks.iter();
        let people = people.filter(|track| is_included(track));
        let body = |track: &Track| KnownBody {
            keypoints_m: track.estimator.keypoints_m(),
        };
        people.map(body).chain(self.posters.bodies()).collect()
    }

    /// Moves the tentative tracks that wait for their first crops to their new sightings; returns
    /// the other sighted persons.
    ///
    /// Over a long link the first crops of a newcomer are cut some ticks after its initiation. A
    /// standing person is in them, a runner has left, and one sighting gives no speed. So a
    /// newcomer moves to each new sighting until its first crops arrive.
    fn reinitiate(
        &mut self,
        found: Vec<SightedPerson>,
        tick: Tick,
        method: &Method,
    ) -> Vec<SightedPerson> {
        self.take_facts();
        if !self.facts.iter().any(TrackFacts::is_awaited) {
            return found;
        }
        let mut bodies: Vec<Option<Fitted>> = found.iter().map(|p| fitted(p, method)).collect();
        let pelvis_m = |body: &Option<Fitted>| body.as_ref().map(|body| body.pose.root_m);
        let sighted_m: Vec<Option<Vector3<f64>>> = bodies.iter().map(pelvis_m).collect();
        let awaited = self.scheduler.awaited_ticks();
        let taken = sighted::reinitiate(&sighted_m, &self.facts, awaited, &self.rules);
        for (which, event) in &taken {
            let (index, body) = (self.position(event.wire_id), bodies[*which].take());
            if let (Some(index), Some(body)) = (index, body) {
                self.apply(std::slice::from_ref(event), tick, method);
                self.tracks[index].start_over(&found[*which], body, tick, method.dt_s);
            }
        }
        without(found, &taken)
    }

    /// Moves lost people to their sightings; returns the other sighted persons.
    fn revive(
        &mut self,
        found: Vec<SightedPerson>,
        tick: Tick,
        method: &Method,
    ) -> Vec<SightedPerson> {
        let lost: Vec<LostPerson> = self
            .tracks
            .iter()
            .filter(|track| track.identity.phase.is_lost())
            .map(|track| LostPerson {
                wire_id: track.wire_id(),
                known: track.candidate(self.rules.rate_hz, &self.shown),
                led_m: track.is_led().then(|| track.estimator.joints_m()[0]),
            })
            .collect();
        if lost.is_empty() || found.is_empty() {
            return found;
        }
        let sighted: Vec<Option<Appearance>> =
            found.iter().map(|p| appearance_of(p, method)).collect();
        let mut taken = sighted::revive(&sighted, &lost, tick, &self.rules);
        taken.retain(|(which, event)| {
            let index = self.position(event.wire_id);
            // If the known body cannot take this pose, it is another person.
            let is_back = index
                .is_some_and(|index| self.tracks[index].take_back(&found[*which], tick, method));
            if is_back {
                self.apply(std::slice::from_ref(event), tick, method);
            }
            is_back
        });
        without(found, &taken)
    }

    /// Initiates the track of a new person.
    fn initiate(&mut self, person: &SightedPerson, tick: Tick, method: &Method) {
        if self.tracks.len() >= MAX_PERSONS {
            return;
        }
        let Some(body) = fitted(person, method) else {
            return;
        };
        let kind = EventKind::Initiate {
            views: person.views,
            awaited_ticks: self.scheduler.awaited_ticks(),
        };
        if let Some(track) = self.begin_track(kind, body, tick, method) {
            track.is_sighted_at(person, tick);
            let keypoints_m = track.estimator.keypoints_m();
            self.scheduler.request_for_tentative(tick, &keypoints_m);
        }
    }

    /// Adds the people who are given by hand at `tick`.
    pub(super) fn take_in_given(&mut self, tick: Tick, method: &Method) {
        let given: Vec<GivenPerson> = self
            .given
            .iter()
            .filter(|person| person.tick == tick)
            .cloned()
            .collect();
        for person in given {
            let observed = given_joints(&person, method);
            let (ik, bounds) = (&method.parameters.ik, method.range_of_motion.as_ref());
            let Ok(body) = fit(&[observed], ik, bounds) else {
                continue;
            };
            self.take_facts();
            let replaced = places::replaced_by_hand(&self.facts, &body.pose.root_m, &self.rules);
            self.apply(&replaced, tick, method);
            if self.tracks.len() < MAX_PERSONS {
                self.begin_track(EventKind::Given, body, tick, method);
            }
        }
    }
}

impl Track {
    /// Starts a tentative life with a sighting at `tick`, where the track stands.
    fn is_sighted_at(&mut self, person: &SightedPerson, tick: Tick) {
        self.estimator.evidence.estimates = person.estimates();
        self.is_seen_at(tick);
        let estimates = person.estimates();
        let record = &mut self.identity.tentative;
        record.place_m = self.estimator.pose().root_m;
        record.begin(tick, estimates);
    }

    /// Starts over at `tick` with another sighting. The velocity follows from the first one.
    fn start_over(&mut self, person: &SightedPerson, body: Fitted, tick: Tick, dt_s: f64) {
        let record = &mut self.identity.tentative;
        let began = record.ticks.first().map_or(tick, |first| first.tick);
        let (first, place_m) = *record.first.get_or_insert((began, record.place_m));
        let since_s = (tick - first) as f64 * dt_s;
        if since_s > 0.0 {
            record.velocity_m_s = (body.pose.root_m - place_m) / since_s;
        }
        let velocity_m_s = record.velocity_m_s;
        self.estimator.restart(body.skeleton, &body.pose);
        self.estimator.set_velocity(velocity_m_s);
        self.is_sighted_at(person, tick);
    }

    /// Moves a lost person to where it was sighted at `tick`, with the known body. Returns whether
    /// that body can take the pose.
    pub(crate) fn take_back(
        &mut self,
        person: &SightedPerson,
        tick: Tick,
        method: &Method,
    ) -> bool {
        let estimator = &mut self.estimator;
        let observed = person.observed(&estimator.body.sites);
        let bounds = method.range_of_motion.as_ref();
        let mut finder = PoseFinder::new(&method.parameters.ik, bounds);
        let Some(pose) = finder.find(&estimator.body.skeleton, &observed) else {
            return false;
        };
        estimator.evidence.estimates = person.estimates();
        let is_near = (pose.root_m - estimator.pose().root_m).norm() < IN_PLACE_M;
        if is_near && estimator.reaches(&pose, method.parameters.lattice.half_width_m) {
            estimator.update_uncertainty(method.dt_s, method);
            return true;
        }
        let since = self.identity.last_seen.map(|seen| {
            let absence_s = (tick - seen.tick) as f64 * method.dt_s;
            (seen.whereabouts, absence_s)
        });
        let now = Whereabouts::at(pose.root_m).facing(|joint| observed.position_m(joint));
        let velocity_m_s = since
            .filter(|&(_, absence_s)| absence_s > 0.0 && absence_s <= STRAIGHT_S)
            .map_or_else(Vector3::zeros, |(seen, absence_s)| {
                seen.velocity_at(&now, absence_s).push(0.0)
            });
        estimator.restart_at(&pose);
        estimator.set_velocity(velocity_m_s);
        estimator.update_uncertainty(method.dt_s, method);
        true
    }
}

/// The sighted persons without the `taken` ones.
fn without(found: Vec<SightedPerson>, taken: &[Taken]) -> Vec<SightedPerson> {
    let is_taken = |which: usize| taken.iter().any(|(taken, _)| *taken == which);
    let found = found.into_iter().enumerate();
    found
        .filter(|(which, _)| !is_taken(*which))
        .map(|(_, person)| person)
        .collect()
}

/// The body of a sighted person; `None` if it cannot be one.
fn fitted(person: &SightedPerson, method: &Method) -> Option<Fitted> {
    let observed = person.observed(&method.sites);
    let bounds = method.range_of_motion.as_ref();
    fit(&[observed], &method.parameters.ik, bounds).ok()
}

/// A person as the sightings of one tick show it.
fn appearance_of(person: &SightedPerson, method: &Method) -> Option<Appearance> {
    let body = fitted(person, method)?;
    let observed = person.observed(&method.sites);
    Some(Appearance {
        lengths: Lengths::from_skeleton(&body.skeleton, 0.0),
        whereabouts: Whereabouts::at(body.pose.root_m).facing(|joint| observed.position_m(joint)),
    })
}

/// A person's keypoints from the venue file: on the sites of the network's keypoints, and on joints
/// for names that only the model has.
fn given_joints(person: &GivenPerson, method: &Method) -> ObservedJoints {
    let mut observed = ObservedJoints::default();
    for (name, position) in &person.keypoints_m {
        let site = method
            .keypoints
            .index_of(name)
            .and_then(|k| method.sites[k]);
        match (site, Joint::from_name(name)) {
            (Some(site), _) => observed.set_site(&site, Vector3::from(*position), 1.0),
            (None, Some(joint)) => observed.set(joint, Vector3::from(*position), 1.0),
            (None, None) => {}
        }
    }
    observed
}
