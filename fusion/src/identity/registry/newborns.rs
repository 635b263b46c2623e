//! Newborns whose crops are still on the way: the looks that come meanwhile tell where they are now, and so
//! how fast they move.
//!
//! Over a far link the first crops of a newborn are cut some ticks after its birth. Who stands is in them, who
//! runs has left; and one look tells no speed. So until its first crops have come, a newborn is placed anew
//! wherever a look finds it.

use farfield_proto::tick::Tick;

use super::Crowd;
use crate::body::fit::{Fitted, fit};
use crate::identity::phase::Life;
use crate::identity::tentative::TentativeTick;
use crate::method::Method;
use crate::sightings::finder::SightedPerson;

/// How far off its place somebody who stands may be sighted, metres.
const SIGHTED_OFF_M: f64 = 0.3;

impl Crowd {
    /// Places those newborns anew who wait for their first crops and are among the `found`; the others are
    /// returned. Pairs are made nearest first, and nobody goes farther than people run.
    pub(crate) fn follow_newborns(
        &mut self,
        found: Vec<SightedPerson>,
        tick: Tick,
        method: &Method,
    ) -> Vec<SightedPerson> {
        let waits = |index: &usize| self.tracks[*index].life.is_awaited();
        let waiting: Vec<usize> = (0..self.tracks.len()).filter(waits).collect();
        if waiting.is_empty() {
            return found;
        }
        let bodies: Vec<Option<Fitted>> = found.iter().map(|p| fitted(p, method)).collect();
        let mut pairs = Vec::new();
        for (which, body) in bodies.iter().enumerate() {
            let Some(body) = body else { continue };
            for &index in &waiting {
                let track = &self.tracks[index];
                let waited_s = f64::from(track.life.missing_ticks()) * method.dt_s;
                let off_m = (body.pose.root_m - track.joints_m()[0]).norm();
                if off_m <= SIGHTED_OFF_M + self.births.return_speed_m_s * waited_s {
                    pairs.push((off_m, which, index));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut placed = vec![None; found.len()];
        for (_, which, index) in pairs {
            if placed[which].is_none() && !placed.contains(&Some(index)) {
                placed[which] = Some(index);
            }
        }
        let awaited = self.lookout.awaited_ticks();
        let mut others = Vec::new();
        for ((person, body), index) in found.into_iter().zip(bodies).zip(placed) {
            let (Some(body), Some(index)) = (body, index) else {
                others.push(person);
                continue;
            };
            let track = &mut self.tracks[index];
            track.life = Life::newborn(awaited);
            track.is_born_anew(body, tick, method.dt_s);
            track.estimates = person.estimates();
            track.is_seen_at(tick);
            track.tentative.clear();
            track.tentative.push(TentativeTick {
                tick,
                estimates: track.estimates.clone(),
            });
        }
        others
    }
}

/// The body of a sighted person; `None` where it cannot be one.
fn fitted(person: &SightedPerson, method: &Method) -> Option<Fitted> {
    let observed = person.observed(&method.sites);
    let bounds = method.range_of_motion.as_ref();
    fit(&[observed], &method.parameters.ik, bounds).ok()
}
