//! Sightings of people outside the field, whose rays meet inside it.
//!
//! Groups compete for their witnesses ([`crate::sightings::association`]) among the rays that meet in the field: of a
//! crowd around it there are far more that do not. So who waits at a door, or looks on from beside the field, takes no
//! witness out of a group, and what two viewpoints see of two of them can be a body in the field. A group of few is
//! therefore held against the others once more, wherever rays meet: its members go that see somebody elsewhere better.

use super::PersonFinder;
use crate::sightings::agreement::agree;
use crate::sightings::association::associate;
use crate::sightings::contradiction::DetectionPass;
use crate::sightings::reconstruction::{Reconstruction, reconstruct};

/// Whom no more viewpoints than this see is asked about: rays of so many meet by chance in any crowd.
const FEW: usize = 3;
/// The same as a share of the viewpoints that see anybody: where many look at a crowd, rays of more meet by chance. Whom
/// most of them see is somebody.
const FEW_SHARE: f64 = 0.5;

impl PersonFinder {
    /// What is left of `group` without members that see somebody else of the `free` witnesses of `pass`, outside the
    /// field, better; `None` where that is nobody.
    pub(super) fn without_outsiders(
        &self,
        group: Reconstruction,
        pass: &DetectionPass,
        free: &[usize],
    ) -> Option<Reconstruction> {
        let few = FEW_SHARE * pass.viewpoints().len() as f64;
        if group.members.len() > FEW && group.members.len() as f64 > few {
            return Some(group);
        }
        let members = group.members.iter().copied();
        let own = members.filter(|&member| !self.is_outsiders(member, &group, pass, free));
        let own: Vec<usize> = own.collect();
        if own.len() == group.members.len() {
            return Some(group);
        }
        let mut left = reconstruct(
            &pass.witnesses,
            &own,
            self.gates.point_distance_m(),
            self.gates.min_keypoints,
        )?;
        let body = self.body_group(&mut left, pass, &self.gates)?;
        body.is_person.then_some(left)
    }

    /// Whether `member` of `group` is in none with another of its members when rays may meet anywhere.
    fn is_outsiders(
        &self,
        member: usize,
        group: &Reconstruction,
        pass: &DetectionPass,
        free: &[usize],
    ) -> bool {
        let (all, gates) = (&pass.witnesses, self.gates.anywhere());
        let near = free.iter().copied();
        let near = near.filter(|&w| w == member || agree(&all[w], &all[member], &gates));
        let near: Vec<usize> = near.collect();
        let groups = associate(all, &near, &gates, |group| {
            let body = self.body_group(group, pass, &gates);
            body.is_some_and(|body| body.is_person)
        });
        let winner = groups.iter().find(|g| g.members.contains(&member));
        let is_shared = |m: &usize| *m != member && group.members.contains(m);
        winner.is_some_and(|winner| !winner.members.iter().any(is_shared))
    }
}
