//! The Virtual Motion Capture protocol, version 3.1, as a performer: OSC over UDP, one person per
//! port.
//!
//! Source: *VMC Protocol specification*, <https://protocol.vmc.info/specification> and
//! <https://protocol.vmc.info/marionette-spec>.
//!
//! Unity's axes: metres, left-handed, y up; a person who faces the world's x faces z. Bones have
//! the names of Unity's humanoid. Each is relative to its parent and to the T-pose, in which all
//! rotations are identities. The root is the point on the floor below the hips, without rotation;
//! the hips are relative to it. Thus receivers that use root and hips get the full pose, and
//! receivers that use only the root still move the person over the floor.
//!
//! The first person is sent to the first port, 39539 by default, the next to the next port, up to
//! [`VMC_PORTS`]. A person keeps the port while in the roster. Missing people are not sent.

use std::io;
use std::net::{IpAddr, SocketAddr};

use farfield_export::axes::{Axes, Preset};
use farfield_export::skeleton::{Bone, BoneNames};
use nalgebra::{UnitQuaternion, Vector3};
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};
use tokio::net::UdpSocket;

use crate::frame::{Frame, PersonFrame};
use crate::people::Places;
use crate::server::{any_address, send_all};
use crate::slot::Shell;
use crate::spec::VMC_PORTS;

/// Maximum datagram on this machine, bytes: the limit of UDP over IPv4. A frame has 1,696 bytes and
/// is one bundle.
pub const LOOPBACK_BYTES: usize = 65_507;
/// Maximum datagram over a network, bytes: below 1,500 as the specification requires, with room for
/// tunnels.
pub const NETWORK_BYTES: usize = 1_400;
/// Header of a bundle, and size field of each message, bytes (OSC 1.0).
const BUNDLE_HEAD: usize = 16;
const MESSAGE_HEAD: usize = 4;

/// The maximum datagram for the path to `to`.
pub fn most_bytes(to: IpAddr) -> usize {
    if to.to_canonical().is_loopback() {
        LOOPBACK_BYTES
    } else {
        NETWORK_BYTES
    }
}

/// The datagrams of one person: as few bundles as possible, each of at most `most_bytes`. Each
/// contains state and time, since receivers treat a bundle as a frame. `None` if OSC cannot encode
/// them, which no frame causes.
pub fn datagrams(frame: &Frame, person: &PersonFrame, most_bytes: usize) -> Option<Vec<Vec<u8>>> {
    let state = vec![
        // Model loaded, calibrated, normal mode, tracked.
        message("/VMC/Ext/OK", [1, 3, 0, 1].map(OscType::Int).to_vec()),
        message("/VMC/Ext/T", vec![OscType::Float(frame.elapsed_s as f32)]),
    ];
    let empty_bytes = BUNDLE_HEAD + sizes(&state)?.iter().sum::<usize>();
    let poses = poses(person);
    let (mut parts, mut bytes) = (vec![state.clone()], empty_bytes);
    for (pose, size) in poses.iter().zip(sizes(&poses)?) {
        if bytes + size > most_bytes && bytes > empty_bytes {
            parts.push(state.clone());
            bytes = empty_bytes;
        }
        parts.last_mut()?.push(pose.clone());
        bytes += size;
    }
    // "Immediately": the time is in the messages.
    let timetag = OscTime {
        seconds: 0,
        fractional: 1,
    };
    let bundle = |content| OscPacket::Bundle(OscBundle { timetag, content });
    let parts = parts.into_iter().map(bundle);
    parts.map(|part| encoder::encode(&part).ok()).collect()
}

/// Root and bones.
fn poses(person: &PersonFrame) -> Vec<OscPacket> {
    let axes = Axes::of_points(Preset::Unity);
    let root_m = Vector3::new(person.motion.root_m.x, person.motion.root_m.y, 0.0);
    let mut poses = vec![posed(
        "/VMC/Ext/Root/Pos",
        "root",
        &axes.point(&root_m),
        &UnitQuaternion::identity(),
    )];
    poses.extend(Bone::ALL.map(|bone| {
        let i = bone.index();
        let at_m = match bone.parent() {
            None => person.motion.root_m - root_m,
            Some(_) => person.rig.offset_m[i],
        };
        posed(
            "/VMC/Ext/Bone/Pos",
            BoneNames::Unity.name(bone),
            &axes.point(&at_m),
            &axes.rotation(&person.motion.rotations[i]),
        )
    }));
    poses
}

/// Size of each message in a bundle, bytes.
fn sizes(messages: &[OscPacket]) -> Option<Vec<usize>> {
    let size = |it| Some(MESSAGE_HEAD + encoder::encode(it).ok()?.len());
    messages.iter().map(size).collect()
}

fn message(address: &str, args: Vec<OscType>) -> OscPacket {
    OscPacket::Message(OscMessage {
        addr: address.to_owned(),
        args,
    })
}

fn posed(address: &str, name: &str, at: &Vector3<f64>, turned: &UnitQuaternion<f64>) -> OscPacket {
    let numbers = at.iter().chain(turned.coords.iter());
    let mut args = vec![OscType::String(name.to_owned())];
    args.extend(numbers.map(|v| OscType::Float(*v as f32)));
    message(address, args)
}

/// Sends to `first`, the port of the first person.
pub(crate) async fn send(first: SocketAddr, shell: Shell) -> io::Result<SocketAddr> {
    let socket = UdpSocket::bind(SocketAddr::new(any_address(first), 0)).await?;
    let mut feed = shell.feed.fresh();
    let counters = std::sync::Arc::clone(&shell.counters);
    shell.spawn(async move {
        let mut ports = Places::new(VMC_PORTS);
        while let Some(frame) = feed.next().await {
            ports.assign(frame.roster.ids());
            counters.set_clients(ports.len());
            for person in frame.confirmed() {
                let Some(port) = ports.get(person.id) else {
                    continue;
                };
                let to = SocketAddr::new(first.ip(), first.port().saturating_add(port));
                let sent = match datagrams(&frame, person, most_bytes(to.ip())) {
                    Some(all) => send_all(&socket, &all, to).await,
                    None => Err(io::Error::other("cannot encode the OSC messages")),
                };
                match sent {
                    Ok(()) => counters.sent(),
                    Err(error) => counters.failed(format!("{to}: {error}")),
                }
            }
        }
    });
    Ok(first)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use farfield_fusion::body::skeleton::{Pose, reported_angles};
    use nalgebra::Quaternion;

    use super::*;
    use crate::frame::FrameMaker;
    use crate::synthetic;

    /// The messages of a bundle.
    fn content(datagram: &[u8]) -> Vec<OscMessage> {
        let (_, packet) = rosc::decoder::decode_udp(datagram).unwrap();
        let OscPacket::Bundle(bundle) = packet else {
            panic!("no bundle")
        };
        let messages = bundle.content.into_iter().map(|packet| match packet {
            OscPacket::Message(message) => message,
            OscPacket::Bundle(_) => panic!("no message"),
        });
        messages.collect()
    }

    fn messages(frame: &Frame, person: &PersonFrame) -> Vec<OscMessage> {
        let [whole] = &datagrams(frame, person, LOOPBACK_BYTES).unwrap()[..] else {
            panic!("several datagrams")
        };
        content(whole)
    }

    /// Datagrams received on a real socket, with `most_bytes` as limit.
    async fn received(most_bytes: usize) -> Vec<Vec<u8>> {
        let frame = synthetic::frame(77);
        let sent = datagrams(&frame, &frame.persons[1], most_bytes).unwrap();
        let receiver = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let to = receiver.local_addr().unwrap();
        send_all(&sender, &sent, to).await.unwrap();
        let mut all = Vec::new();
        for _ in &sent {
            let mut bytes = vec![0; LOOPBACK_BYTES];
            let length = receiver.recv(&mut bytes).await.unwrap();
            all.push(bytes[..length].to_vec());
        }
        all
    }

    #[tokio::test]
    async fn datagrams_have_state_and_time_and_locally_all_bones() {
        let local = "127.0.0.1".parse().unwrap();
        let remote = "192.168.1.20".parse().unwrap();
        for (path, parts) in [(local, 1), (remote, 2)] {
            let most_bytes = most_bytes(path);
            let datagrams = received(most_bytes).await;
            assert_eq!(datagrams.len(), parts);
            let mut bones = 0;
            for datagram in &datagrams {
                assert!(datagram.len() <= most_bytes, "{} bytes", datagram.len());
                let content = content(datagram);
                let [ok, time] = [&content[0], &content[1]];
                assert_eq!([&*ok.addr, &*time.addr], ["/VMC/Ext/OK", "/VMC/Ext/T"]);
                let of_bones = content.iter().filter(|it| it.addr == "/VMC/Ext/Bone/Pos");
                bones += of_bones.count();
            }
            assert_eq!(bones, Bone::ALL.len());
        }
        assert_eq!(received(LOOPBACK_BYTES).await[0].len(), 1696);
        for ip in ["::1", "::ffff:127.0.0.1", "127.0.0.2"] {
            assert_eq!(most_bytes(ip.parse().unwrap()), LOOPBACK_BYTES, "{ip}");
        }
    }

    /// Position and rotation of a message.
    fn posed_at(message: &OscMessage) -> (String, Vector3<f64>, UnitQuaternion<f64>) {
        let name = message.args[0].clone().string().unwrap();
        let v: Vec<f64> = message.args[1..]
            .iter()
            .map(|arg| f64::from(arg.clone().float().unwrap()))
            .collect();
        let turned = UnitQuaternion::new_normalize(Quaternion::new(v[6], v[3], v[4], v[5]));
        (name, Vector3::new(v[0], v[1], v[2]), turned)
    }

    #[test]
    fn unity_forward_kinematics_gives_the_joints() {
        let frame = synthetic::frame(77);
        let person = &frame.persons[1];
        let all = messages(&frame, person);
        assert_eq!(all.len(), 23);
        assert_eq!([&all[0].addr, &all[1].addr], ["/VMC/Ext/OK", "/VMC/Ext/T"]);
        let (root, mut at, mut turned) = posed_at(&all[2]);
        assert_eq!(root, "root");
        let mut world = BTreeMap::new();
        for (bone, message) in Bone::ALL.into_iter().zip(&all[3..]) {
            let (name, local, by) = posed_at(message);
            assert_eq!(name, BoneNames::Unity.name(bone));
            if let Some(parent) = bone.parent() {
                (at, turned) = world[&parent];
            }
            let head = at + turned * local;
            world.insert(bone, (head, turned * by));
            if !matches!(bone, Bone::LeftToes | Bone::RightToes) {
                let joint_m = person.joints_m[bone.joint().index()];
                let expected = Vector3::new(-joint_m.y, joint_m.z, joint_m.x);
                assert!((head - expected).norm() < 1e-5, "{name}");
            }
        }
    }

    #[test]
    fn in_a_neutral_pose_only_the_arms_are_rotated() {
        let mut pose = synthetic::person_at(1, 0);
        let neutral = Pose::neutral(Vector3::zeros(), UnitQuaternion::identity());
        pose.angles = reported_angles(&neutral).map(|v| v as f32).to_vec();
        let mut maker = FrameMaker::new(synthetic::facts());
        let mut poses = synthetic::poses_at(1, 0);
        poses.persons = vec![pose];
        let frame = maker.frame(&poses);
        let all = messages(&frame, &frame.persons[0]);
        for message in &all[3..] {
            let (name, _, by) = posed_at(message);
            let expected = if name.ends_with("UpperArm") {
                90.0
            } else {
                0.0
            };
            assert!((by.angle().to_degrees() - expected).abs() < 1e-3, "{name}");
        }
    }
}
