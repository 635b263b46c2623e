//! One direction of a link: rate and bounded queue, then loss, delay, jitter, duplicates and reordering.
//!
//! A waiting datagram keeps the rate at which it was queued; a change applies to later ones. Loss is behind the queue, as on
//! air: a lost datagram has taken its time.

use std::collections::BTreeMap;

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::meter::ByteMeter;

/// Bytes of an IPv4 packet on Ethernet without its own header.
const FRAGMENT_BYTES: usize = 1480;
/// What IPv4 adds to each packet, and UDP to each datagram, bytes.
const HEADERS_BYTES: [usize; 2] = [20, 8];

/// Bytes of a datagram with `payload` bytes on the path, with the headers of IPv4 and UDP. Rates, queues and counts of a
/// [`RelayLink`] are in these bytes.
pub fn on_the_wire(payload: usize) -> usize {
    let [ip, udp] = HEADERS_BYTES;
    let datagram = payload + udp;
    datagram + ip * datagram.div_ceil(FRAGMENT_BYTES)
}

/// Impairments of one direction of a link. The default has none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impairment {
    /// Bytes per second; `None`: unlimited.
    pub rate_bytes_s: Option<u32>,
    /// Size of the queue, bytes; datagrams that do not fit are dropped.
    pub queue_bytes: u32,
    /// Time in flight, microseconds.
    pub delay_us: u32,
    /// Largest additional delay, uniform, microseconds. It does not change the order.
    pub jitter_us: u32,
    /// Share that is lost, 0 to 1.
    pub loss: f64,
    /// Share that arrives twice, 0 to 1.
    pub duplicate: f64,
    /// Share that others may overtake, 0 to 1.
    pub reorder: f64,
    /// Additional delay of those, microseconds.
    pub reorder_us: u32,
}

impl Default for Impairment {
    fn default() -> Self {
        Self {
            rate_bytes_s: None,
            queue_bytes: 64 * 1024,
            delay_us: 0,
            jitter_us: 0,
            loss: 0.0,
            duplicate: 0.0,
            reorder: 0.0,
            reorder_us: 20_000,
        }
    }
}

/// Counts of the datagrams of one direction.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Counts {
    /// Offered to the link.
    pub offered: ByteMeter,
    /// Delivered, including duplicates.
    pub delivered: ByteMeter,
    /// Datagrams lost on the path.
    pub lost: u64,
    /// Datagrams dropped at a full queue.
    pub dropped: u64,
    /// Datagrams offered while the link was cut.
    pub cut: u64,
    /// Datagrams that were duplicated.
    pub doubled: u64,
    /// Datagrams that were held back for others to overtake.
    pub held_back: u64,
    /// Longest wait in the queue, microseconds.
    pub longest_wait_us: u64,
    /// Sum of the waits, microseconds.
    pub waited_us: u64,
}

/// One direction of a link, with datagrams as items of any kind.
#[derive(Debug)]
pub struct RelayLink<T> {
    impairment: Impairment,
    rng: ChaCha8Rng,
    /// Time at which the queue is empty, nanoseconds.
    free_at_ns: u64,
    /// Nothing passes before.
    cut_until_us: u64,
    /// Latest arrival of datagrams that keep their order.
    newest_due_us: u64,
    number: u64,
    /// By arrival, then number: bytes and item.
    on_the_way: BTreeMap<(u64, u64), (u64, T)>,
    counts: Counts,
}

/// Random draws of one datagram. All are always drawn, so that no fault changes another.
struct DatagramDraws {
    is_lost: bool,
    is_doubled: bool,
    is_held_back: bool,
    jitter_us: u64,
}

impl<T: Clone> RelayLink<T> {
    /// A link with nothing in flight.
    pub fn new(impairment: Impairment, seed: u64) -> Self {
        Self {
            impairment,
            rng: ChaCha8Rng::seed_from_u64(seed),
            free_at_ns: 0,
            cut_until_us: 0,
            newest_due_us: 0,
            number: 0,
            on_the_way: BTreeMap::new(),
            counts: Counts::default(),
        }
    }

    /// Changes the impairments from now on.
    pub fn set(&mut self, impairment: Impairment) {
        self.impairment = impairment;
    }

    /// The current impairments.
    pub fn impairment(&self) -> Impairment {
        self.impairment
    }

    /// Drops everything before `until_us`.
    pub fn cut(&mut self, until_us: u64) {
        self.cut_until_us = self.cut_until_us.max(until_us);
    }

    /// Offers a datagram of `payload` bytes at `now_us`, which never decreases.
    pub fn offer(&mut self, now_us: u64, payload: usize, item: T) {
        let bytes = on_the_wire(payload) as u64;
        self.counts.offered.count(now_us, bytes);
        let draws = self.draw();
        if now_us < self.cut_until_us {
            self.counts.cut += 1;
            return;
        }
        let Some(left_at_us) = self.queue(now_us, bytes) else {
            self.counts.dropped += 1;
            return;
        };
        if draws.is_lost {
            self.counts.lost += 1;
            return;
        }
        let mut due_us = left_at_us + u64::from(self.impairment.delay_us) + draws.jitter_us;
        if draws.is_held_back {
            self.counts.held_back += 1;
            due_us += u64::from(self.impairment.reorder_us);
        } else {
            due_us = due_us.max(self.newest_due_us);
            self.newest_due_us = due_us;
        }
        if draws.is_doubled {
            self.counts.doubled += 1;
            self.send(due_us, bytes, item.clone());
        }
        self.send(due_us, bytes, item);
    }

    /// Arrival of the next datagram, if any is in flight.
    pub fn next_due_us(&self) -> Option<u64> {
        self.on_the_way.keys().next().map(|&(due_us, _)| due_us)
    }

    /// The next datagram that has arrived by `now_us`.
    pub fn take(&mut self, now_us: u64) -> Option<T> {
        let entry = self.on_the_way.first_entry()?;
        if entry.key().0 > now_us {
            return None;
        }
        let (bytes, item) = entry.remove();
        self.counts.delivered.count(now_us, bytes);
        Some(item)
    }

    /// The counts so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Resets the counts.
    pub fn restart_counts(&mut self) {
        let Counts {
            mut offered,
            mut delivered,
            ..
        } = std::mem::take(&mut self.counts);
        offered.restart();
        delivered.restart();
        self.counts = Counts {
            offered,
            delivered,
            ..Counts::default()
        };
    }

    fn draw(&mut self) -> DatagramDraws {
        let Impairment {
            loss,
            duplicate,
            reorder,
            jitter_us,
            ..
        } = self.impairment;
        let [lost, doubled, held_back, late] = std::array::from_fn(|_| self.rng.random::<f64>());
        DatagramDraws {
            is_lost: lost < loss,
            is_doubled: doubled < duplicate,
            is_held_back: held_back < reorder,
            jitter_us: (late * f64::from(jitter_us)) as u64,
        }
    }

    /// Time at which a datagram of `bytes` leaves the queue, microseconds; `None` if it is full.
    fn queue(&mut self, now_us: u64, bytes: u64) -> Option<u64> {
        let Some(rate_bytes_s) = self.impairment.rate_bytes_s else {
            return Some(now_us);
        };
        let rate = u64::from(rate_bytes_s.max(1));
        let now_ns = now_us * 1000;
        let wait_ns = self.free_at_ns.saturating_sub(now_ns);
        let waiting_bytes = u128::from(wait_ns) * u128::from(rate) / 1_000_000_000;
        if waiting_bytes + u128::from(bytes) > u128::from(self.impairment.queue_bytes) {
            return None;
        }
        self.free_at_ns = now_ns + wait_ns + bytes * 1_000_000_000 / rate;
        self.counts.longest_wait_us = self.counts.longest_wait_us.max(wait_ns / 1000);
        self.counts.waited_us += wait_ns / 1000;
        Some(self.free_at_ns.div_ceil(1000))
    }

    fn send(&mut self, due_us: u64, bytes: u64, item: T) {
        self.on_the_way.insert((due_us, self.number), (bytes, item));
        self.number += 1;
    }
}
