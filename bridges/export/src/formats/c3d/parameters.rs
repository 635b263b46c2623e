//! The parameter section of a C3D file: named values in groups.

use std::io;

use super::BLOCK;
use crate::target_names::C3D_BYTES;

/// Intel byte order and floating-point numbers.
const INTEL: u8 = 84;

/// Collected parameters.
#[derive(Debug, Default)]
pub(super) struct Parameters {
    bytes: Vec<u8>,
    groups: u8,
}

/// Type of a parameter.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Text = -1,
    Integer = 2,
    Float = 4,
}

impl Parameters {
    /// Starts a group for the following parameters.
    pub(super) fn group(&mut self, name: &str) {
        self.groups += 1;
        self.head(name, 0_u8.wrapping_sub(self.groups));
        // Offset to the next item: these two bytes, and an empty description.
        self.bytes.extend(3_u16.to_le_bytes());
        self.bytes.push(0);
    }

    /// Adds an integer.
    pub(super) fn integer(&mut self, name: &str, value: u16) -> io::Result<()> {
        self.value(name, Kind::Integer, &[], &value.to_le_bytes())
    }

    /// Adds a list of integers.
    pub(super) fn list(&mut self, name: &str, values: &[u16]) -> io::Result<()> {
        let data: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.value(name, Kind::Integer, &[values.len()], &data)
    }

    /// Adds a real number.
    pub(super) fn float(&mut self, name: &str, value: f32) -> io::Result<()> {
        self.value(name, Kind::Float, &[], &value.to_le_bytes())
    }

    /// Adds a text.
    pub(super) fn text(&mut self, name: &str, text: &str) -> io::Result<()> {
        self.value(name, Kind::Text, &[text.len()], text.as_bytes())
    }

    /// Adds a list of texts, padded with spaces to the longest.
    pub(super) fn texts(&mut self, name: &str, texts: &[String]) -> io::Result<()> {
        let longest = texts.iter().map(String::len).max().unwrap_or(0).max(1);
        let mut data = Vec::new();
        for text in texts {
            data.extend(text.as_bytes());
            data.resize(data.len() + longest - text.len(), b' ');
        }
        self.value(name, Kind::Text, &[longest, texts.len()], &data)
    }

    /// The section in whole blocks.
    pub(super) fn into_blocks(self) -> io::Result<Vec<u8>> {
        let mut bytes = vec![1, super::KEY, 0, INTEL];
        bytes.extend(self.bytes);
        // A name of length 0 ends the section.
        bytes.extend([0; 2]);
        bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
        let blocks = u8::try_from(bytes.len() / BLOCK);
        bytes[2] =
            blocks.map_err(|_| io::Error::other("more parameters than a C3D file has room for"))?;
        Ok(bytes)
    }

    fn head(&mut self, name: &str, group: u8) {
        self.bytes.push(name.len() as u8);
        self.bytes.push(group);
        self.bytes.extend(name.as_bytes());
    }

    fn value(
        &mut self,
        name: &str,
        kind: Kind,
        dimensions: &[usize],
        data: &[u8],
    ) -> io::Result<()> {
        let too_long =
            || io::Error::other(format!("`{name}` is longer than a C3D file has room for"));
        let dimensions = dimensions
            .iter()
            .map(|n| u8::try_from(*n).map_err(|_| too_long()));
        let dimensions: Vec<u8> = dimensions.collect::<io::Result<_>>()?;
        if matches!(kind, Kind::Text)
            && dimensions
                .first()
                .is_some_and(|n| usize::from(*n) > C3D_BYTES)
        {
            return Err(too_long());
        }
        self.head(name, self.groups);
        // Offset to the next item: these two bytes, type, number of dimensions, dimensions, data,
        // empty description.
        let size =
            u16::try_from(2 + 2 + dimensions.len() + data.len() + 1).map_err(|_| too_long())?;
        self.bytes.extend(size.to_le_bytes());
        self.bytes.push(kind as i8 as u8);
        self.bytes.push(dimensions.len() as u8);
        self.bytes.extend(dimensions);
        self.bytes.extend(data);
        self.bytes.push(0);
        Ok(())
    }
}
