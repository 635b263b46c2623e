//! The newest generation of each node's certificate, counted by `farfield certs`. Older ones are
//! refused, so that a stolen key is useless once the node has a new one.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use serde::Deserialize;

use crate::key::is_key_chunk;
use crate::toml_file::{FileError, Place, TomlFile};

/// The name of the file in a folder written by `farfield certs`.
pub const GENERATIONS_FILE: &str = "generations.toml";
/// This many generations beyond the newest known one are admitted. Only the venue's authority makes
/// certificates, so a newer one is valid and the file is outdated.
pub(super) const AHEAD: u32 = 8;
/// This many older generations, the newest of them, are refused by name; earlier ones are refused
/// as unknown.
pub(super) const BEHIND: u32 = 64;
/// Largest number of a generation.
const MAX_GENERATION: u32 = 1_000_000;

/// The newest generation of each node's certificate.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Generations(BTreeMap<String, u32>);

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    generation: BTreeMap<String, u32>,
}

impl Generations {
    /// Parses the text of a file at `path`.
    ///
    /// # Errors
    /// [`FileError`] with the line of an invalid node name or generation number.
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let file = TomlFile::parse(text, path)?;
        let Raw { generation } = file.read()?;
        let wrong = generation
            .iter()
            .find(|(node, number)| !is_key_chunk(node) || !(1..=MAX_GENERATION).contains(*number));
        match wrong {
            Some((node, number)) => Err(file.error(
                &Place::field("generation").key(node),
                format!("found {number}, expected the number of a generation, 1 to {MAX_GENERATION}, of a node's name"),
            )),
            None => Ok(Self(generation)),
        }
    }

    /// The newest generation of `node`; 0 if its certificate was made before generations were
    /// counted, or never.
    pub fn of(&self, node: &str) -> u32 {
        self.0.get(node).copied().unwrap_or(0)
    }

    /// Increments the generation of `node` and returns the new one.
    pub fn renew(&mut self, node: &str) -> u32 {
        let newest = self.0.entry(node.to_owned()).or_insert(0);
        *newest = (*newest + 1).min(MAX_GENERATION);
        *newest
    }

    /// The names of all nodes with a counted certificate.
    pub fn nodes(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// The text of the file for `venue`.
    pub fn to_toml(&self, venue: &str) -> String {
        let mut text = format!(
            "# The newest certificate of each node of the venue \"{venue}\"; older ones are refused. Written by\n\
             # `farfield certs`: after each change, copy it next to ca.pem on fusion's machine, and after\n\
             # `--renew fusion` on all machines.\n[generation]\n"
        );
        for (node, generation) in &self.0 {
            // Writing to a String cannot fail; a name contains no quotes.
            let _infallible = writeln!(text, "\"{node}\" = {generation}");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Generations, String> {
        Generations::parse(text, Path::new("generations.toml")).map_err(|error| error.to_string())
    }

    #[test]
    fn written_generations_are_read_back_and_renew_increments() {
        let mut generations = Generations::default();
        assert_eq!(generations.of("ne"), 0);
        for (node, number) in [("fusion", 1), ("ne.2", 1), ("ne.2", 2), ("screen", 1)] {
            assert_eq!(generations.renew(node), number);
        }
        assert_eq!(parse(&generations.to_toml("hall")).unwrap(), generations);
        let nodes: Vec<&str> = generations.nodes().collect();
        assert_eq!(nodes, ["fusion", "ne.2", "screen"]);
    }

    #[test]
    fn an_invalid_generation_is_refused_with_its_line() {
        for (text, word) in [
            (
                "[generation]\nfusion = 1\nne = 0\n",
                "generations.toml:3: `generation.ne`: found 0",
            ),
            ("[generation]\nne = \"1\"\n", "generations.toml:2"),
            ("[generation]\n\"a/b\" = 1\n", "generations.toml:2"),
            ("ne = 1\n", "generation"),
        ] {
            let refused = parse(text).unwrap_err();
            assert!(refused.contains(word), "{text}: {refused}");
        }
    }
}
