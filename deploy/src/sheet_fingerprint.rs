//! The fingerprint of a calibration in the head of its sheet (a web page); venues identify calibrations by it.

/// Text before and after the fingerprint.
const BEFORE: &str = "<meta name=\"farfield-calibration\" content=\"";
const AFTER: &str = "\">";
/// Digits of a fingerprint.
const DIGITS: usize = 16;
/// The fingerprint is within the first bytes of the page.
const HEAD_BYTES: usize = 4096;

/// The line in the sheet of the calibration with this text.
pub(crate) fn line(calibration: &str) -> String {
    let fingerprint = &blake3::hash(calibration.as_bytes()).to_hex()[..DIGITS];
    format!("{BEFORE}{fingerprint}{AFTER}")
}

/// The fingerprint in the sheet with these bytes; `None` if it has none.
pub(crate) fn read(html: &[u8]) -> Option<&str> {
    let head = html.get(..HEAD_BYTES).unwrap_or(html);
    let head = head.utf8_chunks().next().map_or("", |chunk| chunk.valid());
    let (_, behind) = head.split_once(BEFORE)?;
    let (fingerprint, _) = behind.split_once(AFTER)?;
    let is_one = fingerprint.len() == DIGITS && fingerprint.bytes().all(|b| b.is_ascii_hexdigit());
    is_one.then_some(fingerprint)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::calibration::Calibration;

    use super::*;

    #[test]
    fn a_sheet_has_the_fingerprint_that_venues_use() {
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("calibration.sample.toml");
        let text = std::fs::read_to_string(&sample).unwrap();
        let known = Calibration::parse(&text, &sample).unwrap().hash;
        let sheet = format!("<!doctype html>{}<title>", line(&text));
        assert_eq!(read(sheet.as_bytes()), Some(known.as_str()));
    }

    #[test]
    fn a_page_without_a_fingerprint_has_none() {
        for html in [
            "",
            "<!doctype html><h1>",
            "<meta name=\"farfield-calibration\" content=\"12\">",
        ] {
            assert_eq!(read(html.as_bytes()), None);
        }
        assert_eq!(read(&[0xff; 9000]), None);
    }
}
