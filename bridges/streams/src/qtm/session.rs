//! What a client has asked for, and what it is sent: values in, packets out, without a socket.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;

use super::command::{Command, Component, Rate, Topic};
use super::components::data_packet;
use super::layout::Layout;
use super::parameters::parameters;
use super::wire::{PacketKind, packet, text, text_of};
use super::{Packet, Version};
use crate::frame::{Frame, Roster};

/// Events, by their numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Event {
    /// A measurement is there. Clients read parameters again.
    Connected = 1,
    /// The server leaves.
    ShuttingDown = 12,
}

/// What is sent for what a client asked.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Answer {
    /// Packets, one behind the other.
    pub bytes: Vec<u8>,
    /// Whether the connection ends then.
    pub closes: bool,
}

impl Answer {
    fn say(text_of_it: &str) -> Self {
        Self::packet(text(PacketKind::Command, text_of_it))
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
    /// Which of the frames that the rate lets through was the last.
    last: Option<i64>,
}

/// One client.
#[derive(Debug)]
pub struct Session {
    peer: IpAddr,
    version: Version,
    layout: Layout,
    streaming: Option<Streaming>,
    /// The list of people that the client knows of; `None` until it has asked for any: simple clients take an event for the
    /// answer to what they asked.
    told_roster: Option<u64>,
    rate_hz: f64,
}

impl Session {
    /// A client at that address, who has asked for nothing yet.
    pub fn new(peer: IpAddr) -> Self {
        Self {
            peer,
            version: Version::NEWEST,
            layout: Layout::default(),
            streaming: None,
            told_roster: None,
            rate_hz: 100.0,
        }
    }

    /// What is said first.
    pub fn welcome() -> Vec<u8> {
        text(PacketKind::Command, "QTM RT Interface connected")
    }

    /// What is said instead when there are too many clients, or one sends what is no packet.
    pub fn refusal(why: &str) -> Vec<u8> {
        text(PacketKind::Error, why)
    }

    /// What is said last when the streams stop.
    pub fn goodbye() -> Vec<u8> {
        event(Event::ShuttingDown)
    }

    /// Whether frames are wanted.
    pub fn is_streaming(&self) -> bool {
        self.streaming.is_some()
    }

    /// Answers a packet of the client; `newest` is the newest frame, if there is one yet.
    pub fn answer(&mut self, asked: &Packet, newest: Option<&Arc<Frame>>) -> Answer {
        if asked.kind == PacketKind::Command as u32 {
            match Command::parse(&text_of(&asked.payload)) {
                Ok(command) => self.command(command, newest),
                Err(why) => Answer::refuse(&why),
            }
        } else if asked.kind == PacketKind::Xml as u32 {
            Answer::refuse(NOT_MASTER)
        } else {
            Answer::refuse("Parse error")
        }
    }

    fn command(&mut self, command: Command, newest: Option<&Arc<Frame>>) -> Answer {
        match command {
            Command::Version(None) => {
                let Version { major, minor } = self.version;
                Answer::say(&format!("Version is {major}.{minor}"))
            }
            Command::Version(Some(version)) => {
                self.version = version;
                let Version { major, minor } = version;
                Answer::say(&format!("Version set to {major}.{minor}"))
            }
            // Clients take the number apart: a version of QTM that speaks the newest protocol that is spoken here.
            Command::QtmVersion => Answer::say("QTM Version is 2024.1 (build 0)"),
            Command::ByteOrder => Answer::say("Byte order is little endian"),
            Command::CheckLicense => Answer::say("License pass"),
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
                ..Answer::say("Bye bye")
            },
            Command::Control => Answer::refuse(NOT_MASTER),
        }
    }

    fn parameters(&mut self, topics: &[Topic], newest: Option<&Arc<Frame>>) -> Answer {
        let nobody = Arc::new(Roster {
            version: 0,
            people: Vec::new(),
        });
        let roster = newest.map_or(&nobody, |frame| &frame.roster);
        if let Some(frame) = newest {
            self.rate_hz = frame.rate_hz;
        }
        self.layout.read(topics, roster);
        self.told_roster = Some(roster.version);
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
            // Or anybody could have a third machine flooded.
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
        self.told_roster.get_or_insert(version);
        if newest.is_some() {
            return Answer::default();
        }
        // As QTM does where no measurement runs; frames follow when there are some.
        Answer::packet(packet(PacketKind::NoMoreData, &[]))
    }

    /// What is sent of a frame: to the connection, and to where by UDP.
    pub fn frame(&mut self, frame: &Frame) -> (Vec<u8>, Option<(SocketAddr, Vec<u8>)>) {
        self.rate_hz = frame.rate_hz;
        let mut bytes = Vec::new();
        let version = frame.roster.version;
        if self.told_roster.is_some_and(|told| told != version) {
            self.told_roster = Some(version);
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

/// QTM's own words.
const NOT_MASTER: &str = "You must be master to issue this command";

fn event(event: Event) -> Vec<u8> {
    packet(PacketKind::Event, &[event as u8])
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
        let asked = Packet {
            kind: PacketKind::Command as u32,
            payload: command.as_bytes().to_vec(),
        };
        let bytes = session.answer(&asked, newest).bytes;
        let kind = bytes.get(4..8).map_or(u32::MAX, |four| {
            u32::from_le_bytes(four.try_into().unwrap())
        });
        (kind, text_of(bytes.get(8..).unwrap_or_default()))
    }

    #[test]
    fn who_has_asked_for_nothing_is_told_nothing() {
        let mut session = session();
        assert!(session.frame(&synthetic::frame(0)).0.is_empty());
        ask(&mut session, "GetParameters General", None);
        assert!(!session.frame(&synthetic::frame(0)).0.is_empty());
    }

    #[test]
    fn nobody_can_take_control() {
        for command in ["TakeControl", "Start", "Load a.qtm", "New"] {
            let (kind, said) = ask(&mut session(), command, None);
            assert_eq!((kind, said.as_str()), (0, NOT_MASTER));
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
    fn udp_goes_to_the_client_alone() {
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
    fn rates_let_through_as_many_frames_as_they_say() {
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
    fn a_client_counts_by_the_list_that_it_read_until_it_reads_again() {
        let mut maker = FrameMaker::new(synthetic::facts());
        let one = Arc::new(maker.frame(&synthetic::poses_at(1, 0)));
        let mut session = session();
        ask(&mut session, "GetParameters 3D", Some(&one));
        ask(&mut session, "StreamFrames AllFrames 3D", Some(&one));
        let alone = session.frame(&one).0;
        assert_eq!(alone[4..8], [3, 0, 0, 0]);
        let two = Arc::new(maker.frame(&synthetic::poses_at(2, 1)));
        let told = session.frame(&two).0;
        // An event, then markers of one person still.
        assert_eq!(told[..9], [9, 0, 0, 0, 6, 0, 0, 0, 1]);
        assert_eq!(told.len(), 9 + alone.len());
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
