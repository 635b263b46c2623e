//! Playback position of a client. Pure: the time is an argument.

use std::time::Duration;

use farfield_proto::tick::Tick;

use crate::protocol::text::PlaybackState;

/// The playback position of one client.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cursor {
    motion: Motion,
    rate_hz: f64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Motion {
    Live,
    Paused(Tick),
    Playing {
        /// Position at the time `since`.
        from: Tick,
        since: Duration,
        speed: f64,
        repeat: Option<[Tick; 2]>,
    },
}

impl Cursor {
    /// Follows the newest tick; `rate_hz` is the venue's rate.
    pub fn live(rate_hz: f64) -> Self {
        Self {
            motion: Motion::Live,
            rate_hz,
        }
    }

    /// Whether it follows the newest tick.
    pub fn is_live(&self) -> bool {
        self.motion == Motion::Live
    }

    /// Whether it moves by itself.
    pub fn is_playing(&self) -> bool {
        matches!(self.motion, Motion::Playing { .. })
    }

    /// The playback state.
    pub fn state(&self) -> PlaybackState {
        match self.motion {
            Motion::Live => PlaybackState::Live,
            Motion::Paused(_) => PlaybackState::Paused,
            Motion::Playing { .. } => PlaybackState::Playing,
        }
    }

    /// Speed relative to real time; 1 while not playing.
    pub fn speed(&self) -> f64 {
        match self.motion {
            Motion::Playing { speed, .. } => speed,
            Motion::Live | Motion::Paused(_) => 1.0,
        }
    }

    /// The repeated range.
    pub fn repeat(&self) -> Option<[Tick; 2]> {
        match self.motion {
            Motion::Playing { repeat, .. } => repeat,
            Motion::Live | Motion::Paused(_) => None,
        }
    }

    /// Time between ticks while playing; otherwise `None`.
    pub fn period(&self) -> Option<Duration> {
        match self.motion {
            Motion::Playing { speed, .. } => {
                Duration::try_from_secs_f64(1.0 / (self.rate_hz * speed.abs())).ok()
            }
            Motion::Live | Motion::Paused(_) => None,
        }
    }

    /// Follows the newest tick.
    pub fn follow(&mut self) {
        self.motion = Motion::Live;
    }

    /// Stays at a tick.
    pub fn stay(&mut self, at: Tick) {
        self.motion = Motion::Paused(at);
    }

    /// Plays from a tick; `now` is any monotonic clock.
    pub fn play(&mut self, from: Tick, now: Duration, speed: f64, repeat: Option<[Tick; 2]>) {
        self.motion = Motion::Playing {
            from,
            since: now,
            speed,
            repeat,
        };
    }

    /// The current tick, limited to `first` to `last`; `None` while following the newest tick. On
    /// reaching the newest tick, playback follows it if `can_follow` is set, and otherwise stays at
    /// the end.
    pub fn due(
        &mut self,
        now: Duration,
        [first, last]: [Tick; 2],
        can_follow: bool,
    ) -> Option<Tick> {
        let (from, since, speed, repeat) = match self.motion {
            Motion::Live => return None,
            Motion::Paused(tick) => return Some(tick.clamp(first, last.max(first))),
            Motion::Playing {
                from,
                since,
                speed,
                repeat,
            } => (from, since, speed, repeat),
        };
        let gone = now.saturating_sub(since).as_secs_f64() * self.rate_hz * speed;
        let due = from + gone.floor() as i64;
        if let Some([begin, end]) = repeat {
            let [begin, end] = [
                begin.clamp(first, last.max(first)),
                end.clamp(first, last.max(first)),
            ];
            // A position outside the repeated range wraps into it.
            let length = (end - begin).saturating_add(1).max(1);
            let inside = (due - begin).rem_euclid(length);
            return Some(begin + inside);
        }
        if due >= last && speed > 0.0 {
            self.motion = if can_follow {
                Motion::Live
            } else {
                Motion::Paused(last)
            };
            return (!can_follow).then_some(last);
        }
        if due <= first && speed < 0.0 {
            self.motion = Motion::Paused(first);
            return Some(first);
        }
        Some(due.clamp(first, last.max(first)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const SPAN: [Tick; 2] = [Tick(100), Tick(400)];

    fn at(s: f64) -> Duration {
        Duration::from_secs_f64(s)
    }

    fn playing(from: i64, speed: f64, repeat: Option<[Tick; 2]>) -> Cursor {
        let mut cursor = Cursor::live(60.0);
        cursor.play(Tick(from), at(10.0), speed, repeat);
        cursor
    }

    #[test]
    fn play_goes_at_its_speed_both_ways() {
        assert_eq!(
            playing(200, 1.0, None).due(at(11.0), SPAN, true),
            Some(Tick(260))
        );
        assert_eq!(
            playing(200, 0.25, None).due(at(12.0), SPAN, true),
            Some(Tick(230))
        );
        assert_eq!(
            playing(200, -1.0, None).due(at(11.0), SPAN, true),
            Some(Tick(140))
        );
    }

    #[test]
    fn playing_to_the_end_follows_live_data_or_stops_in_a_recording() {
        let mut cursor = playing(390, 1.0, None);
        assert_eq!(cursor.due(at(11.0), SPAN, true), None);
        assert!(cursor.is_live());
        let mut cursor = playing(390, 1.0, None);
        assert_eq!(cursor.due(at(11.0), SPAN, false), Some(Tick(400)));
        assert_eq!(cursor.state(), PlaybackState::Paused);
    }

    #[test]
    fn playing_backwards_stops_at_the_beginning() {
        let mut cursor = playing(110, -8.0, None);
        assert_eq!(cursor.due(at(12.0), SPAN, true), Some(Tick(100)));
        assert_eq!(cursor.state(), PlaybackState::Paused);
    }

    #[test]
    fn a_loop_repeats_and_never_leaves_its_range() {
        let repeat = Some([Tick(200), Tick(209)]);
        let mut cursor = playing(200, 1.0, repeat);
        let ticks: Vec<i64> = (0..12)
            .map(|i| {
                cursor
                    .due(at(10.0 + (f64::from(i) + 0.5) / 60.0), SPAN, true)
                    .unwrap()
                    .0
            })
            .collect();
        assert_eq!(
            ticks,
            [200, 201, 202, 203, 204, 205, 206, 207, 208, 209, 200, 201]
        );
    }

    #[test]
    fn a_removed_tick_becomes_the_first_tick() {
        let mut cursor = Cursor::live(60.0);
        cursor.stay(Tick(5));
        assert_eq!(cursor.due(at(0.0), SPAN, true), Some(Tick(100)));
    }

    proptest! {
        #[test]
        fn the_current_tick_is_always_in_range(
            from: i64, speed in prop_oneof![-8.0..-0.01f64, 0.01..8.0], s in 0.0..1e6f64,
            repeat in prop::option::of(any::<[i64; 2]>()), can_follow: bool,
        ) {
            let repeat = repeat.map(|[a, b]| [Tick(a.min(b)), Tick(a.max(b))]);
            let mut cursor = playing(from, speed, repeat);
            if let Some(tick) = cursor.due(at(s), SPAN, can_follow) {
                prop_assert!((SPAN[0]..=SPAN[1]).contains(&tick));
            }
        }
    }
}
