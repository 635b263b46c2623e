//! `[[stream]]`: destinations of live poses for other programs.
//!
//! The fields are plain text here: only the command that opens streams knows the protocols. An edge
//! that receives the file ignores them.

use super::raw::RawStream;
use crate::key::is_key_chunk;
use crate::toml_file::{FileError, Place, TomlFile};

/// Most streams of a venue.
const MAX_STREAMS: usize = 32;
/// Longest address, characters.
const MAX_ADDRESS: usize = 128;

/// A stream of the venue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct VenueStream {
    /// The protocol's name.
    pub to: String,
    /// Its destination; `None`: the protocol's default.
    pub address: Option<String>,
    /// The file and the line of each field.
    stands: [FileError; 2],
}

/// A field of a [`VenueStream`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StreamField {
    /// `to`.
    To,
    /// `address`.
    Address,
}

impl VenueStream {
    /// An error of one of its fields, found by code that knows the protocols.
    pub fn error(&self, field: StreamField, problem: impl Into<String>) -> FileError {
        let [to, address] = &self.stands;
        let place = match field {
            StreamField::To => to,
            StreamField::Address => address,
        };
        FileError {
            problem: problem.into(),
            ..place.clone()
        }
    }
}

pub(super) fn streams(
    file: &TomlFile<'_>,
    raw: Vec<RawStream>,
) -> Result<Vec<VenueStream>, FileError> {
    let all = Place::field("stream");
    if raw.len() > MAX_STREAMS {
        let problem = format!("found {}, expected at most {MAX_STREAMS}", raw.len());
        return Err(file.error(&all, problem));
    }
    let mut streams: Vec<VenueStream> = Vec::new();
    for (i, RawStream { to, address }) in raw.into_iter().enumerate() {
        let [to_place, address_place] = ["to", "address"].map(|field| all.index(i).key(field));
        if !is_key_chunk(&to) {
            let problem = format!("found {to:?}, expected the name of a protocol, such as \"vmc\"");
            return Err(file.error(&to_place, problem));
        }
        let is_text = |text: &String| {
            (1..=MAX_ADDRESS).contains(&text.len()) && text.bytes().all(|it| it.is_ascii_graphic())
        };
        if let Some(address) = address.as_ref().filter(|text| !is_text(text)) {
            let problem =
                format!("found {address:?}, expected an address, such as \"192.168.1.20\"");
            return Err(file.error(&address_place, problem));
        }
        if streams
            .iter()
            .any(|it| it.to == to && it.address == address)
        {
            let problem = format!("found \"{to}\" a second time at one address, expected it once");
            return Err(file.error(&to_place, problem));
        }
        let stands = [to_place, address_place].map(|place| file.error(&place, String::new()));
        streams.push(VenueStream {
            to,
            address,
            stands,
        });
    }
    Ok(streams)
}
