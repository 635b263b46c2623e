//! The corpus of the fuzz targets: inputs that fuzzers found, in one archive, which a test replays.
//!
//! The archive is a tar of files `TARGET/NAME`, sorted, without times and owners: the same corpus gives the same bytes.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read as _;
use std::path::Path;

use anyhow::{Context as _, ensure};

use crate::hostile_input;

/// Longer inputs are not kept: shorter ones reach the same code.
const MAX_BYTES: usize = 16 * 1024;

/// Inputs by target and name.
pub type Corpus = BTreeMap<(String, String), Vec<u8>>;

/// Reads an archive.
///
/// # Errors
/// The archive is no tar, or an entry is not named `TARGET/NAME`.
pub fn read(archive: &[u8]) -> anyhow::Result<Corpus> {
    let mut corpus = Corpus::new();
    for entry in tar::Archive::new(archive).entries()? {
        let mut entry = entry?;
        let path = entry.path()?.to_string_lossy().into_owned();
        let name = path.split_once('/').filter(|(_, name)| !name.contains('/'));
        let (target, name) = name.with_context(|| format!("{path}: not TARGET/NAME"))?;
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes)?;
        corpus.insert((target.to_owned(), name.to_owned()), bytes);
    }
    Ok(corpus)
}

/// Writes an archive.
///
/// # Errors
/// A name is too long for a tar.
pub fn archive(corpus: &Corpus) -> anyhow::Result<Vec<u8>> {
    let mut builder = tar::Builder::new(Vec::new());
    for ((target, name), bytes) in corpus {
        let mut header = tar::Header::new_ustar();
        header.set_mode(0o644);
        header.set_size(bytes.len() as u64);
        header.set_mtime(0);
        builder.append_data(&mut header, format!("{target}/{name}"), &bytes[..])?;
    }
    Ok(builder.into_inner()?)
}

/// Reads the folder of the fuzzers: one folder for each target.
///
/// # Errors
/// Contains the path that cannot be read, or a folder without a target.
pub fn read_folder(folder: &Path) -> anyhow::Result<Corpus> {
    let mut corpus = Corpus::new();
    for (path, target) in listed(folder)? {
        ensure!(
            hostile_input::target(&target).is_some(),
            "{}: no fuzz target of this name",
            path.display()
        );
        for (path, name) in listed(&path)? {
            let bytes = std::fs::read(&path).with_context(|| path.display().to_string())?;
            corpus.insert((target.clone(), name), bytes);
        }
    }
    Ok(corpus)
}

/// Paths and names of the entries of a folder.
fn listed(folder: &Path) -> anyhow::Result<Vec<(std::path::PathBuf, String)>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut list = Vec::new();
    for entry in entries {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        list.push((entry.path(), name));
    }
    list.sort();
    Ok(list)
}

/// The inputs of `corpus` worth keeping: for each target and each behaviour of its function the shortest input, and all
/// inputs with names given by people, such as seeds.
pub fn minimised(corpus: &Corpus) -> Corpus {
    let mut order: Vec<_> = corpus.iter().collect();
    order.sort_by_key(|((target, name), bytes)| (target, is_from_fuzzer(name), bytes.len(), name));
    let mut known = BTreeSet::new();
    let mut minimal = Corpus::new();
    for ((target, name), bytes) in order {
        let Some(take) = hostile_input::target(target) else {
            continue;
        };
        if bytes.len() > MAX_BYTES {
            continue;
        }
        let is_new = known.insert((target, take(bytes)));
        if is_new || !is_from_fuzzer(name) {
            minimal.insert((target.clone(), name.clone()), bytes.clone());
        }
    }
    minimal
}

/// Whether the name is from a fuzzer: the SHA-1 of the content.
fn is_from_fuzzer(name: &str) -> bool {
    name.len() == 40 && name.bytes().all(|byte| byte.is_ascii_hexdigit())
}

#[cfg(test)]
mod tests {
    use super::{Corpus, archive, minimised, read};
    use crate::hostile_input::TARGETS;
    use crate::hostile_input::messages::KINDS;

    fn bytes() -> Vec<u8> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../fuzz/corpus.tar");
        std::fs::read(path).unwrap()
    }

    fn committed() -> Corpus {
        read(&bytes()).unwrap()
    }

    #[test]
    fn no_input_of_the_corpus_breaks_its_target() {
        for ((target, name), bytes) in committed() {
            let take = crate::hostile_input::target(&target);
            let take = take.unwrap_or_else(|| panic!("{target}: no target of this name"));
            println!("{target}/{name}: {}", take(&bytes));
        }
    }

    #[test]
    fn every_target_has_inputs() {
        let corpus = committed();
        for (target, _) in TARGETS {
            let has = corpus.keys().any(|(of, _)| of == target);
            assert!(has, "{target} has no input");
        }
    }

    #[test]
    fn the_archive_is_in_its_written_form() {
        let same = archive(&committed()).unwrap() == bytes();
        assert!(same, "write it with `lab fuzz-corpus pack`");
    }

    #[test]
    fn an_archive_reads_back_and_is_the_same_each_time() {
        let entry = |target: &str, name: &str, bytes: &[u8]| {
            ((target.to_owned(), name.to_owned()), bytes.to_vec())
        };
        let corpus = Corpus::from([
            entry("b", "x", b"1"),
            entry("a", "y", b""),
            entry("a", "x", b"2"),
        ]);
        let bytes = archive(&corpus).unwrap();
        assert_eq!(read(&bytes).unwrap(), corpus);
        assert_eq!(archive(&corpus).unwrap(), bytes);
    }

    #[test]
    fn the_shortest_input_of_each_behaviour_is_kept_and_every_seed() {
        let found = |digit: char| digit.to_string().repeat(40);
        // The first kind of messages again, by another byte.
        let same_kind: &[u8] = &[KINDS, 0xff];
        let entry = |name: String, bytes: &[u8]| (("wire_decode".to_owned(), name), bytes.to_vec());
        let corpus = Corpus::from([
            entry(found('a'), b""),
            entry(found('b'), b"\x00\xff"),
            entry(found('c'), same_kind),
            entry(found('d'), &vec![0; 20_000]),
            entry("seed".to_owned(), same_kind),
        ]);
        let kept: Vec<String> = minimised(&corpus)
            .into_keys()
            .map(|(_, name)| name)
            .collect();
        assert_eq!(kept, [found('a'), "seed".to_owned()]);
    }
}
