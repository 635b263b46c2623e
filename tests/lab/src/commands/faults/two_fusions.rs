//! Two fusions of one venue started at the same moment: one works and one waits; then the first dies.

use std::net::{Ipv4Addr, UdpSocket};
use std::process::Command;
use std::thread;
use std::time::Duration;

use anyhow::ensure;
use farfield_node::clock;

use super::field::Field;
use super::strangers::make_keys;
use super::table::{FaultOutcome, Measure};
use crate::live_venue::NodeProcess;

/// Number of rounds.
const ROUNDS: u32 = 10;
/// Longest time until the waiting fusion listens after the other was killed, seconds: the lease of its link, and the time
/// until its old socket is free.
const TAKES_OVER_S: f64 = 8.0;
/// Time limit of all waits, seconds.
const PATIENCE_S: f64 = 30.0;
/// Pause between two polls.
const PAUSE: Duration = Duration::from_millis(20);

pub(super) fn two_fusions(field: &Field) -> anyhow::Result<FaultOutcome> {
    let folder = field.folder("two-fusions")?;
    let keys = make_keys(field, &folder)?;
    let (mut slowest_s, mut failures, mut began) = (0.0_f64, 0, 0);
    for round in 0..ROUNDS {
        let [one, other] = [free_endpoint()?, free_endpoint()?];
        let venue = field.maps.venue.with_file_name("two.toml");
        let text = std::fs::read_to_string(&field.maps.venue)?;
        std::fs::write(
            &venue,
            format!("{text}\n[fusion]\nconnect = [\"{one}\", \"{other}\"]\n"),
        )?;
        let start = |endpoint: &str| {
            let mut command = Command::new(&field.maps.program);
            command.arg("fusion").arg(&venue).args(["--live", "--out"]);
            command.arg(folder.join(format!("{round}-{}", endpoint.replace('/', "-"))));
            command.args(["--listen", endpoint, "--certificates"]);
            command.arg(&keys);
            NodeProcess::start(endpoint, command)
        };
        let both = [start(&one)?, start(&other)?];
        let waits = |node: &NodeProcess| node.output().contains("this one waits");
        wait(&both, |both| both.iter().any(waits))?;
        let [one, other] = both;
        let (first, mut second) = if waits(&other) {
            (one, other)
        } else {
            (other, one)
        };
        // Both may have begun to listen before one stepped back.
        began += usize::from(second.output().contains("fusion listens on"));
        first.kill()?;
        let from = clock::now();
        let listens = |node: &NodeProcess| node.output().contains("fusion listens on");
        match wait(std::slice::from_ref(&second), |it| listens(&it[0])) {
            Ok(()) => {
                slowest_s = slowest_s.max(clock::now().duration_since(from).as_secs_f64());
            }
            Err(_) => failures += 1,
        }
        ensure!(
            second.wait(PAUSE)?.is_none() || failures > 0,
            "{}",
            second.output()
        );
    }
    Ok(FaultOutcome::Measured(vec![
        Measure::limited("times none took over", f64::from(failures), 0.0),
        Measure::limited("slowest takeover, s", slowest_s, TAKES_OVER_S),
        Measure::limited("times both worked", began as f64, 0.0),
        Measure::reported("times two were started", f64::from(ROUNDS)),
    ]))
}

/// A free endpoint of this machine.
fn free_endpoint() -> anyhow::Result<String> {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    Ok(format!("quic/{}", socket.local_addr()?))
}

/// Waits until a condition holds.
fn wait(nodes: &[NodeProcess], condition: impl Fn(&[NodeProcess]) -> bool) -> anyhow::Result<()> {
    let from = clock::now();
    while !condition(nodes) {
        let waited_s = clock::now().duration_since(from).as_secs_f64();
        let output: String = nodes.iter().map(NodeProcess::output).collect();
        ensure!(waited_s < PATIENCE_S, "not within {PATIENCE_S} s\n{output}");
        thread::sleep(PAUSE);
    }
    Ok(())
}
