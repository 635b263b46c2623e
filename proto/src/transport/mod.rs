//! Zenoh's configuration for both kinds of nodes: pure settings, (key, JSON5 value) pairs; nothing
//! is opened.
//!
//! Lock-step and live use the same settings. Whether a message waits or is dropped is set per
//! publisher. The queues are short, because messages in a queue are late. There is no discovery:
//! scouting is off.
//!
//! Endpoints and their properties (see [`crate::transport::endpoint`]):
//!
//! | endpoint | encrypted | best-effort messages | reliable messages |
//! | --- | --- | --- | --- |
//! | `quic/host:port` | yes | datagrams | streams |
//! | `tls/host:port` | yes | wait behind lost packets | one stream |
//! | `udp/host:port` | no | datagrams | streams |
//! | `tcp/host:port` | no | wait behind lost packets | one stream |
//!
//! The first and the third are QUIC, the third without keys. Zenoh needs options for datagrams
//! (`?mixed_rel=1`), for streams over UDP (`?rel=1`, without which a lost declaration stays lost),
//! and for [`MIN_WINDOW_BYTES`] and [`DATAGRAM_BUFFER_BYTES`]. Each option is added to an endpoint
//! unless it sets the option itself after `?` or `#`. Other options of the endpoint stay.

mod access;
pub mod endpoint;
mod exposure;
mod generations;

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::transport::endpoint::scheme;

pub use access::{FUSION, READER, RECORDER, common_name, generation_of, reader};
pub use exposure::{Exposure, ExposureError, is_loopback};
pub use generations::{GENERATIONS_FILE, Generations};

/// Bytes that Zenoh and the protocols below it add to a message. Measured on the loopback of a
/// namespace with an MTU of 1500: about 70 for TCP over IPv4, including acknowledgements in the
/// other direction; a TLS record adds 22. The rest is for Ethernet.
pub const MESSAGE_OVERHEAD_BYTES: usize = 110;

/// A node without any message for this time counts as gone.
pub const LEASE: Duration = Duration::from_secs(5);
/// Timeout of one connection attempt. The next attempt starts with fresh timers, so a link that
/// returns after a cut is used sooner.
const OPEN_TIMEOUT: Duration = Duration::from_secs(3);
/// How long a blocking send may wait before the link is closed: a busy node slows the others down
/// but stays connected.
const WAIT_BEFORE_CLOSE: Duration = Duration::from_mins(1);
/// Largest message assembled from fragments, bytes: twice the limit of [`crate::wire`].
const MAX_ASSEMBLED_BYTES: usize = 2 << 20;
/// Limit of unfinished connections with unknown peers; further ones are closed. The same number may
/// be in their TLS handshake (`vendor/tls-listener`).
const MOST_OPENING: usize = 128;
/// Limit of simultaneous sessions: every edge of the largest venue, and as many readers.
const MOST_SESSIONS: usize = 512;
/// Most handles of a node's sessions over `tls/` or `tcp/`; those of `quic/` and `udp/` share one.
pub const MOST_LINK_HANDLES: usize = MOST_SESSIONS + 2 * MOST_OPENING;
/// Send buffer of a TCP or TLS link in the kernel, bytes. Data in it is late and can no longer be
/// dropped.
const SEND_BUFFER_BYTES: u32 = 64 << 10;

/// Smallest congestion window of a QUIC connection after any loss, bytes: the edge controls the
/// rate itself, and distinguishes loss from a full queue. 64 KiB are 2.6 Mbit/s at a round trip of
/// 200 ms.
pub const MIN_WINDOW_BYTES: u32 = 64 << 10;
/// Datagrams that may wait for the network, bytes; when full, the oldest are dropped.
pub const DATAGRAM_BUFFER_BYTES: u32 = 32 << 10;

/// One setting of Zenoh: its key, and its value as JSON5.
pub type ZenohSetting = (String, String);

/// The files that prove the identity of a node.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// The certificate of the venue's authority (CA), PEM.
    pub authority: PathBuf,
    /// The node's certificate, PEM.
    pub certificate: PathBuf,
    /// The node's private key, PEM.
    pub key: PathBuf,
    /// The newest known generations of all nodes.
    pub generations: Generations,
}

impl Identity {
    /// The files of `node` in a folder written by `farfield certs`; its generations are not read
    /// yet.
    pub fn in_folder(folder: &Path, node: &str) -> Self {
        Self {
            authority: folder.join("ca.pem"),
            certificate: folder.join(format!("{node}.pem")),
            key: folder.join(format!("{node}.key")),
            generations: Generations::default(),
        }
    }
}

/// Zenoh's settings of an edge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EdgeTransport<'a> {
    /// The venue's name.
    pub venue: &'a str,
    /// The endpoints of fusion, tried in turn until one answers, and again after a disconnection.
    pub connect: &'a [String],
    /// The edge's keys; `None` without TLS.
    pub identity: Option<&'a Identity>,
}

impl EdgeTransport<'_> {
    /// The settings in the order of their application. With an identity, messages are accepted from
    /// fusion alone, and only under the venue's name. Zenoh also trusts certificates of public
    /// authorities, which must not make a fusion node.
    pub fn settings(&self) -> Vec<ZenohSetting> {
        let mut settings = common("client", self.connect);
        settings.extend(pairs([
            ("connect/endpoints", list(&completed(self.connect))),
            // An edge may start before fusion and waits for it.
            ("connect/timeout_ms", "-1".to_owned()),
            ("connect/exit_on_failure", "false".to_owned()),
            (
                "connect/retry",
                "{ period_init_ms: 100, period_max_ms: 1000, period_increase_factor: 2 }"
                    .to_owned(),
            ),
        ]));
        if let Some(identity) = self.identity {
            settings.push(tls(identity));
            settings.push(access::at_edge(self.venue, &identity.generations));
        }
        settings
    }
}

/// Zenoh's settings of fusion.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FusionTransport<'a> {
    /// The venue's name.
    pub venue: &'a str,
    /// The names of the venue's viewpoints.
    pub viewpoints: &'a [&'a str],
    /// The endpoints to listen at.
    pub listen: &'a [String],
    /// Fusion's keys; `None` without TLS.
    pub identity: Option<&'a Identity>,
}

impl FusionTransport<'_> {
    /// The settings in the order of their application. With an identity every node can publish only
    /// under its own name, and read only what it needs. Without one every node may do everything,
    /// but gets no pictures.
    pub fn settings(&self) -> Vec<ZenohSetting> {
        let mut settings = common("router", self.listen);
        settings.extend(pairs([
            ("listen/endpoints", list(&completed(self.listen))),
            ("listen/exit_on_failure", "true".to_owned()),
            ("transport/unicast/max_sessions", MOST_SESSIONS.to_string()),
            ("transport/unicast/accept_pending", MOST_OPENING.to_string()),
            (
                "transport/unicast/accept_timeout",
                OPEN_TIMEOUT.as_millis().to_string(),
            ),
        ]));
        if let Some(identity) = self.identity {
            settings.push(tls(identity));
            settings.push(access::at_fusion(
                self.venue,
                self.viewpoints,
                &identity.generations,
            ));
        } else {
            settings.push(access::pictures_end_here(self.venue));
        }
        settings
    }
}

/// Endpoints with the options of the module documentation.
fn completed(endpoints: &[String]) -> Vec<String> {
    endpoints.iter().map(|text| complete(text)).collect()
}

fn complete(endpoint: &str) -> String {
    let metadata: &[(&str, u32)] = match scheme(endpoint) {
        "quic" => &[("mixed_rel", 1)],
        "udp" => &[("rel", 1), ("mixed_rel", 1)],
        _ => return endpoint.to_owned(),
    };
    let config = [
        ("min_window", MIN_WINDOW_BYTES),
        ("datagram_buffer", DATAGRAM_BUFFER_BYTES),
    ];
    let (rest, own_config) = endpoint.split_once('#').unwrap_or((endpoint, ""));
    let (address, own_metadata) = rest.split_once('?').unwrap_or((rest, ""));
    // `rel=0` means plain UDP, which has no reliable part to mix.
    let metadata = if is_set(own_metadata, "rel") {
        &[]
    } else {
        metadata
    };
    let (metadata, config) = (with(own_metadata, metadata), with(own_config, &config));
    format!("{address}?{metadata}#{config}")
}

/// The options of `own` (`a=1;b=2`), and those of `defaults` that it does not set.
fn with(own: &str, defaults: &[(&str, u32)]) -> String {
    let own_options = own.split(';').filter(|option| !option.is_empty());
    let missing = defaults.iter().filter(|(name, _)| !is_set(own, name));
    let missing = missing.map(|(name, value)| format!("{name}={value}"));
    let all: Vec<String> = own_options.map(str::to_owned).chain(missing).collect();
    all.join(";")
}

fn is_set(options: &str, name: &str) -> bool {
    options
        .split(';')
        .any(|option| option.split('=').next() == Some(name))
}

fn common(mode: &str, endpoints: &[String]) -> Vec<ZenohSetting> {
    let mut schemes: Vec<&str> = endpoints.iter().map(|text| scheme(text)).collect();
    schemes.sort_unstable();
    schemes.dedup();
    let queue = "transport/link/tx/queue";
    let mut settings = pairs([
        ("mode", quoted(mode)),
        ("scouting/multicast/enabled", "false".to_owned()),
        ("scouting/gossip/enabled", "false".to_owned()),
        (
            "transport/unicast/open_timeout",
            OPEN_TIMEOUT.as_millis().to_string(),
        ),
        ("transport/link/protocols", list(&schemes)),
        ("transport/link/tx/lease", LEASE.as_millis().to_string()),
        (
            "transport/link/rx/max_message_size",
            MAX_ASSEMBLED_BYTES.to_string(),
        ),
    ]);
    settings.push((
        format!("{queue}/congestion_control/block/wait_before_close"),
        WAIT_BEFORE_CLOSE.as_micros().to_string(),
    ));
    for scheme in ["tcp", "tls"] {
        settings.push((
            format!("transport/link/{scheme}/so_sndbuf"),
            SEND_BUFFER_BYTES.to_string(),
        ));
    }
    settings
}

fn tls(identity: &Identity) -> ZenohSetting {
    let file = |path: &Path| quoted(&path.to_string_lossy());
    let (certificate, key) = (file(&identity.certificate), file(&identity.key));
    let value = format!(
        "{{ root_ca_certificate: {}, enable_mtls: true, verify_name_on_connect: true, \
         close_link_on_expiration: true, so_sndbuf: {SEND_BUFFER_BYTES}, \
         listen_certificate: {certificate}, listen_private_key: {key}, \
         connect_certificate: {certificate}, connect_private_key: {key} }}",
        file(&identity.authority),
    );
    ("transport/link/tls".to_owned(), value)
}

fn pairs<const N: usize>(settings: [(&str, String); N]) -> Vec<ZenohSetting> {
    settings
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value))
        .collect()
}

/// `text` as a JSON string.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => quoted.extend(format!("\\u{:04x}", u32::from(c)).chars()),
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}

/// `texts` as a JSON array.
fn list(texts: &[impl AsRef<str>]) -> String {
    let texts: Vec<String> = texts.iter().map(|text| quoted(text.as_ref())).collect();
    format!("[{}]", texts.join(","))
}

/// Zenoh's message without the places in its own source, ` at FILE.rs:LINE.`, which do not help an
/// operator.
pub fn without_places(text: &str) -> String {
    let mut parts = text.split(" at ");
    let mut kept = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| c.is_whitespace() || c == ']');
        let (word, rest) = part.split_at(end.unwrap_or(part.len()));
        if word.contains(".rs:") {
            kept.push_str(rest);
        } else {
            kept.push_str(" at ");
            kept.push_str(part);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn value<'a>(settings: &'a [ZenohSetting], key: &str) -> Option<&'a str> {
        settings
            .iter()
            .find(|(known, _)| known == key)
            .map(|(_, value)| value.as_str())
    }

    #[test]
    fn only_the_protocols_of_the_endpoints_are_enabled() {
        let connect = [
            "quic/fusion.lan:7447?mixed_rel=1".to_owned(),
            "tls/10.0.0.1:7448".to_owned(),
        ];
        let settings = EdgeTransport {
            venue: "hall",
            connect: &connect,
            identity: None,
        }
        .settings();
        let protocols = value(&settings, "transport/link/protocols");
        assert_eq!(protocols, Some(r#"["quic","tls"]"#));
        assert_eq!(
            value(&settings, "scouting/multicast/enabled"),
            Some("false")
        );
    }

    #[test]
    fn missing_endpoint_options_are_added_and_set_ones_stay() {
        let added =
            format!("min_window={MIN_WINDOW_BYTES};datagram_buffer={DATAGRAM_BUFFER_BYTES}");
        for (given, completed) in [
            ("quic/h:1", format!("quic/h:1?mixed_rel=1#{added}")),
            ("udp/h:1", format!("udp/h:1?rel=1;mixed_rel=1#{added}")),
            ("udp/h:1?rel=0", format!("udp/h:1?rel=0#{added}")),
            (
                "quic/h:1#bind=h:2",
                format!("quic/h:1?mixed_rel=1#bind=h:2;{added}"),
            ),
            (
                "quic/h:1#min_window=9",
                format!(
                    "quic/h:1?mixed_rel=1#min_window=9;datagram_buffer={DATAGRAM_BUFFER_BYTES}"
                ),
            ),
            ("tls/h:1", "tls/h:1".to_owned()),
        ] {
            assert_eq!(complete(given), completed);
        }
    }

    #[test]
    fn without_an_identity_only_pictures_are_restricted() {
        let listen = ["tcp/127.0.0.1:0".to_owned()];
        let mut transport = FusionTransport {
            venue: "hall",
            viewpoints: &["ne"],
            listen: &listen,
            identity: None,
        };
        let settings = transport.settings();
        let access = value(&settings, "access_control").unwrap();
        assert!(access.contains("default_permission:\"allow\""), "{access}");
        assert!(access.contains("hall/thumbnail/*"), "{access}");
        assert_eq!(value(&settings, "transport/link/tls"), None);
        let identity = Identity::in_folder(Path::new("certs"), FUSION);
        transport.identity = Some(&identity);
        let settings = transport.settings();
        let tls = value(&settings, "transport/link/tls").unwrap();
        assert!(tls.contains("enable_mtls: true"), "{tls}");
        assert!(tls.contains("\"certs/fusion.key\""), "{tls}");
        assert!(value(&settings, "access_control").is_some());
    }

    #[test]
    fn quotes_and_control_characters_are_escaped() {
        assert_eq!(quoted("a\"b\\c\n\u{7f}é"), r#""a\"b\\c\u000a\u007fé""#);
        assert_eq!(list(&["a", "b"]), r#"["a","b"]"#);
        assert_eq!(list(&[] as &[&str]), "[]");
    }

    #[test]
    fn source_places_are_removed_from_zenohs_messages() {
        let message = "Can not create a new TCP listener at [::]:1: [tcp: Address in use (os error 98) at /r/src/a-1/unicast.rs:367.] at /r/src/b-2/tcp.rs:12. - Caused by x";
        assert_eq!(
            without_places(message),
            "Can not create a new TCP listener at [::]:1: [tcp: Address in use (os error 98)] - Caused by x"
        );
    }
}
