//! Which frame a file or a picture is of: the last number in its name.

/// Frames are counted up to here; what is more is a time, not a count.
pub(crate) const MAX_FRAME: i64 = 1 << 40;

/// The last number in a file's name, without its folder and its ending; `None` where there is none, or one too large.
///
/// `cam01_000000000123_keypoints.json` is 123, as is `123.jpg`.
pub(crate) fn of_name(name: &str) -> Option<i64> {
    let name = name.rsplit(['/', '\\']).next().unwrap_or(name);
    let stem = match name.rsplit_once('.') {
        Some((stem, ending)) if !stem.is_empty() && !ending.bytes().all(|c| c.is_ascii_digit()) => {
            stem
        }
        _ => name,
    };
    let end = stem.rfind(|c: char| c.is_ascii_digit())? + 1;
    let head = stem.get(..end)?;
    let start = head.rfind(|c: char| !c.is_ascii_digit()).map_or(0, |at| {
        // Beyond the last character that is no digit.
        at + head[at..].chars().next().map_or(1, char::len_utf8)
    });
    let number = head.get(start..)?.parse().ok()?;
    (number <= MAX_FRAME).then_some(number)
}

/// The folder that a picture's name has before its last part, as COCO's `file_name` may.
pub(crate) fn folder_of_name(name: &str) -> Option<&str> {
    let (folder, _) = name.rsplit_once(['/', '\\'])?;
    let last = folder.rsplit(['/', '\\']).find(|it| !it.is_empty())?;
    (last != "." && last != "..").then_some(last)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_last_number_of_a_name_is_its_frame() {
        for (name, frame) in [
            ("cam01_000000000123_keypoints.json", Some(123)),
            ("cam01_000042.json", Some(42)),
            ("00012.json", Some(12)),
            ("frame_7.json", Some(7)),
            ("0.jpg", Some(0)),
            ("labeled-data/video2/img0012.png", Some(12)),
            ("123", Some(123)),
            ("take2_é34é.jpg", Some(34)),
            ("keypoints.json", None),
            ("99999999999999999999.json", None),
            ("", None),
        ] {
            assert_eq!(of_name(name), frame, "{name}");
        }
        assert_eq!(folder_of_name("images/cam1/0001.jpg"), Some("cam1"));
        assert_eq!(folder_of_name("0001.jpg"), None);
    }

    proptest! {
        #[test]
        fn no_name_panics(name in ".{0,40}") {
            of_name(&name);
            folder_of_name(&name);
        }

        #[test]
        fn numbers_come_back(prefix in "[a-z_é]{0,6}", frame in 0i64..=MAX_FRAME, width in 0usize..13) {
            let name = format!("{prefix}{frame:0width$}_keypoints.json");
            prop_assert_eq!(of_name(&name), Some(frame));
        }
    }
}
