//! Access rules: `Host`, `Origin`, token.

use std::fmt::{self, Write as _};
use std::net::SocketAddr;

use axum::http::header::{AUTHORIZATION, HOST, ORIGIN, SEC_WEBSOCKET_PROTOCOL};
use axum::http::{HeaderMap, HeaderName, StatusCode};
use ring::rand::{SecureRandom as _, SystemRandom};

/// Names that always mean this machine.
const LOOPBACK: [&str; 3] = ["localhost", "127.0.0.1", "[::1]"];
/// The subprotocol of pages.
pub(super) const SUBPROTOCOL: &str = "farfield.page.v1";
/// Prefix of the token in a subprotocol.
const TOKEN_PREFIX: &str = "token.";

/// Rights of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Rights {
    /// May read the state.
    pub(super) may_read: bool,
    /// May request actions.
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
    /// Rules of a server at `address`, which browsers may also call by `names`; `is_secret` for
    /// HTTPS.
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

    /// The page's URL with the token.
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

    /// Rights of the sender of a request.
    pub(super) fn rights(&self, headers: &HeaderMap) -> Result<Rights, Refusal> {
        let host = one(headers, &HOST)?
            .ok_or(Refusal::Host)?
            .to_ascii_lowercase();
        if !self.is_own_name(without_port(&host)) {
            return Err(Refusal::Host);
        }
        if let Some(origin) = one(headers, &ORIGIN)? {
            // The page's own origin is the requested host with the scheme of this server.
            let own = format!("{}://{host}", self.scheme());
            if !origin.eq_ignore_ascii_case(&own) {
                return Err(Refusal::Origin);
            }
        }
        let has_token = match given_token(headers)? {
            Some(given) if self.token.is(given) => true,
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

/// Why a request is rejected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    /// A header is duplicated or is not text.
    #[error("a header is duplicated or is not text")]
    Header,
    /// Unknown host name.
    #[error("this server does not go by that name: open the address that it printed")]
    Host,
    /// Request from another site.
    #[error("pages of other sites are not answered")]
    Origin,
    /// Wrong token.
    #[error(
        "the token is wrong: it changes at every start; open the address that the server printed"
    )]
    WrongToken,
    /// Missing token.
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

/// The text of a header that may occur once.
fn one<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Result<Option<&'a str>, Refusal> {
    let mut values = headers.get_all(name).iter();
    match (values.next(), values.next()) {
        (None, _) => Ok(None),
        (Some(value), None) => value.to_str().map(Some).map_err(|_| Refusal::Header),
        (Some(_), Some(_)) => Err(Refusal::Header),
    }
}

/// The `host` of `host:port`, also of `[::1]:7460`.
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

/// The token of a request.
fn given_token(headers: &HeaderMap) -> Result<Option<&str>, Refusal> {
    if let Some(given) = one(headers, &AUTHORIZATION)? {
        let (scheme, token) = given.split_once(' ').ok_or(Refusal::WrongToken)?;
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

/// Bytes of a token.
const BYTES: usize = 16;
/// Length of its text.
const DIGITS: usize = 2 * BYTES;

/// A token of 128 random bits; its text has 32 hexadecimal digits.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A new token; `None` if the system provides no random numbers.
    pub fn random() -> Option<Self> {
        let mut bytes = [0; BYTES];
        SystemRandom::new().fill(&mut bytes).ok()?;
        let mut text = String::with_capacity(DIGITS);
        for byte in bytes {
            write!(text, "{byte:02x}").ok()?;
        }
        Some(Self(text))
    }

    /// The token with this text; `None` if the text is invalid.
    pub fn of_text(text: &str) -> Option<Self> {
        let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
        let is_token = text.len() == DIGITS && text.bytes().all(is_digit);
        is_token.then(|| Self(text.to_owned()))
    }

    /// The text of the token.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether `text` is the token; the time does not depend on where they differ.
    pub(crate) fn is(&self, text: &str) -> bool {
        let (known, given) = (self.0.as_bytes(), text.as_bytes());
        let differ = known
            .iter()
            .zip(given)
            .fold(0, |differ, (a, b)| differ | (a ^ b));
        known.len() == given.len() && differ == 0
    }
}

impl fmt::Debug for Token {
    /// Hides the text, since logs are read by others.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
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
    fn on_the_loopback_everyone_may_read() {
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
    fn other_origins_and_ports_are_refused() {
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
    fn beyond_the_loopback_the_token_is_required() {
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
    fn a_wrong_token_is_refused_even_on_the_loopback() {
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
    fn the_operator_url_has_the_token_in_the_fragment() {
        let open = access("0.0.0.0:7460", true);
        let token = open.token().text();
        assert_eq!(
            open.url(),
            format!("https://hall.local:7460/#token={token}")
        );
    }

    #[test]
    fn tokens_are_random_and_match_only_themselves() {
        let [a, b] = [0, 1].map(|_| Token::random().unwrap());
        assert_eq!(a.text().len(), 32);
        assert!(a.is(a.text()) && !a.is(b.text()) && !a.is("") && !a.is(&a.text()[..31]));
        assert_eq!(format!("{a:?}"), "Token(..)");
    }

    #[test]
    fn only_valid_text_becomes_a_token() {
        let token = Token::random().unwrap();
        let text = token.text();
        assert!(Token::of_text(text).unwrap().is(text));
        for other in ["", "x", &text[1..], &format!("{text}0"), &"G".repeat(32)] {
            assert!(Token::of_text(other).is_none(), "{other}");
        }
    }
}
