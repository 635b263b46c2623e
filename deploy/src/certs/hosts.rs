//! The names and addresses that fusion's certificate is good for.

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::path::Path;

use farfield_node::certificate::{common_name_in, hosts_in};
use farfield_node::keys::node_of;
use farfield_node::process::say;
use farfield_proto::transport::FUSION;
use farfield_proto::transport::endpoint::host;
use farfield_proto::venue::Venue;

/// What nodes on fusion's own machine use.
const LOOPBACK: [&str; 3] = ["localhost", "127.0.0.1", "::1"];

/// All that edges may call fusion by: the venue's endpoints, `more`, and the loopback.
///
/// # Errors
/// When one of `more` is neither a host's name nor an address.
pub(super) fn of_fusion(venue: &Venue, more: &[String]) -> anyhow::Result<Vec<String>> {
    if let Some(wrong) = more.iter().find(|text| !is_host(text)) {
        anyhow::bail!("`--host`: found `{wrong}`, expected a name or an address, without a port");
    }
    let endpoints = venue
        .endpoints
        .connect
        .iter()
        .chain(&venue.endpoints.listen);
    let hosts: BTreeSet<&str> = LOOPBACK
        .into_iter()
        .chain(endpoints.map(|endpoint| host(endpoint)))
        .chain(more.iter().map(String::as_str))
        // 0.0.0.0 is a place to listen at, and nobody's address.
        .filter(|host| !host.parse::<IpAddr>().is_ok_and(|a| a.is_unspecified()))
        .collect();
    Ok(hosts.into_iter().map(str::to_owned).collect())
}

/// `hosts`, and those of fusion's certificate in the folder `keys`, as `--host` gave them when it was made. Says where they are
/// not known.
pub(super) fn with_those_before(mut hosts: Vec<String>, keys: &Path, venue: &str) -> Vec<String> {
    let path = keys.join(format!("{FUSION}.pem"));
    let is_ours = |name: String| node_of(venue, &name).is_some_and(|(node, _)| node == FUSION);
    let found = (common_name_in(&path).map(is_ours), hosts_in(&path));
    let before = if let (Ok(true), Ok(before)) = found {
        before
    } else {
        say(format_args!(
            "{}: no certificate of this venue's fusion: the new one is good for {}; say more with --host",
            path.display(),
            hosts.join(", ")
        ));
        Vec::new()
    };
    // The same address may be written in several ways.
    let same = |a: &str, b: &str| match (a.parse::<IpAddr>(), b.parse::<IpAddr>()) {
        (Ok(a), Ok(b)) => a == b,
        _ => a == b,
    };
    for host in before.into_iter().filter(|host| is_host(host)) {
        if !hosts.iter().any(|known| same(known, &host)) {
            hosts.push(host);
        }
    }
    hosts
}

fn is_host(text: &str) -> bool {
    let is_name = |text: &str| {
        text.bytes()
            .all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'.'))
    };
    !text.is_empty() && (text.parse::<IpAddr>().is_ok() || is_name(text))
}
