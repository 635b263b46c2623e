//! A recording is gone to as the last minutes are.

use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use farfield_proto::message::PoseSet;
use farfield_proto::tick::{Micros, Tick};
use farfield_proto::wire;
use serde_json::Value;

use super::RecordedMessages;
use crate::state::HistoryBounds;
use crate::state::fixture::made_up::MadeUp;
use crate::state::fixture::{synthetic, venue};
use crate::state::known::frame::SharedFrame;
use crate::state::past::Found;
use crate::state::{PageOptions, PageState};

fn recording(messages: impl RecordedMessages + 'static, bytes: usize) -> Arc<PageState> {
    let options = PageOptions {
        history: HistoryBounds {
            bytes,
            seconds: 0.0,
        },
        ..PageOptions::default()
    };
    PageState::recording(
        venue::venue(),
        venue::skeleton(),
        Box::new(messages),
        options,
    )
    .unwrap()
}

fn wait<T>(mut what: impl FnMut() -> Option<T>) -> T {
    for _ in 0..3000 {
        if let Some(found) = what() {
            return found;
        }
        sleep(Duration::from_millis(10));
    }
    panic!("it never came");
}

fn at(state: &PageState, tick: i64) -> SharedFrame {
    wait(|| match state.shared().past.at(Tick(tick)) {
        Found::Frame(frame) => Some(frame),
        Found::Loading => None,
        Found::Nothing => panic!("nothing at {tick}"),
    })
}

#[test]
fn any_tick_is_gone_to_with_how_everything_was_then() {
    let state = recording(MadeUp::new(synthetic(2), 60 * 30), 64 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    assert_eq!(state.shared().past.span(), Some([Tick(0), Tick(1800)]));
    for tick in [1700, 3, 900, 901, 1799] {
        assert_eq!(at(&state, tick).tick, Tick(tick));
    }
    // Seconds 12 to 18 without the last edge; its link is red at once.
    at(&state, 60 * 14);
    let then = state.shared().past.status_at(Tick(60 * 14)).unwrap();
    assert!(then.contains("\"key\":\"link/south-east\""), "{then}");
    at(&state, 60 * 5);
    let before = state.shared().past.status_at(Tick(60 * 5)).unwrap();
    assert!(before.contains("\"alarms\":[]"), "{before}");
    let (events, _) = state.shared().events.after(0, 1000);
    assert!(events.iter().any(|event| event.change == "lose"));
}

#[test]
fn what_was_not_used_for_long_leaves_memory() {
    let state = recording(MadeUp::new(synthetic(2), 60 * 40), 1 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    for tick in (0..2400).step_by(120) {
        at(&state, tick);
    }
    let crate::state::past::Past::Recording(recording) = &state.shared().past else {
        panic!("no recording");
    };
    let inner = crate::state::lock(&recording.inner);
    let held: usize = inner.loaded.values().map(|loaded| loaded.bytes).sum();
    let largest = inner
        .loaded
        .values()
        .map(|loaded| loaded.bytes)
        .max()
        .unwrap();
    assert!(held <= (1 << 20).max(largest), "{held}");
}

/// A file that ends in the middle.
struct Torn(MadeUp);

impl RecordedMessages for Torn {
    fn span_us(&self) -> [Micros; 2] {
        self.0.span_us()
    }

    fn read(
        &mut self,
        from_us: Micros,
        to_us: Micros,
        visit: &mut dyn FnMut(&str, &[u8], Micros),
    ) -> Result<(), String> {
        let [begin_us, _] = self.0.span_us();
        if from_us > begin_us + 9_000_000 {
            return Err("the file ends in the middle of a chunk".to_owned());
        }
        self.0.read(from_us, to_us, visit)
    }
}

#[test]
fn what_is_before_a_tear_is_shown() {
    let state = recording(Torn(MadeUp::new(synthetic(1), 60 * 30)), 64 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    let [first, last] = state.shared().past.span().unwrap();
    assert!(first == Tick(0) && (600..800).contains(&last.0), "{last}");
    assert_eq!(at(&state, 300).tick, Tick(300));
}

/// Fusion that starts again after so many seconds: another session, whose ticks begin anew.
struct Restarted(MadeUp, i64);

impl RecordedMessages for Restarted {
    fn span_us(&self) -> [Micros; 2] {
        self.0.span_us()
    }

    fn read(
        &mut self,
        from_us: Micros,
        to_us: Micros,
        visit: &mut dyn FnMut(&str, &[u8], Micros),
    ) -> Result<(), String> {
        let seconds = self.1;
        let again_us = self.0.span_us()[0] + seconds * 1_000_000;
        self.0.read(from_us, to_us, &mut |key, bytes, at_us| {
            if at_us < again_us || !key.ends_with("/pose") {
                return visit(key, bytes, at_us);
            }
            let mut poses: PoseSet = wire::decode(bytes).unwrap();
            poses.session.0 += 1;
            poses.tick = Tick(poses.tick.0 - 60 * seconds);
            visit(key, &wire::encode(&poses), at_us);
        })
    }
}

#[test]
fn of_two_sessions_the_one_with_the_most_ticks_is_shown() {
    for (again_s, last) in [(10, 60 * 20), (21, 60 * 21 - 1)] {
        let state = recording(
            Restarted(MadeUp::new(synthetic(1), 60 * 30), again_s),
            64 << 20,
        );
        wait(|| (!state.shared().past.is_loading()).then_some(()));
        let [first, end] = state.shared().past.span().unwrap();
        // Poses pass a little after their tick.
        assert!(first.0 < 3 && (end.0 - last).abs() < 4, "{first} to {end}");
        let sessions: Vec<u32> = [5, 60 * 5, 60 * 9]
            .into_iter()
            .map(|tick| {
                let frame = at(&state, tick);
                assert_eq!(frame.tick, Tick(tick));
                frame.session
            })
            .collect();
        assert!(sessions.iter().all(|session| *session == sessions[0]));
        let range = state.shared().past.range([first, end], usize::MAX);
        assert!(range.windows(2).all(|pair| pair[0].tick < pair[1].tick));
    }
}

#[test]
fn an_alarm_is_on_since_it_began_wherever_a_recording_is_entered() {
    let state = recording(MadeUp::new(synthetic(1), 60 * 30), 64 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    // The last edge is missed from second 14 on; a part begins at 16.
    at(&state, 60 * 17 + 50);
    let status = state.shared().past.status_at(Tick(60 * 17 + 50)).unwrap();
    let status: Value = serde_json::from_str(&status).unwrap();
    let alarms = status["alarms"].as_array().unwrap();
    let missed = alarms
        .iter()
        .find(|alarm| alarm["key"] == "node/south-east");
    let since_us = missed.unwrap()["since_us"].as_i64().unwrap();
    let since_s = (since_us - crate::state::fixture::EPOCH_US) as f64 / 1e6;
    assert!((13.9..15.9).contains(&since_s), "{since_s}");
}

#[test]
fn the_part_that_is_shown_stays_in_memory() {
    let state = recording(MadeUp::new(synthetic(2), 60 * 40), 1 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    let crate::state::past::Past::Recording(recording) = &state.shared().past else {
        panic!("no recording");
    };
    for tick in (0..2400).step_by(120) {
        at(&state, tick);
        // Those beside it come, too.
        for _ in 0..5 {
            sleep(Duration::from_millis(20));
            assert!(
                matches!(recording.at(Tick(tick)), Found::Frame(_)),
                "{tick}"
            );
        }
        let inner = crate::state::lock(&recording.inner);
        let most = inner.loaded.values().map(|loaded| loaded.bytes).max();
        assert!(most <= Some((1 << 20) / 2), "{most:?}");
    }
}
