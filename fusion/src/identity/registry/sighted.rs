//! Who is sighted, or given by hand: somebody who waits for its crops, somebody lost, or somebody new.

use farfield_proto::message::{MAX_PERSONS, Sighting};
use farfield_proto::tick::Tick;
use farfield_proto::venue::GivenPerson;
use nalgebra::Vector3;

use super::Registry;
use crate::align::TickGroup;
use crate::body::fit::{Fitted, fit};
use crate::body::initial_pose::PoseFinder;
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

/// A person that is sighted this near to where it is carried is there already, metres, where its limbs are, too: the
/// lattice finds it by itself.
const IN_PLACE_M: f64 = 0.1;
/// Longest absence after which the way back tells the speed, seconds: later people have turned.
const STRAIGHT_S: f64 = 1.5;

impl Registry {
    /// Takes in whom the sightings show; returns how many sightings could not be used: at a tick at which
    /// nobody looks, all of them.
    pub(super) fn take_in_sighted(&mut self, group: &TickGroup, method: &Method) -> u32 {
        let tick = group.tick;
        if !self.scheduler.is_pass(tick) {
            let sets = group.sighting_sets.iter();
            return sets.map(|set| set.sightings.len() as u32).sum();
        }
        let (pass, unusable) = self.pass(group, method.sites.len());
        self.finds_people |= !pass.witnesses.is_empty();
        // Who may be elsewhere by now explains nothing.
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
            votes.count(self.finder.verdicts(&pass, &body));
        }
        for person in self.revive(found, tick, method) {
            self.initiate(&person, tick, method);
        }
        let everybody = self.bodies(|_| true);
        // At most passes they are the same.
        let explanation = if everybody == explanation.bodies {
            explanation
        } else {
            self.finder.explain(&pass, everybody)
        };
        let unexplained = self.finder.unexplained(&pass, &explanation);
        self.scheduler.keep(tick, unexplained);
        unusable
    }

    /// What the viewpoints sighted, and how many sightings could not be used.
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
        let asked = self
            .scheduler
            .looks_at(group.tick)
            .iter()
            .zip(&self.viewpoint_of_camera);
        let answered = |viewpoint| group.sighting_sets.iter().any(|s| s.viewpoint == viewpoint);
        let looked = asked.map(|(&asked, &viewpoint)| asked && answered(viewpoint));
        (
            self.finder.detection_pass(&sightings, looked.collect()),
            unusable,
        )
    }

    /// The bodies of those who `count`, and the posters on the walls.
    fn bodies(&self, count: impl Fn(&Track) -> bool) -> Vec<KnownBody> {
        let people = self.tracks.iter();
        let people = people.filter(|track| count(track));
        let body = |track: &Track| KnownBody {
            keypoints_m: track.estimator.keypoints_m(),
        };
        people.map(body).chain(self.posters.bodies()).collect()
    }

    /// Places those tentative tracks anew that wait for their first crops and are among the `found`; the
    /// others are returned.
    ///
    /// Over a far link the first crops of a newcomer are cut some ticks after its initiation. Who stands is in
    /// them, who runs has left; and one sighting tells no speed. So until its first crops have come, a newcomer
    /// is placed anew wherever a detection pass finds it.
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

    /// Takes those back who are lost and among the `found`; the others are returned.
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
            // Whose known body cannot be so is somebody else.
            let is_back = index
                .is_some_and(|index| self.tracks[index].take_back(&found[*which], tick, method));
            if is_back {
                self.apply(std::slice::from_ref(event), tick, method);
            }
            is_back
        });
        without(found, &taken)
    }

    /// Initiates the track of somebody new.
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
            self.scheduler.ask_about_tentative(tick, &keypoints_m);
        }
    }

    /// Takes in those who are given by hand at `tick`.
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

    /// Starts over at `tick` with another sighting, moving as fast as it must have since the first one.
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

    /// Takes a lost person back to where it was sighted at `tick`, with the body that is known; returns
    /// whether that body can be so.
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

/// The `found` but for those who are taken for somebody.
fn without(found: Vec<SightedPerson>, taken: &[Taken]) -> Vec<SightedPerson> {
    let is_taken = |which: usize| taken.iter().any(|(taken, _)| *taken == which);
    let found = found.into_iter().enumerate();
    found
        .filter(|(which, _)| !is_taken(*which))
        .map(|(_, person)| person)
        .collect()
}

/// The body of a sighted person; `None` where it cannot be one.
fn fitted(person: &SightedPerson, method: &Method) -> Option<Fitted> {
    let observed = person.observed(&method.sites);
    let bounds = method.range_of_motion.as_ref();
    fit(&[observed], &method.parameters.ik, bounds).ok()
}

/// A person as one tick's sightings show it.
fn appearance_of(person: &SightedPerson, method: &Method) -> Option<Appearance> {
    let body = fitted(person, method)?;
    let observed = person.observed(&method.sites);
    Some(Appearance {
        lengths: Lengths::of(&body.skeleton, 0.0),
        whereabouts: Whereabouts::at(body.pose.root_m).facing(|joint| observed.position_m(joint)),
    })
}

/// A person's keypoints as the venue file gives them: on the sites of the network's keypoints, and on
/// joints for names that only the model knows.
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
