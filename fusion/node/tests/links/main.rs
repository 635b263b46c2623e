//! Zenoh's links over real sockets: certificates, access control, and best-effort messages that are lost singly instead of
//! delaying later ones.

#![expect(clippy::unwrap_used, reason = "a test that fails may panic")]

mod relay;

use std::path::Path;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use farfield_proto::message::parts::MESSAGE_BYTES;
use farfield_proto::order_statistics::value_after;
use farfield_proto::transport::{
    EdgeTransport, FusionTransport, Identity, ZenohSetting, common_name,
};
use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa,
    KeyPair, KeyUsagePurpose,
};
use relay::{Faults, Relay};
use tokio::time::{interval, timeout};
use zenoh::Session;
use zenoh::handlers::FifoChannel;
use zenoh::qos::{CongestionControl, Priority, Reliability};

const VENUE: &str = "links";
/// Far above the time that a loaded machine needs; a longer wait is a failure.
const PATIENCE: Duration = Duration::from_secs(20);
const NO_FAULTS: Faults = Faults {
    delay: Duration::ZERO,
    lose_every: 0,
};

async fn open(settings: Vec<ZenohSetting>) -> Session {
    let mut config = zenoh::Config::default();
    for (key, value) in settings {
        config
            .insert_json5(&key, &value)
            .unwrap_or_else(|error| panic!("{key} = {value}: {error}"));
    }
    timeout(PATIENCE, zenoh::open(config))
        .await
        .expect("no connection")
        .unwrap_or_else(|error| panic!("{error}"))
}

/// Writes the authority of `venue` and a key for each of `nodes` into `folder`; all may be servers at
/// 127.0.0.1.
fn write_keys(folder: &Path, venue: &str, nodes: &[&str]) {
    let mut authority = CertificateParams::default();
    authority.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    authority.key_usages = vec![KeyUsagePurpose::KeyCertSign];
    authority
        .distinguished_name
        .push(DnType::CommonName, format!("{venue} test authority"));
    let key = KeyPair::generate().unwrap();
    let authority = CertifiedIssuer::self_signed(authority, key).unwrap();
    std::fs::write(folder.join("ca.pem"), authority.pem()).unwrap();
    for node in nodes {
        let mut params = CertificateParams::new(vec!["127.0.0.1".to_owned()]).unwrap();
        params.extended_key_usages = vec![
            ExtendedKeyUsagePurpose::ServerAuth,
            ExtendedKeyUsagePurpose::ClientAuth,
        ];
        params
            .distinguished_name
            .push(DnType::CommonName, common_name(venue, node, 0));
        let key = KeyPair::generate().unwrap();
        let certificate = params.signed_by(&key, &authority).unwrap();
        std::fs::write(folder.join(format!("{node}.pem")), certificate.pem()).unwrap();
        std::fs::write(folder.join(format!("{node}.key")), key.serialize_pem()).unwrap();
    }
}

/// A link between a fusion node and one edge, `a`, through a relay.
struct Rig {
    fusion: Session,
    edge: Session,
    relay: Relay,
    _keys: Option<tempfile::TempDir>,
}

impl Rig {
    /// `endpoint` contains `PORT` in place of the port; its scheme selects TLS.
    async fn new(endpoint: &str, faults: Faults) -> Self {
        let keys = endpoint.starts_with("quic").then(|| {
            let folder = tempfile::tempdir().unwrap();
            write_keys(folder.path(), VENUE, &["fusion", "a", "b"]);
            folder
        });
        let identity = |node: &str| {
            let folder = keys.as_ref()?.path();
            Some(Identity::in_folder(folder, node))
        };
        let (of_fusion, of_edge) = (identity("fusion"), identity("a"));
        let listen = [endpoint.replace("PORT", "0")];
        let transport = FusionTransport {
            venue: VENUE,
            viewpoints: &["a", "b"],
            listen: &listen,
            identity: of_fusion.as_ref(),
        };
        let fusion = open(transport.settings()).await;
        let locator = fusion.info().locators().await[0].to_string();
        let address = locator.split(['?', '#']).next().unwrap();
        let port = address.rsplit(':').next().unwrap().parse().unwrap();
        let relay = Relay::before(port, faults).await;
        let connect = [endpoint.replace("PORT", &relay.port.to_string())];
        let transport = EdgeTransport {
            venue: VENUE,
            connect: &connect,
            identity: of_edge.as_ref(),
        };
        let edge = open(transport.settings()).await;
        Self {
            fusion,
            edge,
            relay,
            _keys: keys,
        }
    }
}

/// Delivery of messages sent at a steady rate.
#[derive(Debug)]
struct Sent {
    /// Number of messages that arrived.
    arrived: usize,
    /// Time from sending to arrival, ascending.
    taken: Vec<Duration>,
    /// Most messages in a row that did not arrive.
    longest_gap: usize,
}

impl Sent {
    fn percentile(&self, share: f64) -> Duration {
        value_after(&self.taken, share).expect("some arrived")
    }
}

/// The edge sends `count` messages of `bytes` at 60 Hz under `key`; fusion receives them.
async fn send(rig: &Rig, key: &str, count: usize, bytes: usize) -> Sent {
    let subscriber = rig.fusion.declare_subscriber(key);
    let subscriber = subscriber.with(FifoChannel::new(4096)).await.unwrap();
    let publisher = rig
        .edge
        .declare_publisher(key.to_owned())
        .reliability(Reliability::BestEffort)
        .congestion_control(CongestionControl::Drop)
        .priority(Priority::RealTime)
        .express(true)
        .await
        .unwrap();
    timeout(PATIENCE, async {
        while !publisher.matching_status().await.unwrap().matching() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    })
    .await
    .expect("no subscriber");
    #[expect(
        clippy::disallowed_methods,
        reason = "a test that measures is its own clock"
    )]
    let start = Instant::now();
    let sender = async {
        let mut ticks = interval(Duration::from_secs(1) / 60);
        for number in 0..count {
            ticks.tick().await;
            let mut payload = vec![0; bytes];
            payload[..8].copy_from_slice(&(number as u64).to_le_bytes());
            let now = start.elapsed().as_micros() as u64;
            payload[8..16].copy_from_slice(&now.to_le_bytes());
            publisher.put(payload).await.unwrap();
        }
    };
    let receiver = async {
        let mut arrivals = Vec::new();
        while let Ok(Ok(sample)) = timeout(Duration::from_secs(2), subscriber.recv_async()).await {
            let payload = sample.payload().to_bytes();
            let field = |at: usize| u64::from_le_bytes(payload[at..at + 8].try_into().unwrap());
            let sent = Duration::from_micros(field(8));
            let taken = start.elapsed().saturating_sub(sent);
            arrivals.push((field(0) as usize, taken));
            if field(0) as usize == count - 1 {
                break;
            }
        }
        arrivals
    };
    let ((), arrivals) = tokio::join!(sender, receiver);
    sum_up(arrivals)
}

fn sum_up(mut arrivals: Vec<(usize, Duration)>) -> Sent {
    arrivals.sort_unstable();
    let gaps = arrivals.windows(2).map(|pair| pair[1].0 - pair[0].0 - 1);
    let longest_gap = gaps.max().unwrap_or(0);
    let mut taken: Vec<Duration> = arrivals.iter().map(|(_, taken)| *taken).collect();
    taken.sort_unstable();
    Sent {
        arrived: taken.len(),
        taken,
        longest_gap,
    }
}

const QUIC: &str = "quic/127.0.0.1:PORT";
const PLAIN: &str = "udp/127.0.0.1:PORT";
/// Zenoh's default: datagrams that wait for the congestion controller.
const CUBIC: &str = "quic/127.0.0.1:PORT?mixed_rel=1#min_window=0;datagram_buffer=1048576";
const STREAM: &str = "quic/127.0.0.1:PORT?mixed_rel=0";

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn best_effort_messages_over_quic_are_lost_singly() {
    let faults = Faults {
        delay: Duration::from_millis(40),
        lose_every: 10,
    };
    for endpoint in [QUIC, PLAIN] {
        let rig = Rig::new(endpoint, faults).await;
        let sent = send(&rig, "links/patch/a", 200, 400).await;
        // A lost message stays lost, at most with the others of its packet.
        assert!(sent.arrived < 200, "{endpoint}: nothing was lost");
        assert!(sent.arrived > 100, "{endpoint}: {} arrived", sent.arrived);
    }
    // On a stream all messages arrive, late ones too.
    let rig = Rig::new(STREAM, faults).await;
    let sent = send(&rig, "links/patch/a", 200, 400).await;
    assert!(rig.relay.lost.load(Ordering::Relaxed) > 0);
    assert_eq!(sent.arrived, 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_of_maximal_size_is_one_datagram() {
    // Symptom to prevent: messages of 1200 bytes did not fit datagrams of 1150, so that every loss cost two messages.
    const COUNT: usize = 200;
    let faults = Faults {
        delay: Duration::from_millis(1),
        lose_every: 0,
    };
    let rig = Rig::new(QUIC, faults).await;
    let mut per_message = Vec::new();
    for bytes in [400, MESSAGE_BYTES, 2000] {
        let before = rig.relay.received.load(Ordering::Relaxed);
        send(&rig, "links/patch/a", COUNT, bytes).await;
        let received = rig.relay.received.load(Ordering::Relaxed) - before;
        println!(
            "{COUNT} messages of {bytes} bytes took {received} datagrams, acknowledgements included"
        );
        per_message.push(received as f64 / COUNT as f64);
    }
    // Two datagrams per message would be visible.
    assert!(per_message[1] < per_message[0] + 0.2, "{per_message:?}");
    assert!(per_message[2] > per_message[0] + 0.5, "{per_message:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn plain_udp_carries_messages_without_tls() {
    let rig = Rig::new("udp/127.0.0.1:PORT?rel=0", NO_FAULTS).await;
    let sent = send(&rig, "links/patch/a", 60, 400).await;
    assert!(sent.arrived > 30, "{} arrived", sent.arrived);
}

/// Prints a table, in minutes; `FARFIELD_MEASURE=1 cargo test -p farfield-fusion --test links -- --nocapture`.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn delivery_over_a_long_lossy_link_by_endpoint() {
    if std::env::var_os("FARFIELD_MEASURE").is_none() {
        println!("skipped: this measurement takes minutes; set FARFIELD_MEASURE to run it");
        return;
    }
    println!(
        "endpoint round_trip_ms lose_every bytes arrived_of_600 p50_ms p99_ms max_ms longest_gap"
    );
    let links = [(0, 0), (40, 0), (40, 100), (100, 20)];
    for endpoint in [QUIC, PLAIN, CUBIC, STREAM] {
        for (delay_ms, lose_every) in links {
            for bytes in [400, 1600] {
                let faults = Faults {
                    delay: Duration::from_millis(delay_ms),
                    lose_every,
                };
                let rig = Rig::new(endpoint, faults).await;
                let sent = send(&rig, "links/patch/a", 600, bytes).await;
                let ms = |share| sent.percentile(share).as_secs_f64() * 1e3;
                let arrived = sent.arrived;
                let gap = sent.longest_gap;
                println!(
                    "{endpoint} {} {lose_every} {bytes} {arrived} {:.1} {:.1} {:.1} {gap}",
                    2 * delay_ms,
                    ms(0.5),
                    ms(0.99),
                    ms(1.0),
                );
            }
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn access_control_checks_common_names_over_quic() {
    let rig = Rig::new(QUIC, NO_FAULTS).await;
    let subscriber = rig
        .fusion
        .declare_subscriber("links/patch/*")
        .await
        .unwrap();
    for (key, word) in [("links/patch/b", "stolen"), ("links/patch/a", "own")] {
        rig.edge.put(key, word).await.unwrap();
    }
    let sample = timeout(PATIENCE, subscriber.recv_async())
        .await
        .unwrap()
        .unwrap();
    assert_eq!(sample.key_expr().as_str(), "links/patch/a");
}
