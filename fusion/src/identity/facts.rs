//! The state of each track at a tick as plain values: the only input of decisions.

use farfield_proto::id::PersonId;
use farfield_proto::tick::Tick;
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;

use super::phase::{self, Coverage, Phase};
use super::poster::Stillness;
use super::track::{Track, Votes};
use crate::body::skeleton::{Joint, Joints};

/// Parameters of decisions, the same for all tracks.
#[derive(Debug, Clone)]
pub(crate) struct Rules {
    pub(crate) births: BirthParameters,
    pub(crate) field: Field,
    pub(crate) rate_hz: f64,
}

impl Rules {
    /// Converts ticks to seconds.
    pub(crate) fn seconds(&self, ticks: u32) -> f64 {
        f64::from(ticks) / self.rate_hz
    }

    /// Tick period, seconds.
    pub(crate) fn dt_s(&self) -> f64 {
        1.0 / self.rate_hz
    }
}

/// Facts about one track.
#[derive(Debug, Clone)]
pub(crate) struct TrackFacts {
    pub(crate) id: PersonId,
    pub(crate) wire_id: PersonId,
    pub(crate) phase: Phase,
    pub(crate) coverage: Coverage,
    /// The joints of the newest pose, world, metres.
    pub(crate) joints_m: Joints,
    /// The last tick at which no other person was near.
    pub(crate) alone_at: Option<Tick>,
    /// How many ticks it has been tentative.
    pub(crate) tentative_ticks: usize,
    /// Results of the detection passes since its initiation.
    pub(crate) votes: Votes,
    /// How flat and how still it is; `None` until it has been tentative for long enough.
    pub(crate) stillness: Option<Stillness>,
}

impl TrackFacts {
    pub(crate) fn from_track(track: &Track) -> Self {
        let identity = &track.identity;
        Self {
            id: identity.id,
            wire_id: identity.wire_id,
            phase: identity.phase,
            coverage: identity.coverage,
            joints_m: *track.estimator.joints_m(),
            alone_at: identity.alone.map(|alone| alone.tick),
            tentative_ticks: identity.tentative.ticks.len(),
            votes: identity.tentative.votes,
            stillness: identity.tentative.stillness,
        }
    }

    /// Whether the first crops of a tentative track are still on the way.
    pub(crate) fn is_awaited(&self) -> bool {
        phase::is_awaited(self.phase, self.coverage)
    }

    /// Mean distance of the joints of two bodies, metres. The smaller of two pairings (same sides,
    /// swapped sides), because one of two tracks on a body may face the other way.
    pub(crate) fn distance_m(&self, other: &Self) -> f64 {
        let (a, b) = (&self.joints_m, &other.joints_m);
        let mean = |other: &dyn Fn(Joint) -> Joint| {
            let gaps = Joint::ALL
                .iter()
                .map(|&joint| (a[joint.index()] - b[other(joint).index()]).norm());
            gaps.sum::<f64>() / a.len() as f64
        };
        mean(&|joint| joint).min(mean(&mirrored))
    }
}

/// The same joint of the other side: `Joint::ALL` has left directly before right.
fn mirrored(joint: Joint) -> Joint {
    let at = joint.index();
    let other = if joint.name().starts_with("left_") {
        at + 1
    } else if joint.name().starts_with("right_") {
        at - 1
    } else {
        at
    };
    Joint::ALL[other]
}

#[cfg(test)]
impl TrackFacts {
    /// A track with this phase only, all joints in one place.
    pub(crate) fn example(id: u32, phase: Phase) -> Self {
        Self {
            id: PersonId(id),
            wire_id: PersonId(id),
            phase,
            coverage: Coverage::default(),
            joints_m: [nalgebra::Vector3::zeros(); crate::body::skeleton::N_JOINTS],
            alone_at: None,
            tentative_ticks: 0,
            votes: Votes::default(),
            stillness: None,
        }
    }

    /// A track that was just sighted, and whose first crops arrive in `awaited` ticks.
    pub(crate) fn sighted(id: u32, awaited: u32) -> Self {
        Self {
            coverage: Coverage::sighted(awaited),
            ..Self::example(id, Phase::Tentative)
        }
    }

    /// The same, `x_m` along the hall.
    pub(crate) fn at_x(mut self, x_m: f64) -> Self {
        self.joints_m = self.joints_m.map(|_| nalgebra::Vector3::new(x_m, 0.0, 1.0));
        self
    }
}

#[cfg(test)]
impl Rules {
    /// Defaults at `rate_hz` in a field of 8 m x 6 m.
    pub(crate) fn example(rate_hz: f64) -> Self {
        Self {
            // As many ticks until a confirmation as at 60 Hz.
            births: BirthParameters {
                confirm_s: 12.0 / rate_hz,
                ..BirthParameters::default()
            },
            field: Field {
                min_m: [-4.0, -3.0, -0.3],
                max_m: [4.0, 3.0, 2.6],
                floor_m: 0.0,
            },
            rate_hz,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_joint_has_its_mirror() {
        for joint in Joint::ALL {
            let expected = joint
                .name()
                .replace("left_", "LEFT")
                .replace("right_", "left_")
                .replace("LEFT", "right_");
            assert_eq!(mirrored(joint).name(), expected);
        }
    }
}
