//! The newest boxes that fusion has sent, and the looks that it has asked for.
//!
//! Box sets get lost, come twice and overtake each other: only what is newer than all before counts, so
//! that a duplicate or a late one changes nothing. Looks are planned by tick and for all viewpoints alike, so
//! those of a set that a newer one has replaced are kept until their tick.

use std::collections::VecDeque;
use std::sync::Arc;

use farfield_proto::id::{CameraIndex, SessionId};
use farfield_proto::live::BoxEcho;
use farfield_proto::message::BoxSet;
use farfield_proto::tick::Tick;

use super::{Micros, SECOND_US};

/// Boxes that are older say nothing any more about where somebody is, microseconds: as long as fusion
/// carries somebody on by default without seeing them.
pub const LIFE_US: Micros = SECOND_US;
/// Ticks whose looks are kept: past the longest horizon of boxes at any rate.
const MAX_LOOKS: usize = 256;
/// Sessions of fusion that are known to be over.
const MAX_PAST_SESSIONS: usize = 8;

/// What came of a box set that arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// The first of a session.
    NewSession,
    /// Newer than all before.
    Newer,
    /// A duplicate, overtaken by a newer one, or of a session that is over.
    Stale,
}

/// The newest boxes of fusion's newest session.
#[derive(Debug, Default)]
pub struct NewestBoxes {
    newest: Option<(Arc<BoxSet>, u32, Micros)>,
    /// In order of tick.
    looks: VecDeque<(Tick, Vec<CameraIndex>)>,
    past: VecDeque<SessionId>,
}

impl NewestBoxes {
    /// Takes a box set that arrived at `now_us`; what is not made for a live edge is stale.
    pub fn hear(&mut self, boxes: Arc<BoxSet>, now_us: Micros) -> Arrival {
        let Some(sequence) = boxes.live.map(|live| live.sequence) else {
            return Arrival::Stale;
        };
        if self.past.contains(&boxes.session) {
            return Arrival::Stale;
        }
        let arrival = match &self.newest {
            Some((newest, last, _)) if newest.session == boxes.session => {
                if !is_after(sequence, *last) {
                    // Its looks may still be ahead.
                    self.keep_look(&boxes);
                    return Arrival::Stale;
                }
                Arrival::Newer
            }
            Some((newest, ..)) => {
                if self.past.len() == MAX_PAST_SESSIONS {
                    self.past.pop_front();
                }
                self.past.push_back(newest.session);
                self.looks.clear();
                Arrival::NewSession
            }
            None => Arrival::NewSession,
        };
        self.keep_look(&boxes);
        self.newest = Some((boxes, sequence, now_us));
        arrival
    }

    /// The newest boxes, if they arrived at most [`LIFE_US`] before `now_us`.
    pub fn at(&self, now_us: Micros) -> Option<&Arc<BoxSet>> {
        let (boxes, _, heard_us) = self.newest.as_ref()?;
        (now_us - heard_us <= LIFE_US).then_some(boxes)
    }

    /// Fusion's session, once there is one; it stays when boxes grow old.
    pub fn session(&self) -> Option<SessionId> {
        self.newest.as_ref().map(|(boxes, ..)| boxes.session)
    }

    /// What was heard last, for fusion to measure the round trip by.
    pub fn echo(&self, now_us: Micros) -> Option<BoxEcho> {
        let (_, sequence, heard_us) = self.newest.as_ref()?;
        Some(BoxEcho {
            sequence: *sequence,
            held_us: u32::try_from((now_us - heard_us).max(0)).unwrap_or(u32::MAX),
        })
    }

    /// How long nothing new has come, microseconds; `None` when nothing ever has.
    pub fn silent_us(&self, now_us: Micros) -> Option<Micros> {
        self.newest.as_ref().map(|(_, _, at)| now_us - at)
    }

    /// The cameras that look at `tick`; those of earlier ticks are forgotten. Ticks must not go back.
    pub fn take_look(&mut self, tick: Tick) -> Vec<CameraIndex> {
        while self.looks.front().is_some_and(|(of, _)| *of < tick) {
            self.looks.pop_front();
        }
        match self.looks.front() {
            Some((of, _)) if *of == tick => self
                .looks
                .pop_front()
                .map(|(_, look)| look)
                .unwrap_or_default(),
            _ => Vec::new(),
        }
    }

    /// The first tick from `tick` on at which a camera looks, as far as it is known.
    pub fn next_look(&self, tick: Tick) -> Option<Tick> {
        let mut looks = self.looks.iter().map(|(of, _)| *of);
        looks.find(|of| *of >= tick)
    }

    fn keep_look(&mut self, boxes: &BoxSet) {
        if boxes.look.is_empty() {
            return;
        }
        let at = self.looks.partition_point(|(of, _)| *of < boxes.tick);
        if self.looks.get(at).is_none_or(|(of, _)| *of != boxes.tick) {
            self.looks.insert(at, (boxes.tick, boxes.look.clone()));
        }
        if self.looks.len() > MAX_LOOKS {
            self.looks.pop_front();
        }
    }
}

/// Whether number `a` was given after `b`, of numbers that wrap.
fn is_after(a: u32, b: u32) -> bool {
    a != b && a.wrapping_sub(b) < 1 << 31
}

#[cfg(test)]
mod tests {
    use farfield_proto::id::ViewpointIndex;
    use farfield_proto::live::LiveBoxes;
    use farfield_proto::message::Order;
    use proptest::prelude::*;

    use super::*;

    fn boxes(session: u64, sequence: u32) -> Arc<BoxSet> {
        Arc::new(BoxSet {
            session: SessionId(session),
            tick: Tick(100 + i64::from(sequence)),
            viewpoint: ViewpointIndex(0),
            order: Order::Track,
            live: Some(LiveBoxes {
                sequence,
                epoch_us: 0,
                clock_correction_us: 0,
                heard: None,
            }),
            look: if sequence.is_multiple_of(7) {
                vec![CameraIndex(1)]
            } else {
                Vec::new()
            },
            persons: Vec::new(),
        })
    }

    #[test]
    fn boxes_of_a_session_that_is_over_do_not_come_back() {
        let mut newest = NewestBoxes::default();
        assert_eq!(newest.hear(boxes(1, 50), 0), Arrival::NewSession);
        assert_eq!(newest.hear(boxes(2, 3), 1), Arrival::NewSession);
        assert_eq!(newest.hear(boxes(1, 51), 2), Arrival::Stale);
        assert_eq!(newest.session(), Some(SessionId(2)));
    }

    #[test]
    fn old_boxes_die_but_the_session_is_kept() {
        let mut newest = NewestBoxes::default();
        newest.hear(boxes(1, 0), 0);
        assert!(newest.at(LIFE_US).is_some());
        assert!(newest.at(LIFE_US + 1).is_none());
        assert_eq!(newest.session(), Some(SessionId(1)));
        assert_eq!(newest.echo(1500).unwrap().held_us, 1500);
    }

    #[test]
    fn numbers_wrap() {
        assert!(is_after(0, u32::MAX) && is_after(5, 4));
        assert!(!is_after(u32::MAX, 0) && !is_after(4, 4));
    }

    #[test]
    fn a_look_waits_for_its_tick_whatever_comes_after_it() {
        let mut newest = NewestBoxes::default();
        for sequence in 0..20 {
            newest.hear(boxes(1, sequence), 0);
        }
        assert_eq!(newest.take_look(Tick(106)), []);
        assert_eq!(newest.take_look(Tick(107)), [CameraIndex(1)]);
        assert_eq!(newest.take_look(Tick(107)), []);
        assert_eq!(newest.take_look(Tick(115)), []);
        assert!(newest.looks.is_empty());
    }

    proptest! {
        #[test]
        fn order_and_repeats_do_not_matter(
            mut order in Just((0u32..30).collect::<Vec<_>>()).prop_shuffle(),
            again in prop::collection::vec(0u32..30, 0..30),
        ) {
            let mut newest = NewestBoxes::default();
            order.extend(again);
            let mut most = None;
            for sequence in order {
                let arrival = newest.hear(boxes(1, sequence), 0);
                prop_assert_eq!(arrival == Arrival::Stale, most.is_some_and(|m| sequence <= m));
                most = most.max(Some(sequence));
                prop_assert_eq!(newest.echo(0).map(|echo| echo.sequence), most);
            }
            let looked: Vec<i64> = (100..130).filter(|&t| !newest.take_look(Tick(t)).is_empty()).collect();
            prop_assert_eq!(looked, [100, 107, 114, 121, 128]);
        }
    }
}
