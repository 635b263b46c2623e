//! Mistakes of new users in files and on command lines: exit code and message.
//!
//! The list was written before the mistakes were tried. The scenarios of `agreement` cover cameras that disagree.

mod folder;
mod input;
mod newer;
mod usage;

use std::path::Path;

use crate::farfield::{command, finish};

/// A mistake of a new user.
struct Mistake {
    what: &'static str,
    /// Makes the mistake in a folder that holds the sample venue.
    make: fn(&Path),
    /// Arguments of `farfield` in that folder, separated by spaces.
    words: &'static str,
    code: i32,
    /// Parts of the message on standard error.
    expected: &'static [&'static str],
}

/// Makes each mistake in a folder of its own, and checks exit code and message.
fn check_mistakes(mistakes: &[Mistake]) {
    let mut faults = Vec::new();
    for mistake in mistakes {
        let folder = folder::sample();
        (mistake.make)(folder.path());
        let mut command = command();
        command
            .current_dir(folder.path())
            .args(mistake.words.split(' '));
        let output = finish(&command.output().unwrap());
        let Mistake { what, code, .. } = mistake;
        println!("{what} -> {}: {}", output.code, output.stderr.trim());
        let is_reported = mistake.expected.iter().all(|word| output.stderr.contains(word));
        let is_panic = output.stderr.contains("panicked");
        if output.code != *code || !is_reported || is_panic || mistake.expected.is_empty() {
            faults.push(format!(
                "{what}: expected exit code {code} and {:?}, found {}:\n{}{}",
                mistake.expected, output.code, output.stdout, output.stderr
            ));
        }
        // The named folder of results, and the default one.
        let is_left = ["out", "farfield-out"].map(|name| folder.path().join(name).is_dir());
        if *code == 2 && is_left.contains(&true) {
            faults.push(format!("{what}: refused, and results were written"));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
}
