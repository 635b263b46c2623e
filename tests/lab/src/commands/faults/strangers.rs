//! Garbage and silent connections at fusion's endpoint while a node with a key joins.

use std::io::Write as _;
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, anyhow, ensure};
use farfield_node::clock;
use farfield_proto::transport::{EdgeTransport, Identity};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use zenoh::Wait as _;

use super::stage::Field;
use super::table::{FaultOutcome, Measure};
use crate::live_venue::{NodeProcess, Vitals};

/// Longest time until a node has joined, seconds.
const JOIN_S: f64 = 1.0;
/// Time limit of a join, milliseconds.
const JOIN_PATIENCE_MS: &str = "15000";
/// Threads that send garbage, and the pause between their datagrams or connections: about three thousand in half a minute.
const STRANGERS: u64 = 4;
const STRANGER_PAUSE: Duration = Duration::from_millis(20);
/// Open and silent connections: more than [`FEW_HANDLES`].
const SILENT: usize = 1100;
/// Limit of fusion's file handles, a common default.
const FEW_HANDLES: usize = 1024;
/// The beginning of a TLS handshake that never continues.
const HALF_A_HELLO: [u8; 4] = [0x16, 3, 1, 2];
/// Longest time until the first poses of a venue.
const BEGINS_WITHIN: Duration = Duration::from_mins(1);
/// Bytes of a message of garbage: the minimum of a first QUIC datagram.
const GARBAGE_BYTES: usize = 1200;

/// Largest number of missing ticks while strangers connect, as seconds.
const MISSING_TICKS_S: f64 = 0.5;

/// A fusion that accepts nodes with keys.
struct Target {
    address: SocketAddr,
    endpoint: String,
    keys: PathBuf,
    viewpoint: String,
    venue: String,
    fusion: NodeProcess,
}

pub(super) fn garbage_quic(field: &Field) -> anyhow::Result<FaultOutcome> {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
    let target = open(field, "quic", free)?;
    drive(field, &target, datagrams, Vec::<TcpStream>::new)
}

pub(super) fn garbage_tls(field: &Field) -> anyhow::Result<FaultOutcome> {
    let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
    let target = open(field, "tls", free)?;
    drive(field, &target, connections, || silent(&target))
}

/// More silent connections than fusion has handles, while it works.
pub(super) fn few_handles(field: &Field) -> anyhow::Result<FaultOutcome> {
    let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
    let target = open(field, "tls", free)?;
    let _edges = edges(field, &target)?;
    let from = clock::now();
    while target
        .fusion
        .newest()
        .is_none_or(|(_, persons)| persons == 0)
    {
        ensure!(
            clock::now().duration_since(from) < BEGINS_WITHIN,
            "no poses come\n{}",
            target.fusion.output()
        );
        thread::sleep(STRANGER_PAUSE);
    }
    let held = silent(&target);
    thread::sleep(STRANGER_PAUSE * 50);
    let newest = || target.fusion.newest().map_or(0, |(tick, _)| tick);
    let (from, span_s) = (newest(), field.whole_or_quick(15.0, 5.0));
    thread::sleep(Duration::from_secs_f64(span_s));
    let rate_hz = farfield_node::files::load_venue(&field.maps.venue)?.rate_hz;
    let missing_s = span_s - (newest() - from) as f64 / rate_hz;
    let slowest_s = (0..3).map(|_| join(&target).unwrap_or(f64::INFINITY));
    let slowest_s = slowest_s.fold(0.0, f64::max);
    let log = target.fusion.output();
    let complaints = log.lines().filter(|line| line.contains("open files"));
    let vitals = target.fusion.vitals();
    let vitals = vitals.with_context(|| format!("fusion has ended\n{log}"))?;
    Ok(FaultOutcome::Measured(vec![
        Measure::limited("ticks that are missing, s", missing_s, MISSING_TICKS_S),
        Measure::limited("slowest of three joins, s", slowest_s, JOIN_S),
        Measure::limited(
            "times without a free handle",
            complaints.count() as f64,
            0.0,
        ),
        Measure::reported("silent connections", held.len() as f64),
        Measure::reported("fusion's handles meanwhile", f64::from(vitals.handles)),
    ]))
}

/// Connections that begin a handshake and never continue.
fn silent(target: &Target) -> Vec<TcpStream> {
    let connect = || -> std::io::Result<TcpStream> {
        let mut connection = TcpStream::connect(target.address)?;
        connection.write_all(&HALF_A_HELLO)?;
        Ok(connection)
    };
    (0..SILENT).filter_map(|_| connect().ok()).collect()
}

/// Starts all edges of the venue with their keys.
fn edges(field: &Field, target: &Target) -> anyhow::Result<Vec<NodeProcess>> {
    let venue = farfield_node::files::load_venue(&field.maps.venue)?;
    let start = |name: &str| {
        let mut command = Command::new(&field.maps.program);
        command.arg("edge").arg(&field.maps.venue);
        command.args(["--managed", "--viewpoint", name, "--connect"]);
        command.args([target.endpoint.as_str(), "--certificates"]);
        command.arg(&target.keys).arg("--ring");
        command.arg(target.keys.with_file_name("rings").join(name));
        NodeProcess::start(name, command)
    };
    let edges = venue.viewpoints.iter().map(|it| start(&it.name));
    Ok(edges.collect::<std::io::Result<_>>()?)
}

/// Creates keys and starts fusion with them.
fn open(field: &Field, scheme: &str, address: SocketAddr) -> anyhow::Result<Target> {
    let folder = field.folder(&format!("garbage-{scheme}"))?;
    let keys = make_keys(field, &folder)?;
    let (program, venue_path) = (&field.maps.program, &field.maps.venue);
    let endpoint = format!("{scheme}/{address}");
    let mut command = Command::new("sh");
    let limited = format!("ulimit -n {FEW_HANDLES}; exec \"$@\"");
    command.args(["-c", limited.as_str(), "sh"]).arg(program);
    command
        .arg("fusion")
        .arg(venue_path)
        .args(["--live", "--managed", "--certificates"]);
    command
        .arg(&keys)
        .args(["--listen", &endpoint, "--out"])
        .arg(output_folder(&folder)?);
    let venue = farfield_node::files::load_venue(venue_path)?;
    Ok(Target {
        address,
        endpoint,
        keys,
        viewpoint: venue.viewpoints[0].name.clone(),
        venue: venue.name,
        fusion: NodeProcess::start("fusion", command)?,
    })
}

/// Creates keys of the venue's nodes in a folder below `folder`.
pub(super) fn make_keys(field: &Field, folder: &Path) -> anyhow::Result<PathBuf> {
    let keys = folder.join("certs");
    let made = Command::new(&field.maps.program)
        .arg("certs")
        .arg(&field.maps.venue)
        .arg("--out")
        .arg(&keys)
        .output()?;
    let stderr = String::from_utf8_lossy(&made.stderr);
    ensure!(made.status.success(), "making keys: {stderr}");
    Ok(keys)
}

fn output_folder(folder: &Path) -> std::io::Result<PathBuf> {
    let out = folder.join("out");
    std::fs::create_dir_all(&out)?;
    Ok(out)
}

/// Measures joins without disturbance, and then with `garbage` and `silent` connections.
fn drive<T>(
    field: &Field,
    target: &Target,
    garbage: impl Fn(&Target, &AtomicBool, &AtomicU64, u64) + Sync,
    silent: impl FnOnce() -> Vec<T>,
) -> anyhow::Result<FaultOutcome> {
    // The first join waits until fusion listens.
    join(target)?;
    let undisturbed_s = join(target)?;
    let (is_over, n_sent) = (AtomicBool::new(false), AtomicU64::new(0));
    let held = silent();
    let (joined, handles) = thread::scope(|scope| {
        for seed in 0..STRANGERS {
            let (garbage, is_over, n_sent) = (&garbage, &is_over, &n_sent);
            scope.spawn(move || garbage(target, is_over, n_sent, seed));
        }
        thread::sleep(Duration::from_secs_f64(field.whole_or_quick(20.0, 3.0)));
        let joined: anyhow::Result<Vec<f64>> = (0..3).map(|_| join(target)).collect();
        let handles = target.fusion.vitals().map(|vitals: Vitals| vitals.handles);
        is_over.store(true, Ordering::Relaxed);
        (joined, handles)
    });
    let slowest_s = joined.map_or(f64::INFINITY, |all| all.into_iter().fold(0.0, f64::max));
    let handles =
        handles.with_context(|| format!("fusion has ended\n{}", target.fusion.output()))?;
    Ok(FaultOutcome::Measured(vec![
        Measure::limited("slowest of three joins under garbage, s", slowest_s, JOIN_S),
        Measure::reported("an undisturbed join, s", undisturbed_s),
        Measure::reported("messages of garbage", n_sent.load(Ordering::Relaxed) as f64),
        Measure::reported("silent connections", held.len() as f64),
        Measure::reported("fusion's handles meanwhile", f64::from(handles)),
    ]))
}

/// Opens and closes a session with the first viewpoint's key; duration of opening, seconds.
fn join(target: &Target) -> anyhow::Result<f64> {
    let identity = Identity::in_folder(&target.keys, &target.viewpoint);
    let connect = [target.endpoint.clone()];
    let transport = EdgeTransport {
        venue: &target.venue,
        connect: &connect,
        identity: Some(&identity),
    };
    let mut config = zenoh::Config::default();
    let mut settings = transport.settings();
    for (key, value) in [
        ("connect/timeout_ms", JOIN_PATIENCE_MS),
        ("connect/exit_on_failure", "true"),
    ] {
        settings.push((key.to_owned(), value.to_owned()));
    }
    for (key, value) in settings {
        config
            .insert_json5(&key, &value)
            .map_err(|error| anyhow!("{key}: {error}"))?;
    }
    let from = clock::now();
    let session = zenoh::open(config)
        .wait()
        .map_err(|error| anyhow!("{error}"))?;
    let took = clock::now().duration_since(from);
    session.close().wait().map_err(|error| anyhow!("{error}"))?;
    Ok(took.as_secs_f64())
}

/// Sends datagrams that look like the first of a QUIC connection, each from a port of its own.
fn datagrams(target: &Target, is_over: &AtomicBool, n_sent: &AtomicU64, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    while !is_over.load(Ordering::Relaxed) {
        let mut bytes: Vec<u8> = (0..GARBAGE_BYTES).map(|_| rng.random()).collect();
        // An Initial packet of version 1 (RFC 9000, section 17.2.2) with a connection id of 8 bytes.
        bytes[..6].copy_from_slice(&[0xc3, 0, 0, 0, 1, 8]);
        let sent = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
            .and_then(|socket| socket.send_to(&bytes, target.address));
        n_sent.fetch_add(u64::from(sent.is_ok()), Ordering::Relaxed);
        thread::sleep(STRANGER_PAUSE);
    }
}

/// Opens connections, sends bytes that no TLS handshake begins with, and closes them.
fn connections(target: &Target, is_over: &AtomicBool, n_sent: &AtomicU64, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    while !is_over.load(Ordering::Relaxed) {
        let bytes: Vec<u8> = (0..GARBAGE_BYTES).map(|_| rng.random()).collect();
        let sent = TcpStream::connect(target.address).and_then(|mut it| it.write_all(&bytes));
        n_sent.fetch_add(u64::from(sent.is_ok()), Ordering::Relaxed);
        thread::sleep(STRANGER_PAUSE);
    }
}
