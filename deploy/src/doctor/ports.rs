//! The endpoints of fusion: whether they are free, and which process has them.

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener, ToSocketAddrs as _, UdpSocket};
use std::path::Path;

use farfield_proto::transport::endpoint::{host, scheme};
use farfield_proto::venue::Venue;

use super::exposure;
use crate::report_lines::ReportLines;

const PORTS: &str = "ports";
/// Process names of a fusion.
const OURS: [&str; 2] = ["farfield", "farfield-fusion"];

/// Whether the checked venue runs now: then its fusion has its ports, which is no fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum VenueRuns {
    /// Its fusion answered at the endpoint of the venue file.
    Now,
    /// No fusion answered, or none was queried.
    No,
}

/// Checks every endpoint of fusion by binding it for a moment.
pub(super) fn check_ports(venue: Option<&Venue>, runs: VenueRuns, report: &mut ReportLines) {
    let known = venue.map_or(&[][..], |venue| &venue.endpoints.listen);
    let endpoints = match exposure(venue).choose(Vec::new(), known) {
        Ok(endpoints) => endpoints,
        Err(error) => {
            report.fail(PORTS, error.to_string(), "farfield certs VENUE --out certs");
            return;
        }
    };
    for endpoint in &endpoints {
        check_endpoint(endpoint, runs, report);
    }
}

fn check_endpoint(endpoint: &str, runs: VenueRuns, report: &mut ReportLines) {
    let Some(port) = port(endpoint) else {
        report.fail(
            PORTS,
            format!("{endpoint} has no port"),
            "listen = [\"quic/0.0.0.0:7447\"]",
        );
        return;
    };
    let found = (host(endpoint), port).to_socket_addrs();
    let Some(address) = found.ok().and_then(|mut all| all.next()) else {
        report.fail(
            PORTS,
            format!("{endpoint}: host `{}` does not exist", host(endpoint)),
            "set `[fusion] listen` to an address of the fusion computer, or to 0.0.0.0",
        );
        return;
    };
    let is_datagram = matches!(scheme(endpoint), "quic" | "udp");
    let bound = if is_datagram {
        UdpSocket::bind(address).map(drop)
    } else {
        TcpListener::bind(address).map(drop)
    };
    match bound {
        Ok(()) => report.ok(PORTS, format!("{endpoint} is free")),
        Err(error) if error.kind() == ErrorKind::AddrInUse => {
            taken(endpoint, address, is_datagram, runs, report);
        }
        Err(error) if error.kind() == ErrorKind::AddrNotAvailable => report.warn(
            PORTS,
            format!("{endpoint} is not an address of this machine"),
            "on the fusion computer, correct `[fusion] listen`; on an edge computer this is normal",
        ),
        Err(error) => report.fail(
            PORTS,
            format!("cannot listen on {endpoint}: {error}"),
            "choose a port above 1023 in `[fusion] listen`",
        ),
    }
}

fn taken(
    endpoint: &str,
    address: SocketAddr,
    is_datagram: bool,
    runs: VenueRuns,
    report: &mut ReportLines,
) {
    let owner = owner(Path::new("/proc"), address.port(), is_datagram);
    let is_ours = |(_, name): &(u32, String)| OURS.contains(&name.as_str());
    // Only its own user and root can see the owner, and builds have names of their own.
    let may_be_ours = owner
        .as_ref()
        .is_none_or(|(_, name)| name.starts_with(OURS[0]));
    if runs == VenueRuns::Now && may_be_ours {
        report.ok(
            PORTS,
            format!("{endpoint} is in use by this venue's fusion"),
        );
        return;
    }
    let by = owner.as_ref().map_or_else(
        || "another program".to_owned(),
        |(id, name)| format!("`{name}` (process {id})"),
    );
    let text = format!("{endpoint} is taken by {by}");
    if owner.as_ref().is_some_and(is_ours) {
        report.warn(
            PORTS,
            text,
            "end that run first, if it belongs to another venue",
        );
    } else {
        let end = owner.map_or_else(|| "end it".to_owned(), |(id, _)| format!("kill {id}"));
        report.fail(
            PORTS,
            text,
            format!("{end}, or choose another port in `[fusion] listen`"),
        );
    }
}

/// Id and name of the process that has the port, read from the kernel's `proc`.
fn owner(proc: &Path, port: u16, is_datagram: bool) -> Option<(u32, String)> {
    let tables = if is_datagram {
        ["udp", "udp6"]
    } else {
        ["tcp", "tcp6"]
    };
    let texts = tables
        .map(|table| std::fs::read_to_string(proc.join("net").join(table)).unwrap_or_default());
    let sockets: Vec<String> = texts
        .iter()
        .flat_map(|text| text.lines().skip(1))
        .filter_map(|line| socket_at(line, port))
        .map(|inode| format!("socket:[{inode}]"))
        .collect();
    let has = |folder: &Path| {
        let handles = std::fs::read_dir(folder.join("fd"))
            .into_iter()
            .flatten()
            .flatten();
        let mut targets = handles.filter_map(|handle| std::fs::read_link(handle.path()).ok());
        targets.any(|target| {
            sockets
                .iter()
                .any(|socket| target.as_os_str() == socket.as_str())
        })
    };
    let processes = std::fs::read_dir(proc).ok()?.flatten();
    let found = processes.filter_map(|entry| {
        Some((
            entry.file_name().to_str()?.parse::<u32>().ok()?,
            entry.path(),
        ))
    });
    let (id, folder) = found.into_iter().find(|(_, folder)| has(folder))?;
    let name = std::fs::read_to_string(folder.join("comm")).unwrap_or_default();
    Some((id, name.trim().to_owned()))
}

/// The inode of the socket in a line of the kernel's table, if its local port is `port`.
fn socket_at(line: &str, port: u16) -> Option<&str> {
    let mut fields = line.split_whitespace();
    let local = fields.nth(1)?;
    let found = u16::from_str_radix(local.rsplit_once(':')?.1, 16).ok()?;
    (found == port).then(|| fields.nth(7)).flatten()
}

/// The port of an endpoint; options of Zenoh can follow it.
fn port(endpoint: &str) -> Option<u16> {
    let address = endpoint.split(['?', '#']).next()?;
    address.rsplit_once(':')?.1.parse().ok()
}
