//! Clocks, delays and links of nodes that run live. In lock-step none of it is sent.
//!
//! Fusion learns round trip and clock offset of every edge from the box sets that it sends and the
//! patch sets that come back, as NTP does (RFC 5905, section 8): the sending of box set `sequence` is t1, its
//! arrival at the edge t2 = t3 - `held_us`, the sending of the patch set t3, its arrival t4.

use serde::{Deserialize, Serialize};

use crate::id::CameraIndex;
use crate::tick::Tick;

/// Largest correction of an edge's clock that is sent, applied or accepted, microseconds (half an hour, near what 32
/// bits hold): an edge whose clock is off by far less is refused already.
pub const MAX_CLOCK_CORRECTION_US: i32 = 1_800_000_000;
/// Most edges in a fusion node's status.
pub const MAX_EDGES: usize = 256;
/// Fewest ticks that an edge needs or fusion plans: every 64th. A power of two.
pub const MAX_NTH_TICK: u16 = 64;

/// In a patch set: when it was sent, and which box set the edge had received by then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PatchTiming {
    /// Sending instant by the edge's corrected clock, less the tick's time, microseconds.
    pub sent_after_us: i32,
    /// The correction of the edge's clock that is in force, microseconds: corrected = own + correction.
    pub clock_correction_us: i32,
    /// The newest box set that the edge has received in this session.
    pub echo: Option<BoxEcho>,
}

/// A box set that an edge has received.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoxEcho {
    /// Its [`LiveBoxes::sequence`].
    pub sequence: u32,
    /// How long ago it arrived, microseconds.
    pub held_us: u32,
}

/// In a box set: the clock of the venue, and what fusion receives from the edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LiveBoxes {
    /// Number of this box set among all that were sent to this viewpoint in this session.
    pub sequence: u32,
    /// Unix time of tick 0, microseconds.
    pub epoch_us: u64,
    /// What the edge is to add to its clock, microseconds; `None` while fusion does not know: the edge then keeps the
    /// correction of the session before.
    pub clock_correction_us: Option<i32>,
    /// The newest patch set that has arrived from the viewpoint.
    pub heard: Option<HeardPatches>,
    /// Edges work only on ticks that this divides, so that they share them; 0: fusion does not say. On the wire it stands at
    /// the end of the box set.
    #[serde(skip)]
    pub every_nth_tick: u16,
}

/// What fusion has received from an edge, by which the edge measures the load of its link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeardPatches {
    /// Tick of the newest patch set.
    pub tick: Tick,
    /// Its arrival by fusion's clock less its sending by the edge's corrected clock, microseconds. An offset of the
    /// clocks is constant in it; changes are queues.
    pub one_way_us: i32,
    /// Payload that has arrived from the viewpoint in the last second, bytes.
    pub bytes: u32,
}

/// In a status: how a node runs live.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LiveStatus {
    /// Unix time of tick 0, microseconds; `None` while the node does not know it.
    pub epoch_us: Option<u64>,
    /// An edge's correction of its clock in force, microseconds.
    pub clock_correction_us: i32,
    /// Compression level (0 lossless to 6 fewest bytes) at which an edge packs its patches.
    pub quality: u8,
    /// Persons that an edge sends at most per tick, of those that it has boxes for; `None`: all.
    pub persons_per_tick: Option<u16>,
    /// An edge processes only every n-th tick, n at least 1.
    pub every_nth_tick: u16,
    /// n, where an edge without a plan would process every n-th tick; 0: there are no people to work on, or it does not
    /// report this. On the wire it stands at the end of the status.
    #[serde(skip)]
    pub needed_nth_tick: u16,
    /// Payload that an edge has handed to the network in the last second, bytes.
    pub bytes_per_s: u32,
    /// Messages that an edge did not send because its budget was used up, since the start.
    pub held_back: u64,
    /// Ticks for which the node was too late, since the start.
    pub missed_ticks: u64,
    /// The state of the edge's cameras.
    pub cameras: Vec<CameraStatus>,
    /// The state of fusion's links to its edges, by viewpoint; empty for an edge.
    pub edges: Vec<EdgeLink>,
    /// Why fusion's recording has ended before the run, or why an edge's ring does not hold all of its
    /// sets, when that is so.
    pub recording_failure: Option<String>,
}

/// The state of one camera of an edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraStatus {
    /// Which.
    pub camera: CameraIndex,
    /// Its health.
    pub health: CameraHealth,
    /// Frames in the last second.
    pub frames_per_s: f32,
    /// Capture instants of its frames less their ticks' times, mean of the last second, microseconds.
    pub capture_offset_us: i32,
    /// Why it gives no pictures, in the words of whatever reads them; at most [`crate::wire::MAX_REASON_BYTES`].
    pub reason: Option<String>,
}

/// The health of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraHealth {
    /// It gives new pictures.
    Works,
    /// It gives the same picture over and over.
    Frozen,
    /// Its pictures are black.
    Black,
    /// It gives no pictures.
    Silent,
    /// It has failed, and is being opened again.
    Failed,
}

/// The state of fusion's link to one edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EdgeLink {
    /// The viewpoint's name.
    pub viewpoint: String,
    /// Whether it takes part: it sends, and is not refused.
    pub live: bool,
    /// Why it is refused, when it is.
    pub refused: Option<String>,
    /// Round trip of the network alone (without the time that the edge holds a message), least of the last seconds,
    /// microseconds.
    pub round_trip_us: Option<u32>,
    /// The edge's own clock less fusion's, before any correction, microseconds.
    pub clock_offset_us: Option<i32>,
    /// How far ahead its boxes are made, ticks.
    pub horizon_ticks: f32,
    /// Payload that has arrived in the last second, bytes.
    pub bytes_per_s: u32,
    /// Patch sets that came after their tick was processed, since the start.
    pub late: u64,
    /// Ticks of which nothing came, since the edge's first.
    pub missing: u64,
    /// Messages that could not be read, since the start.
    pub unreadable: u64,
}

impl EdgeLink {
    /// Notes that a second node, process number `process`, has the name of an edge that is connected already: the second
    /// is refused, and the first goes on.
    pub fn refuse_second(&mut self, process: u64) {
        let name = &self.viewpoint;
        self.refused = Some(format!(
            "a second node calls itself {name}: {}",
            refused_process(process)
        ));
    }

    /// Whether the node of the number `process` is refused as the second of its name.
    pub fn refuses_process(&self, process: u64) -> bool {
        let refused = self.refused.as_deref();
        refused.is_some_and(|text| text.ends_with(&refused_process(process)))
    }
}

fn refused_process(process: u64) -> String {
    format!("process {process} is refused")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_of_a_name_knows_that_it_is_meant() {
        let mut link = EdgeLink {
            viewpoint: "north".to_owned(),
            live: true,
            refused: None,
            round_trip_us: None,
            clock_offset_us: None,
            horizon_ticks: 1.0,
            bytes_per_s: 0,
            late: 0,
            missing: 0,
            unreadable: 0,
        };
        assert!(!link.refuses_process(17));
        link.refuse_second(17);
        assert!(link.refuses_process(17) && !link.refuses_process(7));
    }
}
