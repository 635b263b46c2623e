//! Questions, where somebody sits at a terminal to answer them.

use std::io::{IsTerminal as _, Write as _, stderr, stdin};

use anyhow::Context as _;

/// What was answered; `None` where nobody can be asked, or nothing was said.
///
/// # Errors
/// When the terminal cannot be read.
pub(super) fn answer(question: &str) -> anyhow::Result<Option<String>> {
    if !(stdin().is_terminal() && stderr().is_terminal()) {
        return Ok(None);
    }
    // A terminal that cannot be written to is told of by the reading.
    write!(stderr(), "{question} ").ok();
    let mut line = String::new();
    stdin().read_line(&mut line).context("reading the answer")?;
    let said = line.trim();
    Ok((!said.is_empty()).then(|| said.to_owned()))
}
