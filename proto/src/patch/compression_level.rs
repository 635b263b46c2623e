//! The compression level: the one parameter of the patch codec.

use std::fmt;
use std::str::FromStr;

use serde::de::{Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Cells below this value, of 255, are never sent: 0.06 of the highest.
pub const FLOOR: u8 = 15;

/// The compression level of maps. 0 is lossless above [`FLOOR`]; every higher level takes fewer
/// bytes, up to [`CompressionLevel::SMALLEST`]. (Unlike the quality of a JPEG: a higher level is
/// coarser.)
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CompressionLevel(u8);

impl CompressionLevel {
    /// 8 bit cells above [`FLOOR`], exactly.
    pub const LOSSLESS: Self = Self(0);
    /// The start level of a live link.
    pub const DEFAULT: Self = Self(2);
    /// For thin links.
    pub const SMALL: Self = Self(4);
    /// The highest level, with the fewest bytes.
    pub const SMALLEST: Self = Self(6);

    /// The compression level `level`; larger numbers give the smallest.
    pub const fn new(level: u8) -> Self {
        if level > Self::SMALLEST.0 {
            Self::SMALLEST
        } else {
            Self(level)
        }
    }

    /// Its number, 0 (lossless) to that of [`Self::SMALLEST`].
    pub const fn number(self) -> u8 {
        self.0
    }

    /// The next level with fewer bytes; `None` for the smallest.
    pub fn coarser(self) -> Option<Self> {
        (self < Self::SMALLEST).then_some(Self(self.0 + 1))
    }

    /// The next level with more bytes; `None` for lossless.
    pub fn finer(self) -> Option<Self> {
        self.0.checked_sub(1).map(Self)
    }

    /// All levels, the best quality first.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..=Self::SMALLEST.0).map(Self)
    }
}

impl Default for CompressionLevel {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Levels with a name.
const NAMES: [(&str, CompressionLevel); 4] = [
    ("lossless", CompressionLevel::LOSSLESS),
    ("default", CompressionLevel::DEFAULT),
    ("small", CompressionLevel::SMALL),
    ("smallest", CompressionLevel::SMALLEST),
];

impl fmt::Display for CompressionLevel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match NAMES.iter().find(|(_, level)| level == self) {
            Some((name, _)) => f.write_str(name),
            None => self.0.fmt(f),
        }
    }
}

/// A text that is not a compression level.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "found `{0}`, expected \"lossless\", \"default\", \"small\", \"smallest\" or a level from 0 to {max}",
    max = CompressionLevel::SMALLEST.0
)]
pub struct UnknownCompressionLevel(String);

impl FromStr for CompressionLevel {
    type Err = UnknownCompressionLevel;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let named = NAMES.iter().find(|(name, _)| *name == text);
        let level = || text.parse().ok().filter(|&l| l <= Self::SMALLEST.0);
        named
            .map(|&(_, level)| level)
            .or_else(|| level().map(Self))
            .ok_or_else(|| UnknownCompressionLevel(text.to_owned()))
    }
}

impl Serialize for CompressionLevel {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if NAMES.iter().any(|(_, level)| level == self) {
            serializer.collect_str(self)
        } else {
            serializer.serialize_u8(self.0)
        }
    }
}

impl<'de> Deserialize<'de> for CompressionLevel {
    /// From a file: a name or a number.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Written)
    }
}

struct Written;

impl Visitor<'_> for Written {
    type Value = CompressionLevel;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "\"lossless\", \"default\", \"small\", \"smallest\" or a level from 0 to {}",
            CompressionLevel::SMALLEST.0
        )
    }

    fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<CompressionLevel, E> {
        text.parse()
            .map_err(|_| E::invalid_value(Unexpected::Str(text), &self))
    }

    fn visit_i64<E: serde::de::Error>(self, level: i64) -> Result<CompressionLevel, E> {
        u8::try_from(level)
            .ok()
            .filter(|&level| level <= CompressionLevel::SMALLEST.0)
            .map(CompressionLevel)
            .ok_or_else(|| E::invalid_value(Unexpected::Signed(level), &self))
    }

    fn visit_u64<E: serde::de::Error>(self, level: u64) -> Result<CompressionLevel, E> {
        self.visit_i64(level.try_into().unwrap_or(i64::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_written_level_is_read_back() {
        for level in CompressionLevel::all() {
            assert_eq!(level.to_string().parse(), Ok(level));
            let value = toml::Value::try_from(level).unwrap();
            assert_eq!(value.try_into::<CompressionLevel>().unwrap(), level);
        }
    }

    #[test]
    fn every_level_has_neighbours_but_the_ends() {
        assert_eq!(CompressionLevel::LOSSLESS.finer(), None);
        assert_eq!(CompressionLevel::SMALLEST.coarser(), None);
        for level in CompressionLevel::all() {
            if let Some(coarser) = level.coarser() {
                assert_eq!(coarser.finer(), Some(level));
            }
        }
    }

    #[test]
    fn an_invalid_quality_is_refused_with_the_valid_ones() {
        let refused = "fine".parse::<CompressionLevel>().unwrap_err();
        assert!(refused.to_string().contains("`fine`"), "{refused}");
        assert!(
            toml::Value::Integer(99)
                .try_into::<CompressionLevel>()
                .is_err()
        );
    }
}
