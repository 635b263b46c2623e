//! QR code of an address made of characters, to scan from a terminal.

use qrcode::render::unicode::Dense1x2;
use qrcode::{EcLevel, QrCode};

/// The code of `text`, two rows of squares per line, dark on light independently of the terminal's
/// colours; `None` if the text is too long.
pub fn terminal_code(text: &str) -> Option<String> {
    let code = QrCode::with_error_correction_level(text, EcLevel::L).ok()?;
    // Most terminals are dark, so the light squares are drawn.
    let drawn = code
        .render::<Dense1x2>()
        .dark_color(Dense1x2::Dark)
        .light_color(Dense1x2::Light)
        .build();
    Some(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_fits_a_terminal() {
        let text = "https://192.168.100.100:7460/#token=0123456789abcdef0123456789abcdef";
        let drawn = terminal_code(text).unwrap();
        let lines: Vec<&str> = drawn.lines().collect();
        assert!(lines.len() <= 24, "{}", lines.len());
        assert!(lines.iter().all(|line| line.chars().count() <= 48));
        assert!(
            drawn
                .chars()
                .all(|c| matches!(c, '\u{2580}' | '\u{2584}' | '\u{2588}' | ' ' | '\n'))
        );
    }

    #[test]
    fn a_text_that_is_too_long_gives_no_code() {
        assert_eq!(terminal_code(&"x".repeat(5000)), None);
    }
}
