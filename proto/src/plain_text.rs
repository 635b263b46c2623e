//! Makes foreign text (of nodes, files, programs, devices) safe to print and to use in file names.
//!
//! A terminal obeys control characters, a line feed starts a line that looks like one of ours, and
//! direction marks display a text as another. All of these are escaped as in JSON (`\n`, `\u202e`),
//! so that JSON stays JSON. Passwords in URLs are masked, because programs print the URLs that they
//! receive.

use std::fmt::Write as _;

/// Replaces a user's name and password.
const MASK: char = '…';
/// Characters that some system forbids in file names, and `%`, which marks a replacement.
const NOT_IN_FILE_NAMES: &str = "/\\:*?\"<>|%";

/// Whether `c` is displayed as itself: it does not control a terminal, end a line, change the
/// direction or hide text.
pub fn is_plain(c: char) -> bool {
    let is_hidden = matches!(
        c,
        '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{feff}'
    );
    !(c.is_control() || is_hidden)
}

/// Foreign `text` as part of one line.
pub fn one_line(text: &str) -> String {
    written_out(text, is_plain)
}

/// Our own text of any number of lines, which may contain foreign text.
pub fn lines(text: &str) -> String {
    written_out(text, |c| is_plain(c) || matches!(c, '\n' | '\t'))
}

/// `text` without the users and passwords of the URLs in it.
pub fn without_passwords(text: &str) -> String {
    let mut rest = text;
    let mut masked = String::with_capacity(text.len());
    while let Some((before, url)) = rest.split_once("://") {
        masked.extend([before, "://"]);
        let ends = |c: char| "/?#\"'`<>".contains(c) || c.is_whitespace();
        let authority = url.split(ends).next().unwrap_or(url);
        rest = url;
        if let Some(end) = authority.rfind('@') {
            masked.push(MASK);
            rest = &url[end..];
        }
    }
    masked + rest
}

/// A file name, or the start of one, for `name`: it cannot leave its folder, and no other name
/// gives the same.
pub fn file_stem(name: &str) -> String {
    let mut stem = String::with_capacity(name.len());
    for (i, c) in name.chars().enumerate() {
        let is_hiding = i == 0 && c == '.';
        if is_plain(c) && !is_hiding && !NOT_IN_FILE_NAMES.contains(c) {
            stem.push(c);
        } else {
            // Writing to memory does not fail.
            write!(stem, "%{:02X}", u32::from(c)).ok();
        }
    }
    stem
}

fn written_out(text: &str, stays: impl Fn(char) -> bool) -> String {
    let masked = without_passwords(text);
    let mut plain = String::with_capacity(masked.len());
    for c in masked.chars() {
        match c {
            c if stays(c) => plain.push(c),
            '\n' => plain.push_str("\\n"),
            '\r' => plain.push_str("\\r"),
            '\t' => plain.push_str("\\t"),
            // All of them have at most four digits; writing to memory does not fail.
            c => write!(plain, "\\u{:04x}", u32::from(c)).unwrap_or_default(),
        }
    }
    plain
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn foreign_text_controls_no_terminal_and_starts_no_line() {
        let bad = "\u{1b}[2Ja\r\nfusion: all is well\u{202e}b\u{85}\u{9b}31m\u{2028}\u{feff}";
        assert_eq!(
            one_line(bad),
            "\\u001b[2Ja\\r\\nfusion: all is well\\u202eb\\u0085\\u009b31m\\u2028\\ufeff"
        );
        assert_eq!(lines("a\tb\nc\u{1b}"), "a\tb\nc\\u001b");
        assert_eq!(one_line("Zoë, 黒澤 👩‍🚀"), "Zoë, 黒澤 👩‍🚀");
    }

    #[test]
    fn passwords_in_urls_are_masked() {
        for (text, shown) in [
            ("rtsp://me:p@ss@cam.local/1", "rtsp://…@cam.local/1"),
            ("rtsp://cam.local/a@b", "rtsp://cam.local/a@b"),
            ("/dev/video0", "/dev/video0"),
            (
                "rtsp://a:b@c: 401; http://d:e@f/g 'x://h@i'",
                "rtsp://…@c: 401; http://…@f/g 'x://…@i'",
            ),
            ("mail me@home or ://", "mail me@home or ://"),
        ] {
            assert_eq!(without_passwords(text), shown);
            assert_eq!(one_line(text), shown);
        }
    }

    #[test]
    fn a_file_named_after_a_person_stays_in_its_folder() {
        assert_eq!(file_stem("cam-1.left é"), "cam-1.left é");
        assert_eq!(file_stem("../a"), "%2E.%2Fa");
        assert_eq!(file_stem("a/b\u{1b}"), "a%2Fb%1B");
        assert_ne!(file_stem("a/b"), file_stem("a%2Fb"));
    }

    proptest! {
        #[test]
        fn only_plain_text_remains(text in any::<String>()) {
            prop_assert!(one_line(&text).chars().all(is_plain));
            prop_assert!(lines(&text).chars().all(|c| is_plain(c) || c == '\n' || c == '\t'));
        }

        #[test]
        fn different_names_give_different_files(a in "[a%/.\u{1b}]{0,4}", b in "[a%/.\u{1b}]{0,4}") {
            prop_assert_eq!(file_stem(&a) == file_stem(&b), a == b);
            prop_assert!(!file_stem(&a).contains('/') && !file_stem(&a).starts_with('.'));
        }
    }
}
