//! Where a client is in time. Pure: what time it is, is an argument.

use std::time::Duration;

use farfield_proto::tick::Tick;

use crate::protocol::text::PlaybackState;

/// The cursor of one client.
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
        /// Where it was at `since`.
        from: Tick,
        since: Duration,
        speed: f64,
        repeat: Option<[Tick; 2]>,
    },
}

impl Cursor {
    /// Follows what is new; ticks follow at `rate_hz`.
    pub fn live(rate_hz: f64) -> Self {
        Self {
            motion: Motion::Live,
            rate_hz,
        }
    }

    /// Whether it follows what is new.
    pub fn is_live(&self) -> bool {
        self.motion == Motion::Live
    }

    /// Whether it moves by itself.
    pub fn is_playing(&self) -> bool {
        matches!(self.motion, Motion::Playing { .. })
    }

    /// What it does.
    pub fn state(&self) -> PlaybackState {
        match self.motion {
            Motion::Live => PlaybackState::Live,
            Motion::Paused(_) => PlaybackState::Paused,
            Motion::Playing { .. } => PlaybackState::Playing,
        }
    }

    /// Times real time; 1 while it does not play.
    pub fn speed(&self) -> f64 {
        match self.motion {
            Motion::Playing { speed, .. } => speed,
            Motion::Live | Motion::Paused(_) => 1.0,
        }
    }

    /// What it repeats.
    pub fn repeat(&self) -> Option<[Tick; 2]> {
        match self.motion {
            Motion::Playing { repeat, .. } => repeat,
            Motion::Live | Motion::Paused(_) => None,
        }
    }

    /// From one tick to the next as it plays; `None` while it does not.
    pub fn period(&self) -> Option<Duration> {
        match self.motion {
            Motion::Playing { speed, .. } => {
                Duration::try_from_secs_f64(1.0 / (self.rate_hz * speed.abs())).ok()
            }
            Motion::Live | Motion::Paused(_) => None,
        }
    }

    /// Follows what is new.
    pub fn follow(&mut self) {
        self.motion = Motion::Live;
    }

    /// Stays at a tick.
    pub fn stay(&mut self, at: Tick) {
        self.motion = Motion::Paused(at);
    }

    /// Plays from a tick; `now` is any clock that goes on.
    pub fn play(&mut self, from: Tick, now: Duration, speed: f64, repeat: Option<[Tick; 2]>) {
        self.motion = Motion::Playing {
            from,
            since: now,
            speed,
            repeat,
        };
    }

    /// The tick that is due, of those from `first` to `last`; `None` while it follows what is new. `can_follow`: whoever
    /// plays into the newest tick follows from there on; else it stays at the end.
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
            // From outside of what is repeated it comes in at the near end.
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
    fn who_plays_into_the_newest_tick_follows_and_a_recording_stays_at_its_end() {
        let mut cursor = playing(390, 1.0, None);
        assert_eq!(cursor.due(at(11.0), SPAN, true), None);
        assert!(cursor.is_live());
        let mut cursor = playing(390, 1.0, None);
        assert_eq!(cursor.due(at(11.0), SPAN, false), Some(Tick(400)));
        assert_eq!(cursor.state(), PlaybackState::Paused);
    }

    #[test]
    fn backwards_it_stays_at_the_beginning() {
        let mut cursor = playing(110, -8.0, None);
        assert_eq!(cursor.due(at(12.0), SPAN, true), Some(Tick(100)));
        assert_eq!(cursor.state(), PlaybackState::Paused);
    }

    #[test]
    fn a_loop_goes_round_and_never_out() {
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
    fn who_stays_at_a_tick_that_is_forgotten_is_at_the_first() {
        let mut cursor = Cursor::live(60.0);
        cursor.stay(Tick(5));
        assert_eq!(cursor.due(at(0.0), SPAN, true), Some(Tick(100)));
    }

    proptest! {
        #[test]
        fn what_is_due_is_there(
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
