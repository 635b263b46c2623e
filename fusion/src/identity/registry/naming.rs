//! Remeasures bodies and compares them with the venue's subjects. Lengths and names change at no
//! other tick.

use farfield_proto::id::PersonId;
use rayon::prelude::*;

use super::Registry;
use crate::identity::recognise::Lengths;
use crate::identity::subjects::{Nameless, Subject, Subjects};
use crate::identity::track::Track;
use crate::method::Method;

/// Most bodies that are measured at one tick if there are no subjects.
const MOST_AT_ONCE: usize = 8;

impl Registry {
    /// Sets the subjects; must be called before the first tick.
    pub fn know(&mut self, subjects: Vec<Subject>) {
        self.subjects = Subjects::new(subjects);
    }

    /// Remeasures the bodies of confirmed people when due. A person that matches a subject gets its
    /// name, and the body is measured with the subject's prior.
    pub(super) fn remeasure(&mut self, method: &Method) {
        for track in self.tracks.iter_mut().filter(|track| !track.is_tentative()) {
            track.estimator.note_lengths(method);
        }
        let due = self.due();
        if due.is_empty() {
            return;
        }
        let tracks = self.tracks.par_iter_mut();
        let own = tracks.filter(|track| due.contains(&track.wire_id()));
        own.for_each(|track| track.estimator.remeasure(method));
        if self.subjects.is_empty() {
            return;
        }
        self.forget_names();
        let nameless = self.nameless(&due, method);
        let namings = self.subjects.decide(&nameless);
        for person in namings.iter().filter(|it| it.name().is_some()) {
            let mut tracks = self.tracks.iter_mut();
            let track = tracks.find(|track| track.id() == person.person);
            if let Some((track, body)) = track.zip(self.subjects.body_of(person.person)) {
                track.estimator.is_known(body.clone(), method);
            }
        }
        self.namings.extend(namings);
    }

    /// The people whose bodies are due (wire ids). A team that arrives together is due together,
    /// and measuring takes about as long as the rest of its tick. So only some are taken, unless
    /// there are names, which are decided for all together.
    fn due(&self) -> Vec<PersonId> {
        let confirmed = self.tracks.iter().filter(|track| !track.is_tentative());
        let due = confirmed.filter(|track| track.estimator.body.remeasure.is_due());
        let mut due: Vec<PersonId> = due.map(Track::wire_id).collect();
        if self.subjects.is_empty() {
            due.truncate(MOST_AT_ONCE);
        }
        due
    }

    /// Frees the names of people who are neither tracked nor remembered.
    fn forget_names(&mut self) {
        let (tracks, gone) = (&self.tracks, self.memory.remembered());
        let is_here = |id| tracks.iter().any(|track| track.id() == id);
        let is_remembered = |id: PersonId| gone.iter().any(|departed| departed.id == id);
        self.subjects.forget(|id| is_here(id) || is_remembered(id));
    }

    /// All confirmed people without a name; the bodies of `measured` (wire ids) were measured at
    /// this tick.
    fn nameless(&self, measured: &[PersonId], method: &Method) -> Vec<Nameless> {
        let here = self.tracks.iter().filter(|track| !track.is_tentative());
        let nameless = here.filter(|track| !self.subjects.has(track.id()));
        let of = |track: &Track| {
            let lived_s = f64::from(track.identity.lived_ticks) * method.dt_s;
            Nameless {
                id: track.id(),
                lengths: Lengths::from_skeleton(&track.estimator.body.skeleton, lived_s),
                is_due: measured.contains(&track.wire_id()),
                is_last: track.estimator.is_measured(method),
            }
        };
        nameless.map(of).collect()
    }
}
