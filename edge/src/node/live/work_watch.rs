//! Detection of network calls that hang, so that a hanging edge does not report that it works.

use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::live::{Micros, SECOND_US};

/// A call is late if it takes this multiple of the expected time and this much longer,
/// microseconds.
const LATE_TIMES: Micros = 10;
const LATE_US: Micros = 2 * SECOND_US;
/// A call hangs if it is late by this, microseconds. The edge then ends, and its supervisor
/// restarts it.
const HANGS_US: Micros = 8 * SECOND_US;

/// The callers of networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Caller {
    /// Patches of people with boxes.
    Patches,
    /// The detector for people without boxes.
    Detector,
    /// Sightings of detected people.
    Sightings,
}

/// A running call.
#[derive(Debug, Clone, Copy)]
struct Call {
    begun_us: Micros,
    expected_us: Micros,
}

/// The running calls.
#[derive(Debug, Default)]
pub(super) struct WorkWatch {
    calls: Mutex<[Option<Call>; 3]>,
}

impl WorkWatch {
    /// Records the start of a call at `begun_us` with its expected duration.
    pub(super) fn begin(&self, caller: Caller, begun_us: Micros, expected_us: Micros) {
        self.lock()[caller as usize] = Some(Call {
            begun_us,
            expected_us,
        });
    }

    /// Records the end of a call.
    pub(super) fn end(&self, caller: Caller) {
        self.lock()[caller as usize] = None;
    }

    /// A message if a call is late at `now_us`, with a flag that it hangs.
    pub(super) fn late(&self, now_us: Micros) -> Option<(String, bool)> {
        let calls = self.lock();
        let late_us = |call: &Call| {
            let late_from_us = LATE_US + LATE_TIMES * call.expected_us;
            now_us - call.begun_us - late_from_us
        };
        let latest = calls.iter().flatten().max_by_key(|call| late_us(call))?;
        let seconds = (now_us - latest.begun_us) / SECOND_US;
        (late_us(latest) >= 0).then(|| {
            let words = format!("the network has not answered for {seconds} s");
            (words, late_us(latest) >= HANGS_US)
        })
    }

    fn lock(&self) -> MutexGuard<'_, [Option<Call>; 3]> {
        self.calls.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hanging_call_is_reported_and_then_ends_the_edge() {
        let watch = WorkWatch::default();
        watch.begin(Caller::Patches, 0, 100_000);
        watch.begin(Caller::Detector, 0, 5 * SECOND_US);
        assert_eq!(watch.late(2 * SECOND_US), None);
        let (words, hangs) = watch.late(4 * SECOND_US).unwrap();
        assert_eq!(
            (words.as_str(), hangs),
            ("the network has not answered for 4 s", false)
        );
        assert!(watch.late(11 * SECOND_US).unwrap().1);
        watch.end(Caller::Patches);
        assert_eq!(
            watch.late(11 * SECOND_US),
            None,
            "a slow network may take long"
        );
        watch.end(Caller::Detector);
        assert_eq!(watch.late(1_000 * SECOND_US), None);
    }
}
