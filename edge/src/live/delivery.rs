//! Capture times from the time stamps of a driver or stream, whose clock is independent of this
//! machine's.
//!
//! ```text
//!   captured = stamp + min over the last minute of (arrival - stamp)
//! ```
//!
//! Delays beyond the quickest delivery are jitter and cancel out. The stamps must come from a real
//! clock, but some streams only count frames at a fixed rate. Stamps are therefore used only while
//! they advance as fast as time.
//!
//! A stamp is wrong if no delivery explains it: the picture would have arrived before its capture
//! or before the previous picture. Its arrival time is used instead. If such stamps agree for a
//! while, the clock was set, and the estimate restarts.

use super::{Micros, SECOND_US};

/// Memory of the quickest delivery, microseconds, in two halves. Clocks that differ by 100 ppm
/// drift by 6 ms in this time.
const DELIVERY_US: Micros = 60 * SECOND_US;
/// Intervals over which stamps and arrivals are compared, microseconds. Streams far from a real
/// clock are recognised soon, those a few hundredths off in half a minute.
const COMPARE_US: Micros = 2 * SECOND_US;
const COMPARE_LONG_US: Micros = 10 * SECOND_US;
/// Largest difference between the two, as a share of the interval and in microseconds. Deliveries
/// of one network do not differ by 0.1 s for long.
const APART_SHARE: f64 = 0.02;
const APART_LONG_SHARE: f64 = 0.002;
const APART_US: Micros = 100_000;
/// If all deliveries of a memory half exceed the quickest one by more, microseconds, the quickest
/// belongs to another clock or path.
const SHIFT_US: Micros = 10_000;

/// Unexplained stamps mean a clock step if this many in a row agree to [`APART_US`] for this time,
/// microseconds. Pictures that a network held up come in a burst, and their stamps do not advance
/// like time.
const MIN_AFTER_STEP: u32 = 5;
const STEP_LASTS_US: Micros = 200_000;

/// The deliveries of one camera.
#[derive(Debug, Clone, Default)]
pub struct Delivery {
    /// Least difference of arrival and stamp, in the current and the previous half of
    /// [`DELIVERY_US`].
    quickest_us: [Option<Micros>; 2],
    turned_at_us: Option<Micros>,
    /// Start of the short comparison: stamp and arrival, and the least difference since.
    since: Option<Since>,
    short: Comparison,
    /// Stamp and arrival at the start of the long comparison.
    since_long: Option<[Micros; 2]>,
    long: Comparison,
    /// The last explained stamp.
    last_stamp_us: Option<Micros>,
    unexplained: Option<Unexplained>,
    /// Step of the stamps' clock, until taken.
    step_us: Option<Micros>,
}

/// Consecutive unexplained stamps that agree: their number, the difference and the arrival of the
/// first, and the least difference since.
#[derive(Debug, Clone, Copy)]
struct Unexplained {
    count: u32,
    took_us: Micros,
    from_us: Micros,
    least_us: Micros,
}

/// State of a comparison of stamps and arrivals.
#[derive(Debug, Clone, Copy, Default)]
struct Comparison {
    /// Whether the stamps were ahead (1) or behind (-1).
    apart: i64,
    is_distrusted: bool,
}

impl Comparison {
    /// Adds the advance of the stamps and of this machine's clock.
    fn take(&mut self, stamped_us: Micros, span_us: Micros, share: f64) {
        let apart_us = stamped_us.saturating_sub(span_us);
        let most_us = APART_US + (share * span_us as f64) as Micros;
        // One such difference is a jump, or a network that held up all messages. Two in the same
        // direction mean that the rates differ.
        let apart = if apart_us.saturating_abs() > most_us {
            apart_us.signum()
        } else {
            0
        };
        self.is_distrusted = apart != 0 && (apart == self.apart || self.is_distrusted);
        self.apart = apart;
    }
}

#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "all are times")]
struct Since {
    stamp_us: Micros,
    now_us: Micros,
    least_us: Micros,
}

impl Delivery {
    /// Capture time by this machine's clock, plus the delay of the quickest delivery; `now_us` if
    /// the stamp is unusable.
    pub fn captured_us(&mut self, stamp_us: Micros, now_us: Micros) -> Micros {
        let took_us = now_us.saturating_sub(stamp_us);
        if !self.is_explained(stamp_us, took_us) && !self.is_set(took_us, now_us) {
            return now_us;
        }
        self.unexplained = None;
        self.last_stamp_us = Some(stamp_us);
        self.compare(stamp_us, now_us, took_us);
        if self.is_distrusted() {
            return now_us;
        }
        let turned_at_us = *self.turned_at_us.get_or_insert(now_us);
        if now_us - turned_at_us > DELIVERY_US / 2 {
            self.quickest_us = [None, self.quickest_us[0]];
            self.turned_at_us = Some(now_us);
        }
        let newest_us = self.quickest_us[0].map_or(took_us, |least| least.min(took_us));
        self.quickest_us[0] = Some(newest_us);
        let quickest_us = self.quickest_us[1].map_or(newest_us, |least| least.min(newest_us));
        stamp_us.saturating_add(quickest_us)
    }

    /// Step of the stamps' clock since the last call, microseconds, if any.
    pub fn take_step_us(&mut self) -> Option<Micros> {
        self.step_us.take()
    }

    /// The quickest delivery of the last minute.
    fn quickest_of_all_us(&self) -> Option<Micros> {
        self.quickest_us.iter().flatten().min().copied()
    }

    /// Whether pictures in order can have this stamp.
    fn is_explained(&self, stamp_us: Micros, took_us: Micros) -> bool {
        let is_ahead = |quickest_us: Micros| took_us < quickest_us.saturating_sub(APART_US);
        let is_back = |last_us: Micros| stamp_us < last_us.saturating_sub(APART_US);
        !self.quickest_of_all_us().is_some_and(is_ahead) && !self.last_stamp_us.is_some_and(is_back)
    }

    /// Counts an unexplained stamp; returns whether the clock was set. Then the estimate restarts.
    fn is_set(&mut self, took_us: Micros, now_us: Micros) -> bool {
        let first = Unexplained {
            count: 0,
            took_us,
            from_us: now_us,
            least_us: took_us,
        };
        let agrees = |it: &Unexplained| took_us.abs_diff(it.took_us) <= APART_US.unsigned_abs();
        let mut row = self.unexplained.filter(agrees).unwrap_or(first);
        row.count += 1;
        row.least_us = row.least_us.min(took_us);
        let is_set = row.count >= MIN_AFTER_STEP && now_us - row.from_us >= STEP_LASTS_US;
        self.unexplained = Some(row);
        if is_set {
            self.step_us = self
                .quickest_of_all_us()
                .map(|it| it.saturating_sub(row.least_us));
            self.quickest_us = [Some(row.least_us), None];
            (self.turned_at_us, self.since, self.since_long) = (None, None, None);
        }
        is_set
    }

    /// Whether `stamp_us`, the newest stamp, is explained.
    pub fn explains(&self, stamp_us: Micros) -> bool {
        self.last_stamp_us == Some(stamp_us)
    }

    /// Whether the stamps do not advance like time.
    pub fn is_distrusted(&self) -> bool {
        self.short.is_distrusted || self.long.is_distrusted
    }

    fn compare(&mut self, stamp_us: Micros, now_us: Micros, took_us: Micros) {
        let begins = Since {
            stamp_us,
            now_us,
            least_us: took_us,
        };
        let since = self.since.get_or_insert(begins);
        since.least_us = since.least_us.min(took_us);
        // After a pause of the stream it is longer.
        let span_us = now_us - since.now_us;
        if span_us < COMPARE_US {
            return;
        }
        let Since {
            stamp_us: from_stamp_us,
            now_us: from_us,
            least_us,
        } = *since;
        self.since = Some(begins);
        let was_distrusted = self.is_distrusted();
        let stamped_us = stamp_us.saturating_sub(from_stamp_us);
        self.short.take(stamped_us, span_us, APART_SHARE);
        let [long_stamp_us, long_us] = *self.since_long.get_or_insert([from_stamp_us, from_us]);
        if now_us - long_us >= COMPARE_LONG_US {
            let stamped_us = stamp_us.saturating_sub(long_stamp_us);
            self.long
                .take(stamped_us, now_us - long_us, APART_LONG_SHARE);
            self.since_long = Some([stamp_us, now_us]);
        }
        let is_distrusted = self.is_distrusted();
        let kept_us = self.quickest_of_all_us();
        let is_shifted = kept_us.is_some_and(|kept_us| least_us.saturating_sub(kept_us) > SHIFT_US);
        if is_distrusted || was_distrusted || is_shifted {
            self.quickest_us = [(!is_distrusted).then_some(least_us), None];
            self.turned_at_us = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Captures of a camera of 50 Hz, in microseconds of the own clock.
    fn captures(seconds: i64) -> impl Iterator<Item = Micros> {
        (0..seconds * 50).map(|n| 1_000_000 + n * 20_000)
    }

    /// Deterministic delays of 0 to 40 ms.
    fn jitter(n: Micros) -> Micros {
        (n / 20_000 * 7_919) % 40_000
    }

    #[test]
    fn jitter_is_removed_from_the_times() {
        let mut delivery = Delivery::default();
        let mut errors = Vec::new();
        for captured_us in captures(20) {
            // The camera's clock has another origin and is 100 ppm fast.
            let stamp_us = (captured_us as f64 * 1.0001) as Micros - 777_777;
            let now_us = captured_us + 30_000 + jitter(captured_us);
            errors.push(delivery.captured_us(stamp_us, now_us) - captured_us - 30_000);
        }
        let worst = errors[200..].iter().map(|us| us.abs()).max();
        assert!(worst < Some(5_000), "{worst:?}");
    }

    #[test]
    fn a_stream_that_only_counts_frames_uses_arrival_times() {
        // 20 frames per second whose stamps count 25.
        let mut delivery = Delivery::default();
        let mut errors = Vec::new();
        for n in 0..400 {
            let now_us = 1_000_000 + n * 50_000;
            errors.push(delivery.captured_us(n * 40_000, now_us) - now_us);
        }
        assert!(delivery.is_distrusted());
        assert!(errors[100..].iter().all(|&us| us == 0), "{errors:?}");
    }

    /// Symptom to prevent: streams 2 to 7 % off were accepted, and their pictures placed up to 158
    /// ms early, in a sawtooth.
    #[test]
    fn a_count_at_almost_the_right_rate_is_detected_within_30_s() {
        for (rate_hz, stamped_hz) in [(24.0, 25.0), (28.5, 30.0), (49.0, 50.0), (30.0, 29.0)] {
            let mut delivery = Delivery::default();
            for n in 0..(120.0 * rate_hz) as i64 {
                let at_us = |hz: f64| (n as f64 / hz * 1e6) as Micros;
                let now_us = 1_000_000 + at_us(rate_hz) + jitter(20_000 * n) / 4;
                let captured_us = delivery.captured_us(at_us(stamped_hz), now_us);
                if at_us(rate_hz) > 30 * SECOND_US {
                    assert!(delivery.is_distrusted(), "{rate_hz} as {stamped_hz}: {n}");
                    assert_eq!(captured_us, now_us, "{rate_hz} as {stamped_hz}: {n}");
                }
            }
        }
    }

    #[test]
    fn a_repaired_stream_is_trusted_again() {
        let mut delivery = Delivery::default();
        let mut stamp_us = 0;
        for captured_us in captures(120) {
            // 50 pictures per second whose stamps count 52, until the camera restarts.
            let step_us = if captured_us < 60_000_000 {
                19_231
            } else {
                20_000
            };
            stamp_us += step_us;
            let now_us = captured_us + jitter(captured_us);
            let error_us = delivery.captured_us(stamp_us, now_us) - captured_us;
            let (at_s, trusts) = (captured_us / SECOND_US, !delivery.is_distrusted());
            match at_s {
                30..60 => assert!(!trusts, "{at_s}"),
                85.. => assert!(trusts && error_us.abs() < 5_000, "{at_s}: {error_us}"),
                _ => {}
            }
        }
    }

    #[test]
    fn a_rate_error_of_a_thousandth_costs_only_milliseconds() {
        let mut delivery = Delivery::default();
        for captured_us in captures(120) {
            let stamp_us = (captured_us as f64 * 0.999) as Micros;
            let error_us = delivery.captured_us(stamp_us, captured_us) - captured_us;
            assert!(
                error_us.abs() <= SHIFT_US + 4_000,
                "{error_us} at {captured_us}"
            );
        }
        assert!(!delivery.is_distrusted());
    }

    #[test]
    fn a_network_stall_of_one_second_moves_no_frame() {
        let mut delivery = Delivery::default();
        for captured_us in captures(20) {
            let held_up = (8_000_000..9_000_000).contains(&captured_us);
            let now_us = if held_up { 9_000_000 } else { captured_us };
            assert_eq!(delivery.captured_us(captured_us + 5, now_us), captured_us);
        }
    }

    #[test]
    fn a_clock_jump_is_followed_within_seconds() {
        for jump_us in [-500_000, 500_000] {
            let mut delivery = Delivery::default();
            let mut late = Vec::new();
            for captured_us in captures(20) {
                let jumped_us = if captured_us > 8_000_000 { jump_us } else { 0 };
                let now_us = captured_us + jitter(captured_us);
                let error_us = delivery.captured_us(captured_us + jumped_us, now_us) - captured_us;
                if captured_us > 13_000_000 {
                    late.push(error_us);
                }
            }
            assert!(
                late.iter().all(|us| us.abs() < 5_000),
                "{jump_us}: {late:?}"
            );
        }
    }

    /// Errors of the captures and reported steps, for a camera whose stamps are `wrong_us` off.
    fn placed(wrong_us: impl Fn(usize) -> Micros) -> (Vec<Micros>, Vec<Micros>) {
        let mut delivery = Delivery::default();
        let (mut errors, mut steps) = (Vec::new(), Vec::new());
        for (n, captured_us) in captures(20).enumerate() {
            let now_us = captured_us + jitter(captured_us);
            let stamp_us = captured_us + wrong_us(n);
            errors.push(delivery.captured_us(stamp_us, now_us) - captured_us);
            steps.extend(delivery.take_step_us());
        }
        assert!(!delivery.is_distrusted());
        (errors, steps)
    }

    #[test]
    fn one_stamp_hours_off_costs_at_most_one_picture() {
        const HOURS_US: Micros = 3 * 3600 * SECOND_US;
        for wrong_us in [HOURS_US, -HOURS_US, i64::MAX / 2, i64::MIN / 2, 500_000] {
            // At each position between two comparisons.
            for at in 300..420 {
                let (errors, steps) = placed(|n| if n == at { wrong_us } else { 0 });
                let worst = errors[100..].iter().map(|us| us.abs()).max();
                assert!(worst <= Some(40_000), "{wrong_us} at {at}: {worst:?}");
                let off = errors[100..].iter().filter(|us| us.abs() > 5_000).count();
                assert!(off <= 1 && steps.is_empty(), "{wrong_us} at {at}: {off}");
            }
        }
    }

    #[test]
    fn a_clock_step_restarts_the_estimate_and_is_reported_once() {
        for step_us in [10, -10, 3 * 3600, -3 * 3600].map(|s| s * SECOND_US) {
            let (errors, steps) = placed(|n| if n >= 400 { step_us } else { 0 });
            let [reported_us] = steps[..] else {
                panic!("{step_us}: {steps:?}")
            };
            assert!((reported_us - step_us).abs() < 50_000, "{reported_us}");
            // Until then the arrival time is used.
            assert!(errors[100..].iter().all(|us| us.abs() <= 40_000));
            assert!(errors[450..].iter().all(|us| us.abs() < 5_000));
        }
    }

    #[test]
    fn a_wrong_first_stamp_and_repeated_stamps_do_no_harm() {
        let (errors, _) = placed(|n| if n == 0 { 3600 * SECOND_US } else { 0 });
        assert!(errors[50..].iter().all(|us| us.abs() < 5_000));
        // Every tenth stamp repeats the previous one.
        let (errors, steps) = placed(|n| if n % 10 == 9 { -20_000 } else { 0 });
        assert!(errors[100..].iter().all(|us| us.abs() <= 25_000));
        assert!(steps.is_empty());
    }

    #[test]
    fn long_delayed_pictures_keep_their_capture_times() {
        let mut delivery = Delivery::default();
        for (n, captured_us) in (0..).zip(captures(40)) {
            // They arrive within a fifth of a second then.
            let held_until_us = 30_000_000 + 200 * Micros::max(n - 400, 0);
            let is_held = (9_000_000..30_000_000).contains(&captured_us);
            let now_us = if is_held {
                held_until_us
            } else {
                captured_us + 300_000
            };
            let placed_us = delivery.captured_us(captured_us, now_us.max(captured_us));
            assert!(delivery.take_step_us().is_none(), "{captured_us}");
            if captured_us < 29_000_000 {
                let error_us = placed_us - captured_us - 300_000;
                assert!(error_us.abs() < 5_000, "{captured_us}: {error_us}");
            }
        }
    }

    proptest! {
        #[test]
        fn no_frame_is_captured_after_it_came(
            frames in prop::collection::vec((-1_000_000i64..1_000_000, 0i64..100_000), 1..300),
        ) {
            let mut delivery = Delivery::default();
            let (mut stamp_us, mut now_us) = (0i64, 0i64);
            for (stamped_us, came_us) in frames {
                stamp_us += stamped_us;
                now_us += came_us;
                prop_assert!(delivery.captured_us(stamp_us, now_us) <= now_us);
            }
        }
    }
}
