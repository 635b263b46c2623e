//! Who may ask what: `Host`, `Origin`, token.

use std::net::SocketAddr;

use axum::http::header::{AUTHORIZATION, HOST, ORIGIN, SEC_WEBSOCKET_PROTOCOL};
use axum::http::{HeaderMap, HeaderName, StatusCode};

use super::token::Token;

/// Names of this machine that no other can have.
const LOOPBACK: [&str; 3] = ["localhost", "127.0.0.1", "[::1]"];
/// The subprotocol of pages.
pub(super) const SUBPROTOCOL: &str = "farfield.page.v1";
/// What stands before the token in a subprotocol.
const TOKEN_PREFIX: &str = "token.";

/// What somebody may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rights {
    /// See what is known.
    pub(super) may_read: bool,
    /// Have something done.
    pub(super) may_act: bool,
}

/// The rules of a server.
#[derive(Debug)]
pub(crate) struct Access {
    token: Token,
    address: SocketAddr,
    names: Vec<String>,
    is_secret: bool,
}

impl Access {
    /// Of a server at `address`, which browsers may call by `names` too; `is_secret`: by HTTPS.
    pub(super) fn new(
        token: Token,
        address: SocketAddr,
        names: Vec<String>,
        is_secret: bool,
    ) -> Self {
        let names = names.into_iter().map(|name| name.to_ascii_lowercase());
        Self {
            token,
            address,
            names: names.collect(),
            is_secret,
        }
    }

    pub(super) fn token(&self) -> &Token {
        &self.token
    }

    /// The address of the page with the token.
    pub(super) fn url(&self) -> String {
        let own = match self.address {
            SocketAddr::V4(address) => address.ip().to_string(),
            SocketAddr::V6(address) => format!("[{}]", address.ip()),
        };
        let name = self.names.first().unwrap_or(&own);
        let (scheme, port) = (self.scheme(), self.address.port());
        format!("{scheme}://{name}:{port}/#token={}", self.token.text())
    }

    fn scheme(&self) -> &'static str {
        if self.is_secret { "https" } else { "http" }
    }

    /// What the sender of a request may do.
    pub(super) fn rights(&self, headers: &HeaderMap) -> Result<Rights, Refusal> {
        let host = one(headers, &HOST)?
            .ok_or(Refusal::Host)?
            .to_ascii_lowercase();
        if !self.is_own_name(without_port(&host)) {
            return Err(Refusal::Host);
        }
        if let Some(origin) = one(headers, &ORIGIN)? {
            // The page's own origin is the name by which it was called, with the scheme of this server.
            let own = format!("{}://{host}", self.scheme());
            if !origin.eq_ignore_ascii_case(&own) {
                return Err(Refusal::Origin);
            }
        }
        let has_token = match said_token(headers)? {
            Some(said) if self.token.is(said) => true,
            Some(_) => return Err(Refusal::WrongToken),
            None => false,
        };
        Ok(Rights {
            may_read: has_token || self.address.ip().is_loopback(),
            may_act: has_token,
        })
    }

    fn is_own_name(&self, name: &str) -> bool {
        let own = match self.address.ip() {
            ip if ip.is_unspecified() => None,
            std::net::IpAddr::V4(ip) => Some(ip.to_string()),
            std::net::IpAddr::V6(ip) => Some(format!("[{ip}]")),
        };
        LOOPBACK.contains(&name)
            || own.is_some_and(|own| own == name)
            || self.names.iter().any(|known| known == name)
    }
}

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    /// A header is there twice, or is no text.
    #[error("a header is there twice, or is no text")]
    Header,
    /// The server is not called so.
    #[error("this server does not go by that name: open the address that it printed")]
    Host,
    /// Another site asks.
    #[error("pages of other sites are not answered")]
    Origin,
    /// The token is wrong.
    #[error(
        "the token is wrong: it is made anew at every start; open the address that the server printed"
    )]
    WrongToken,
    /// There is no token.
    #[error("this needs the token: open the address that the server printed")]
    NoToken,
}

impl Refusal {
    pub(super) fn status(self) -> StatusCode {
        match self {
            Self::Header => StatusCode::BAD_REQUEST,
            Self::Host => StatusCode::MISDIRECTED_REQUEST,
            Self::Origin => StatusCode::FORBIDDEN,
            Self::WrongToken | Self::NoToken => StatusCode::UNAUTHORIZED,
        }
    }
}

/// The text of a header that may be there once.
fn one<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Result<Option<&'a str>, Refusal> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| Refusal::Header),
        (Some(_), Some(_)) => Err(Refusal::Header),
    }
}

/// `host` of `host:port`, also of `[::1]:7460`.
fn without_port(authority: &str) -> &str {
    match authority.rsplit_once(':') {
        Some((host, port)) if port.bytes().all(|b| b.is_ascii_digit()) && !host.is_empty() => {
            if host.starts_with('[') == host.ends_with(']') {
                host
            } else {
                authority
            }
        }
        _ => authority,
    }
}

/// The token that a request brings.
fn said_token(headers: &HeaderMap) -> Result<Option<&str>, Refusal> {
    if let Some(said) = one(headers, &AUTHORIZATION)? {
        let (scheme, token) = said.split_once(' ').ok_or(Refusal::WrongToken)?;
        let is_bearer = scheme.eq_ignore_ascii_case("bearer");
        return if is_bearer {
            Ok(Some(token.trim()))
        } else {
            Err(Refusal::WrongToken)
        };
    }
    for value in headers.get_all(SEC_WEBSOCKET_PROTOCOL) {
        let text = value.to_str().map_err(|_| Refusal::Header)?;
        let mut offered = text.split(',').map(str::trim);
        if let Some(token) = offered.find_map(|one| one.strip_prefix(TOKEN_PREFIX)) {
            return Ok(Some(token));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderValue;

    use super::*;

    fn access(address: &str, is_secret: bool) -> Access {
        let names = vec!["Hall.local".to_owned()];
        Access::new(
            Token::random().unwrap(),
            address.parse().unwrap(),
            names,
            is_secret,
        )
    }

    fn rights(access: &Access, headers: &[(&'static str, &str)]) -> Result<Rights, Refusal> {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, HeaderValue::from_str(value).unwrap());
        }
        access.rights(&map)
    }

    const READ: Rights = Rights {
        may_read: true,
        may_act: false,
    };
    const ALL: Rights = Rights {
        may_read: true,
        may_act: true,
    };
    const NONE: Rights = Rights {
        may_read: false,
        may_act: false,
    };

    #[test]
    fn on_the_loopback_everybody_of_the_machine_may_read() {
        let local = access("127.0.0.1:7460", false);
        for host in [
            "localhost",
            "localhost:7460",
            "127.0.0.1:8000",
            "[::1]:7460",
            "LOCALHOST",
            "hall.local",
        ] {
            assert_eq!(rights(&local, &[("host", host)]), Ok(READ), "{host}");
        }
    }

    #[test]
    fn another_host_is_refused() {
        let local = access("127.0.0.1:7460", false);
        for host in [
            "evil.example",
            "evil.example:7460",
            "localhost.evil.example",
            "",
            "[::1",
            "::1",
            "192.168.1.7",
            "localhost:x",
        ] {
            assert_eq!(
                rights(&local, &[("host", host)]),
                Err(Refusal::Host),
                "{host}"
            );
        }
        assert_eq!(rights(&local, &[]), Err(Refusal::Host));
        let twice = [("host", "localhost"), ("host", "localhost")];
        assert_eq!(rights(&local, &twice), Err(Refusal::Header));
    }

    #[test]
    fn another_origin_is_refused_also_of_another_port_of_the_same_machine() {
        let local = access("127.0.0.1:7460", false);
        let from = |origin| rights(&local, &[("host", "localhost:7460"), ("origin", origin)]);
        assert_eq!(from("http://localhost:7460"), Ok(READ));
        for origin in [
            "http://localhost:3000",
            "https://localhost:7460",
            "http://evil.example",
            "null",
            "http://127.0.0.1:7460",
        ] {
            assert_eq!(from(origin), Err(Refusal::Origin), "{origin}");
        }
    }

    #[test]
    fn beyond_the_loopback_nothing_is_told_without_the_token() {
        let open = access("192.168.1.7:7460", true);
        let token = open.token().text().to_owned();
        assert_eq!(rights(&open, &[("host", "hall.local:7460")]), Ok(NONE));
        assert_eq!(rights(&open, &[("host", "192.168.1.7:7460")]), Ok(NONE));
        let bearer = format!("Bearer {token}");
        assert_eq!(
            rights(&open, &[("host", "hall.local"), ("authorization", &bearer)]),
            Ok(ALL)
        );
        let offered = format!("farfield.page.v1, token.{token}");
        let socket = [
            ("host", "hall.local"),
            ("sec-websocket-protocol", offered.as_str()),
        ];
        assert_eq!(rights(&open, &socket), Ok(ALL));
    }

    #[test]
    fn a_wrong_token_is_refused_also_where_reading_is_free() {
        let local = access("127.0.0.1:7460", false);
        for wrong in [
            "Bearer 0123456789abcdef0123456789abcdef",
            "Bearer ",
            "Basic eA==",
            "x",
        ] {
            let found = rights(&local, &[("host", "localhost"), ("authorization", wrong)]);
            assert_eq!(found, Err(Refusal::WrongToken), "{wrong}");
        }
        let socket = [
            ("host", "localhost"),
            ("sec-websocket-protocol", "farfield.page.v1, token.x"),
        ];
        assert_eq!(rights(&local, &socket), Err(Refusal::WrongToken));
    }

    #[test]
    fn the_address_for_the_operator_has_the_token_where_browsers_do_not_send_it() {
        let open = access("0.0.0.0:7460", true);
        let token = open.token().text();
        assert_eq!(
            open.url(),
            format!("https://hall.local:7460/#token={token}")
        );
    }
}
