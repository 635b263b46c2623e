//! The poses of a run that goes on: whole lines of a file to which somebody writes.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Take};
use std::path::Path;

/// Bytes that are looked through at once, from the end: a few poses.
const BLOCK: usize = 16 << 10;

/// Opens the poses at `path` as they are now; what is read ends with the last whole line.
///
/// # Errors
/// When they cannot be opened or read.
pub(super) fn whole_lines(path: &Path) -> io::Result<Take<File>> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let end = end_of_lines(&mut file, length)?;
    file.seek(SeekFrom::Start(0))?;
    Ok(file.take(end))
}

/// Where the last line ends whose end is among the first `length` bytes; 0 where none is.
fn end_of_lines(file: &mut (impl Read + Seek), length: u64) -> io::Result<u64> {
    let mut block = [0; BLOCK];
    let mut end = length;
    while end > 0 {
        let start = end.saturating_sub(BLOCK as u64);
        let part = &mut block[..(end - start) as usize];
        file.seek(SeekFrom::Start(start))?;
        file.read_exact(part)?;
        if let Some(at) = part.iter().rposition(|&byte| byte == b'\n') {
            return Ok(start + at as u64 + 1);
        }
        end = start;
    }
    Ok(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(content: &str) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("poses.jsonl.tmp");
        std::fs::write(&path, content).unwrap();
        let mut lines = String::new();
        let mut file = whole_lines(&path).unwrap();
        file.read_to_string(&mut lines).unwrap();
        lines
    }

    #[test]
    fn half_a_line_at_the_end_is_left_for_later() {
        for (content, lines) in [
            ("", ""),
            ("{\"ti", ""),
            ("{}\n", "{}\n"),
            ("{}\n{}\n{\"tick\":", "{}\n{}\n"),
        ] {
            assert_eq!(read(content), lines, "{content:?}");
        }
    }

    #[test]
    fn half_a_line_may_be_longer_than_what_is_looked_through_at_once() {
        let long = "x".repeat(3 * BLOCK);
        assert_eq!(read(&long), "");
        let whole = format!("{long}\n{}\n", &long[..BLOCK - 1]);
        assert_eq!(read(&format!("{whole}{long}")), whole);
        assert_eq!(read(&whole), whole);
    }
}
