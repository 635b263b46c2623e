//! Garbage before fusion's door, while somebody with a key joins.

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

use super::field::Field;
use super::table::{Driven, Measure};
use crate::live_venue::{NodeProcess, Vitals};

/// How soon a node must have joined, seconds.
const JOIN_S: f64 = 1.0;
/// How long one may take until it is given up, milliseconds.
const JOIN_PATIENCE_MS: &str = "15000";
/// Threads that say garbage, and how long each waits between two of its goes: about three thousand in half a minute.
const STRANGERS: u64 = 4;
const STRANGER_PAUSE: Duration = Duration::from_millis(20);
/// Connections that are open and silent: more than [`FEW_HANDLES`].
const SILENT: usize = 1100;
/// Handles that fusion may open, as many systems have it.
const FEW_HANDLES: usize = 1024;
/// The beginning of a TLS handshake, after which nothing comes.
const HALF_A_HELLO: [u8; 4] = [0x16, 3, 1, 2];
/// How long a venue may take to give its first poses.
const BEGINS_WITHIN: Duration = Duration::from_mins(1);
/// Bytes of a go: what a first QUIC datagram has at least.
const GARBAGE_BYTES: usize = 1200;

/// Ticks that may be missing while strangers come, seconds of them.
const MISSING_TICKS_S: f64 = 0.5;

/// A door of fusion, open to who has a key.
struct Door {
    address: SocketAddr,
    endpoint: String,
    keys: PathBuf,
    viewpoint: String,
    venue: String,
    fusion: NodeProcess,
}

pub(super) fn garbage_quic(field: &Field) -> anyhow::Result<Driven> {
    let free = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
    let door = open(field, "quic", free)?;
    drive(field, &door, datagrams, Vec::<TcpStream>::new)
}

pub(super) fn garbage_tls(field: &Field) -> anyhow::Result<Driven> {
    let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
    let door = open(field, "tls", free)?;
    drive(field, &door, connections, || silent(&door))
}

/// More silent connections than fusion has handles, while it works.
pub(super) fn few_handles(field: &Field) -> anyhow::Result<Driven> {
    let free = TcpListener::bind((Ipv4Addr::LOCALHOST, 0))?.local_addr()?;
    let door = open(field, "tls", free)?;
    let _edges = edges(field, &door)?;
    let from = clock::now();
    while door.fusion.newest().is_none_or(|(_, persons)| persons == 0) {
        ensure!(
            clock::now().duration_since(from) < BEGINS_WITHIN,
            "no poses come\n{}",
            door.fusion.output()
        );
        thread::sleep(STRANGER_PAUSE);
    }
    let held = silent(&door);
    thread::sleep(STRANGER_PAUSE * 50);
    let newest = || door.fusion.newest().map_or(0, |(tick, _)| tick);
    let (from, span_s) = (newest(), field.either(15.0, 5.0));
    thread::sleep(Duration::from_secs_f64(span_s));
    let rate_hz = farfield_node::files::load_venue(&field.maps.venue)?.rate_hz;
    let missing_s = span_s - (newest() - from) as f64 / rate_hz;
    let slowest_s = (0..3).map(|_| join(&door).unwrap_or(f64::INFINITY));
    let slowest_s = slowest_s.fold(0.0, f64::max);
    let said = door.fusion.output();
    let complaints = said.lines().filter(|line| line.contains("open files"));
    let vitals = door.fusion.vitals();
    let vitals = vitals.with_context(|| format!("fusion has ended\n{said}"))?;
    Ok(Driven::Measured(vec![
        Measure::barred("ticks that are missing, s", missing_s, MISSING_TICKS_S),
        Measure::barred("slowest of three joins, s", slowest_s, JOIN_S),
        Measure::barred("times it lacked a handle", complaints.count() as f64, 0.0),
        Measure::told("silent connections", held.len() as f64),
        Measure::told("fusion's handles meanwhile", f64::from(vitals.handles)),
    ]))
}

/// Connections that begin a handshake and go no further.
fn silent(door: &Door) -> Vec<TcpStream> {
    let connect = || -> std::io::Result<TcpStream> {
        let mut connection = TcpStream::connect(door.address)?;
        connection.write_all(&HALF_A_HELLO)?;
        Ok(connection)
    };
    (0..SILENT).filter_map(|_| connect().ok()).collect()
}

/// All edges of the venue, with their keys.
fn edges(field: &Field, door: &Door) -> anyhow::Result<Vec<NodeProcess>> {
    let venue = farfield_node::files::load_venue(&field.maps.venue)?;
    let start = |name: &str| {
        let mut command = Command::new(&field.maps.program);
        command.arg("edge").arg(&field.maps.venue);
        command.args(["--managed", "--viewpoint", name, "--connect"]);
        command.args([door.endpoint.as_str(), "--certificates"]);
        command.arg(&door.keys).arg("--ring");
        command.arg(door.keys.with_file_name("rings").join(name));
        NodeProcess::start(name, command)
    };
    let edges = venue.viewpoints.iter().map(|it| start(&it.name));
    Ok(edges.collect::<std::io::Result<_>>()?)
}

/// Makes keys, and starts fusion behind them.
fn open(field: &Field, scheme: &str, address: SocketAddr) -> anyhow::Result<Door> {
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
        .arg(made_folder(&folder)?);
    let venue = farfield_node::files::load_venue(venue_path)?;
    Ok(Door {
        address,
        endpoint,
        keys,
        viewpoint: venue.viewpoints[0].name.clone(),
        venue: venue.name,
        fusion: NodeProcess::start("fusion", command)?,
    })
}

/// Keys of the venue's nodes, in a folder below `folder`.
pub(super) fn make_keys(field: &Field, folder: &Path) -> anyhow::Result<PathBuf> {
    let keys = folder.join("certs");
    let made = Command::new(&field.maps.program)
        .arg("certs")
        .arg(&field.maps.venue)
        .arg("--out")
        .arg(&keys)
        .output()?;
    let said = String::from_utf8_lossy(&made.stderr);
    ensure!(made.status.success(), "making keys: {said}");
    Ok(keys)
}

fn made_folder(folder: &Path) -> std::io::Result<PathBuf> {
    let out = folder.join("out");
    std::fs::create_dir_all(&out)?;
    Ok(out)
}

/// Joins in peace, and then while `garbage` is said and `silent` connections are held.
fn drive<T>(
    field: &Field,
    door: &Door,
    garbage: impl Fn(&Door, &AtomicBool, &AtomicU64, u64) + Sync,
    silent: impl FnOnce() -> Vec<T>,
) -> anyhow::Result<Driven> {
    // The first one waits until fusion listens.
    join(door)?;
    let in_peace_s = join(door)?;
    let (is_over, said) = (AtomicBool::new(false), AtomicU64::new(0));
    let held = silent();
    let (joined, handles) = thread::scope(|scope| {
        for seed in 0..STRANGERS {
            let (garbage, is_over, said) = (&garbage, &is_over, &said);
            scope.spawn(move || garbage(door, is_over, said, seed));
        }
        thread::sleep(Duration::from_secs_f64(field.either(20.0, 3.0)));
        let joined: anyhow::Result<Vec<f64>> = (0..3).map(|_| join(door)).collect();
        let handles = door.fusion.vitals().map(|vitals: Vitals| vitals.handles);
        is_over.store(true, Ordering::Relaxed);
        (joined, handles)
    });
    let slowest_s = joined.map_or(f64::INFINITY, |all| all.into_iter().fold(0.0, f64::max));
    let handles = handles.with_context(|| format!("fusion has ended\n{}", door.fusion.output()))?;
    Ok(Driven::Measured(vec![
        Measure::barred("slowest of three joins under garbage, s", slowest_s, JOIN_S),
        Measure::told("a join in peace, s", in_peace_s),
        Measure::told(
            "garbage that was said, times",
            said.load(Ordering::Relaxed) as f64,
        ),
        Measure::told("silent connections", held.len() as f64),
        Measure::told("fusion's handles meanwhile", f64::from(handles)),
    ]))
}

/// A session of the first viewpoint's key, opened and closed; how long the opening took, seconds.
fn join(door: &Door) -> anyhow::Result<f64> {
    let identity = Identity::in_folder(&door.keys, &door.viewpoint);
    let connect = [door.endpoint.clone()];
    let transport = EdgeTransport {
        venue: &door.venue,
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

/// Datagrams that look like the first of a QUIC connection, each from a port of its own.
fn datagrams(door: &Door, is_over: &AtomicBool, said: &AtomicU64, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    while !is_over.load(Ordering::Relaxed) {
        let mut bytes: Vec<u8> = (0..GARBAGE_BYTES).map(|_| rng.random()).collect();
        // An Initial packet of version 1 (RFC 9000, section 17.2.2) with a connection id of 8 bytes.
        bytes[..6].copy_from_slice(&[0xc3, 0, 0, 0, 1, 8]);
        let sent = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))
            .and_then(|socket| socket.send_to(&bytes, door.address));
        said.fetch_add(u64::from(sent.is_ok()), Ordering::Relaxed);
        thread::sleep(STRANGER_PAUSE);
    }
}

/// Connections that say what no TLS handshake begins with, and close.
fn connections(door: &Door, is_over: &AtomicBool, said: &AtomicU64, seed: u64) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    while !is_over.load(Ordering::Relaxed) {
        let bytes: Vec<u8> = (0..GARBAGE_BYTES).map(|_| rng.random()).collect();
        let sent = TcpStream::connect(door.address).and_then(|mut it| it.write_all(&bytes));
        said.fetch_add(u64::from(sent.is_ok()), Ordering::Relaxed);
        thread::sleep(STRANGER_PAUSE);
    }
}
