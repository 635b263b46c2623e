//! The words of a command line before they are understood: what follows an option that can do without a value is its value
//! where it can be one, and else what comes next.

use std::ffi::{OsStr, OsString};

/// `words` with values joined to their options: `--record a.mcap` is `--record=a.mcap`, but what follows `--record` in
/// `fusion --record hall.toml` is the venue. `is_value` says of a word whether it is the value of the last of those before
/// it.
pub fn joined(
    words: impl IntoIterator<Item = OsString>,
    is_value: impl Fn(&[OsString], &OsStr) -> bool,
) -> Vec<OsString> {
    let mut joined: Vec<OsString> = Vec::new();
    for word in words {
        let belongs = is_value(&joined, &word);
        match joined.last_mut() {
            Some(last) if belongs => {
                last.push("=");
                last.push(word);
            }
            _ => joined.push(word),
        }
    }
    joined
}

/// Whether a word names a venue.
pub fn is_venue(word: &OsStr) -> bool {
    word.as_encoded_bytes().ends_with(b".toml")
}

/// Whether a word may name a file to be written: it is no option, and no venue.
pub fn is_file(word: &OsStr) -> bool {
    !word.as_encoded_bytes().starts_with(b"-") && !is_venue(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_joined_to_its_option_and_a_venue_is_none() {
        let of_record = |before: &[OsString], word: &OsStr| {
            before.last().is_some_and(|it| it == "--record") && is_file(word)
        };
        for (said, understood) in [
            ("fusion --record hall.toml", "fusion --record hall.toml"),
            (
                "fusion hall.toml --record --live",
                "fusion hall.toml --record --live",
            ),
            (
                "fusion hall.toml --record a/ --live",
                "fusion hall.toml --record=a/ --live",
            ),
            ("fusion hall.toml --record", "fusion hall.toml --record"),
            ("a.mcap", "a.mcap"),
        ] {
            let words = joined(said.split(' ').map(OsString::from), of_record);
            let words: Vec<&str> = words.iter().map(|word| word.to_str().unwrap()).collect();
            assert_eq!(words.join(" "), understood);
        }
    }
}
