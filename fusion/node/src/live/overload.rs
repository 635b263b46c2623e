//! Overload: viewpoints that exceed their quota, and ticks that would take longer than their time.

use farfield_fusion::align::TickGroup;
use farfield_fusion::live::Micros;
use farfield_fusion::live::shedding::Shedding;

use super::conditions::Condition;

/// Refused messages in one second from which a viewpoint floods; fewer may be a disturbance of the network.
const FLOOD: u64 = 50;

/// The refused messages of each viewpoint at the last update.
#[derive(Debug, Default)]
pub(super) struct FloodWatch(Vec<Watched>);

#[derive(Debug, Clone, Copy, Default)]
struct Watched {
    refused: u64,
    /// Refused messages of the last second.
    more: u64,
    is_flooding: bool,
}

impl FloodWatch {
    /// Updates the counts, once a second: `refused` are the refused messages of each viewpoint since the start.
    pub(super) fn update(&mut self, refused: impl Iterator<Item = u64>) {
        for (index, refused) in refused.enumerate() {
            if self.0.len() <= index {
                self.0.push(Watched::default());
            }
            let watched = &mut self.0[index];
            watched.more = refused.saturating_sub(watched.refused);
            watched.refused = refused;
            let goes_on = watched.is_flooding && watched.more > 0;
            watched.is_flooding = goes_on || watched.more >= FLOOD;
        }
    }

    /// The floods; `names` are those of the viewpoints.
    pub(super) fn conditions<'a>(
        &self,
        names: impl Iterator<Item = &'a str>,
    ) -> impl Iterator<Item = Condition> {
        let flooding = names
            .zip(&self.0)
            .filter(|(_, watched)| watched.is_flooding);
        flooding.map(|(name, Watched { more, .. })| {
            Condition::of(format!("flood {name}"))
                .begins(format!(
                    "viewpoint {name} sends more than any edge may: {more} messages were dropped in the last second, other edges are not affected; check that machine, and renew its keys if others may have them"
                ))
                .notice(format!("viewpoint {name} sends more than any edge may"))
                .ends(format!("viewpoint {name} keeps its limit again"))
        })
    }
}

/// Load shedding of a live run.
#[derive(Debug, Default)]
pub(super) struct LiveShedding {
    shedding: Shedding,
    /// Number of patches of the current tick, by viewpoint.
    patches: Vec<usize>,
    /// Patches left out so far.
    pub(super) shed: u64,
    /// Most viewpoints left out of one tick since the last report.
    most: usize,
}

impl LiveShedding {
    /// Removes the patches that a tick of `n_viewpoints` has no time for.
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

    /// Adds the cost of a step: its number of patches and duration, microseconds.
    pub(super) fn stepped(&mut self, cost: (usize, Micros)) {
        let (patches, took_us) = cost;
        self.shedding.stepped(patches, took_us);
    }

    /// The load shedding since the last call.
    pub(super) fn condition(&mut self) -> Option<Condition> {
        let most = std::mem::take(&mut self.most);
        let n = self.patches.len();
        let condition = || {
            Condition::of("shedding")
                .begins(format!(
                    "this machine is too slow for so many people: up to {most} of {n} viewpoints, in turn, are left out \
                     of each tick (`farfield bench` measures what it can process)"
                ))
                .ends(format!("the ticks have time for all {n} viewpoints again"))
        };
        (most > 0).then(condition)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use farfield_fusion::live::fixture::{of_persons, patches};

    const PERIOD_US: f64 = 16_667.0;

    fn group(viewpoints: u16, people: u32) -> TickGroup {
        let set = |viewpoint| of_persons(patches(0, viewpoint, 0, 1), 0..people);
        TickGroup {
            patch_sets: (0..viewpoints).map(set).collect(),
            ..TickGroup::default()
        }
    }

    #[test]
    fn a_slow_machine_leaves_out_patches_and_counts_them() {
        let mut shedding = LiveShedding::default();
        let mut whole = group(8, 10);
        shedding.trim(&mut whole, 8, PERIOD_US);
        assert_eq!((whole.patch_sets.len(), shedding.shed), (8, 0));
        // 80 patches of 250 us take 20 ms; 14.2 ms are available.
        shedding.stepped((80, 20_000));
        let mut trimmed = group(8, 10);
        shedding.trim(&mut trimmed, 8, PERIOD_US);
        assert_eq!((trimmed.patch_sets.len(), shedding.shed), (5, 30));
        assert_eq!(shedding.most, 3);
        assert!(shedding.condition().is_some());
        for _ in 0..100 {
            shedding.stepped((50, 2_000));
        }
        shedding.trim(&mut whole, 8, PERIOD_US);
        assert_eq!(shedding.condition(), None);
        assert_eq!(whole.patch_sets.len(), 8);
    }

    #[test]
    fn only_many_refused_messages_are_a_flood() {
        let mut watch = FloodWatch::default();
        let mut update = |refused: [u64; 2]| {
            watch.update(refused.into_iter());
            [&watch.0[0], &watch.0[1]].map(|watched| watched.is_flooding)
        };
        assert_eq!(update([FLOOD - 1, 0]), [false; 2]);
        assert_eq!(update([FLOOD - 1, 1000]), [false, true]);
        assert_eq!(update([FLOOD - 1, 1001]), [false, true], "still dropped");
        assert_eq!(update([FLOOD - 1, 1001]), [false; 2]);
    }
}
