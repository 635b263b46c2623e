//! Clocks, delays and links of nodes that run live. In lock-step none of this is sent.
//!
//! Fusion learns round trip and clock offset of every edge from its box sets and the returning
//! patch sets, as in NTP (RFC 5905, section 8). t1 is the sending of box set `sequence`, t2 = t3 -
//! `held_us` its arrival at the edge, t3 the sending of the patch set, and t4 its arrival.

use serde::{Deserialize, Serialize};

use crate::id::CameraIndex;
use crate::tick::Tick;

/// Largest correction of an edge's clock that is sent, applied or accepted, microseconds (half an
/// hour, near the range of 32 bits). An edge is refused at far smaller offsets.
pub const MAX_CLOCK_CORRECTION_US: i32 = 1_800_000_000;
/// Most edges in a fusion node's status.
pub const MAX_EDGES: usize = 256;
/// Largest thinning of ticks: every 64th. A power of two.
pub const MAX_NTH_TICK: u16 = 64;

/// In a patch set: its sending time, and the box set that the edge had received by then.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PatchTiming {
    /// Sending time by the edge's corrected clock, minus the time of the tick, microseconds.
    pub sent_after_us: i32,
    /// The current correction of the edge's clock, microseconds: corrected = own + correction.
    pub clock_correction_us: i32,
    /// The newest box set that the edge has received in this session.
    pub echo: Option<BoxEcho>,
}

/// A box set that an edge has received.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoxEcho {
    /// Its [`LiveBoxes::sequence`].
    pub sequence: u32,
    /// Time since its arrival, microseconds.
    pub held_us: u32,
}

/// In a box set: the clock of the venue, and fusion's view of the edge's link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct LiveBoxes {
    /// Sequence number of this box set for this viewpoint and session.
    pub sequence: u32,
    /// Unix time of tick 0, microseconds.
    pub epoch_us: u64,
    /// Correction for the edge's clock, microseconds. `None` while fusion does not know it: the
    /// edge then keeps the correction of the previous session.
    pub clock_correction_us: Option<i32>,
    /// The newest patch set from the viewpoint.
    pub heard: Option<HeardPatches>,
    /// Edges process only ticks that are multiples of this number, so that all process the same
    /// ones; 0: no plan. On the wire it is at the end of the box set.
    #[serde(skip)]
    pub every_nth_tick: u16,
}

/// Fusion's receipts from an edge, from which the edge estimates the load of its link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct HeardPatches {
    /// Tick of the newest patch set.
    pub tick: Tick,
    /// Its arrival by fusion's clock minus its sending by the edge's corrected clock, microseconds.
    /// A clock offset is a constant part of it; changes are queues.
    pub one_way_us: i32,
    /// Payload received from the viewpoint in the last second, bytes.
    pub bytes: u32,
}

/// In a status: the live state of a node.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct LiveStatus {
    /// Unix time of tick 0, microseconds; `None` while unknown.
    pub epoch_us: Option<u64>,
    /// An edge's current clock correction, microseconds.
    pub clock_correction_us: i32,
    /// Compression level (0 lossless to 6 smallest) of an edge's patches.
    pub quality: u8,
    /// Most people per tick that an edge sends, of those with boxes; `None`: all.
    pub persons_per_tick: Option<u16>,
    /// An edge processes only every n-th tick, n at least 1.
    pub every_nth_tick: u16,
    /// n, if an edge without a plan would process every n-th tick; 0: without people, or not
    /// reported. On the wire it is at the end of the status.
    #[serde(skip)]
    pub needed_nth_tick: u16,
    /// Payload that an edge has sent in the last second, bytes.
    pub bytes_per_s: u32,
    /// Messages that an edge did not send because its budget was used up, since the start.
    pub held_back: u64,
    /// Ticks for which the node was too late, since the start.
    pub missed_ticks: u64,
    /// The state of the edge's cameras.
    pub cameras: Vec<CameraStatus>,
    /// The state of fusion's links to its edges, by viewpoint; empty for an edge.
    pub edges: Vec<EdgeLink>,
    /// Why fusion's recording ended before the run, or why an edge's ring is incomplete.
    pub recording_failure: Option<String>,
}

/// The state of one camera of an edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraStatus {
    /// The camera.
    pub camera: CameraIndex,
    /// Its health.
    pub health: CameraHealth,
    /// Frames in the last second.
    pub frames_per_s: f32,
    /// Capture times of its frames minus the times of their ticks, mean of the last second,
    /// microseconds.
    pub capture_offset_us: i32,
    /// The source's error when there are no pictures; at most [`crate::wire::MAX_REASON_BYTES`].
    pub reason: Option<String>,
}

/// The health of a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CameraHealth {
    /// New pictures arrive.
    Works,
    /// The same picture is repeated.
    Frozen,
    /// Its pictures are black.
    Black,
    /// No pictures arrive.
    Silent,
    /// It has failed and is being reopened.
    Failed,
}

/// The state of fusion's link to one edge.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EdgeLink {
    /// The viewpoint's name.
    pub viewpoint: String,
    /// Whether it takes part: it sends and is not refused.
    pub live: bool,
    /// Why it is refused, if it is.
    pub refused: Option<String>,
    /// Round trip of the network alone (without the time at the edge), minimum of the last seconds,
    /// microseconds.
    pub round_trip_us: Option<u32>,
    /// The edge's own clock minus fusion's, without corrections, microseconds.
    pub clock_offset_us: Option<i32>,
    /// Prediction horizon of its boxes, ticks.
    pub horizon_ticks: f32,
    /// Payload received in the last second, bytes.
    pub bytes_per_s: u32,
    /// Patch sets that arrived after their tick was processed, since the start.
    pub late: u64,
    /// Ticks without any set, since the edge's first.
    pub missing: u64,
    /// Messages that could not be read, since the start.
    pub unreadable: u64,
}

impl EdgeLink {
    /// Refuses a second node, with process number `process`, that has the name of a connected edge.
    /// The first one continues.
    pub fn refuse_second(&mut self, process: u64) {
        let name = &self.viewpoint;
        self.refused = Some(format!(
            "a second node has the name {name}: {}",
            refused_process(process)
        ));
    }

    /// Whether the node with number `process` is refused as the second of its name.
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
    fn a_second_node_of_a_name_recognises_its_refusal() {
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
