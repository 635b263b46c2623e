//! Endpoints to listen at or connect to, as text: `tcp/127.0.0.1:7447`.

use core::net::IpAddr;

/// The allowed protocols; Zenoh is built with only these.
const SCHEMES: [&str; 4] = ["tcp", "udp", "tls", "quic"];

/// Whether `text` is an endpoint: a scheme, `/`, a host and a port, and optionally options of Zenoh
/// after `?` or `#`. An IPv6 address has brackets. The existence of the host is not checked.
pub fn is_endpoint(text: &str) -> bool {
    let Some((host, port)) = address(text).rsplit_once(':') else {
        return false;
    };
    let bracketed = host.starts_with('[') && host.ends_with(']');
    let is_host = !host.is_empty()
        && !host.contains(|c: char| c.is_whitespace() || c == '/')
        && (bracketed || !host.contains(':'));
    let is_port = port.bytes().all(|b| b.is_ascii_digit()) && port.parse::<u16>().is_ok();
    SCHEMES.contains(&scheme(text)) && is_host && is_port
}

/// The protocol of an endpoint: the part before the first `/`.
pub fn scheme(endpoint: &str) -> &str {
    endpoint.split_once('/').map_or("", |(scheme, _)| scheme)
}

/// The host of an endpoint, an IPv6 address without its brackets.
pub fn host(endpoint: &str) -> &str {
    let host = address(endpoint)
        .rsplit_once(':')
        .map_or("", |(host, _)| host);
    let bare = host
        .strip_prefix('[')
        .and_then(|host| host.strip_suffix(']'));
    bare.unwrap_or(host)
}

/// Whether an endpoint means all addresses of a machine.
pub fn is_any_address(endpoint: &str) -> bool {
    let address = host(endpoint).parse::<IpAddr>();
    address.is_ok_and(|address| address.is_unspecified())
}

/// The port of an endpoint.
pub fn port(endpoint: &str) -> Option<u16> {
    let (_, port) = address(endpoint).rsplit_once(':')?;
    port.parse().ok()
}

/// The same endpoint at another host; an IPv6 address gets brackets.
pub fn at_host(endpoint: &str, host: &str) -> String {
    let (before, rest) = endpoint.split_once('/').unwrap_or(("", endpoint));
    let port = address(endpoint)
        .rsplit_once(':')
        .map_or("", |(_, port)| port);
    let options = &rest[address(endpoint).len()..];
    format!("{before}/{host}:{port}{options}")
}

/// Host and port.
fn address(endpoint: &str) -> &str {
    let rest = endpoint.split_once('/').map_or("", |(_, rest)| rest);
    rest.split(['?', '#']).next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_endpoint_has_a_scheme_a_host_and_a_port() {
        for good in [
            "tcp/0.0.0.0:7447",
            "tls/fusion.local:7447",
            "tcp/[::1]:0",
            "tls/fusion.local:7447#root_ca_certificate=ca.pem",
            "quic/10.0.0.1:7447?mixed_rel=1",
            "udp/10.0.0.1:7447?rel=1;mixed_rel=1",
        ] {
            assert!(is_endpoint(good), "{good}");
        }
        for bad in [
            "",
            "garbage",
            "127.0.0.1:7447",
            "tcp/",
            "tcp/7447",
            "tcp/:7447",
            "tcp/host:",
            "tcp/host:+7",
            "tcp/host:70000",
            "tcp/::1:7447",
            "ws/host:7447",
            "tcp/a b:7447",
        ] {
            assert!(!is_endpoint(bad), "{bad}");
        }
    }

    #[test]
    fn an_endpoint_is_split_into_its_parts() {
        assert_eq!(scheme("quic/a.lan:1?mixed_rel=1"), "quic");
        assert_eq!(host("quic/a.lan:1?mixed_rel=1"), "a.lan");
        assert_eq!(host("tcp/[::1]:1"), "::1");
        assert_eq!(port("quic/a.lan:7447?mixed_rel=1"), Some(7447));
        assert_eq!(port("tcp/[::1]"), None);
        assert_eq!(
            at_host("quic/0.0.0.0:7447?mixed_rel=1#a=b", "127.0.0.1"),
            "quic/127.0.0.1:7447?mixed_rel=1#a=b"
        );
        assert_eq!(at_host("tcp/[::]:1", "[::1]"), "tcp/[::1]:1");
    }
}
