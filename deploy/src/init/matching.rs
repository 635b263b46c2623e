//! Which recording is which camera's, by their names: case and separators do not count, the longest name does.

use std::collections::BTreeMap;

use anyhow::bail;

use super::recordings::Recording;

/// Names this short are everywhere inside others, and must stand alone.
const SHORT: usize = 2;

/// Whether cameras, or recordings, may be left over.
///
/// The recording of every one of `cameras`; where `all` are meant, every recording must be one of a camera.
///
/// # Errors
/// Lists both where a camera has no recording or two, or a recording no camera.
pub(super) fn matched<'a>(
    cameras: &[&'a str],
    recordings: &'a [Recording],
    all: bool,
) -> anyhow::Result<BTreeMap<&'a str, &'a Recording>> {
    let mut found: BTreeMap<&str, Vec<&Recording>> = BTreeMap::new();
    let mut faults = Vec::new();
    for recording in recordings {
        let named = longest(cameras, &recording.name);
        match named[..] {
            [camera] => found.entry(camera).or_default().push(recording),
            [] if all => faults.push(format!("`{}` is of no camera", recording.name)),
            [] => {}
            _ => faults.push(format!(
                "`{}` may be of `{}`",
                recording.name,
                named.join("` or `")
            )),
        }
    }
    for camera in cameras {
        match found.get(camera).map_or(&[][..], Vec::as_slice) {
            [_] => {}
            [] => faults.push(format!("camera `{camera}` has no recording")),
            several => {
                let names: Vec<&str> = several.iter().map(|it| it.name.as_str()).collect();
                faults.push(format!(
                    "camera `{camera}` has several recordings: `{}`",
                    names.join("`, `")
                ));
            }
        }
    }
    if !faults.is_empty() {
        let names: Vec<&str> = recordings.iter().map(|it| it.name.as_str()).collect();
        bail!(
            "{}\ncameras of the calibration: {}\nrecordings: {}\nname the files after the cameras, or say which cameras \
             to use with `--viewpoint NAME=CAM1,CAM2`",
            faults.join("\n"),
            cameras.join(", "),
            names.join(", ")
        );
    }
    Ok(found
        .into_iter()
        .filter_map(|(camera, all)| Some((camera, *all.first()?)))
        .collect())
}

/// The longest of `cameras` whose name stands in `name`; several that are equally long.
fn longest<'a>(cameras: &[&'a str], name: &str) -> Vec<&'a str> {
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
        .filter(|camera| stands_in(camera, &text))
        .collect();
    let most = fits.iter().map(|camera| length(camera)).max();
    fits.into_iter()
        .filter(|camera| Some(length(camera)) == most)
        .collect()
}

/// A run of letters or of digits.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Part {
    /// In lower case; of a number, without its leading zeros.
    text: String,
    is_number: bool,
    /// Whether a separator stands before it.
    is_apart: bool,
}

/// Letters join over separators, numbers do not.
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

/// Neighbouring runs of letters as one.
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

fn stands_in(camera: &str, text: &[Part]) -> bool {
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
                // Words may go on before the first letters and behind the last.
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
    use super::super::recordings::RecordingKind;
    use super::*;

    fn recordings(names: &[&str]) -> Vec<Recording> {
        let recording = |name: &&str| Recording {
            kind: RecordingKind::Video,
            path: format!("{name}.mp4").into(),
            name: (*name).to_owned(),
        };
        names.iter().map(recording).collect()
    }

    fn pairs(cameras: &[&str], names: &[&str]) -> Result<Vec<(String, String)>, String> {
        let recordings = recordings(names);
        let found = matched(cameras, &recordings, true).map_err(|error| error.to_string())?;
        Ok(found
            .into_iter()
            .map(|(camera, it)| (camera.to_owned(), it.name.clone()))
            .collect())
    }

    fn check(cameras: &[&str], names: &[&str]) {
        let expected: Vec<_> = cameras
            .iter()
            .zip(names)
            .map(|(a, b)| ((*a).to_owned(), (*b).to_owned()))
            .collect();
        assert_eq!(pairs(cameras, names), Ok(expected));
    }

    #[test]
    fn case_separators_leading_zeros_and_what_stands_around_do_not_count() {
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
    fn what_is_missing_or_ambiguous_is_refused_with_both_lists() {
        let said = pairs(&["cam1", "cam2"], &["cam1", "cam12"]).unwrap_err();
        assert!(
            said.contains("`cam12` is of no camera")
                && said.contains("camera `cam2` has no recording"),
            "{said}"
        );
        assert!(
            said.contains("cameras of the calibration: cam1, cam2\nrecordings: cam1, cam12"),
            "{said}"
        );
        let said = pairs(&["cam1", "cam2"], &["cam1 and cam2", "cam2"]).unwrap_err();
        assert!(
            said.contains("`cam1 and cam2` may be of `cam1` or `cam2`"),
            "{said}"
        );
        let said = pairs(&["cam1"], &["cam1", "cam1 again"]).unwrap_err();
        assert!(
            said.contains("camera `cam1` has several recordings: `cam1`, `cam1 again`"),
            "{said}"
        );
    }

    #[test]
    fn where_cameras_were_named_other_recordings_are_left_out() {
        let recordings = recordings(&["cam1", "cam2"]);
        assert_eq!(matched(&["cam2"], &recordings, false).unwrap().len(), 1);
    }
}
