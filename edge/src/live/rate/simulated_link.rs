//! A simulated link to fusion: a queue before a rate limit, delay, jitter and loss.

use std::collections::VecDeque;

use farfield_proto::id::PersonId;

use super::*;
use crate::live::{SECOND_US, round_robin};

pub(super) const RATE_HZ: f64 = 60.0;
/// Bytes of a person at each level; differs from the controller's initial values.
const TRUE_BYTES: [usize; LEVELS] = [700, 450, 380, 300, 250, 215, 190];

/// A link and the fusion behind it.
pub(super) struct SimulatedLink {
    pub(super) bytes_per_s: f64,
    /// A message that would wait longer is dropped, microseconds; 0 means no queue.
    pub(super) longest_queue_us: i64,
    pub(super) one_way_us: i64,
    pub(super) jitter_us: i64,
    pub(super) loss: f64,
    /// Interval without any delivery in both directions, seconds.
    pub(super) cut_s: std::ops::Range<i64>,
    /// A change of the delay: its time, seconds, and the new delay, microseconds.
    pub(super) then: (i64, i64),
    /// Bytes of a detection pass, which fusion requests at every tick; 0 for none.
    pub(super) pass_bytes: usize,
    /// Spread of the bytes per person between edges, as a share in each direction: distances
    /// differ.
    pub(super) sizes_apart: f64,
}

impl SimulatedLink {
    fn delay_us(&self, at_us: i64) -> i64 {
        let (from_s, then_us) = self.then;
        if at_us / SECOND_US < from_s {
            self.one_way_us
        } else {
            then_us
        }
    }

    fn is_cut(&self, at_us: i64) -> bool {
        self.cut_s.contains(&(at_us / SECOND_US))
    }
}

/// Result of a run.
#[derive(Debug, Default)]
pub(super) struct RunOutcome {
    /// In the last half.
    pub(super) worst_queue_us: i64,
    pub(super) arrived_bytes_per_s: f64,
    pub(super) lost: f64,
    pub(super) plan: Option<SendPlan>,
    /// Persons sent per second, as a share of all.
    pub(super) persons_share: f64,
    /// Number of detection passes.
    pub(super) passes: u32,
}

struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// One edge on the link: its messages in transit, and fusion's reports about them.
#[derive(Default)]
struct SimulatedEdge {
    /// Arrival, tick, sending time, payload.
    under_way: VecDeque<(i64, i64, i64, usize)>,
    /// Sightings in transit: arrival, payload.
    sightings: VecDeque<(i64, usize)>,
    arrived: VecDeque<(i64, usize)>,
    newest: Option<(i64, i64)>,
    words: VecDeque<(i64, HeardPatches)>,
    outcome: RunOutcome,
    chosen: Vec<PersonId>,
    sent_n: f64,
    lost_n: f64,
    /// Bytes of a person, relative to [`TRUE_BYTES`].
    size: f64,
}

impl SimulatedEdge {
    /// Fusion processes the messages that arrived by `now`, and reports them.
    fn report(&mut self, line: &SimulatedLink, now: i64) {
        let by_arrival = self.under_way.make_contiguous();
        by_arrival.sort_by_key(|(at, ..)| *at);
        while self.under_way.front().is_some_and(|(at, ..)| *at <= now) {
            let (at, tick, sent, payload) = self.under_way.pop_front().unwrap();
            self.arrived.push_back((at, payload));
            if self.newest.is_none_or(|(known, _)| tick > known) {
                self.newest = Some((tick, at - sent));
            }
        }
        while let Some((at, payload)) = self.sightings.pop_front_if(|(at, _)| *at <= now) {
            self.arrived.push_back((at, payload));
        }
        self.arrived.retain(|(at, _)| now - at < SECOND_US);
        if let Some((tick, way)) = self.newest {
            let bytes = self.arrived.iter().map(|(_, payload)| *payload as u32);
            let word = HeardPatches {
                tick: Tick(tick),
                one_way_us: way as i32,
                bytes: bytes.sum(),
            };
            self.words.push_back((now + line.delay_us(now), word));
        }
    }

    fn deliver_reports(&mut self, controller: &mut RateController, line: &SimulatedLink, now: i64) {
        while self.words.front().is_some_and(|(at, _)| *at <= now) {
            let (at, word) = self.words.pop_front().unwrap();
            if !line.is_cut(at) {
                controller.receive_report(&word, 0, at);
            }
        }
    }

    /// Sends the plan of the controller for `tick`. `free_at` is the time when the link has sent
    /// all earlier messages.
    fn send(
        &mut self,
        controller: &mut RateController,
        (line, free_at, random): (&SimulatedLink, &mut i64, &mut Random),
        persons: usize,
        tick: i64,
        counts: bool,
    ) {
        let now = tick * SECOND_US / 60;
        let passes = line.pass_bytes > 0 && controller.may_detect(tick % 60 == 0, now);
        if passes {
            let messages = line.pass_bytes.div_ceil(MESSAGE_BYTES);
            for _ in 0..messages {
                let payload = line.pass_bytes / messages;
                controller.sent(MessageKind::Sightings, payload, now);
                let total = (payload + MESSAGE_OVERHEAD_BYTES) as f64;
                let start = now.max(*free_at);
                if start - now > line.longest_queue_us {
                    continue;
                }
                *free_at = start + (total / line.bytes_per_s * 1e6) as i64;
                let arrives_at = *free_at + line.delay_us(now);
                self.sightings.push_back((arrives_at, payload));
            }
            self.outcome.passes += u32::from(counts);
        }
        let plan = controller.plan(persons, now);
        self.outcome.plan = Some(plan);
        if tick % i64::from(plan.every_nth) != 0 || !controller.may_send(Tick(tick), now) {
            return;
        }
        let counted = f64::from(u8::from(counts));
        let all = (1..=persons as u32).map(PersonId);
        let most = plan.persons.unwrap_or(persons as f64);
        let number = Tick(tick / i64::from(plan.every_nth));
        round_robin::choose(all, most, number, &mut self.chosen);
        let n = self.chosen.len();
        let wobble = self.size * (0.8 + 0.4 * random.next());
        let bytes =
            (n as f64 * TRUE_BYTES[usize::from(plan.level.number())] as f64 * wobble) as usize;
        let messages = bytes.div_ceil(MESSAGE_BYTES - 40).max(1);
        controller.packed(plan.level, n, messages, bytes + 40 * messages);
        self.outcome.persons_share += n as f64 * counted;
        for _ in 0..messages {
            let payload = bytes / messages + 40;
            controller.sent(MessageKind::Patches(Tick(tick)), payload, now);
            let start = now.max(*free_at);
            let total = (payload + MESSAGE_OVERHEAD_BYTES) as f64;
            self.sent_n += counted;
            if start - now > line.longest_queue_us || random.next() < line.loss || line.is_cut(now)
            {
                self.lost_n += counted;
                continue;
            }
            *free_at = start + (total / line.bytes_per_s * 1e6) as i64;
            let jitter = (random.next() * line.jitter_us as f64) as i64;
            let arrives_at = *free_at + line.delay_us(now) + jitter;
            self.under_way.push_back((arrives_at, tick, now, payload));
            if counts {
                let worst = &mut self.outcome.worst_queue_us;
                *worst = (*worst).max(start - now);
                self.outcome.arrived_bytes_per_s += total;
            }
        }
    }

    /// The result of the `seconds` that counted.
    fn outcome(mut self, seconds: f64, persons: usize) -> RunOutcome {
        self.outcome.arrived_bytes_per_s /= seconds;
        self.outcome.lost = self.lost_n / f64::max(self.sent_n, 1.0);
        self.outcome.persons_share /= seconds * RATE_HZ * persons as f64;
        self.outcome
    }
}

pub(super) fn run(
    controller: &mut RateController,
    line: &SimulatedLink,
    persons: usize,
    seconds: i64,
    from_s: i64,
) -> RunOutcome {
    let alone = run_together(
        &mut [controller],
        line,
        persons,
        from_s..from_s + seconds,
        0,
    );
    alone.into_iter().next().unwrap()
}

/// Edges that see the same `persons` on one link, each starting `apart_s` after the previous one.
pub(super) fn run_together(
    controllers: &mut [&mut RateController],
    line: &SimulatedLink,
    persons: usize,
    seconds: std::ops::Range<i64>,
    apart_s: i64,
) -> Vec<RunOutcome> {
    let mut random = Random(7);
    let mut free_at = 0i64;
    let last = (controllers.len() - 1).max(1) as f64;
    let size = |edge: usize| 1.0 + line.sizes_apart * (2.0 * edge as f64 / last - 1.0);
    let mut edges: Vec<_> = (0..controllers.len())
        .map(|edge| SimulatedEdge {
            size: size(edge),
            ..SimulatedEdge::default()
        })
        .collect();
    let half_s = (seconds.end - seconds.start) as f64 / 2.0;
    let counts_from = seconds.start * 60 + (half_s * RATE_HZ) as i64;
    for tick in seconds.start * 60..seconds.end * 60 {
        let now = tick * SECOND_US / 60;
        // The first edge changes, so that no edge is always first.
        let first = (tick as usize).wrapping_mul(7) / 3;
        let begun = (now / SECOND_US - seconds.start).checked_div(apart_s);
        let begun = begun.map_or(edges.len(), |last| edges.len().min(last as usize + 1));
        for turn in 0..begun {
            let of = (first + turn) % begun;
            let (edge, controller) = (&mut edges[of], &mut *controllers[of]);
            edge.deliver_reports(controller, line, now);
            let way = (line, &mut free_at, &mut random);
            edge.send(controller, way, persons, tick, tick > counts_from);
        }
        for edge in &mut edges {
            edge.report(line, now);
        }
    }
    let outcomes = edges.into_iter().map(|edge| edge.outcome(half_s, persons));
    outcomes.collect()
}
