//! Flow control by answered pings, so that outdated ticks do not wait in network buffers. Pure: the
//! time is an argument.

use std::time::Duration;

/// Number of ticks per ping.
const TICKS_PER_PING: u32 = 16;
/// No ticks are sent while this many pings are unanswered: at 60 Hz 0.8 s, more than the round trip
/// of a distant link.
const MAX_UNANSWERED: u64 = 3;
/// Maximum time without a ping.
const LONGEST: Duration = Duration::from_secs(10);
/// A client that does not answer for this long is considered gone.
const PATIENCE: Duration = Duration::from_secs(30);

/// What one client has received.
#[derive(Debug, Clone)]
pub(super) struct Flow {
    ticks: u32,
    /// Numbers of the last ping sent and answered.
    sent: u64,
    answered: u64,
    pinged_at: Duration,
    answered_at: Duration,
}

impl Flow {
    pub(super) fn new(now: Duration) -> Self {
        Self {
            ticks: 0,
            sent: 0,
            answered: 0,
            pinged_at: now,
            answered_at: now,
        }
    }

    /// Whether a tick would be read soon.
    pub(super) fn has_room(&self) -> bool {
        self.sent - self.answered < MAX_UNANSWERED
    }

    /// Records a sent tick; returns a ping if one is due.
    pub(super) fn sent_tick(&mut self, now: Duration) -> Option<[u8; 8]> {
        self.ticks += 1;
        (self.ticks >= TICKS_PER_PING).then(|| self.ping(now))
    }

    /// Returns a ping if none was sent for a long time.
    pub(super) fn due_ping(&mut self, now: Duration) -> Option<[u8; 8]> {
        (now.saturating_sub(self.pinged_at) >= LONGEST).then(|| self.ping(now))
    }

    fn ping(&mut self, now: Duration) -> [u8; 8] {
        self.ticks = 0;
        self.sent += 1;
        self.pinged_at = now;
        self.sent.to_le_bytes()
    }

    /// Records an answer; returns `false` if it answers no open ping.
    pub(super) fn answered(&mut self, payload: &[u8], now: Duration) -> bool {
        let Ok(number) = payload.try_into().map(u64::from_le_bytes) else {
            return false;
        };
        let is_answer = self.answered < number && number <= self.sent;
        if is_answer {
            self.answered = number;
            self.answered_at = now;
        }
        is_answer
    }

    /// Whether the client no longer answers.
    pub(super) fn is_gone(&self, now: Duration) -> bool {
        self.sent > self.answered && now.saturating_sub(self.answered_at) >= PATIENCE
    }
}

/// Rate limit of requests: a token bucket.
#[derive(Debug, Clone)]
pub(super) struct Allowance {
    left: f64,
    at: Duration,
}

impl Allowance {
    /// Maximum number of requests at once.
    const MOST: f64 = 40.0;
    /// Requests per second.
    const PER_S: f64 = 20.0;

    pub(super) fn new(now: Duration) -> Self {
        Self {
            left: Self::MOST,
            at: now,
        }
    }

    /// Takes one; returns `false` if none is left.
    pub(super) fn take(&mut self, now: Duration) -> bool {
        let filled = now.saturating_sub(self.at).as_secs_f64() * Self::PER_S;
        self.left = (self.left + filled).min(Self::MOST);
        self.at = now;
        let is_left = self.left >= 1.0;
        if is_left {
            self.left -= 1.0;
        }
        is_left
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(s: u64) -> Duration {
        Duration::from_secs(s)
    }

    #[test]
    fn a_client_that_does_not_read_gets_48_ticks() {
        let mut flow = Flow::new(s(0));
        let mut pings = Vec::new();
        let mut sent = 0;
        while flow.has_room() {
            pings.extend(flow.sent_tick(s(1)));
            sent += 1;
        }
        assert_eq!((sent, pings.len()), (48, 3));
        flow.answered(&pings[1], s(2));
        assert!(flow.has_room());
    }

    #[test]
    fn answers_to_unsent_pings_are_ignored() {
        let mut flow = Flow::new(s(0));
        for payload in [&[][..], &[1; 3], &u64::MAX.to_le_bytes()] {
            assert!(!flow.answered(payload, s(1)));
        }
        assert_eq!(flow.answered, 0);
        let ping = flow.ping(s(2));
        assert!(flow.answered(&ping, s(3)) && !flow.answered(&ping, s(4)));
    }

    #[test]
    fn silent_clients_are_pinged_and_then_dropped() {
        let mut flow = Flow::new(s(0));
        assert_eq!(flow.due_ping(s(9)), None);
        let ping = flow.due_ping(s(10)).unwrap();
        assert!(!flow.is_gone(s(29)) && flow.is_gone(s(30)));
        flow.answered(&ping, s(29));
        assert!(!flow.is_gone(s(100)));
    }

    #[test]
    fn twenty_requests_a_second_and_bursts_of_forty_are_allowed() {
        let mut allowance = Allowance::new(s(0));
        assert_eq!((0..100).filter(|_| allowance.take(s(0))).count(), 40);
        assert_eq!((0..100).filter(|_| allowance.take(s(1))).count(), 20);
    }
}
