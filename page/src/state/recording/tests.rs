//! A recording is gone to as the last minutes are.

use std::sync::Arc;
use std::thread::sleep;
use std::time::Duration;

use farfield_proto::tick::{Micros, Tick};

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
        actions: None,
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
