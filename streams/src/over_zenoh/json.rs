//! Poses as JSON: the messages of the stream `websocket`, on one key.

use farfield_proto::key::is_key_chunk;
use zenoh::bytes::Encoding;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use super::Publish;
use crate::frame::Frame;
use crate::websocket::message;

/// The key of a venue's poses. Nodes' own keys begin with the venue's name: `farfield/` stands before these.
pub(super) fn key(venue: &str) -> String {
    // Names of venues are checked; who streams otherwise may have others.
    let venue = if is_key_chunk(venue) { venue } else { "venue" };
    format!("farfield/{venue}/poses")
}

pub(super) struct Publisher<'a>(zenoh::pubsub::Publisher<'a>);

impl<'a> Publisher<'a> {
    pub(super) fn new(session: &'a Session, venue: &str) -> zenoh::Result<Self> {
        let publisher = session
            .declare_publisher(key(venue))
            .encoding(Encoding::APPLICATION_JSON)
            .congestion_control(CongestionControl::Drop)
            .express(true)
            .wait();
        publisher.map(Self)
    }
}

impl Publish for Publisher<'_> {
    fn publish(&mut self, frame: &Frame) -> zenoh::Result<()> {
        self.0.put(message(frame)).wait()
    }
}
