//! The synthetic venue of the example, for tests.

#[path = "../../examples/synthetic_page/messages.rs"]
pub(crate) mod messages;
#[path = "../../examples/synthetic_page/people.rs"]
pub(crate) mod people;
#[path = "../../examples/synthetic_page/venue.rs"]
pub(crate) mod venue;

use std::sync::Arc;

use farfield_proto::tick::Tick;
use messages::Synthetic;

use super::known::context::Context;
use super::known::{Known, News};

/// Unix time of tick 0 in tests, microseconds.
pub(crate) const EPOCH_US: i64 = 1_767_225_600_000_000;

/// The synthetic venue with this many people.
pub(crate) fn synthetic(people: u32) -> Synthetic {
    Synthetic::new(venue::venue(), people, EPOCH_US)
}

/// Context of the synthetic venue.
pub(crate) fn context() -> Arc<Context> {
    Arc::new(Context::new(venue::venue(), venue::skeleton()))
}

/// Feeds all messages from tick `from` up to `to` (exclusive) that `pass` accepts.
pub(crate) fn feed(
    known: &mut Known,
    synthetic: &Synthetic,
    [from, to]: [i64; 2],
    pass: impl Fn(&str, i64) -> bool,
) -> Vec<News> {
    let context = context();
    let mut news = Vec::new();
    for tick in (from..to).map(Tick) {
        for (key, bytes, at_us) in synthetic.messages(tick) {
            if let Some(topic) = context.topic(&key).filter(|_| pass(&key, tick.0)) {
                news.push(known.take(topic, &bytes, at_us));
            }
        }
    }
    news
}
