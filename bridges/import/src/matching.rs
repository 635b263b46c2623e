//! Matches recordings to cameras by name. Case and separators do not count, and the longest
//! matching name wins.

use std::collections::BTreeMap;

/// Names this short occur inside many others, so they must match a whole part.
const SHORT: usize = 2;

/// What to do with recordings that match no camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Leftovers {
    /// Refuse: every recording must match a camera.
    Refused,
    /// Ignore: the caller listed only some of the cameras.
    LeftOut,
}

/// Returns the index in `recordings` of the recording of each camera.
///
/// # Errors
/// One sentence for every camera without exactly one recording, and for every recording that
/// matches no camera or several.
pub fn matched<'a>(
    cameras: &[&'a str],
    recordings: &[&str],
    leftovers: Leftovers,
) -> Result<BTreeMap<&'a str, usize>, Vec<String>> {
    let mut found: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    let mut faults = Vec::new();
    for (place, recording) in recordings.iter().enumerate() {
        let named = named_by(cameras, recording);
        match named[..] {
            [camera] => found.entry(camera).or_default().push(place),
            [] if leftovers == Leftovers::Refused => {
                faults.push(format!("`{recording}` is of no camera"));
            }
            [] => {}
            _ => faults.push(format!(
                "`{recording}` may be of `{}`",
                named.join("` or `")
            )),
        }
    }
    for camera in cameras {
        match found.get(camera).map_or(&[][..], Vec::as_slice) {
            [_] => {}
            [] => faults.push(format!("camera `{camera}` has no recording")),
            several => {
                let names: Vec<&str> = several
                    .iter()
                    .filter_map(|place| recordings.get(*place).copied())
                    .collect();
                faults.push(format!(
                    "camera `{camera}` has several recordings: `{}`",
                    names.join("`, `")
                ));
            }
        }
    }
    if !faults.is_empty() {
        return Err(faults);
    }
    Ok(found
        .into_iter()
        .filter_map(|(camera, all)| Some((camera, *all.first()?)))
        .collect())
}

/// The longest of `cameras` that occur in `name`; several if equally long.
pub fn named_by<'a>(cameras: &[&'a str], name: &str) -> Vec<&'a str> {
    let text = parts(name);
    let length = |camera: &str| {
        parts(camera)
            .iter()
            .map(|part| part.text.len())
            .sum::<usize>()
    };
    let fits: Vec<&str> = cameras
        .iter()
        .copied()
        .filter(|camera| occurs_in(camera, &text))
        .collect();
    let most = fits.iter().map(|camera| length(camera)).max();
    fits.into_iter()
        .filter(|camera| Some(length(camera)) == most)
        .collect()
}

/// A run of letters or of digits.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Part {
    /// In lower case; numbers without leading zeros.
    text: String,
    is_number: bool,
    /// Whether a separator precedes it.
    is_apart: bool,
}

/// Splits a name. Letters join over separators, numbers do not.
fn parts(name: &str) -> Vec<Part> {
    let mut parts: Vec<Part> = Vec::new();
    let mut is_apart = true;
    for c in name.chars().flat_map(char::to_lowercase) {
        if !c.is_alphanumeric() {
            is_apart = true;
            continue;
        }
        let is_number = c.is_ascii_digit();
        match parts.last_mut() {
            Some(last) if last.is_number == is_number && !is_apart => last.text.push(c),
            _ => parts.push(Part {
                text: c.to_string(),
                is_number,
                is_apart,
            }),
        }
        is_apart = false;
    }
    for part in parts.iter_mut().filter(|part| part.is_number) {
        let zeros = part.text.len() - part.text.trim_start_matches('0').len();
        part.text.drain(..zeros.min(part.text.len() - 1));
    }
    parts
}

/// Sort key that puts `cam_2` before `cam_10`.
pub(crate) type NaturalKey = Vec<(usize, String)>;

/// Sort key by the last number of a name, then by the whole name; the flag is true without a
/// number.
pub(crate) fn by_last_number(name: &str) -> (bool, NaturalKey) {
    let parts = parts(name);
    // Without leading zeros, the longer number is the larger one.
    let key = |part: &Part| {
        let length = if part.is_number { part.text.len() } else { 0 };
        (length, part.text.clone())
    };
    let last = parts.iter().rev().find(|part| part.is_number);
    let mut order: NaturalKey = last.map(key).into_iter().collect();
    order.extend(parts.iter().map(key));
    (last.is_none(), order)
}

/// Joins adjacent runs of letters.
fn joined(parts: &[Part]) -> Vec<Part> {
    let mut whole: Vec<Part> = Vec::new();
    for part in parts {
        match whole.last_mut() {
            Some(last) if !last.is_number && !part.is_number => last.text += &part.text,
            _ => whole.push(part.clone()),
        }
    }
    whole
}

fn occurs_in(camera: &str, text: &[Part]) -> bool {
    let wanted = parts(camera);
    if let [only] = &wanted[..]
        && only.text.len() <= SHORT
    {
        return text.iter().any(|part| part.text == only.text);
    }
    let (wanted, text) = (joined(&wanted), joined(text));
    if wanted.is_empty() {
        return false;
    }
    text.windows(wanted.len()).any(|window| {
        let last = wanted.len() - 1;
        wanted
            .iter()
            .zip(window)
            .enumerate()
            .all(|(i, (part, found))| {
                if part.is_number != found.is_number {
                    return false;
                }
                // A word may continue before the first letters and after the last.
                match (part.is_number, i == 0, i == last) {
                    (true, _, _) | (false, false, false) => part.text == found.text,
                    (false, true, true) => found.text.contains(&part.text),
                    (false, true, false) => found.text.ends_with(&part.text),
                    (false, false, true) => found.text.starts_with(&part.text),
                }
            })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(cameras: &[&str], names: &[&str]) {
        let found = matched(cameras, names, Leftovers::Refused).unwrap();
        let found: Vec<(&str, &str)> = found
            .into_iter()
            .map(|(camera, place)| (camera, names[place]))
            .collect();
        let expected: Vec<(&str, &str)> =
            cameras.iter().copied().zip(names.iter().copied()).collect();
        assert_eq!(found, expected);
    }

    fn faults(cameras: &[&str], names: &[&str]) -> String {
        matched(cameras, names, Leftovers::Refused)
            .unwrap_err()
            .join("\n")
    }

    #[test]
    fn matching_ignores_case_separators_leading_zeros_and_other_text() {
        check(&["ne-left", "sw"], &["2024-05-01_NE_Left", "take3 sw"]);
        check(&["cam_1", "cam_2"], &["cam01", "cam02"]);
        check(
            &["cam1", "cam10", "cam2"],
            &["hall_cam1_60fps", "hall_cam10_60fps", "hall_cam2_60fps"],
        );
        check(
            &["int_cam01_img", "int_cam02_img"],
            &["int_cam01_img", "int_cam02_img"],
        );
        check(&["left", "left-far"], &["left", "left_far"]);
        check(&["a", "b"], &["camera a", "camera b"]);
    }

    #[test]
    fn missing_or_ambiguous_recordings_are_refused() {
        let message = faults(&["cam1", "cam2"], &["cam1", "cam12"]);
        assert!(
            message.contains("`cam12` is of no camera")
                && message.contains("camera `cam2` has no recording"),
            "{message}"
        );
        let message = faults(&["cam1", "cam2"], &["cam1 and cam2", "cam2"]);
        assert!(
            message.contains("`cam1 and cam2` may be of `cam1` or `cam2`"),
            "{message}"
        );
        let message = faults(&["cam1"], &["cam1", "cam1 again"]);
        assert!(
            message.contains("camera `cam1` has several recordings: `cam1`, `cam1 again`"),
            "{message}"
        );
    }

    #[test]
    fn recordings_of_unlisted_cameras_can_be_left_out() {
        let found = matched(&["cam2"], &["cam1", "cam2"], Leftovers::LeftOut);
        assert_eq!(found, Ok(BTreeMap::from([("cam2", 1)])));
    }
}
