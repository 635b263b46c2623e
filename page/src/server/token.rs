//! The token: 128 random bits that say that somebody has the address that was printed.

use std::fmt::{self, Write as _};

use ring::rand::{SecureRandom as _, SystemRandom};

/// Bytes of a token.
const BYTES: usize = 16;
/// Digits of its text.
const DIGITS: usize = 2 * BYTES;

/// A token; its text is 32 hexadecimal digits.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A new one; `None` where the system has no random numbers.
    pub fn random() -> Option<Self> {
        let mut bytes = [0; BYTES];
        SystemRandom::new().fill(&mut bytes).ok()?;
        let mut text = String::with_capacity(DIGITS);
        for byte in bytes {
            write!(text, "{byte:02x}").ok()?;
        }
        Some(Self(text))
    }

    /// The one with this text; `None` where it is no token's.
    pub fn of_text(text: &str) -> Option<Self> {
        let is_digit = |byte: u8| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte);
        let is_token = text.len() == DIGITS && text.bytes().all(is_digit);
        is_token.then(|| Self(text.to_owned()))
    }

    /// Its text.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether `text` is the token; takes as long wherever the two differ.
    pub(crate) fn is(&self, text: &str) -> bool {
        let (known, said) = (self.0.as_bytes(), text.as_bytes());
        let differ = known
            .iter()
            .zip(said)
            .fold(0, |differ, (a, b)| differ | (a ^ b));
        known.len() == said.len() && differ == 0
    }
}

impl fmt::Debug for Token {
    /// Not its text: logs are read by others.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tokens_are_new_each_time_and_know_themselves() {
        let [a, b] = [0, 1].map(|_| Token::random().unwrap());
        assert_eq!(a.text().len(), 32);
        assert!(a.is(a.text()) && !a.is(b.text()) && !a.is("") && !a.is(&a.text()[..31]));
        assert_eq!(format!("{a:?}"), "Token(..)");
    }

    #[test]
    fn a_token_is_known_by_its_text_and_nothing_else_is_one() {
        let token = Token::random().unwrap();
        let text = token.text();
        assert!(Token::of_text(text).unwrap().is(text));
        for other in ["", "x", &text[1..], &format!("{text}0"), &"G".repeat(32)] {
            assert!(Token::of_text(other).is_none(), "{other}");
        }
    }
}
