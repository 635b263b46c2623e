//! Standard output, for the results that people and programs read.

use std::io::{self, ErrorKind, Write as _, stdout};

use anyhow::Context as _;
use farfield_proto::plain_text;

/// Clears the terminal and moves to its top.
const CLEAR: &str = "\u{1b}[H\u{1b}[2J";

/// Whether standard output still has a reader.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reader {
    /// Yes, as far as is known.
    Reads,
    /// No: there is no reason to print more.
    Gone,
}

/// Prints `text`, which may contain foreign text: see [`plain_text`]. A reader that has gone is no error.
///
/// # Errors
/// When the text cannot be written, for example because the disk behind standard output is full.
pub fn print(text: &str) -> anyhow::Result<()> {
    print_while_read(text).map(|_| ())
}

/// Like [`print()`], and returns whether to continue.
///
/// # Errors
/// As [`print()`].
pub fn print_while_read(text: &str) -> anyhow::Result<Reader> {
    write(&plain_text::lines(text))
}

/// Like [`print_while_read`], but replaces the text that was on the terminal.
///
/// # Errors
/// As [`print()`].
pub fn print_over(text: &str) -> anyhow::Result<Reader> {
    write(&(CLEAR.to_owned() + &plain_text::lines(text)))
}

fn write(text: &str) -> anyhow::Result<Reader> {
    let mut out = stdout().lock();
    reader_after(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
        .context("writing to standard output")
}

/// Columns of the terminal behind standard output; `None` if there is none or its size is unknown.
pub fn columns() -> Option<usize> {
    let size = rustix::termios::tcgetwinsize(stdout()).ok()?;
    Some(usize::from(size.ws_col)).filter(|columns| *columns > 0)
}

fn reader_after(written: io::Result<()>) -> io::Result<Reader> {
    match written {
        Ok(()) => Ok(Reader::Reads),
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(Reader::Gone),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_reader_that_has_gone_is_no_error() {
        let gone = reader_after(Err(ErrorKind::BrokenPipe.into()));
        assert_eq!(gone.unwrap(), Reader::Gone);
        reader_after(Err(ErrorKind::StorageFull.into())).unwrap_err();
        assert_eq!(reader_after(Ok(())).unwrap(), Reader::Reads);
    }
}
