//! Standard output, for the results that people and programs read.

use std::io::{self, ErrorKind, Write as _, stdout};

use anyhow::Context as _;

/// Prints `text` as it is. A reader that has gone wants no more, which is no error.
///
/// # Errors
/// When the text cannot be written, for example because the disk behind standard output is full.
pub fn print(text: &str) -> anyhow::Result<()> {
    let mut out = stdout().lock();
    allow_gone(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
        .context("writing to standard output")
}

fn allow_gone(written: io::Result<()>) -> io::Result<()> {
    match written {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_reader_that_has_gone_is_forgiven() {
        allow_gone(Err(ErrorKind::BrokenPipe.into())).unwrap();
        allow_gone(Err(ErrorKind::StorageFull.into())).unwrap_err();
    }
}
