//! The names and addresses that fusion's certificate is good for.

use std::collections::BTreeSet;
use std::net::IpAddr;

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

fn is_host(text: &str) -> bool {
    let is_name = |text: &str| {
        text.bytes()
            .all(|b| b.is_ascii_alphanumeric() || matches!(b, b'-' | b'.'))
    };
    !text.is_empty() && (text.parse::<IpAddr>().is_ok() || is_name(text))
}
