//! What other programs and strangers say to the import, to the page and to streams.

use std::path::Path;

use farfield_calibration::alignment::Marks;
use farfield_import::formats::{ParseOptions, parse};
use farfield_page::protocol::request;
use farfield_streams::qtm::{Command, Incoming};

use super::{read_or_refused, size, text};

/// Keypoints of other programs of any content: told by their content and read, or refused.
pub(super) fn imported_keypoints(bytes: &[u8]) -> String {
    let parsed = parse(
        bytes,
        Path::new("cam1_000001.json"),
        ParseOptions::default(),
    );
    match &parsed {
        Ok(read) => format!("read: {:?}", read.format),
        Err(_) => read_or_refused(&parsed),
    }
}

/// What was clicked in pictures, of any content: read or refused.
pub(super) fn clicked_marks_text(bytes: &[u8]) -> String {
    let text = text(bytes);
    read_or_refused(&Marks::parse(text, Path::new("marks.toml")))
}

/// What a browser says on a WebSocket, of any content: understood, or answered.
pub(super) fn page_request_text(bytes: &[u8]) -> String {
    read_or_refused(&request::parse(text(bytes)))
}

/// What a client of the QTM protocol sends, of any content and in any pieces: packets, each a command or answered.
pub(super) fn qtm_packets(bytes: &[u8]) -> String {
    let mut incoming = Incoming::default();
    let mut became = String::new();
    for piece in bytes.chunks(7) {
        incoming.push(piece);
        loop {
            match incoming.take() {
                Ok(Some(packet)) => {
                    let command = Command::parse(&String::from_utf8_lossy(&packet.payload));
                    became.push(if command.is_ok() { '+' } else { '-' });
                }
                Ok(None) => break,
                Err(_) => return format!("{}!", size(became.len())),
            }
        }
    }
    let understood = became.matches('+').count();
    format!("{} of {}", size(understood), size(became.len()))
}
