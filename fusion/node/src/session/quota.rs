//! Quota of incoming messages per node in a live run: messages beyond it are dropped unread, and counted.
//!
//! An edge with a valid key may still be compromised. Its cost for fusion and the recording is bounded here, before decoding.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use farfield_proto::transport::MESSAGE_OVERHEAD_BYTES;

/// Bytes per second of a node without a budget: more than lossless maps of a crowd take.
const MOST_BYTES_PER_S: f64 = (32 << 20) as f64;
/// Accepted multiple of the budget: delays of the network bunch messages.
const OVER_BUDGET: f64 = 2.0;
/// Burst, seconds of the rate.
const BURST_S: f64 = 1.0;
/// Interval of recording unreadable or repeated messages of a node: enough for a diagnosis.
const UNUSABLE_EVERY_US: i64 = 1_000_000;

/// The quota of one node, and its dropped messages.
#[derive(Debug)]
pub(super) struct Quota {
    bytes_per_s: f64,
    bucket: Mutex<Bucket>,
    /// Messages beyond the quota.
    refused: AtomicU64,
    /// Messages dropped from a full queue.
    lost: AtomicU64,
}

#[derive(Debug)]
struct Bucket {
    bytes: f64,
    filled_us: Option<i64>,
    unusable_us: Option<i64>,
}

impl Quota {
    /// The quota of a node with `budget_bytes_per_s`; 0: no budget.
    pub(super) fn new(budget_bytes_per_s: f64) -> Self {
        let bytes_per_s = if budget_bytes_per_s > 0.0 {
            (OVER_BUDGET * budget_bytes_per_s).min(MOST_BYTES_PER_S)
        } else {
            MOST_BYTES_PER_S
        };
        Self {
            bytes_per_s,
            bucket: Mutex::new(Bucket {
                bytes: bytes_per_s * BURST_S,
                filled_us: None,
                unusable_us: None,
            }),
            refused: AtomicU64::new(0),
            lost: AtomicU64::new(0),
        }
    }

    /// Whether a message of `bytes` is accepted at `now_us`; refusals are counted.
    pub(super) fn admits(&self, bytes: usize, now_us: i64) -> bool {
        let mut bucket = self.bucket.lock().unwrap_or_else(PoisonError::into_inner);
        let since_us = bucket
            .filled_us
            .map_or(0, |at_us| now_us.saturating_sub(at_us));
        bucket.filled_us = Some(now_us);
        let more = since_us.max(0) as f64 / 1e6 * self.bytes_per_s;
        bucket.bytes = (bucket.bytes + more).min(self.bytes_per_s * BURST_S);
        let cost = (bytes + MESSAGE_OVERHEAD_BYTES) as f64;
        let is_admitted = bucket.bytes >= cost;
        if is_admitted {
            bucket.bytes -= cost;
        } else {
            self.refused.fetch_add(1, Ordering::Relaxed);
        }
        is_admitted
    }

    /// Whether an unusable message is recorded at `now_us`.
    pub(super) fn records_unusable(&self, now_us: i64) -> bool {
        let mut bucket = self.bucket.lock().unwrap_or_else(PoisonError::into_inner);
        let is_due = bucket
            .unusable_us
            .is_none_or(|at_us| now_us.saturating_sub(at_us) >= UNUSABLE_EVERY_US);
        if is_due {
            bucket.unusable_us = Some(now_us);
        }
        is_due
    }

    /// Counts a message dropped from a full queue.
    pub(super) fn count_lost(&self) {
        self.lost.fetch_add(1, Ordering::Relaxed);
    }

    /// Messages beyond the quota since the start: caused by the sender.
    pub(super) fn refused(&self) -> u64 {
        self.refused.load(Ordering::Relaxed)
    }

    /// All dropped messages, including those from a full queue, which fusion may have caused.
    pub(super) fn dropped(&self) -> u64 {
        self.refused() + self.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_gets_twice_its_budget_and_others_lose_nothing() {
        let honest = Quota::new(100_000.0);
        let sent = (0..1_000).filter(|i| honest.admits(900, i * 10_000));
        assert_eq!(sent.count(), 1_000, "90 kB/s");
        let flood = Quota::new(100_000.0);
        // 10 MB/s for 10 s.
        let passed = (0..100_000)
            .filter(|i| flood.admits(1_000, i * 100))
            .count();
        let cost = 1_000 + MESSAGE_OVERHEAD_BYTES;
        assert!(passed * cost <= 2_200_000, "{passed}");
        assert_eq!(flood.refused(), 100_000 - passed as u64);
        // Messages dropped because fusion was slow are no flood.
        honest.count_lost();
        assert_eq!((honest.refused(), honest.dropped()), (0, 1));
    }

    #[test]
    fn one_unusable_message_a_second_is_recorded() {
        let quota = Quota::new(0.0);
        let recorded = (0..100).filter(|i| quota.records_unusable(i * 100_000));
        assert_eq!(recorded.count(), 10);
    }
}
