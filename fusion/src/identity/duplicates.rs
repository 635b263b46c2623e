//! Two tracks never stay on one body: who stands in another's place for long is a ghost.

use farfield_proto::id::PersonId;
use farfield_proto::venue::parameters::BirthParameters;

use super::track::Track;
use crate::body::skeleton::Joint;
use crate::body::skeleton::Joints;

/// Pairs of persons in one place, and for how many ticks in a row.
#[derive(Debug, Clone, Default)]
pub(crate) struct Ghosts {
    pairs: Vec<(PersonId, PersonId, u32)>,
    /// Buffer: those of the tick before.
    before: Vec<(PersonId, PersonId, u32)>,
}

impl Ghosts {
    /// Looks at everybody after a tick; returns those who are ghosts now.
    pub(crate) fn found(
        &mut self,
        tracks: &[Track],
        rate_hz: f64,
        births: &BirthParameters,
    ) -> Vec<PersonId> {
        let limit = (births.same_place_s * rate_hz).ceil() as u32;
        std::mem::swap(&mut self.pairs, &mut self.before);
        self.pairs.clear();
        let mut ghosts = Vec::new();
        for (index, a) in tracks.iter().enumerate() {
            for b in &tracks[index + 1..] {
                if distance_m(a.joints_m(), b.joints_m()) >= births.same_place_m {
                    continue;
                }
                let before = self
                    .before
                    .iter()
                    .find(|(c, d, _)| (*c, *d) == (a.id(), b.id()));
                let ticks = before.map_or(1, |(_, _, ticks)| ticks + 1);
                if ticks > limit {
                    ghosts.push(weaker(a, b).id());
                }
                self.pairs.push((a.id(), b.id(), ticks));
            }
        }
        ghosts
    }
}

/// Who of two in one place goes: the one who is not confirmed, else who has lacked evidence for
/// longer, else the younger.
fn weaker<'a>(older: &'a Track, younger: &'a Track) -> &'a Track {
    let doubt = |track: &Track| (track.life.is_tentative(), track.life.missing_ticks());
    if doubt(older) > doubt(younger) {
        older
    } else {
        younger
    }
}

/// Mean distance of the joints of two bodies, metres; the smaller of left on left and left on right,
/// because a ghost may face the other way.
pub(crate) fn distance_m(a: &Joints, b: &Joints) -> f64 {
    let mean = |other: &dyn Fn(Joint) -> Joint| {
        let gaps = Joint::ALL
            .iter()
            .map(|&joint| (a[joint.index()] - b[other(joint).index()]).norm());
        gaps.sum::<f64>() / a.len() as f64
    };
    mean(&|joint| joint).min(mean(&mirrored))
}

/// The same joint of the other side: left comes right before right.
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
