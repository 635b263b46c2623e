//! PosiStageNet, version 2: positions and velocities of people over UDP; one tracker per person,
//! its pelvis.
//!
//! Source: *PosiStageNet Protocol description v2.03*, VYV and MA Lighting 2019,
//! <https://posistage.net>. It is in the public domain.
//!
//! Its axes are x right, y up, z depth; with the world's x as depth this is (-y, z, x) of the
//! world, metres. A tracker's id is the person's id modulo 65,536. Validity is 1 for a seen person
//! and 0 for a predicted one. Names are sent once per second, and when people come or leave. Frames
//! that exceed 1,500 bytes are split into several packets.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;

use farfield_export::axes::{Axes, Preset};
use farfield_proto::id::PersonId;
use farfield_proto::message::PersonState;
use nalgebra::Vector3;
use socket2::{Domain, Protocol, Socket, Type};
use tokio::net::UdpSocket;

use crate::frame::{Frame, PersonFrame};
use crate::server::{any_address, send_all};
use crate::slot::Shell;

const INFO_PACKET: u16 = 0x6756;
const DATA_PACKET: u16 = 0x6755;
/// Protocol version.
const VERSION: [u8; 2] = [2, 3];
/// Flag in a chunk's header: it contains chunks.
const HAS_CHUNKS: u16 = 0x8000;
/// Maximum size of a packet's tracker list, bytes; with headers and addresses the packet is below
/// 1,500.
const MAX_LIST: usize = 1200;
/// Maximum size of a name, bytes.
const MAX_NAME: usize = 200;
/// Maximum number of hops: the venue's network and one router.
const TTL: u32 = 2;

/// Packets with the positions of people; `frame_id` identifies the frame.
pub fn data_packets(frame: &Frame, frame_id: u8) -> Vec<Vec<u8>> {
    let trackers = frame.confirmed().map(|person| tracker(frame, person));
    packets(DATA_PACKET, frame, frame_id, 0x0001, &[], trackers)
}

/// Packets with the names of people.
pub fn info_packets(frame: &Frame, frame_id: u8) -> Vec<Vec<u8>> {
    let trackers = frame.confirmed().map(|person| {
        let name = chunk(0x0000, 0, cut(&person.name).as_bytes());
        chunk(tracker_id(person.id), HAS_CHUNKS, &name)
    });
    let system = chunk(0x0001, 0, cut(&frame.venue).as_bytes());
    packets(INFO_PACKET, frame, frame_id, 0x0002, &system, trackers)
}

fn packets(
    kind: u16,
    frame: &Frame,
    frame_id: u8,
    list: u16,
    before: &[u8],
    trackers: impl Iterator<Item = Vec<u8>>,
) -> Vec<Vec<u8>> {
    let mut lists = vec![Vec::new()];
    for tracker in trackers {
        match lists.last_mut() {
            Some(last) if last.len() + tracker.len() <= MAX_LIST => {
                last.extend_from_slice(&tracker);
            }
            _ => lists.push(tracker),
        }
    }
    let n = u8::try_from(lists.len()).unwrap_or(u8::MAX);
    let packet = |trackers: &Vec<u8>| {
        let mut head = frame.elapsed_us().to_le_bytes().to_vec();
        head.extend_from_slice(&VERSION);
        head.extend_from_slice(&[frame_id, n]);
        let mut content = chunk(0x0000, 0, &head);
        content.extend_from_slice(before);
        content.extend_from_slice(&chunk(list, HAS_CHUNKS, trackers));
        chunk(kind, HAS_CHUNKS, &content)
    };
    lists.iter().map(packet).collect()
}

fn tracker(frame: &Frame, person: &PersonFrame) -> Vec<u8> {
    let axes = Axes::of_points(Preset::Unity);
    let three = |v: &Vector3<f64>| -> Vec<u8> {
        let of_it = axes.point(v);
        of_it
            .iter()
            .flat_map(|v| (*v as f32).to_le_bytes())
            .collect()
    };
    let is_seen = person.state != PersonState::Coasting;
    let validity: f32 = if is_seen { 1.0 } else { 0.0 };
    let mut content = chunk(0x0000, 0, &three(&person.motion.root_m));
    content.extend(chunk(0x0001, 0, &three(&person.velocity_m_s)));
    content.extend(chunk(0x0003, 0, &validity.to_le_bytes()));
    content.extend(chunk(0x0006, 0, &frame.elapsed_us().to_le_bytes()));
    chunk(tracker_id(person.id), HAS_CHUNKS, &content)
}

fn tracker_id(id: PersonId) -> u16 {
    id.0 as u16
}

/// A chunk: id, length of the content with the chunk flag, content.
fn chunk(id: u16, has_chunks: u16, content: &[u8]) -> Vec<u8> {
    // 15 bits; lists are far shorter.
    let length = u16::try_from(content.len()).unwrap_or(u16::MAX) & !HAS_CHUNKS;
    let mut bytes = id.to_le_bytes().to_vec();
    bytes.extend_from_slice(&(length | has_chunks).to_le_bytes());
    bytes.extend_from_slice(content);
    bytes
}

/// Truncates a name to at most [`MAX_NAME`] bytes.
fn cut(name: &str) -> &str {
    name.get(..name.floor_char_boundary(MAX_NAME))
        .unwrap_or(name)
}

/// Sends to `address`: a multicast group, through `interface` if given, or one receiver.
pub(crate) fn send(
    address: SocketAddr,
    interface: Option<Ipv4Addr>,
    shell: &Shell,
) -> io::Result<SocketAddr> {
    let socket = open(address, interface)?;
    let mut feed = shell.feed.fresh();
    let counters = Arc::clone(&shell.counters);
    counters.set_clients(1);
    shell.spawn(async move {
        let (mut frame_id, mut named) = (0u8, None);
        while let Some(frame) = feed.next().await {
            frame_id = frame_id.wrapping_add(1);
            let mut packets = data_packets(&frame, frame_id);
            let second = (frame.elapsed_s.floor() as i64, frame.roster.version);
            if named.replace(second) != Some(second) {
                packets.extend(info_packets(&frame, frame_id));
            }
            let sent = send_all(&socket, &packets, address).await;
            match sent {
                Ok(()) => counters.sent(),
                Err(error) => counters.failed(format!("{address}: {error}")),
            }
        }
    });
    Ok(address)
}

fn open(address: SocketAddr, interface: Option<Ipv4Addr>) -> io::Result<UdpSocket> {
    let domain = Domain::for_address(address);
    let socket = Socket::new(domain, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_nonblocking(true)?;
    if address.is_ipv4() && address.ip().is_multicast() {
        socket.set_multicast_ttl_v4(TTL)?;
        // Receivers on this machine also receive it.
        socket.set_multicast_loop_v4(true)?;
        if let Some(interface) = interface {
            socket.set_multicast_if_v4(&interface)?;
        }
    }
    let from = interface.map_or_else(|| any_address(address), Into::into);
    socket.bind(&SocketAddr::new(from, 0).into())?;
    UdpSocket::from_std(socket.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::FrameMaker;
    use crate::synthetic;

    /// The chunks in `bytes`.
    fn chunks(mut bytes: &[u8]) -> Vec<(u16, bool, &[u8])> {
        let mut all = Vec::new();
        while !bytes.is_empty() {
            let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
            let end = 4 + usize::from(word(2) & !HAS_CHUNKS);
            all.push((word(0), word(2) & HAS_CHUNKS != 0, &bytes[4..end]));
            bytes = &bytes[end..];
        }
        all
    }

    fn three(bytes: &[u8]) -> [f64; 3] {
        [0, 4, 8].map(|at| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())))
    }

    #[test]
    fn output_matches_another_implementation() {
        // README of the npm package @jwetzell/posistagenet: one tracker of id 1, the server's name, version 2.3.
        const THEIRS: &str = concat!(
            "5667348000000c00010000000000000002030101",
            "01000b00536572766572204e616d65",
            "0200118001000d8000000900547261636b65722031"
        );
        let mut frame = FrameMaker::new(synthetic::facts()).frame(&synthetic::poses_at(1, 0));
        frame.venue = "Server Name".into();
        frame.elapsed_s = 1e-6;
        frame.persons[0].name = "Tracker 1".into();
        let [ours] = &info_packets(&frame, 1)[..] else {
            panic!("more than one packet")
        };
        let byte = |at: usize| u8::from_str_radix(&THEIRS[at..at + 2], 16).unwrap();
        let theirs: Vec<u8> = (0..THEIRS.len()).step_by(2).map(byte).collect();
        assert_eq!(*ours, theirs);
    }

    #[test]
    fn trackers_are_pelvises_in_posistagenet_axes() {
        let frame = synthetic::frame(60);
        let packets = data_packets(&frame, 9);
        assert_eq!(packets.len(), 1);
        let [(DATA_PACKET, true, content)] = chunks(&packets[0])[..] else {
            panic!("no data packet")
        };
        let [(0, false, head), (1, true, list)] = chunks(content)[..] else {
            panic!("no head and list")
        };
        assert_eq!(head[..8], 1_000_000u64.to_le_bytes());
        assert_eq!(head[8..], [2, 3, 9, 1]);
        for ((id, _, tracker), person) in chunks(list).into_iter().zip(&frame.persons) {
            assert_eq!(u32::from(id), person.id.0);
            let [(0, _, at), (1, _, speed), (3, _, valid), (6, _, _)] = chunks(tracker)[..] else {
                panic!("no tracker")
            };
            let pelvis_m = person.joints_m[0];
            let expected = [-pelvis_m.y, pelvis_m.z, pelvis_m.x];
            assert!(
                three(at)
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() < 1e-5)
            );
            assert_eq!(valid, 1.0f32.to_le_bytes());
            assert!(three(speed).iter().all(|v| v.abs() < 10.0));
        }
    }

    #[test]
    fn velocity_matches_the_circular_motion() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let mut frame = maker.frame(&synthetic::poses_at(1, 0));
        assert_eq!(frame.persons[0].velocity_m_s, Vector3::zeros());
        for tick in 1..30 {
            frame = maker.frame(&synthetic::poses_at(1, tick));
        }
        let along = frame.persons[0].velocity_m_s.xy().norm();
        // A radius of one metre, one turn in four seconds.
        assert!(
            (along - std::f64::consts::TAU / 4.0).abs() < 0.01,
            "{along}"
        );
    }

    #[test]
    fn crowds_are_split_into_packets_below_1500_bytes() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let frame = maker.frame(&synthetic::poses_at(60, 0));
        for packets in [data_packets(&frame, 1), info_packets(&frame, 1)] {
            let mut trackers = 0;
            for packet in &packets {
                assert!(packet.len() <= 1472);
                let [(_, true, content)] = chunks(packet)[..] else {
                    panic!("no packet")
                };
                let parts = chunks(content);
                assert_eq!(usize::from(parts[0].2[11]), packets.len());
                trackers += chunks(parts.last().unwrap().2).len();
            }
            assert_eq!(trackers, 60);
        }
    }

    #[test]
    fn long_names_are_truncated_between_characters() {
        let name = "é".repeat(300);
        assert_eq!(cut(&name).len(), MAX_NAME);
        assert_eq!(cut("Ada"), "Ada");
    }
}
