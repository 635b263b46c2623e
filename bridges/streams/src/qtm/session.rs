//! State of a client and the packets for it: values in, packets out, without sockets.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use super::command::{Command, Component, Rate, Topic};
use super::components::data_packet;
use super::parameters::parameters;
use super::wire::{PacketKind, packet, text, text_of};
use super::{Packet, Version};
use crate::frame::{Frame, Roster};

/// Events with their numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Event {
    /// A measurement is available. Clients read parameters again.
    Connected = 1,
    /// The server shuts down.
    ShuttingDown = 12,
}

/// The answer to a client.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Answer {
    /// Concatenated packets.
    pub bytes: Vec<u8>,
    /// Whether the connection ends afterwards.
    pub closes: bool,
}

impl Answer {
    fn reply(message: &str) -> Self {
        Self::packet(text(PacketKind::Command, message))
    }

    fn refuse(why: &str) -> Self {
        Self::packet(text(PacketKind::Error, why))
    }

    fn packet(bytes: Vec<u8>) -> Self {
        Self {
            bytes,
            closes: false,
        }
    }
}

#[derive(Debug, Clone)]
struct Streaming {
    rate: Rate,
    components: Vec<Component>,
    udp: Option<SocketAddr>,
    /// Number of the last streamed frame, counted at the requested rate.
    last: Option<i64>,
}

/// One client.
#[derive(Debug)]
pub struct Session {
    peer: IpAddr,
    version: Version,
    layout: Layout,
    streaming: Option<Streaming>,
    /// Version of the roster that the client knows; `None` before its first request, since simple
    /// clients mistake an event for the answer.
    known_roster: Option<u64>,
    rate_hz: f64,
}

impl Session {
    /// A client at this address without any requests yet.
    pub fn new(peer: IpAddr) -> Self {
        Self {
            peer,
            version: Version::NEWEST,
            layout: Layout::default(),
            streaming: None,
            known_roster: None,
            rate_hz: 100.0,
        }
    }

    /// The first packet.
    pub fn welcome() -> Vec<u8> {
        text(PacketKind::Command, "QTM RT Interface connected")
    }

    /// The packet for surplus clients and invalid packets.
    pub fn refusal(why: &str) -> Vec<u8> {
        text(PacketKind::Error, why)
    }

    /// The last packet when the streams stop.
    pub fn goodbye() -> Vec<u8> {
        event(Event::ShuttingDown)
    }

    /// Whether frames are requested.
    pub fn is_streaming(&self) -> bool {
        self.streaming.is_some()
    }

    /// Answers a client's packet; `newest` is the newest frame, if any.
    pub fn answer(&mut self, request: &Packet, newest: Option<&Arc<Frame>>) -> Answer {
        if request.kind == PacketKind::Command as u32 {
            match Command::parse(&text_of(&request.payload)) {
                Ok(command) => self.command(command, newest),
                Err(why) => Answer::refuse(&why),
            }
        } else if request.kind == PacketKind::Xml as u32 {
            Answer::refuse(NOT_MASTER)
        } else {
            Answer::refuse("Parse error")
        }
    }

    fn command(&mut self, command: Command, newest: Option<&Arc<Frame>>) -> Answer {
        match command {
            Command::Version(None) => {
                let Version { major, minor } = self.version;
                Answer::reply(&format!("Version is {major}.{minor}"))
            }
            Command::Version(Some(version)) => {
                self.version = version;
                let Version { major, minor } = version;
                Answer::reply(&format!("Version set to {major}.{minor}"))
            }
            // Clients parse the number: a QTM version that supports the newest protocol version
            // supported here.
            Command::QtmVersion => Answer::reply("QTM Version is 2024.1 (build 0)"),
            Command::ByteOrder => Answer::reply("Byte order is little endian"),
            Command::CheckLicense => Answer::reply("License pass"),
            Command::GetState => Answer::packet(event(Event::Connected)),
            Command::GetParameters(topics) => self.parameters(&topics, newest),
            Command::GetCurrentFrame(components) => Answer::packet(match newest {
                Some(frame) => data_packet(frame, &components, &self.layout),
                None => packet(PacketKind::NoMoreData, &[]),
            }),
            Command::StreamFrames {
                rate,
                udp,
                components,
            } => self.stream(rate, udp, components, newest),
            Command::StopStreaming => {
                self.streaming = None;
                Answer::default()
            }
            Command::Quit => Answer {
                closes: true,
                ..Answer::reply("Bye bye")
            },
            Command::Control => Answer::refuse(NOT_MASTER),
        }
    }

    fn parameters(&mut self, topics: &[Topic], newest: Option<&Arc<Frame>>) -> Answer {
        let empty = Arc::new(Roster {
            version: 0,
            people: Vec::new(),
        });
        let roster = newest.map_or(&empty, |frame| &frame.roster);
        if let Some(frame) = newest {
            self.rate_hz = frame.rate_hz;
        }
        self.layout.read(topics, roster);
        self.known_roster = Some(roster.version);
        let xml = parameters(topics, self.version, self.rate_hz, roster);
        Answer::packet(text(PacketKind::Xml, &xml))
    }

    fn stream(
        &mut self,
        rate: Rate,
        udp: Option<(Option<IpAddr>, u16)>,
        components: Vec<Component>,
        newest: Option<&Arc<Frame>>,
    ) -> Answer {
        let udp = match udp {
            // Otherwise anyone could flood a third machine.
            Some((Some(ip), _)) if ip.to_canonical() != self.peer.to_canonical() => {
                return Answer::refuse("UDP goes to the client's own address only");
            }
            Some((_, port)) => Some(SocketAddr::new(self.peer, port)),
            None => None,
        };
        self.streaming = Some(Streaming {
            rate,
            components,
            udp,
            last: None,
        });
        let version = newest.map_or(0, |frame| frame.roster.version);
        self.known_roster.get_or_insert(version);
        if newest.is_some() {
            return Answer::default();
        }
        // As QTM does without a measurement; frames follow when there are some.
        Answer::packet(packet(PacketKind::NoMoreData, &[]))
    }

    /// Packets for a frame: for the connection, and by UDP.
    pub fn frame(&mut self, frame: &Frame) -> (Vec<u8>, Option<(SocketAddr, Vec<u8>)>) {
        self.rate_hz = frame.rate_hz;
        let mut bytes = Vec::new();
        let version = frame.roster.version;
        if self.known_roster.is_some_and(|known| known != version) {
            self.known_roster = Some(version);
            bytes = event(Event::Connected);
        }
        let Some(streaming) = self.streaming.as_mut() else {
            return (bytes, None);
        };
        let number = match streaming.rate {
            Rate::All => frame.tick.0,
            Rate::Divisor(n) => frame.tick.0.div_euclid(i64::from(n)),
            Rate::Hz(hz) if f64::from(hz) >= frame.rate_hz => frame.tick.0,
            Rate::Hz(hz) => (frame.tick.0 as f64 * f64::from(hz) / frame.rate_hz).floor() as i64,
        };
        if streaming.last.replace(number) == Some(number) {
            return (bytes, None);
        }
        let data = data_packet(frame, &streaming.components, &self.layout);
        if let Some(to) = streaming.udp {
            return (bytes, Some((to, data)));
        }
        bytes.extend_from_slice(&data);
        (bytes, None)
    }
}

/// QTM's own wording.
const NOT_MASTER: &str = "You must be master to issue this command";

fn event(event: Event) -> Vec<u8> {
    packet(PacketKind::Event, &[event as u8])
}

/// The lists of people that a client last read, which define the order of data. Lists that it never
/// read are those of the frame.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    markers: Option<Arc<Roster>>,
    bodies: Option<Arc<Roster>>,
    skeletons: Option<Arc<Roster>>,
}

impl Layout {
    /// The people whose markers are sent, in order.
    pub fn markers<'a>(&'a self, frame: &'a Frame) -> &'a Roster {
        self.markers.as_ref().unwrap_or(&frame.roster)
    }

    /// The people whose bodies are sent, in order.
    pub fn bodies<'a>(&'a self, frame: &'a Frame) -> &'a Roster {
        self.bodies.as_ref().unwrap_or(&frame.roster)
    }

    /// The people whose skeletons are sent, in order.
    pub fn skeletons<'a>(&'a self, frame: &'a Frame) -> &'a Roster {
        self.skeletons.as_ref().unwrap_or(&frame.roster)
    }

    /// Records that the client read these parameters for the people of `roster`.
    fn read(&mut self, topics: &[Topic], roster: &Arc<Roster>) {
        for topic in topics {
            let list = match topic {
                Topic::Markers => &mut self.markers,
                Topic::Bodies => &mut self.bodies,
                Topic::Skeletons { .. } => &mut self.skeletons,
                Topic::General | Topic::Force | Topic::Nothing => continue,
            };
            *list = Some(Arc::clone(roster));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::frame::FrameMaker;
    use crate::synthetic;

    fn session() -> Session {
        Session::new([127, 0, 0, 1].into())
    }

    fn ask(session: &mut Session, command: &str, newest: Option<&Arc<Frame>>) -> (u32, String) {
        let request = Packet {
            kind: PacketKind::Command as u32,
            payload: command.as_bytes().to_vec(),
        };
        let bytes = session.answer(&request, newest).bytes;
        let kind = bytes.get(4..8).map_or(u32::MAX, |four| {
            u32::from_le_bytes(four.try_into().unwrap())
        });
        (kind, text_of(bytes.get(8..).unwrap_or_default()))
    }

    #[test]
    fn clients_without_requests_receive_no_events() {
        let mut session = session();
        assert!(session.frame(&synthetic::frame(0)).0.is_empty());
        ask(&mut session, "GetParameters General", None);
        assert!(!session.frame(&synthetic::frame(0)).0.is_empty());
    }

    #[test]
    fn control_commands_are_refused() {
        for command in ["TakeControl", "Start", "Load a.qtm", "New"] {
            let (kind, text) = ask(&mut session(), command, None);
            assert_eq!((kind, text.as_str()), (0, NOT_MASTER));
        }
    }

    #[test]
    fn before_the_first_frame_there_is_no_more_data() {
        let mut session = session();
        assert_eq!(ask(&mut session, "GetCurrentFrame 3D", None).0, 4);
        assert_eq!(ask(&mut session, "StreamFrames AllFrames 3D", None).0, 4);
        assert!(session.is_streaming());
    }

    #[test]
    fn udp_is_sent_only_to_the_client() {
        let mut session = session();
        let frame = synthetic::frame(5);
        let refused = "StreamFrames AllFrames UDP:192.168.1.9:4000 3D";
        assert_eq!(ask(&mut session, refused, Some(&frame)).0, 0);
        assert!(!session.is_streaming());
        ask(
            &mut session,
            "StreamFrames AllFrames UDP:4000 3D",
            Some(&frame),
        );
        let (_, udp) = session.frame(&frame);
        assert_eq!(udp.unwrap().0, "127.0.0.1:4000".parse().unwrap());
    }

    #[test]
    fn rates_limit_the_number_of_frames() {
        for (rate, expected) in [
            ("AllFrames", 60),
            ("FrequencyDivisor:4", 15),
            ("Frequency:25", 25),
            ("Frequency:100", 60),
        ] {
            let mut session = session();
            let first = synthetic::frame(0);
            ask(&mut session, "GetParameters 3D", Some(&first));
            ask(
                &mut session,
                &format!("StreamFrames {rate} 3D"),
                Some(&first),
            );
            let mut maker = FrameMaker::new(synthetic::facts());
            let sent = (0..60).filter(|tick| {
                let frame = maker.frame(&synthetic::poses_at(2, *tick));
                !session.frame(&frame).0.is_empty()
            });
            assert_eq!(sent.count(), expected, "{rate}");
        }
    }

    #[test]
    fn clients_get_their_known_order_until_they_read_the_list_again() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let one = Arc::new(maker.frame(&synthetic::poses_at(1, 0)));
        let mut session = session();
        ask(&mut session, "GetParameters 3D", Some(&one));
        ask(&mut session, "StreamFrames AllFrames 3D", Some(&one));
        let alone = session.frame(&one).0;
        assert_eq!(alone[4..8], [3, 0, 0, 0]);
        let two = Arc::new(maker.frame(&synthetic::poses_at(2, 1)));
        let bytes = session.frame(&two).0;
        // An event, then markers of still one person.
        assert_eq!(bytes[..9], [9, 0, 0, 0, 6, 0, 0, 0, 1]);
        assert_eq!(bytes.len(), 9 + alone.len());
        ask(&mut session, "GetParameters 3D", Some(&two));
        let three = maker.frame(&synthetic::poses_at(2, 2));
        assert_eq!(session.frame(&three).0.len(), alone.len() + 29 * 12);
    }

    proptest! {
        #[test]
        fn no_packet_panics(kind in 0u32..10, payload in prop::collection::vec(any::<u8>(), 0..80)) {
            let frame = synthetic::frame(3);
            let mut session = session();
            session.answer(&Packet { kind, payload }, Some(&frame));
            session.frame(&frame);
        }
    }
}
