//! Streams of a run in the protocols of other programs.

use std::collections::BTreeMap;
use std::sync::Arc;

use farfield_fusion::node::{CopiedMessage, CopiedStep, Listeners, RunAtItsStart, Wiretap};
use farfield_proto::key::Keys;
use farfield_proto::message::PoseSet;
use farfield_proto::wire;
use farfield_streams::{StreamError, StreamSpec, Streams, VenueFacts};

/// Starts the streams of a run.
///
/// # Errors
/// The first whose address cannot be had.
pub(super) async fn listen(
    run: &RunAtItsStart<'_>,
    specs: &[StreamSpec],
    listeners: &mut Listeners,
) -> Result<(), StreamError> {
    let facts = VenueFacts {
        venue: run.venue.name.clone(),
        rate_hz: run.venue.rate_hz,
        names: BTreeMap::new(),
    };
    let streams = Streams::start(specs, facts).await?;
    for stream in streams.report() {
        let what = if stream.spec.kind.is_server() {
            "waits for clients at"
        } else {
            "goes to"
        };
        let open = if stream.spec.leaves_this_machine() {
            ": whoever can reach it sees where people are, it has no keys"
        } else {
            ""
        };
        let (name, address) = (stream.spec.kind.name(), stream.address);
        listeners
            .said
            .push(format!("stream {name} {what} {address}{open}"));
    }
    listeners.wiretaps.push(Arc::new(StreamTap {
        streams,
        pose_key: Keys::new(&run.venue.name).pose(),
    }));
    Ok(())
}

/// Gives the streams what fusion publishes of people.
struct StreamTap {
    streams: Streams,
    pose_key: String,
}

impl Wiretap for StreamTap {
    fn received(&self, _: CopiedMessage<'_>) {}

    fn published(&self, message: CopiedMessage<'_>) {
        // What fusion encoded a moment ago can be read again.
        if message.key == self.pose_key
            && let Ok(poses) = wire::decode::<PoseSet>(message.bytes)
        {
            self.streams.poses(poses);
        }
    }

    fn decided(&self, _: CopiedStep<'_>) {}
}
