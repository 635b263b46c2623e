//! Rejects bodies from sightings of people outside the field, whose rays meet inside it.
//!
//! Groups compete for their witnesses ([`crate::sightings::association`]) only with rays that meet
//! in the field, because a crowd around it has far more rays that do not. So people who wait
//! outside the field take no witness out of a group, and two views of two of them can form a body
//! in the field. A small group is therefore compared with the others again, wherever rays meet.
//! Members that fit a person elsewhere better are removed.

use super::PersonFinder;
use crate::sightings::agreement::agree;
use crate::sightings::association::associate;
use crate::sightings::contradiction::DetectionPass;
use crate::sightings::reconstruction::{Reconstruction, reconstruct};

/// Only groups of at most this many viewpoints are checked: in any crowd rays of so many meet by
/// chance.
const FEW: usize = 3;
/// The same as a share of the viewpoints that see any person: with many viewpoints, rays of more
/// meet by chance. A body that most of them see is a person.
const FEW_SHARE: f64 = 0.5;

impl PersonFinder {
    /// `group` without members that fit a body of the `free` witnesses of `pass` outside the field
    /// better; `None` if no person is left.
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

    /// Whether the best group of `member`, when rays may meet anywhere, shares no other member with
    /// `group`.
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
