//! Address and token of a page.

use std::env;
use std::ffi::OsString;
use std::net::SocketAddr;

use anyhow::{Context as _, ensure};
use farfield_node::process::NodeError;
use farfield_page::server::Token;

/// Parses an IP address and a port.
pub(crate) fn page_address(word: &str) -> Result<SocketAddr, String> {
    let found = word.parse().ok();
    found.ok_or_else(|| {
        let port: Option<u16> = word
            .trim_start_matches("localhost")
            .trim_start_matches(':')
            .parse()
            .ok();
        let example = format!("127.0.0.1:{}", port.unwrap_or(7460));
        format!("found `{word}`, expected an IP address and a port, for example {example}")
    })
}

/// Refuses an `address` that other machines can reach, as a page without keys is served. `option` is the command line
/// option before the address; `what` names the content.
///
/// # Errors
/// Names the option and the way to open the page from another machine.
pub(super) fn check_own_machine(
    option: &str,
    address: SocketAddr,
    what: &str,
) -> anyhow::Result<()> {
    ensure!(
        address.ip().is_loopback(),
        "{}: found {address}, expected a loopback address: {what} has no keys; from another machine use \
         `ssh -L 7460:127.0.0.1:7460 HOST`",
        option.trim_end_matches(['=', ' '])
    );
    Ok(())
}

/// Environment variable with the token. Only the same user can read a process's environment; everyone can read its
/// command line.
const VARIABLE: &str = "FARFIELD_PAGE_TOKEN";

/// Variable and value that pass a token to a node.
pub(crate) fn token_for_node(token: &Token) -> (&'static str, &str) {
    (VARIABLE, token.text())
}

/// The token passed to this process; `None`: it creates one.
///
/// # Errors
/// Names the variable if its value is no token.
pub(super) fn token_of_this_node() -> Result<Option<Token>, NodeError> {
    read_token(env::var_os(VARIABLE))
}

fn read_token(value: Option<OsString>) -> Result<Option<Token>, NodeError> {
    let Some(value) = value.filter(|value| !value.is_empty()) else {
        return Ok(None);
    };
    // Without the value, which is a secret.
    let token = value.to_str().and_then(Token::of_text);
    let token = token.with_context(|| format!("{VARIABLE}: expected 32 hexadecimal digits"));
    token.map(Some).map_err(NodeError::Refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_port_alone_is_refused_with_the_full_address() {
        assert!(page_address("127.0.0.1:7460").is_ok());
        for word in ["8080", ":8080", "localhost:8080"] {
            let error = page_address(word).unwrap_err();
            assert!(error.contains("127.0.0.1:8080"), "{error}");
        }
        assert!(page_address("hall").unwrap_err().contains("found `hall`"));
    }

    #[test]
    fn pages_without_keys_are_served_on_loopback_only() {
        let check = |address: &str| check_own_machine("--at ", address.parse().unwrap(), "it");
        check("127.0.0.1:7460").unwrap();
        check("[::1]:7460").unwrap();
        for address in ["0.0.0.0:7460", "10.0.0.1:7460"] {
            let error = check(address).unwrap_err().to_string();
            let start = format!("--at: found {address}, expected");
            assert!(error.starts_with(&start), "{error}");
        }
    }

    #[test]
    fn a_node_receives_its_token() {
        let token = Token::random().unwrap();
        let (_, value) = token_for_node(&token);
        let received = read_token(Some(value.into())).unwrap().unwrap();
        assert_eq!(received.text(), token.text());
        for nothing in [None, Some(OsString::new())] {
            assert!(read_token(nothing).unwrap().is_none());
        }
    }

    #[test]
    fn an_invalid_token_is_refused_and_not_printed() {
        let NodeError::Refused(error) = read_token(Some("secret".into())).unwrap_err() else {
            panic!("a node with an invalid token must not start");
        };
        let error = format!("{error:#}");
        assert!(
            error.starts_with(VARIABLE) && !error.contains("secret"),
            "{error}"
        );
    }
}
