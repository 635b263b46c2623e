//! Births: of those whom several viewpoints sighted, and of those who are given by hand.

use farfield_proto::message::{MAX_PERSONS, Sighting};
use farfield_proto::tick::Tick;
use farfield_proto::venue::GivenPerson;
use nalgebra::Vector3;

use super::{Crowd, Lost};
use crate::align::TickGroup;
use crate::body::fit::fit;
use crate::body::observed::ObservedJoints;
use crate::body::skeleton::{Joint, Pose};
use crate::identity::phase::Life;
use crate::identity::tentative::TentativeTick;
use crate::identity::track::Track;
use crate::method::Method;
use crate::sightings::contradiction::Look;
use crate::sightings::finder::{SightedPerson, TrackedBody};

impl Crowd {
    /// Bears those whom the sightings show, and takes back those who were lost; returns how many sightings
    /// could not be used: at a tick at which nobody looks, all of them.
    pub(crate) fn bear_sighted(&mut self, group: &TickGroup, method: &Method) -> u32 {
        if !self.lookout.is_look(group.tick) {
            let sets = group.sighting_sets.iter();
            return sets.map(|set| set.sightings.len() as u32).sum();
        }
        let (look, unusable) = self.look(group, method.sites.len());
        let found = self.finder.find_in(&look, &self.bodies(Lost::Not));
        let found = self.follow_newborns(found, group.tick, method);
        for track in self.tracks.iter_mut().filter(|t| t.life.is_tentative()) {
            let body = TrackedBody {
                keypoints_m: track.keypoints_m(),
            };
            track.trial.hear(self.finder.verdicts(&look, &body));
        }
        for person in self.take_back(found, group.tick, method) {
            self.bear(&person, group.tick, method);
        }
        let bodies = self.bodies(Lost::Too);
        let unexplained = self.finder.unexplained(&look, &bodies);
        self.lookout.keep(group.tick, unexplained);
        unusable
    }

    /// What the viewpoints sighted, and how many sightings could not be used.
    fn look(&self, group: &TickGroup, n_keypoints: usize) -> (Look, u32) {
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
            .lookout
            .looks_at(group.tick)
            .iter()
            .zip(&self.viewpoint_of_camera);
        let answered = |viewpoint| group.sighting_sets.iter().any(|s| s.viewpoint == viewpoint);
        let looked = asked.map(|(&asked, &viewpoint)| asked && answered(viewpoint));
        (self.finder.look(&sightings, looked.collect()), unusable)
    }

    fn bear(&mut self, person: &SightedPerson, tick: Tick, method: &Method) {
        if self.tracks.len() >= MAX_PERSONS {
            return;
        }
        let observed = person.observed(&method.sites);
        let Ok(body) = fit(
            &[observed],
            &method.parameters.ik,
            method.range_of_motion.as_ref(),
        ) else {
            return;
        };
        let mut track = Track::new(
            self.new_id(),
            Life::newborn(self.lookout.awaited_ticks()),
            body.skeleton,
            body.pose,
            method,
        );
        track.estimates = person.estimates();
        track.is_seen_at(tick);
        self.lookout.ask_about_newborn(tick, &track.keypoints_m());
        track.tentative.push(TentativeTick {
            tick,
            estimates: track.estimates.clone(),
        });
        self.tracks.push(track);
    }

    /// Bears those who are given by hand at `tick`.
    pub(crate) fn bear_given(&mut self, tick: Tick, method: &Method) {
        let given: Vec<GivenPerson> = self
            .given
            .iter()
            .filter(|person| person.tick == tick)
            .cloned()
            .collect();
        for person in given {
            let observed = given_joints(&person, method);
            let Ok(body) = fit(
                &[observed],
                &method.parameters.ik,
                method.range_of_motion.as_ref(),
            ) else {
                continue;
            };
            self.make_room_for(&body.pose);
            if self.tracks.len() < MAX_PERSONS {
                let (id, life) = (self.new_id(), Life::given());
                self.tracks
                    .push(Track::new(id, life, body.skeleton, body.pose, method));
            }
        }
    }

    /// Who was found where a person is given by hand is that person: the hand knows better.
    fn make_room_for(&mut self, given: &Pose) {
        let near_m = self.births.explained_m;
        self.tracks
            .retain(|track| (track.joints_m()[0] - given.root_m).norm() >= near_m);
    }
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
