//! Options with an optional value. The next word is the value of such an option if it is a valid
//! value; otherwise it is a separate argument.

use std::ffi::{OsStr, OsString};

/// `words` with values joined to their options: `--record a.mcap` becomes `--record=a.mcap`. In
/// `fusion --record hall.toml` the last word is the venue. `is_value` decides for a word whether it
/// is the value of the option before it.
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

/// Whether a word may name an output file: it is neither an option nor a venue.
pub fn is_file(word: &OsStr) -> bool {
    !word.as_encoded_bytes().starts_with(b"-") && !is_venue(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_is_joined_to_its_option_but_a_venue_is_not() {
        let of_record = |before: &[OsString], word: &OsStr| {
            before.last().is_some_and(|it| it == "--record") && is_file(word)
        };
        for (line, understood) in [
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
            let words = joined(line.split(' ').map(OsString::from), of_record);
            let words: Vec<&str> = words.iter().map(|word| word.to_str().unwrap()).collect();
            assert_eq!(words.join(" "), understood);
        }
    }
}
