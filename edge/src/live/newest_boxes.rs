//! The newest boxes of fusion, and its requests for detection passes.
//!
//! Box sets can be lost, repeated or reordered. Only a set newer than all before counts, so
//! duplicates and late sets have no effect. Without keys any process on the machine can send box
//! sets. A foreign session is ignored while fusion's own continues, and one that was accepted ends
//! when it stops. Detection passes are scheduled by tick for all viewpoints, so the requests of a
//! replaced set are kept until their tick. A set can consist of several messages
//! ([`crate::box_parts`]); the first that arrives replaces the previous set.

use std::collections::VecDeque;
use std::sync::Arc;

use farfield_proto::id::{CameraIndex, SessionId};
use farfield_proto::message::BoxSet;
use farfield_proto::message::live::BoxEcho;
use farfield_proto::tick::Tick;

use super::{Micros, SECOND_US};
use crate::box_parts::BoxParts;

/// Longest age of boxes in use, microseconds. By default fusion keeps a person without views as
/// long.
pub const LIFE_US: Micros = SECOND_US;
/// Another session is accepted if the followed one sent nothing new for this time, microseconds. A
/// running fusion sends at least ten times a second, and a restart takes longer.
const TAKEOVER_US: Micros = 3 * SECOND_US / 10;
/// A session that seemed to be over is accepted again after [`LIFE_US`] without other news, if this
/// many of its sets came in order.
const KEEPS_COMING: u32 = 3;
/// Ticks with stored detection requests: more than the longest horizon of boxes at any rate.
const MAX_DETECTION_REQUESTS: usize = 256;
/// Number of stored sessions that are over.
const MAX_PAST_SESSIONS: usize = 8;

/// Result of the arrival of a box set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoxSetArrival {
    /// The first set of a session.
    NewSession,
    /// Newer than all previous sets.
    Newer,
    /// Another message of the newest set.
    Part,
    /// A duplicate, older than another set, or from a session that is over.
    Stale,
    /// From another session, while the followed one continues.
    Foreign,
}

/// Stale sets that arrive in order.
#[derive(Debug, Clone, Copy)]
struct StaleSequence {
    session: SessionId,
    sequence: u32,
    sets: u32,
}

/// The newest boxes of fusion's newest session.
#[derive(Debug, Default)]
pub struct NewestBoxes {
    newest: Option<(Arc<BoxSet>, u32, Micros)>,
    /// The messages of the newest set that have arrived.
    parts: Option<BoxParts>,
    /// In order of ticks.
    detection_requests: VecDeque<(Tick, Vec<CameraIndex>)>,
    past: VecDeque<SessionId>,
    claim: Option<StaleSequence>,
}

impl NewestBoxes {
    /// Adds a box set that arrived at `now_us`. Sets without data for a live edge are stale.
    pub fn receive(&mut self, mut boxes: BoxSet, now_us: Micros) -> BoxSetArrival {
        let Some(sequence) = boxes.live.map(|live| live.sequence) else {
            return BoxSetArrival::Stale;
        };
        if self.add_part(&boxes, sequence) {
            return BoxSetArrival::Part;
        }
        let arrival = self.judge(&boxes, sequence, now_us);
        match arrival {
            BoxSetArrival::Foreign => return arrival,
            BoxSetArrival::NewSession => self.leave_session(boxes.session),
            BoxSetArrival::Newer | BoxSetArrival::Part | BoxSetArrival::Stale => {}
        }
        // The detection requests of a stale set can still be in the future.
        if arrival != BoxSetArrival::Stale || self.session() == Some(boxes.session) {
            self.keep_detection_request(&boxes);
        }
        if arrival != BoxSetArrival::Stale {
            self.claim = None;
            let same_session = self.newest.as_ref().map(|(before, ..)| &**before);
            let before = same_session.filter(|before| before.session == boxes.session);
            self.parts = Some(BoxParts::begin(&mut boxes, before));
            self.newest = Some((boxes.into(), sequence, now_us));
        }
        arrival
    }

    /// Adds another message of the newest set; `false` if it is none.
    fn add_part(&mut self, boxes: &BoxSet, sequence: u32) -> bool {
        let (Some((newest, last, _)), Some(parts)) = (&mut self.newest, &mut self.parts) else {
            return false;
        };
        let is_same = newest.session == boxes.session && *last == sequence;
        is_same && !parts.is_whole() && parts.add(Arc::make_mut(newest), boxes)
    }

    fn judge(&mut self, boxes: &BoxSet, sequence: u32, now_us: Micros) -> BoxSetArrival {
        let Some((newest, last, heard_us)) = &self.newest else {
            return BoxSetArrival::NewSession;
        };
        let silent_us = now_us - heard_us;
        let is_same = newest.session == boxes.session;
        if is_same && is_after(sequence, *last) {
            return BoxSetArrival::Newer;
        }
        if !is_same && !self.past.contains(&boxes.session) {
            return if silent_us > TAKEOVER_US {
                BoxSetArrival::NewSession
            } else {
                BoxSetArrival::Foreign
            };
        }
        if silent_us <= LIFE_US || !self.keeps_coming(boxes.session, sequence) {
            BoxSetArrival::Stale
        } else if is_same {
            BoxSetArrival::Newer
        } else {
            BoxSetArrival::NewSession
        }
    }

    fn keeps_coming(&mut self, session: SessionId, sequence: u32) -> bool {
        let claim = self.claim.get_or_insert(StaleSequence {
            session,
            sequence,
            sets: 1,
        });
        if claim.session != session {
            (claim.session, claim.sequence, claim.sets) = (session, sequence, 1);
        } else if is_after(sequence, claim.sequence) {
            (claim.sequence, claim.sets) = (sequence, claim.sets + 1);
        }
        claim.sets >= KEEPS_COMING
    }

    /// Ends the followed session and starts `next`.
    fn leave_session(&mut self, next: SessionId) {
        self.past.retain(|past| *past != next);
        if let Some(last) = self.session() {
            if self.past.len() == MAX_PAST_SESSIONS {
                self.past.pop_front();
            }
            self.past.push_back(last);
            self.detection_requests.clear();
        }
    }

    /// The newest boxes, if they arrived within [`LIFE_US`] before `now_us`.
    pub fn at(&self, now_us: Micros) -> Option<&Arc<BoxSet>> {
        let (boxes, _, heard_us) = self.newest.as_ref()?;
        (now_us - heard_us <= LIFE_US).then_some(boxes)
    }

    /// The newest boxes of any age.
    pub fn last(&self) -> Option<&Arc<BoxSet>> {
        self.newest.as_ref().map(|(boxes, ..)| boxes)
    }

    /// Fusion's session, once known; it remains when boxes are too old.
    pub fn session(&self) -> Option<SessionId> {
        self.newest.as_ref().map(|(boxes, ..)| boxes.session)
    }

    /// The newest box set and its age, from which fusion measures the round trip.
    pub fn echo(&self, now_us: Micros) -> Option<BoxEcho> {
        let (_, sequence, heard_us) = self.newest.as_ref()?;
        Some(BoxEcho {
            sequence: *sequence,
            held_us: u32::try_from((now_us - heard_us).max(0)).unwrap_or(u32::MAX),
        })
    }

    /// Time since the last new boxes, microseconds; `None` before the first.
    pub fn silent_us(&self, now_us: Micros) -> Option<Micros> {
        self.newest.as_ref().map(|(_, _, at)| now_us - at)
    }

    /// The cameras of the detection pass at `tick`; earlier requests are removed. Ticks must not
    /// decrease.
    pub fn take_detection_request(&mut self, tick: Tick) -> Vec<CameraIndex> {
        while self
            .detection_requests
            .front()
            .is_some_and(|(of, _)| *of < tick)
        {
            self.detection_requests.pop_front();
        }
        match self.detection_requests.front() {
            Some((of, _)) if *of == tick => self
                .detection_requests
                .pop_front()
                .map(|(_, cameras)| cameras)
                .unwrap_or_default(),
            _ => Vec::new(),
        }
    }

    /// The first known detection pass from `tick`, and its cameras.
    pub fn next_detection_request(&self, tick: Tick) -> Option<(Tick, &[CameraIndex])> {
        let requests = self.detection_requests.iter();
        let mut requests = requests.map(|(of, cameras)| (*of, &cameras[..]));
        requests.find(|(of, _)| *of >= tick)
    }

    fn keep_detection_request(&mut self, boxes: &BoxSet) {
        if boxes.detection_cameras.is_empty() {
            return;
        }
        let at = self
            .detection_requests
            .partition_point(|(of, _)| *of < boxes.tick);
        if self
            .detection_requests
            .get(at)
            .is_none_or(|(of, _)| *of != boxes.tick)
        {
            self.detection_requests
                .insert(at, (boxes.tick, boxes.detection_cameras.clone()));
        }
        if self.detection_requests.len() > MAX_DETECTION_REQUESTS {
            self.detection_requests.pop_front();
        }
    }
}

/// Whether `a` comes after `b` in wrapping sequence numbers.
fn is_after(a: u32, b: u32) -> bool {
    a != b && a.wrapping_sub(b) < 1 << 31
}

#[cfg(test)]
mod tests {
    use crate::box_parts::tests::message;
    use farfield_proto::id::ViewpointIndex;
    use farfield_proto::message::Order;
    use farfield_proto::message::live::LiveBoxes;
    use proptest::prelude::*;

    use super::*;

    fn boxes(session: u64, sequence: u32) -> BoxSet {
        BoxSet {
            session: SessionId(session),
            tick: Tick(100 + i64::from(sequence)),
            viewpoint: ViewpointIndex(0),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: Some(LiveBoxes {
                sequence,
                epoch_us: 0,
                clock_correction_us: None,
                heard: None,
                every_nth_tick: 0,
            }),
            detection_cameras: if sequence.is_multiple_of(7) {
                vec![CameraIndex(1)]
            } else {
                Vec::new()
            },
            persons: Vec::new(),
        }
    }

    #[test]
    fn boxes_of_an_ended_session_are_stale() {
        let mut newest = NewestBoxes::default();
        assert_eq!(newest.receive(boxes(1, 50), 0), BoxSetArrival::NewSession);
        let later_us = TAKEOVER_US + 1;
        assert_eq!(
            newest.receive(boxes(2, 3), later_us),
            BoxSetArrival::NewSession
        );
        assert_eq!(
            newest.receive(boxes(1, 51), later_us + 1),
            BoxSetArrival::Stale
        );
        assert_eq!(newest.session(), Some(SessionId(2)));
    }

    #[test]
    fn a_foreign_session_is_ignored_while_fusion_sends() {
        // Symptom to prevent: after one forged set the real session counted as over forever.
        let mut newest = NewestBoxes::default();
        for sequence in 0..100 {
            let now_us = i64::from(sequence) * SECOND_US / 10;
            newest.receive(boxes(1, sequence), now_us);
            let forged = boxes(2 + u64::from(sequence), 1 << 20);
            assert_eq!(newest.receive(forged, now_us + 1), BoxSetArrival::Foreign);
        }
        assert_eq!(newest.session(), Some(SessionId(1)));
        assert_eq!(newest.at(10 * SECOND_US).unwrap().tick, Tick(199));
    }

    /// Fusion continues from `from` ten times a second; returns the time until the edge follows it
    /// again.
    fn back_after_us(newest: &mut NewestBoxes, from: u32, since_us: Micros) -> Micros {
        let back = (from..from + 100).find_map(|sequence| {
            let us = i64::from(sequence - from) * SECOND_US / 10;
            let arrival = newest.receive(boxes(1, sequence), since_us + us);
            matches!(arrival, BoxSetArrival::Newer | BoxSetArrival::NewSession).then_some(us)
        });
        back.unwrap()
    }

    #[test]
    fn a_foreign_session_accepted_in_an_outage_does_not_last() {
        let mut newest = NewestBoxes::default();
        newest.receive(boxes(1, 7), 0);
        assert_eq!(
            newest.receive(boxes(2, 0), SECOND_US),
            BoxSetArrival::NewSession
        );
        assert!(back_after_us(&mut newest, 8, SECOND_US) <= 3 * SECOND_US / 2);
        assert_eq!(newest.session(), Some(SessionId(1)));
        // The forged session is over now.
        assert_eq!(
            newest.receive(boxes(2, 1), 3 * SECOND_US),
            BoxSetArrival::Stale
        );
    }

    #[test]
    fn a_number_far_ahead_does_not_block_fusion() {
        // Symptom to prevent: after one forged set half of all sequence numbers were stale.
        let mut newest = NewestBoxes::default();
        newest.receive(boxes(1, 7), 0);
        assert_eq!(
            newest.receive(boxes(1, 7 + (1 << 30)), 1),
            BoxSetArrival::Newer
        );
        assert!(back_after_us(&mut newest, 8, 2) <= 3 * SECOND_US / 2);
        assert_eq!(newest.echo(0).map(|echo| echo.sequence < 100), Some(true));
        let next = newest.echo(0).unwrap().sequence + 1;
        assert_eq!(newest.receive(boxes(1, next), 9), BoxSetArrival::Newer);
    }

    #[test]
    fn a_duplicate_after_an_outage_is_still_stale() {
        let mut newest = NewestBoxes::default();
        newest.receive(boxes(1, 7), 0);
        for _ in 0..10 {
            assert_eq!(
                newest.receive(boxes(1, 6), 2 * LIFE_US),
                BoxSetArrival::Stale
            );
        }
    }

    #[test]
    fn old_boxes_expire_but_the_session_is_kept() {
        let mut newest = NewestBoxes::default();
        newest.receive(boxes(1, 0), 0);
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
    fn a_detection_request_waits_for_its_tick() {
        let mut newest = NewestBoxes::default();
        for sequence in 0..20 {
            newest.receive(boxes(1, sequence), 0);
        }
        assert_eq!(newest.take_detection_request(Tick(106)), []);
        assert_eq!(newest.take_detection_request(Tick(107)), [CameraIndex(1)]);
        assert_eq!(newest.take_detection_request(Tick(107)), []);
        assert_eq!(newest.take_detection_request(Tick(115)), []);
        assert!(newest.detection_requests.is_empty());
    }

    #[test]
    fn a_split_set_is_used_from_its_first_message() {
        let mut newest = NewestBoxes::default();
        newest.receive(message(1, [0, 1], &[1, 2]), 0);
        assert_eq!(
            newest.receive(message(2, [0, 2], &[1]), 1),
            BoxSetArrival::Newer
        );
        let persons = |newest: &NewestBoxes| newest.at(2).map(|boxes| boxes.persons.len());
        assert_eq!(persons(&newest), Some(2));
        assert_eq!(
            newest.receive(message(2, [1, 2], &[3, 4]), 2),
            BoxSetArrival::Part
        );
        assert_eq!(persons(&newest), Some(3));
        assert_eq!(
            newest.receive(message(2, [1, 2], &[3, 4]), 3),
            BoxSetArrival::Stale
        );
        assert_eq!(
            newest.echo(1).map(|echo| (echo.sequence, echo.held_us)),
            Some((2, 0))
        );
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
                let arrival = newest.receive(boxes(1, sequence), 0);
                prop_assert_eq!(arrival == BoxSetArrival::Stale, most.is_some_and(|m| sequence <= m));
                most = most.max(Some(sequence));
                prop_assert_eq!(newest.echo(0).map(|echo| echo.sequence), most);
            }
            let requested: Vec<i64> = (100..130).filter(|&t| !newest.take_detection_request(Tick(t)).is_empty()).collect();
            prop_assert_eq!(requested, [100, 107, 114, 121, 128]);
        }
    }
}
