//! Parses stream specifications: `qtm`, `vmc=127.0.0.1:39539`, `psn=236.10.10.10@192.168.1.7`.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::str::FromStr;

use thiserror::Error;

use crate::server::is_of_this_machine;

/// Number of ports of a `vmc` stream, one per person.
pub const VMC_PORTS: u16 = 16;

/// A protocol.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum StreamKind {
    /// Real-time protocol of Qualisys Track Manager; a TCP server.
    Qtm,
    /// Virtual Motion Capture protocol, OSC over UDP; sends to one port per person.
    Vmc,
    /// JSON over WebSocket; a TCP server.
    WebSocket,
    /// Foxglove's protocol over WebSocket; a TCP server.
    Foxglove,
    /// JSON on Zenoh keys; a peer that others connect to.
    Zenoh,
    /// ROS 2 through `rmw_zenoh`; connects to ROS 2's router.
    Ros2,
    /// PosiStageNet over UDP multicast, or to one receiver.
    Psn,
    /// Lab Streaming Layer: an outlet that inlets discover by UDP; a TCP server.
    Lsl,
}

impl StreamKind {
    /// All protocols with their names.
    pub const ALL: [(&'static str, Self); 8] = [
        ("qtm", Self::Qtm),
        ("vmc", Self::Vmc),
        ("websocket", Self::WebSocket),
        ("foxglove", Self::Foxglove),
        ("zenoh", Self::Zenoh),
        ("ros2", Self::Ros2),
        ("psn", Self::Psn),
        ("lsl", Self::Lsl),
    ];

    /// The name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Qtm => "qtm",
            Self::Vmc => "vmc",
            Self::WebSocket => "websocket",
            Self::Foxglove => "foxglove",
            Self::Zenoh => "zenoh",
            Self::Ros2 => "ros2",
            Self::Psn => "psn",
            Self::Lsl => "lsl",
        }
    }

    /// The default address. PosiStageNet's is a multicast group, sent on the loopback only.
    pub const fn default_address(self) -> SocketAddr {
        let (ip, port) = match self {
            Self::Qtm => (Ipv4Addr::LOCALHOST, 22223),
            Self::Vmc => (Ipv4Addr::LOCALHOST, 39539),
            Self::WebSocket => (Ipv4Addr::LOCALHOST, 8765),
            Self::Foxglove => (Ipv4Addr::LOCALHOST, 8766),
            // Fusion may use 7447, Zenoh's default port.
            Self::Zenoh => (Ipv4Addr::LOCALHOST, 7448),
            Self::Ros2 => (Ipv4Addr::LOCALHOST, 7447),
            Self::Psn => (Ipv4Addr::new(236, 10, 10, 10), 56565),
            Self::Lsl => (Ipv4Addr::LOCALHOST, 16572),
        };
        SocketAddr::new(IpAddr::V4(ip), port)
    }

    /// Whether it is a server at its address; others send to it.
    pub const fn is_server(self) -> bool {
        matches!(
            self,
            Self::Qtm | Self::WebSocket | Self::Foxglove | Self::Zenoh | Self::Lsl
        )
    }
}

/// A stream specification.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StreamSpec {
    /// The protocol.
    pub kind: StreamKind,
    /// Address of a server, or target of a sender.
    pub address: SocketAddr,
    /// Address of the local interface for multicast; `None` for the system's default.
    pub interface: Option<Ipv4Addr>,
}

/// Why a specification is invalid.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum SpecError {
    /// Unknown protocol.
    #[error(
        "stream `{found}`: found no stream of that name, expected one of qtm, vmc, websocket, foxglove, zenoh, ros2, psn, lsl"
    )]
    UnknownName {
        /// The name.
        found: String,
    },
    /// Invalid address.
    #[error(
        "stream `{stream}`: found the address `{found}`, expected IP:PORT or IP, as {expected}"
    )]
    NoAddress {
        /// Name of the protocol.
        stream: &'static str,
        /// The text in place of the address.
        found: String,
        /// The default address.
        expected: SocketAddr,
    },
    /// `@` in the wrong place, or without an address after it.
    #[error(
        "stream `{stream}`: found `@{found}`, expected the IPv4 address of one of this machine's interfaces, behind a multicast address of psn"
    )]
    NoInterface {
        /// Name of the protocol.
        stream: &'static str,
        /// The text after `@`.
        found: String,
    },
    /// Unsupported kind of address.
    #[error("stream `{stream}`: found the address {found}, expected an IPv4 address")]
    NoIpv4 {
        /// Name of the protocol.
        stream: &'static str,
        /// The address.
        found: IpAddr,
    },
    /// Invalid port.
    #[error("stream `{stream}`: found port {found}, expected {expected}")]
    NoPort {
        /// Name of the protocol.
        stream: &'static str,
        /// The port.
        found: u16,
        /// The allowed ports.
        expected: &'static str,
    },
}

impl SpecError {
    /// Whether the name is wrong; otherwise the address is.
    pub fn is_of_name(&self) -> bool {
        matches!(self, Self::UnknownName { .. })
    }
}

impl StreamSpec {
    /// The stream with its default address, which stays on this machine.
    pub const fn new(kind: StreamKind) -> Self {
        Self {
            kind,
            address: kind.default_address(),
            interface: match kind {
                StreamKind::Psn => Some(Ipv4Addr::LOCALHOST),
                _ => None,
            },
        }
    }

    /// Whether other machines can receive it. None of these protocols has authentication: anyone
    /// who can reach the address or network sees all people.
    pub fn leaves_this_machine(&self) -> bool {
        match self.interface {
            Some(interface) if self.address.ip().is_multicast() => !interface.is_loopback(),
            _ => !self.address.ip().is_loopback(),
        }
    }

    /// The stream `name` with the default address or with `given`.
    ///
    /// # Errors
    /// [`SpecError`] for the name or the address.
    pub fn of(name: &str, given: Option<&str>) -> Result<Self, SpecError> {
        let kind = StreamKind::ALL.iter().find(|(known, _)| *known == name);
        let Some(&(stream, kind)) = kind else {
            return Err(SpecError::UnknownName {
                found: name.to_owned(),
            });
        };
        let Some(given) = given else {
            return Ok(Self::new(kind));
        };
        let (address, interface) = match given.split_once('@') {
            Some((address, interface)) => (address, Some(interface)),
            None => (given, None),
        };
        let default = kind.default_address();
        let parsed = address.parse::<SocketAddr>().or_else(|_| {
            let ip = address.trim_start_matches('[').trim_end_matches(']');
            ip.parse::<IpAddr>()
                .map(|ip| SocketAddr::new(ip, default.port()))
        });
        let address = parsed.map_err(|_| SpecError::NoAddress {
            stream,
            found: address.to_owned(),
            expected: default,
        })?;
        let interface = interface
            .map(|text| match text.parse::<Ipv4Addr>() {
                Ok(ip) if kind == StreamKind::Psn && address.ip().is_multicast() => Ok(ip),
                _ => Err(SpecError::NoInterface {
                    stream,
                    found: text.to_owned(),
                }),
            })
            .transpose()?;
        Self {
            kind,
            address,
            interface,
        }
        .checked()
    }

    /// Whether this stream is a client that would mistake our own server at `listening` for its
    /// server.
    pub fn takes_for_its_own(&self, listening: SocketAddr) -> bool {
        let (there, own) = (self.address.ip(), listening.ip());
        let is_there = own == there
            || own.is_unspecified() && is_of_this_machine(there)
            || there.is_unspecified();
        self.kind == StreamKind::Ros2 && self.address.port() == listening.port() && is_there
    }

    fn checked(self) -> Result<Self, SpecError> {
        let refused = |expected| {
            Err(SpecError::NoPort {
                stream: self.kind.name(),
                found: self.address.port(),
                expected,
            })
        };
        if self.kind == StreamKind::Lsl && self.address.is_ipv6() {
            return Err(SpecError::NoIpv4 {
                stream: self.kind.name(),
                found: self.address.ip(),
            });
        }
        match (self.kind, self.address.port()) {
            (StreamKind::Psn | StreamKind::Zenoh | StreamKind::Ros2, 0) => refused("1 to 65535"),
            (StreamKind::Vmc, port) if port == 0 || port > u16::MAX - (VMC_PORTS - 1) => {
                refused("1 to 65520: each person has a port, the first this one")
            }
            _ => Ok(self),
        }
    }
}

impl FromStr for StreamSpec {
    type Err = SpecError;

    fn from_str(text: &str) -> Result<Self, SpecError> {
        match text.split_once('=') {
            Some((name, address)) => Self::of(name, Some(address)),
            None => Self::of(text, None),
        }
    }
}

impl fmt::Display for StreamSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.kind.name(), self.address)?;
        match self.interface {
            Some(interface) => write!(f, "@{interface}"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn read(text: &str) -> Result<StreamSpec, String> {
        text.parse().map_err(|e: SpecError| e.to_string())
    }

    #[test]
    fn by_default_nothing_leaves_this_machine() {
        for (name, kind) in StreamKind::ALL {
            let spec = read(name).unwrap();
            assert_eq!(spec, StreamSpec::new(kind));
            assert!(!spec.leaves_this_machine(), "{name}");
        }
    }

    #[test]
    fn addresses_beyond_the_loopback_are_flagged() {
        for text in [
            "qtm=0.0.0.0:22223",
            "qtm=[::]:22223",
            "vmc=192.168.1.7",
            "psn=236.10.10.10",
            "psn=236.10.10.10:56565@192.168.1.7",
            "websocket=10.0.0.1:80",
        ] {
            assert!(read(text).unwrap().leaves_this_machine(), "{text}");
        }
        for text in ["qtm=[::1]:1", "qtm=::1", "vmc=127.0.0.2:9", "psn=127.0.0.1"] {
            assert!(!read(text).unwrap().leaves_this_machine(), "{text}");
        }
    }

    #[test]
    fn ros2_does_not_connect_to_fusion() {
        let takes = |text: &str, listening: &str| {
            let spec = read(text).unwrap();
            spec.takes_for_its_own(listening.parse().unwrap())
        };
        assert!(takes("ros2", "127.0.0.1:7447"));
        assert!(takes("ros2", "0.0.0.0:7447"));
        assert!(takes("ros2=127.0.0.1:7449", "0.0.0.0:7449"));
        assert!(!takes("ros2=127.0.0.1:7449", "127.0.0.1:7447"));
        // A documentation address, which no machine has (RFC 5737).
        assert!(!takes("ros2=192.0.2.1:7447", "0.0.0.0:7447"));
        assert!(!takes("zenoh=127.0.0.1:7447", "127.0.0.1:7447"));
    }

    #[test]
    fn the_default_port_applies_unless_one_is_given() {
        assert_eq!(read("qtm=10.1.2.3").unwrap().address.port(), 22223);
        assert_eq!(read("qtm=10.1.2.3:5").unwrap().address.port(), 5);
    }

    #[test]
    fn errors_contain_found_and_expected_values() {
        let errors = [
            (
                "qmt",
                "stream `qmt`: found no stream of that name, expected one of qtm, vmc, websocket, foxglove, zenoh, ros2, psn, lsl",
            ),
            (
                "qtm=here",
                "stream `qtm`: found the address `here`, expected IP:PORT or IP, as 127.0.0.1:22223",
            ),
            (
                "vmc=127.0.0.1:65530",
                "stream `vmc`: found port 65530, expected 1 to 65520: each person has a port, the first this one",
            ),
            (
                "lsl=[::1]:16572",
                "stream `lsl`: found the address ::1, expected an IPv4 address",
            ),
            (
                "psn=127.0.0.1:0",
                "stream `psn`: found port 0, expected 1 to 65535",
            ),
            (
                "qtm=127.0.0.1@10.0.0.1",
                "stream `qtm`: found `@10.0.0.1`, expected the IPv4 address of one of this machine's interfaces, behind a multicast address of psn",
            ),
        ];
        for (text, message) in errors {
            assert_eq!(read(text).unwrap_err(), message);
        }
    }

    proptest! {
        #[test]
        fn specifications_round_trip(ip in any::<u32>(), port in 1u16..65520, kind in 0..StreamKind::ALL.len()) {
            let address = SocketAddr::new(IpAddr::V4(ip.into()), port);
            let spec = StreamSpec { kind: StreamKind::ALL[kind].1, address, interface: None };
            prop_assert_eq!(spec.to_string().parse(), Ok(spec));
        }

        #[test]
        fn no_text_panics(text in ".*") {
            let read = text.parse::<StreamSpec>();
            prop_assert!(read.is_ok() || read.is_err());
        }
    }
}
