//! Reasons for refusals are known only from Zenoh's log. These tests provoke every refusal over both encrypted
//! transports. If Zenoh or TLS changes its wording, they fail: update the word lists in
//! `fusion/node/src/session/authentication_log.rs` and `edge/src/node/attempts.rs`.

use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use farfield_lab::live_venue::NodeProcess;
use farfield_proto::transport::{FUSION, FusionTransport, Identity, common_name};
use rcgen::{CertificateParams, DnType, ExtendedKeyUsagePurpose, Issuer, KeyPair};
use zenoh::{Session, Wait as _};

use super::keys::{edge, fusion, has_printed, wait_for};
use super::{SecuredHall, TRY, VIEWPOINTS, enter_blocking};
use crate::farfield::farfield;

const DAY: Duration = Duration::from_hours(24);

/// A certificate to create.
struct CertificateRequest<'a> {
    common_name: &'a str,
    /// Host name or address that the certificate is valid for.
    host: &'a str,
    /// Start and end of validity, days from now.
    valid_days: [i64; 2],
}

impl CertificateRequest<'_> {
    /// Signs it with the authority of `hall`, in a folder of its own.
    fn make(&self, hall: &SecuredHall) -> Identity {
        let read = |name: &str| std::fs::read_to_string(hall.path(name)).unwrap();
        let key = KeyPair::from_pem(&read("certs-authority/ca.key")).unwrap();
        let issuer = Issuer::from_ca_cert_pem(&read("certs/ca.pem"), key).unwrap();
        let mut params = CertificateParams::new(vec![self.host.to_owned()]).unwrap();
        params.distinguished_name = rcgen::DistinguishedName::new();
        params
            .distinguished_name
            .push(DnType::CommonName, self.common_name);
        params.extended_key_usages = vec![
            ExtendedKeyUsagePurpose::ServerAuth,
            ExtendedKeyUsagePurpose::ClientAuth,
        ];
        let at = |days: i64| match u32::try_from(days) {
            Ok(days) => SystemTime::now() + DAY * days,
            Err(_) => SystemTime::now() - DAY * days.unsigned_abs() as u32,
        };
        (params.not_before, params.not_after) =
            (at(self.valid_days[0]).into(), at(self.valid_days[1]).into());
        let key = KeyPair::generate().unwrap();
        let certificate = params.signed_by(&key, &issuer).unwrap();
        let folder = hall.path(&format!("made-{}", key.serialize_pem().len()));
        let folder = (0..1000)
            .map(|n| folder.with_extension(n.to_string()))
            .find(|path| !path.exists());
        let folder: PathBuf = folder.unwrap();
        std::fs::create_dir(&folder).unwrap();
        let identity = Identity {
            authority: hall.path("certs/ca.pem"),
            ..Identity::in_folder(&folder, "node")
        };
        std::fs::write(&identity.certificate, certificate.pem()).unwrap();
        std::fs::write(&identity.key, key.serialize_pem()).unwrap();
        identity
    }
}

/// The hall at an endpoint of `scheme`, with keys of another authority in `elsewhere`, and a second generation of
/// north-east's key.
fn hall_at(scheme: &str) -> SecuredHall {
    let mut hall = SecuredHall::new();
    let address = if scheme == "tls" {
        TcpListener::bind("127.0.0.1:0").unwrap().local_addr()
    } else {
        UdpSocket::bind("127.0.0.1:0").unwrap().local_addr()
    };
    hall.endpoint = format!("{scheme}/{}", address.unwrap());
    hall.certs("elsewhere");
    let words = [
        "certs".into(),
        hall.path("venue.toml"),
        "--out".into(),
        hall.path("certs"),
    ];
    let renewed = farfield(&[&words[..], &["--renew".into(), "north-east".into()]].concat());
    assert_eq!(renewed.code, 0, "{}", renewed.stderr);
    hall
}

/// A stranger tries to connect; waits until `node` prints `words`.
fn is_refused(
    hall: &SecuredHall,
    identity: &Identity,
    is_bare: bool,
    node: &NodeProcess,
    words: &str,
) {
    let tls = format!(
        "{{ root_ca_certificate: {:?}, enable_mtls: false }}",
        hall.path("certs/ca.pem").to_str().unwrap()
    );
    let change = [("transport/link/tls", tls)];
    let change = if is_bare { &change[..] } else { &[] };
    let session = enter_blocking(hall, identity, change, TRY);
    if let Some(session) = &session {
        // Its actions are refused, not its session.
        session.put("walk/patch/north-west", "lie").wait().unwrap();
        let token = session.liveliness().declare_token("walk/alive/north-west");
        drop(token.wait().unwrap());
    }
    wait_for(node, words);
}

fn check_refusals_of_fusion(scheme: &str) {
    let hall = hall_at(scheme);
    let fusion = fusion(&hall, "out");
    wait_for(&fusion, "listens on");
    let make = |common_name: &str, valid_days| {
        let host = "127.0.0.1";
        CertificateRequest {
            common_name,
            host,
            valid_days,
        }
        .make(&hall)
    };
    let mut foreign = hall.identity("elsewhere", "north-east");
    foreign.authority = hall.path("certs/ca.pem");
    let strict = hall.identity("elsewhere", "north-east");
    let good = || hall.identity("certs", "north-east");
    let current = common_name("walk", "north-east", 2);
    let strangers = [
        (
            foreign,
            false,
            "refused a node: its certificate is not of this venue's authority",
        ),
        (
            strict,
            false,
            "a node rejects fusion's certificate: its authority is another one",
        ),
        (good(), true, "refused a node: it has no certificate"),
        (
            make(&current, [-9, -2]),
            false,
            "refused a node: its certificate has run out",
        ),
        (
            make(&current, [2, 9]),
            false,
            "refused a node: its certificate is not valid yet",
        ),
        (
            make("walk/unknown", [-1, 9]),
            false,
            "whose certificate names no node of this venue",
        ),
        (
            make("walk/north-east/1", [-1, 9]),
            false,
            "the node of certificate walk/north-east/1: north-east has newer keys",
        ),
        (
            good(),
            false,
            "refused the node of certificate walk/north-east/2: ",
        ),
    ];
    // All at once, since most try as long as they may. On threads, because Zenoh blocks on the parker of the thread: a session
    // that closes inside a future can swallow the wake-up of another future.
    std::thread::scope(|scope| {
        for (identity, is_bare, words) in &strangers {
            scope.spawn(|| is_refused(&hall, identity, *is_bare, &fusion, words));
        }
    });
}

#[test]
fn fusion_recognises_every_refusal_in_zenohs_log_over_quic() {
    check_refusals_of_fusion("quic");
}

#[test]
fn fusion_recognises_every_refusal_in_zenohs_log_over_tls() {
    check_refusals_of_fusion("tls");
}

/// A router with fusion's access control and the given certificate.
fn listen(hall: &SecuredHall, identity: &Identity) -> Session {
    let listen = [hall.endpoint.clone()];
    let transport = FusionTransport {
        venue: "walk",
        viewpoints: &VIEWPOINTS,
        listen: &listen,
        identity: Some(identity),
    };
    let mut config = zenoh::Config::default();
    for (key, value) in transport.settings() {
        config.insert_json5(&key, &value).unwrap();
    }
    zenoh::open(config).wait().unwrap()
}

fn check_waiting_edges(scheme: &str) {
    let start = |hall: &SecuredHall, keys: &Path| {
        let mut command = edge(hall, &hall.path("venue.toml"), "north-east");
        command.arg("--certificates").arg(keys);
        NodeProcess::start("edge", command).unwrap()
    };
    let name = common_name("walk", FUSION, 1);
    let good = CertificateRequest {
        common_name: &name,
        host: "127.0.0.1",
        valid_days: [-1, 9],
    };
    let mut waiting = Vec::new();
    for (server, words) in [
        (
            Some(CertificateRequest {
                valid_days: [-9, -2],
                ..good
            }),
            "fusion's certificate has expired",
        ),
        (
            Some(CertificateRequest {
                valid_days: [2, 9],
                ..good
            }),
            "fusion's certificate is not valid yet",
        ),
        (
            Some(CertificateRequest {
                host: "elsewhere.lan",
                ..good
            }),
            "fusion's certificate is not valid for that address",
        ),
        (None, "has a certificate of another venue"),
    ] {
        let hall = hall_at(scheme);
        let identity = match server {
            Some(wanted) => wanted.make(&hall),
            None => hall.identity("elsewhere", FUSION),
        };
        let (session, edge) = (listen(&hall, &identity), start(&hall, &hall.path("certs")));
        waiting.push((Some(session), edge, words, hall));
    }
    let hall = hall_at(scheme);
    // Its certificate is of another authority than fusion's, and it trusts both.
    let both = ["certs/ca.pem", "elsewhere/ca.pem"];
    let both = both.map(|file| std::fs::read_to_string(hall.path(file)).unwrap());
    std::fs::write(hall.path("elsewhere/ca.pem"), both.concat()).unwrap();
    let session = listen(&hall, &hall.identity("certs", FUSION));
    let edge = start(&hall, &hall.path("elsewhere"));
    waiting.push((
        Some(session),
        edge,
        "it rejects this edge's certificate",
        hall,
    ));
    let hall = hall_at(scheme);
    let edge = start(&hall, &hall.path("certs"));
    let words = if scheme == "tls" {
        "no node listens there"
    } else {
        "no answer from there"
    };
    waiting.push((None, edge, words, hall));
    let output: Vec<bool> = waiting
        .iter()
        .map(|(_, edge, words, _)| has_printed(edge, words))
        .collect();
    for ((_, edge, words, _), has_printed) in waiting.iter().zip(output) {
        assert!(
            has_printed,
            "{scheme}: the edge did not print: {words}\n{}",
            edge.output()
        );
    }
}

#[test]
fn an_edge_recognises_in_zenohs_log_why_it_waits_over_quic() {
    check_waiting_edges("quic");
}

#[test]
fn an_edge_recognises_in_zenohs_log_why_it_waits_over_tls() {
    check_waiting_edges("tls");
}
