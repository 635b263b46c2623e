//! The token of a run's page, where whoever starts the run has made it: to who looks, the rounds of a demo are one.

use std::env;
use std::ffi::OsString;

use anyhow::Context as _;
use farfield_node::process::NodeError;
use farfield_page::server::Token;

/// Where a node finds it: the environment of a process is read by its user alone, its command line by everybody on the machine.
const VARIABLE: &str = "FARFIELD_PAGE_TOKEN";

/// What tells a node its token: a variable of its environment and the value.
pub(crate) fn for_node(token: &Token) -> (&'static str, &str) {
    (VARIABLE, token.text())
}

/// The token that this process was told; `None`: it makes one.
///
/// # Errors
/// Names the variable where its value is no token.
pub(super) fn of_this_node() -> Result<Option<Token>, NodeError> {
    read(env::var_os(VARIABLE))
}

fn read(value: Option<OsString>) -> Result<Option<Token>, NodeError> {
    let Some(value) = value.filter(|value| !value.is_empty()) else {
        return Ok(None);
    };
    // Not the value: whoever has it may act.
    let token = value.to_str().and_then(Token::of_text);
    let token = token.with_context(|| format!("{VARIABLE}: expected 32 hexadecimal digits"));
    token.map(Some).map_err(NodeError::Refused)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_node_has_the_token_that_it_was_told() {
        let token = Token::random().unwrap();
        let (_, value) = for_node(&token);
        let told = read(Some(value.into())).unwrap().unwrap();
        assert_eq!(told.text(), token.text());
        for nothing in [None, Some(OsString::new())] {
            assert!(read(nothing).unwrap().is_none());
        }
    }

    #[test]
    fn what_is_no_token_is_refused_and_not_repeated() {
        let NodeError::Refused(error) = read(Some("secret".into())).unwrap_err() else {
            panic!("a node that cannot be told its token must not begin");
        };
        let said = format!("{error:#}");
        assert!(
            said.starts_with(VARIABLE) && !said.contains("secret"),
            "{said}"
        );
    }
}
