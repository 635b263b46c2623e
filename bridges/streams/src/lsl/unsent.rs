//! What an inlet has still to get: it takes less than there is for a while, and loses nothing; for long, and there is one gap.
//!
//! Who were sent only the newest, and something in the place of each sample that was passed over, would be sent as many bytes, of which
//! hardly any are poses.

use std::collections::VecDeque;
use std::sync::Arc;

/// For how long samples wait, seconds: where so much is missing readers of files begin anew.
const LONGEST_S: f64 = 1.0;

/// Samples in their order, the first perhaps sent in part.
#[derive(Debug, Default)]
pub(super) struct Unsent {
    samples: VecDeque<Arc<[u8]>>,
    /// Bytes of the first that were sent.
    sent: usize,
}

impl Unsent {
    /// Takes a sample of a stream of `rate_hz`, before which all that wait are given up where they are too many; how many those are.
    pub(super) fn push(&mut self, sample: Arc<[u8]>, rate_hz: f64) -> u64 {
        let most = (LONGEST_S * rate_hz).ceil() as usize;
        let mut given_up = 0;
        if self.samples.len() > most {
            // What was begun is ended.
            let begun = usize::from(self.sent > 0);
            given_up = self.samples.len() - begun;
            self.samples.truncate(begun);
        }
        self.samples.push_back(sample);
        given_up as u64
    }

    /// The bytes that come next; none where nothing waits.
    pub(super) fn next(&self) -> &[u8] {
        let first = self.samples.front();
        first
            .and_then(|sample| sample.get(self.sent..))
            .unwrap_or_default()
    }

    /// Notes that `n` of the next bytes were sent; whether that was the end of a sample.
    pub(super) fn sent(&mut self, n: usize) -> bool {
        self.sent += n;
        let is_whole = self
            .samples
            .front()
            .is_some_and(|sample| self.sent >= sample.len());
        if is_whole {
            self.samples.pop_front();
            self.sent = 0;
        }
        is_whole
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE_HZ: f64 = 60.0;
    const BYTES: usize = 100;

    fn sample(number: u8) -> Arc<[u8]> {
        [number; BYTES].into()
    }

    /// An inlet that takes `share` of a stream for a minute: the numbers of the samples that it got, in order.
    fn taken(share: f64) -> Vec<usize> {
        let (mut unsent, mut room, mut got) = (Unsent::default(), 0.0, Vec::new());
        for tick in 0..3600_usize {
            let mut bytes = vec![0; BYTES];
            bytes[..8].copy_from_slice(&tick.to_le_bytes());
            unsent.push(bytes.into(), RATE_HZ);
            room += share * BYTES as f64;
            while room >= 1.0 && !unsent.is_empty() {
                let next = unsent.next();
                let n = next.len().min(room as usize);
                let number = (next.len() == BYTES).then(|| next[..8].try_into().unwrap());
                got.extend(number.map(usize::from_le_bytes));
                unsent.sent(n);
                room -= n as f64;
            }
        }
        got
    }

    #[test]
    fn who_takes_nine_tenths_gets_nine_tenths_of_the_poses_and_few_gaps_of_a_second() {
        let got = taken(0.9);
        println!("{} of 3600 samples", got.len());
        assert!(got.len() > 3200, "{}", got.len());
        let gaps: Vec<usize> = got.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let wide: Vec<usize> = gaps.into_iter().filter(|gap| *gap != 1).collect();
        assert!(
            wide.len() <= 6 && wide.iter().all(|gap| *gap >= 60),
            "{wide:?}"
        );
    }

    #[test]
    fn who_takes_all_gets_all() {
        let got = taken(1.0);
        assert!(got.len() >= 3599 && got.windows(2).all(|pair| pair[1] == pair[0] + 1));
    }

    #[test]
    fn a_sample_that_was_begun_is_ended_whatever_is_given_up() {
        let mut unsent = Unsent::default();
        assert_eq!(unsent.push(sample(0), 2.0), 0);
        assert!(!unsent.sent(30));
        assert_eq!(
            (1..3).map(|it| unsent.push(sample(it), 2.0)).sum::<u64>(),
            0
        );
        assert_eq!(unsent.push(sample(3), 2.0), 2);
        assert_eq!(unsent.next(), [0; 70]);
        assert!(unsent.sent(70));
        assert_eq!(unsent.next(), [3; 100]);
        assert!(unsent.sent(100) && unsent.is_empty());
    }
}
