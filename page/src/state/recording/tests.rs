//! Tests: seeking in a recording works like seeking in the last minutes.

use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use farfield_proto::message::PoseSet;
use farfield_proto::tick::{Micros, Tick};
use farfield_proto::wire;
use serde_json::Value;

use super::RecordedMessages;
use crate::state::HistoryBounds;
use crate::state::fixture::messages::SyntheticRecording;
use crate::state::fixture::{synthetic, venue};
use crate::state::known::frame::SharedFrame;
use crate::state::past::Lookup;
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
        Lookup::Frame(frame) => Some(frame),
        Lookup::Loading => None,
        Lookup::Nothing => panic!("nothing at {tick}"),
    })
}

#[test]
fn any_tick_can_be_sought_with_its_status() {
    let state = recording(SyntheticRecording::new(synthetic(2), 60 * 30), 64 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    assert_eq!(state.shared().past.span(), Some([Tick(0), Tick(1800)]));
    for tick in [1700, 3, 900, 901, 1799] {
        assert_eq!(at(&state, tick).tick, Tick(tick));
    }
    // The last edge is silent in seconds 12 to 18; its link fails at once.
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
fn unused_parts_are_removed_from_memory() {
    let state = recording(SyntheticRecording::new(synthetic(2), 60 * 40), 1 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    for tick in (0..2400).step_by(120) {
        at(&state, tick);
    }
    let crate::state::past::Past::Recording(recording) = &state.shared().past else {
        panic!("no recording");
    };
    let inner = crate::state::lock(&recording.inner);
    let total: usize = inner.loaded.values().map(|loaded| loaded.bytes).sum();
    let largest = inner
        .loaded
        .values()
        .map(|loaded| loaded.bytes)
        .max()
        .unwrap();
    assert!(total <= (1 << 20).max(largest), "{total}");
}

/// A file that ends in the middle.
struct Truncated(SyntheticRecording);

impl RecordedMessages for Truncated {
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
fn a_truncated_recording_is_shown_up_to_the_cut() {
    let state = recording(
        Truncated(SyntheticRecording::new(synthetic(1), 60 * 30)),
        64 << 20,
    );
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    let [first, last] = state.shared().past.span().unwrap();
    assert!(first == Tick(0) && (600..800).contains(&last.0), "{last}");
    assert_eq!(at(&state, 300).tick, Tick(300));
}

/// Fusion is restarted after this many seconds: another session with new ticks.
struct Restarted(SyntheticRecording, i64);

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
fn the_session_with_the_most_ticks_is_shown() {
    for (again_s, last) in [(10, 60 * 20), (21, 60 * 21 - 1)] {
        let state = recording(
            Restarted(SyntheticRecording::new(synthetic(1), 60 * 30), again_s),
            64 << 20,
        );
        wait(|| (!state.shared().past.is_loading()).then_some(()));
        let [first, end] = state.shared().past.span().unwrap();
        // Poses are sent a little after their tick.
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
fn alarm_start_times_do_not_depend_on_where_a_recording_is_entered() {
    let state = recording(SyntheticRecording::new(synthetic(1), 60 * 30), 64 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    // The last edge is reported silent from second 14; a part begins at second 16.
    at(&state, 60 * 17 + 50);
    let status = state.shared().past.status_at(Tick(60 * 17 + 50)).unwrap();
    let status: Value = serde_json::from_str(&status).unwrap();
    let alarms = status["alarms"].as_array().unwrap();
    let alarm = alarms
        .iter()
        .find(|alarm| alarm["key"] == "node/south-east");
    let since_us = alarm.unwrap()["since_us"].as_i64().unwrap();
    let since_s = (since_us - crate::state::fixture::EPOCH_US) as f64 / 1e6;
    assert!((13.9..15.9).contains(&since_s), "{since_s}");
}

#[test]
fn the_current_part_stays_in_memory() {
    let state = recording(SyntheticRecording::new(synthetic(2), 60 * 40), 1 << 20);
    wait(|| (!state.shared().past.is_loading()).then_some(()));
    let crate::state::past::Past::Recording(recording) = &state.shared().past else {
        panic!("no recording");
    };
    for tick in (0..2400).step_by(120) {
        at(&state, tick);
        // Its neighbours are loaded too.
        for _ in 0..5 {
            sleep(Duration::from_millis(20));
            assert!(
                matches!(recording.at(Tick(tick)), Lookup::Frame(_)),
                "{tick}"
            );
        }
        let inner = crate::state::lock(&recording.inner);
        let most = inner.loaded.values().map(|loaded| loaded.bytes).max();
        assert!(most <= Some((1 << 20) / 2), "{most:?}");
    }
}
