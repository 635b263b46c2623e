//! Which calibration a sheet is of: the fingerprint that venues know their calibration by, in the head of the page.

/// What stands before and behind the fingerprint.
const BEFORE: &str = "<meta name=\"farfield-calibration\" content=\"";
const AFTER: &str = "\">";
/// Digits of a fingerprint.
const DIGITS: usize = 16;
/// Where it stands at the latest, bytes.
const HEAD_BYTES: usize = 4096;

/// The line of the sheet of the calibration with this text.
pub(crate) fn line(calibration: &str) -> String {
    let fingerprint = &blake3::hash(calibration.as_bytes()).to_hex()[..DIGITS];
    format!("{BEFORE}{fingerprint}{AFTER}")
}

/// The fingerprint of the calibration that the sheet with these bytes is of; `None` where it does not say.
pub(crate) fn of_sheet(html: &[u8]) -> Option<&str> {
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
    fn a_sheet_says_what_a_venue_knows_its_calibration_by() {
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("calibration.sample.toml");
        let text = std::fs::read_to_string(&sample).unwrap();
        let known = Calibration::parse(&text, &sample).unwrap().hash;
        let sheet = format!("<!doctype html>{}<title>", line(&text));
        assert_eq!(of_sheet(sheet.as_bytes()), Some(known.as_str()));
    }

    #[test]
    fn what_says_nothing_is_of_nothing() {
        for html in [
            "",
            "<!doctype html><h1>",
            "<meta name=\"farfield-calibration\" content=\"12\">",
        ] {
            assert_eq!(of_sheet(html.as_bytes()), None);
        }
        assert_eq!(of_sheet(&[0xff; 9000]), None);
    }
}
