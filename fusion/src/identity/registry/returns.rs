//! Who comes back: lost people who are sighted again, and newborns who were here before.

use farfield_proto::id::PersonId;
use farfield_proto::message::PersonPose;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use super::Crowd;
use crate::body::fit::fit;
use crate::body::observed::ObservedJoints;
use crate::identity::memory::{Candidate, Departed};
use crate::identity::recognise::{Appearance, Lengths, Reach, recognise};
use crate::identity::track::Track;
use crate::method::Method;
use crate::sightings::finder::SightedPerson;

/// Least ln of the likelihood ratio at which a newborn is somebody who was here before.
const LEAST_RETURN: f64 = 1.0;
/// The same for somebody who is still there, and lost: it is expected.
const LEAST_FOUND: f64 = 0.0;

impl Crowd {
    /// Confirms newborns: decides who of them was here before, and gives their tentative ticks.
    pub(crate) fn welcome(
        &mut self,
        confirmed: &[PersonId],
        method: &Method,
    ) -> Vec<(Tick, PersonPose)> {
        if confirmed.is_empty() {
            return Vec::new();
        }
        let known = self.known(confirmed);
        let rows: Vec<usize> = (0..self.tracks.len())
            .filter(|&index| {
                let track = &self.tracks[index];
                track.life.is_tentative() || confirmed.contains(&track.wire_id())
            })
            .collect();
        let reach = Reach::new(&self.field, &self.births);
        let likeness: Vec<Vec<Option<f64>>> = rows
            .iter()
            .map(|&index| {
                let (newborn, since) = newborn(&self.tracks[index], method);
                let pair = |known: &Candidate| {
                    let absence_s = (since - known.last_seen.tick) as f64 / self.rate_hz;
                    reach.likeness(&newborn, &known.appearance, absence_s)
                };
                known.iter().map(pair).collect()
            })
            .collect();
        let mut poses = Vec::new();
        for (&index, chosen) in rows.iter().zip(recognise(&likeness, LEAST_RETURN)) {
            if !confirmed.contains(&self.tracks[index].wire_id()) {
                continue;
            }
            let known = chosen.and_then(|column| self.take_known(known[column].id, confirmed));
            let track = &mut self.tracks[index];
            if let Some(known) = &known {
                track.becomes(known, self.rate_hz);
            }
            let skeleton = known.as_ref().map(|known| &known.body.skeleton);
            poses.extend(track.settle(skeleton, method));
        }
        self.leave_to_the_recognised(confirmed);
        poses
    }

    /// Those who are gone, and those who are lost.
    fn known(&self, confirmed: &[PersonId]) -> Vec<Candidate> {
        let lost = self.lost(confirmed);
        let lost = lost.filter_map(|track| Candidate::of(track, self.rate_hz));
        self.memory.candidates().chain(lost).collect()
    }

    /// What is known of `id`, who is one of [`Self::known`]. The memory forgets it.
    fn take_known(&mut self, id: PersonId, confirmed: &[PersonId]) -> Option<Departed> {
        let gone = self.memory.take(id);
        gone.or_else(|| {
            let track = self.lost(confirmed).find(|track| track.id() == id)?;
            Departed::of(track, self.rate_hz)
        })
    }

    /// Those who are lost, without the `confirmed`.
    fn lost(&self, confirmed: &[PersonId]) -> impl Iterator<Item = &Track> {
        self.tracks
            .iter()
            .filter(move |track| track.life.is_lost() && !confirmed.contains(&track.wire_id()))
    }

    /// A lost track whose person has been found elsewhere ends.
    fn leave_to_the_recognised(&mut self, confirmed: &[PersonId]) {
        let new: Vec<PersonId> = self
            .tracks
            .iter()
            .filter(|track| confirmed.contains(&track.wire_id()))
            .map(Track::id)
            .collect();
        self.tracks
            .retain(|track| confirmed.contains(&track.wire_id()) || !new.contains(&track.id()));
    }

    /// Takes those back who are lost and among the `found`; the others are returned.
    pub(crate) fn take_back(
        &mut self,
        found: Vec<SightedPerson>,
        tick: Tick,
        method: &Method,
    ) -> Vec<SightedPerson> {
        let lost: Vec<usize> = (0..self.tracks.len())
            .filter(|&index| self.tracks[index].life.is_lost())
            .collect();
        if lost.is_empty() || found.is_empty() {
            return found;
        }
        let reach = Reach::new(&self.field, &self.births);
        let likeness: Vec<Vec<Option<f64>>> = found
            .iter()
            .map(|person| {
                let sighted = sighted(person, method);
                let pair = |&index: &usize| {
                    let track = &self.tracks[index];
                    let known = Candidate::of(track, self.rate_hz)?;
                    let absence_s = (tick - known.last_seen.tick) as f64 / self.rate_hz;
                    // One viewpoint may have led it on: it may be nearer to there.
                    let last = known.appearance;
                    let carried = Appearance {
                        place_m: track.joints_m()[0],
                        ..last
                    };
                    let sighted = sighted.as_ref()?;
                    let l = [last, carried].map(|at| reach.likeness(sighted, &at, absence_s));
                    l.into_iter().flatten().reduce(f64::max)
                };
                lost.iter().map(pair).collect()
            })
            .collect();
        let chosen = recognise(&likeness, LEAST_FOUND);
        let mut others = Vec::new();
        for (person, column) in found.into_iter().zip(chosen) {
            let track = column.map(|column| &mut self.tracks[lost[column]]);
            if !track.is_some_and(|track| track.revive(&person, tick, method)) {
                others.push(person);
            }
        }
        others
    }
}

/// A newborn as its tentative ticks show it, and its first tick.
fn newborn(track: &Track, method: &Method) -> (Appearance, Tick) {
    let ticks: Vec<ObservedJoints> = track
        .tentative
        .iter()
        .map(|t| ObservedJoints::from_estimates(&t.estimates, &method.sites))
        .collect();
    let fitted = fit(&ticks, &method.parameters.ik, None);
    let skeleton = fitted.map_or_else(|_| track.skeleton.clone(), |body| body.skeleton);
    let seconds = track.tentative.len() as f64 * method.dt_s;
    let since = track.tentative.first().map_or(Tick::default(), |t| t.tick);
    let appearance = Appearance {
        lengths: Lengths::of(&skeleton, seconds),
        place_m: track.born_m,
    };
    (appearance, since)
}

/// A person as one tick's sightings show it.
fn sighted(person: &SightedPerson, method: &Method) -> Option<Appearance> {
    let observed = person.observed(&method.sites);
    let bounds = method.range_of_motion.as_ref();
    let body = fit(&[observed], &method.parameters.ik, bounds).ok()?;
    Some(Appearance {
        lengths: Lengths::of(&body.skeleton, 0.0),
        place_m: Vector3::from(body.pose.root_m),
    })
}
