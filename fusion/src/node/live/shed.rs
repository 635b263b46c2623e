//! What ticks leave out because they would cost more than their time: done, counted and said.

use farfield_node::process::say;

use crate::align::TickGroup;
use crate::live::Micros;
use crate::live::shedding::Shedding;

/// The shedding of a live run.
#[derive(Debug, Default)]
pub(super) struct LiveShedding {
    shedding: Shedding,
    /// Of the tick at hand, by viewpoint.
    patches: Vec<usize>,
    /// Patches that were left out so far.
    pub(super) shed: u64,
    /// Most viewpoints that a tick has left out since it was told.
    most: usize,
    is_told: bool,
}

impl LiveShedding {
    /// Takes out of a tick of `n_viewpoints` what it would not have the time for.
    pub(super) fn trim(&mut self, group: &mut TickGroup, n_viewpoints: usize, period_us: f64) {
        self.patches.clear();
        self.patches.resize(n_viewpoints, 0);
        for set in &group.patch_sets {
            if let Some(patches) = self.patches.get_mut(usize::from(set.viewpoint.0)) {
                *patches += set.persons.len();
            }
        }
        let left_out = self.shedding.leave_out(&self.patches, period_us);
        let is_left_out = |viewpoint: u16| left_out.get(usize::from(viewpoint)) == Some(&true);
        for (viewpoint, patches) in (0..).zip(&self.patches) {
            self.shed += u64::from(is_left_out(viewpoint)) * *patches as u64;
        }
        group.patch_sets.retain(|set| !is_left_out(set.viewpoint.0));
        self.most = self.most.max(self.shedding.n_left_out());
    }

    /// A tick of so many patches took so long, microseconds.
    pub(super) fn stepped(&mut self, (patches, took_us): (usize, Micros)) {
        self.shedding.stepped(patches, took_us);
    }

    /// Says when it begins and when it is over.
    pub(super) fn tell(&mut self) {
        let most = std::mem::take(&mut self.most);
        if self.is_told == (most > 0) {
            return;
        }
        self.is_told = most > 0;
        let n = self.patches.len();
        if most > 0 {
            say(format_args!(
                "this machine is too slow for so many people: of {n} viewpoints up to {most}, in turn, are left out \
                 of each tick (farfield bench says what it carries)"
            ));
        } else {
            say(format_args!(
                "the ticks have time for all {n} viewpoints again"
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::fixture::{of_persons, patches};

    const PERIOD_US: f64 = 16_667.0;

    fn group(viewpoints: u16, people: u32) -> TickGroup {
        let set = |viewpoint| of_persons(patches(0, viewpoint, 0, 1), 0..people);
        TickGroup {
            patch_sets: (0..viewpoints).map(set).collect(),
            ..TickGroup::default()
        }
    }

    #[test]
    fn a_machine_that_is_too_slow_leaves_patches_out_and_counts_them() {
        let mut shedding = LiveShedding::default();
        let mut whole = group(8, 10);
        shedding.trim(&mut whole, 8, PERIOD_US);
        assert_eq!((whole.patch_sets.len(), shedding.shed), (8, 0));
        // 80 patches of 250 us: 20 ms, of which 14.2 are there.
        shedding.stepped((80, 20_000));
        let mut trimmed = group(8, 10);
        shedding.trim(&mut trimmed, 8, PERIOD_US);
        assert_eq!((trimmed.patch_sets.len(), shedding.shed), (5, 30));
        assert_eq!(shedding.most, 3);
        shedding.tell();
        assert!(shedding.is_told);
        for _ in 0..100 {
            shedding.stepped((50, 2_000));
        }
        shedding.trim(&mut whole, 8, PERIOD_US);
        shedding.tell();
        assert!(!shedding.is_told && whole.patch_sets.len() == 8);
    }
}
