//! The share of a link for thumbnails: none while the link carries less than fusion needs, and
//! little otherwise.
//!
//! Thumbnails are for people; poses do not depend on them. They are dropped first, and each is so
//! small that the next patches wait for at most one tick.

use farfield_proto::message::thumbnail::MAX_THUMBNAIL_BYTES;

use super::{MessageKind, Micros, RateController};
use crate::live::budget::ByteBudget;

/// Share of a byte budget for all thumbnails of the edge.
const SHARE: f64 = 0.1;
/// Share of a byte budget that thumbnails leave free for other messages within the next second.
const SPARE: f64 = 0.25;
/// Longest time for which one thumbnail occupies the link, seconds: about a tick at 60 Hz.
const MAX_OCCUPATION_S: f64 = 0.02;
/// Assumed rate of an unknown link, bytes per second: 2 Mbit/s.
const USUAL_BYTES_PER_S: f64 = 250_000.0;
/// Most bytes of a message in addition to the picture.
const HEAD_BYTES: usize = 32;

/// Counts the bytes of thumbnails.
#[derive(Debug, Clone)]
pub struct ThumbnailShare(ByteBudget);

impl ThumbnailShare {
    /// For a link with this budget; 0 means no budget.
    pub fn new(budget_bytes_per_s: f64) -> Self {
        Self(ByteBudget::new(SHARE * budget_bytes_per_s))
    }

    /// Most bytes of the picture of a thumbnail at `now_us`; 0 if none may be sent.
    pub fn room(
        &mut self,
        budget: &mut ByteBudget,
        rate: &RateController,
        now_us: Micros,
    ) -> usize {
        if !rate.has_room(now_us) {
            return 0;
        }
        let spare = (SPARE * budget.most().unwrap_or(0) as f64) as u64;
        let left = budget.left(now_us).map(|left| left.saturating_sub(spare));
        let own = self.0.left(now_us);
        let rate = Some(rate.rate()).filter(|rate| rate.is_finite());
        let longest = MAX_OCCUPATION_S * rate.unwrap_or(USUAL_BYTES_PER_S);
        let bounds = [left, own, Some(longest as u64)];
        let least = bounds.into_iter().flatten().min();
        let total = usize::try_from(least.unwrap_or(u64::MAX)).unwrap_or(usize::MAX);
        let head = MessageKind::Thumbnail.total_bytes(HEAD_BYTES);
        // Each datagram has an overhead.
        let of_picture = total.saturating_sub(head).min(MAX_THUMBNAIL_BYTES);
        let overhead = MessageKind::Thumbnail.total_bytes(of_picture) - of_picture;
        total
            .saturating_sub(head + overhead)
            .min(MAX_THUMBNAIL_BYTES)
    }

    /// Counts a thumbnail sent at `now_us`: `total` bytes with protocol overhead.
    pub fn sent(&mut self, total: usize, now_us: Micros) -> bool {
        self.0.take(total, now_us)
    }
}

#[cfg(test)]
mod tests {
    use farfield_proto::message::live::HeardPatches;
    use farfield_proto::message::parts::MESSAGE_BYTES;
    use farfield_proto::patch::CompressionLevel;
    use farfield_proto::tick::Tick;
    use proptest::prelude::*;

    use super::*;
    use crate::live::SECOND_US;

    /// An edge at 60 Hz with patches of fixed size per tick, and thumbnails whenever there is room.
    struct Edge {
        budget: ByteBudget,
        rate: RateController,
        share: ThumbnailShare,
        sent: Vec<(Micros, usize)>,
    }

    impl Edge {
        fn new(budget: f64) -> Self {
            let best = CompressionLevel::DEFAULT;
            Self {
                budget: ByteBudget::new(budget),
                rate: RateController::new(60.0, best, budget, MESSAGE_BYTES),
                share: ThumbnailShare::new(budget),
                sent: Vec::new(),
            }
        }

        /// Sends a thumbnail that fills the room; returns its bytes.
        fn thumbnail(&mut self, now_us: Micros) -> usize {
            let room = self.share.room(&mut self.budget, &self.rate, now_us);
            if room == 0 {
                return 0;
            }
            let total = MessageKind::Thumbnail.total_bytes(room + HEAD_BYTES);
            assert!(self.share.sent(total, now_us) && self.budget.take(total, now_us));
            self.sent.push((now_us, total));
            room
        }

        /// Sends the persons of a tick that the rate allows, and then a thumbnail.
        fn tick(&mut self, tick: i64, persons: usize) {
            let now_us = tick * SECOND_US / 60;
            let plan = self.rate.plan(persons, now_us);
            let n = plan.persons.map_or(persons, |most| most as usize);
            let payload = 300 * n + 40;
            let total = MessageKind::Patches(Tick(tick)).total_bytes(payload);
            if self.budget.take(total, now_us) {
                self.rate
                    .sent(MessageKind::Patches(Tick(tick)), payload, now_us);
            }
            self.rate.packed(plan.level, n, 1, payload);
            self.thumbnail(now_us);
        }
    }

    #[test]
    fn without_a_budget_a_thumbnail_takes_at_most_a_tick() {
        let bytes = Edge::new(0.0).thumbnail(0);
        assert!((4_000..=5_000).contains(&bytes), "{bytes}");
    }

    #[test]
    fn thumbnails_take_a_tenth_of_a_budget() {
        let mut edge = Edge::new(125_000.0);
        for tick in 0..600 {
            edge.tick(tick, 2);
        }
        let largest = edge.sent.iter().map(|(_, bytes)| *bytes).max().unwrap();
        assert!((1_000..=2_500).contains(&largest), "{largest}");
        let all: usize = edge.sent.iter().map(|(_, bytes)| bytes).sum();
        let per_s = all as f64 / 10.0;
        assert!((5_000.0..=12_500.0).contains(&per_s), "{per_s}");
    }

    #[test]
    fn no_thumbnail_is_sent_while_people_are_left_out() {
        let mut edge = Edge::new(60_000.0);
        for tick in 0..600 {
            edge.tick(tick, 22);
        }
        assert!(edge.rate.last_plan().level > CompressionLevel::DEFAULT);
        assert_eq!(edge.sent, []);
    }

    #[test]
    fn no_thumbnail_is_sent_while_the_link_is_cut() {
        let mut edge = Edge::new(0.0);
        let heard = HeardPatches {
            tick: Tick(0),
            one_way_us: 5_000,
            bytes: 300,
        };
        edge.rate.sent(MessageKind::Patches(Tick(0)), 300, 0);
        edge.rate.receive_report(&heard, 0, 10_000);
        assert!(edge.thumbnail(20_000) > 0);
        edge.rate.sent(MessageKind::Patches(Tick(3)), 300, 50_000);
        assert_eq!(edge.thumbnail(2 * SECOND_US), 0);
    }

    proptest! {
        #[test]
        fn a_thumbnail_leaves_room_for_other_messages(
            budget in 5_000.0f64..1e6, used in 0.0f64..1.0, at in 0i64..10 * SECOND_US,
        ) {
            let mut edge = Edge::new(budget);
            prop_assert!(edge.budget.take((used * budget) as usize, at));
            edge.thumbnail(at);
            let left = edge.budget.left(at).unwrap() as f64;
            let before = (1.0 - used) * budget;
            prop_assert!(left >= (SPARE * budget - 1.0).min(before - 1.0), "{left} of {before}");
        }
    }
}
