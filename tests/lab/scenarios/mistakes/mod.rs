//! First-time mistakes, written down before they were tried: what each of them is told, and the exit code.
//!
//! None may pass without a word. What cameras that disagree are told is in other scenarios: here are mistakes that a file
//! or a command line shows.

mod folder;
mod input;
mod newer;
mod usage;

use std::path::Path;

use crate::farfield::{command, finish};

/// Something that a new user does.
struct Mistake {
    what: &'static str,
    /// Makes it, in a folder that holds the sample venue.
    make: fn(&Path),
    /// What is said to `farfield` in that folder.
    words: &'static str,
    code: i32,
    /// Words that the answer on standard error must hold.
    told: &'static [&'static str],
}

/// Makes all mistakes, each in a folder of its own, and prints what is said.
fn are_told(mistakes: &[Mistake]) {
    let mut faults = Vec::new();
    for mistake in mistakes {
        let folder = folder::sample();
        (mistake.make)(folder.path());
        let mut command = command();
        command
            .current_dir(folder.path())
            .args(mistake.words.split(' '));
        let said = finish(&command.output().unwrap());
        let Mistake { what, code, .. } = mistake;
        println!("{what} -> {}: {}", said.code, said.stderr.trim());
        let is_told = mistake.told.iter().all(|word| said.stderr.contains(word));
        let is_panic = said.stderr.contains("panicked");
        if said.code != *code || !is_told || is_panic || mistake.told.is_empty() {
            faults.push(format!(
                "{what}: expected exit code {code} and {:?}, found {}:\n{}{}",
                mistake.told, said.code, said.stdout, said.stderr
            ));
        }
        // The folder of results that was named, and the one of those that are not.
        let is_left = ["out", "farfield-out"].map(|name| folder.path().join(name).is_dir());
        if *code == 2 && is_left.contains(&true) {
            faults.push(format!("{what}: refused, and results were written"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
}
