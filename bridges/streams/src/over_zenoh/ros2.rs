//! ROS 2 as in `rmw_zenoh`: CDR messages on its keys, an attachment each, liveliness tokens for its
//! graph.
//!
//! ```text
//! key         <domain>/<topic>/<type>/<type hash>
//! attachment  sequence i64, Unix time in nanoseconds i64, 16, gid of 16 bytes; little endian
//! node        @ros2_lv/<domain>/<session>/0/0/NN/%/%/<node>
//! publisher   @ros2_lv/<domain>/<session>/0/<entity>/MP/%/%/<node>/%<topic>/<type>/<hash>/<quality of service>
//! ```
//!
//! Source: <https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md>. Humble has no type
//! hashes: its keys end with `TypeHashNotSupported`, and messages are sent there too.

use zenoh::liveliness::LivelinessToken;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait as _};

use super::Publish;
use crate::frame::Frame;
use crate::ros::{MARKERS_TYPE, Stamp, TF_TYPE, marker_array, tf_message};
use crate::wall_clock::{WallClock, since_1970};

/// Default of `ROS_DOMAIN_ID`.
const DOMAIN: u32 = 0;
/// Name of the node.
const NODE: &str = "farfield";
/// Replaces the type hash in Humble.
const NO_HASH: &str = "TypeHashNotSupported";
/// Reliable, volatile, last ten: the defaults, so only the depth is given.
const QUALITY: &str = "::,10:,:,:,,";

pub(super) struct Publisher<'a> {
    transforms: Topic<'a>,
    markers: Topic<'a>,
    clock: WallClock,
    _node: LivelinessToken,
}

/// An open topic.
struct Topic<'a> {
    publishers: [zenoh::pubsub::Publisher<'a>; 2],
    gid: [u8; 16],
    sequence: i64,
    _token: LivelinessToken,
}

impl<'a> Publisher<'a> {
    pub(super) fn new(session: &'a Session) -> zenoh::Result<Self> {
        let node = format!("@ros2_lv/{DOMAIN}/{}/0/0/NN/%/%/{NODE}", session.zid());
        let token = session.liveliness().declare_token(node).wait()?;
        Ok(Self {
            transforms: Topic::new(session, 1, "tf", TF_TYPE)?,
            markers: Topic::new(session, 2, "farfield/markers", MARKERS_TYPE)?,
            clock: WallClock::default(),
            _node: token,
        })
    }
}

impl<'a> Topic<'a> {
    fn new(
        session: &'a Session,
        entity: u8,
        topic: &str,
        (kind, hash): (&str, &str),
    ) -> zenoh::Result<Self> {
        let publisher = |hash: &str| {
            session
                .declare_publisher(format!("{DOMAIN}/{topic}/{kind}/{hash}"))
                .congestion_control(CongestionControl::Drop)
                .express(true)
                .wait()
        };
        let zid = session.zid();
        let mangled = topic.replace('/', "%");
        let token = format!(
            "@ros2_lv/{DOMAIN}/{zid}/0/{entity}/MP/%/%/{NODE}/%{mangled}/{kind}/{hash}/{QUALITY}"
        );
        let mut gid = zid.to_le_bytes();
        // Derived from the session, and unique per publisher.
        gid[15] = gid[15].wrapping_add(entity);
        Ok(Self {
            publishers: [publisher(hash)?, publisher(NO_HASH)?],
            gid,
            sequence: 0,
            _token: session.liveliness().declare_token(token).wait()?,
        })
    }

    fn put(&mut self, message: &[u8], unix_ns: i64) -> zenoh::Result<()> {
        self.sequence += 1;
        for publisher in &self.publishers {
            let attachment = attachment(self.sequence, unix_ns, &self.gid);
            publisher.put(message).attachment(attachment).wait()?;
        }
        Ok(())
    }
}

fn attachment(sequence: i64, unix_ns: i64, gid: &[u8; 16]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(33);
    bytes.extend_from_slice(&sequence.to_le_bytes());
    bytes.extend_from_slice(&unix_ns.to_le_bytes());
    // Length of the gid.
    bytes.push(16);
    bytes.extend_from_slice(gid);
    bytes
}

impl Publish for Publisher<'_> {
    fn publish(&mut self, frame: &Frame) -> zenoh::Result<()> {
        let at = self.clock.stamp(frame.elapsed_s, since_1970());
        // Valid until 2038 and 2262.
        let stamp = Stamp {
            secs: i32::try_from(at.as_secs()).unwrap_or(i32::MAX),
            nanos: at.subsec_nanos(),
        };
        let unix_ns = i64::try_from(at.as_nanos()).unwrap_or(i64::MAX);
        self.transforms.put(&tf_message(frame, stamp), unix_ns)?;
        self.markers.put(&marker_array(frame, stamp), unix_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attachment_contains_the_length_of_its_gid() {
        let bytes = attachment(1, 2, &[7; 16]);
        assert_eq!(bytes.len(), 33);
        assert_eq!(bytes[..8], 1i64.to_le_bytes());
        assert_eq!(bytes[8..16], 2i64.to_le_bytes());
        assert_eq!(bytes[16..], [&[16][..], &[7; 16]].concat());
    }
}
