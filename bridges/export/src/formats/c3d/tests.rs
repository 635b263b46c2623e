//! Tests of the bytes of C3D files, by their documented offsets.

use crate::axes::Preset;
use crate::fixture::{KEYPOINTS, poses_jsonl, summary_json};
use crate::formats::determined;
use crate::timeline::Gaps;
use crate::{Existing, ExportRequest, Format, Options, export};

/// The file of person 2, who is absent between ticks 20 and 30.
fn file(gaps: Gaps) -> Vec<u8> {
    file_of(&poses_jsonl(&[2], 40), gaps, None)
}

fn file_of(poses: &str, gaps: Gaps, preset: Option<Preset>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("poses.jsonl"), poses).unwrap();
    std::fs::write(folder.path().join("summary.json"), summary_json(40)).unwrap();
    let request = ExportRequest {
        poses: folder.path().join("poses.jsonl"),
        summary: folder.path().join("summary.json"),
        edits: None,
        subjects: Vec::new(),
        cameras: Vec::new(),
        out: folder.path().to_owned(),
        formats: vec![Format::C3d],
        options: Options {
            gaps,
            preset,
            ..Options::default()
        },
        existing: Existing::Refuse,
    };
    std::fs::read(&export(&request, |_| ()).unwrap()[0].path).unwrap()
}

fn word(bytes: &[u8], number: usize) -> u16 {
    u16::from_le_bytes([bytes[2 * number - 2], bytes[2 * number - 1]])
}

/// The bits of a floating-point number, for exact comparison.
fn float(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// Cameras and residual of the first point of a frame, counted from 0.
fn cameras_and_residual(bytes: &[u8], frame: usize) -> u32 {
    let n_points = usize::from(word(bytes, 2));
    let start = 512 * (usize::from(word(bytes, 9)) - 1);
    float(bytes, start + 16 * n_points * frame + 12)
}

#[test]
fn header_fields_match_the_content() {
    let bytes = file(Gaps::Keep);
    // Nose, left knee and right wrist; joints that they do not determine are omitted, as in TRC
    // files.
    let determined_points = determined(&KEYPOINTS.map(str::to_owned));
    let n_joints = determined_points
        .iter()
        .take(29)
        .filter(|is_determined| **is_determined)
        .count() as u16;
    assert!((10..20).contains(&n_joints), "{n_joints}");
    assert_eq!(bytes.len() % 512, 0);
    assert_eq!(&bytes[..2], &[2, 0x50]);
    assert_eq!(
        [word(&bytes, 2), word(&bytes, 4), word(&bytes, 5)],
        [n_joints + 3, 1, 40]
    );
    assert_eq!(
        [float(&bytes, 12), float(&bytes, 20)],
        [-1.0_f32, 60.0].map(f32::to_bits)
    );
    // The parameters have as many blocks as precede the data.
    assert_eq!(u16::from(bytes[514]) + 2, word(&bytes, 9));
    assert_eq!(bytes[515], 84);
}

#[test]
fn absent_points_have_residual_minus_one_and_filled_ones_zero() {
    // Other points are seen by 4 views with a deviation of 12 mm.
    let (unfilled, filled) = (file(Gaps::Keep), file(Gaps::Fill));
    let seen = f32::from(0x0F00_u16) + 12.0;
    let [unfilled_gap, filled_gap] =
        [-1.0, 0.0].map(|gap: f32| [seen, gap, gap, seen].map(f32::to_bits));
    assert_eq!(
        [19, 20, 29, 30].map(|frame| cameras_and_residual(&unfilled, frame)),
        unfilled_gap
    );
    assert_eq!(
        [19, 20, 29, 30].map(|frame| cameras_and_residual(&filled, frame)),
        filled_gap
    );
}

/// The value of `POINT:SCALE`.
fn scale(bytes: &[u8]) -> f32 {
    let name = b"\x05\x01SCALE";
    let at = bytes.windows(name.len()).position(|it| it == name).unwrap();
    // Offset to the next item, type, number of dimensions.
    f32::from_bits(float(bytes, at + name.len() + 2 + 1 + 1))
}

/// Poses with the deviation `sigma_m`, or without one.
fn poses_with_sigma(sigma_m: Option<f64>) -> String {
    let lines = poses_jsonl(&[2], 40);
    let lines = lines.lines().map(|line| {
        let mut line: serde_json::Value = serde_json::from_str(line).unwrap();
        let fields = line.as_object_mut().unwrap();
        match sigma_m {
            None => drop(fields.remove("sigma_m")),
            Some(sigma_m) => {
                for sigma in fields["sigma_m"].as_object_mut().unwrap().values_mut() {
                    *sigma = sigma_m.into();
                }
            }
        }
        format!("{line}\n")
    });
    lines.collect()
}

#[test]
fn residuals_are_deviations_in_the_file_unit() {
    for (preset, per_metre) in [
        (None, 1000.0),
        (Some(Preset::Blender), 1.0),
        (Some(Preset::Unity), 1.0),
        (Some(Preset::Unreal), 100.0),
    ] {
        let bytes = file_of(&poses_with_sigma(Some(0.012)), Gaps::Keep, preset);
        assert_eq!(float(&bytes, 12), scale(&bytes).to_bits());
        assert!(scale(&bytes) < 0.0, "floating-point data");
        let residual = f32::from_bits(cameras_and_residual(&bytes, 0)) % 256.0;
        let in_units = f64::from(residual * scale(&bytes).abs());
        let apart_m = (in_units / per_metre - 0.012).abs();
        assert!(apart_m < 1e-6, "{preset:?}: {in_units}");
    }
}

#[test]
fn seen_points_are_never_marked_as_filled() {
    for sigma_m in [None, Some(0.0002)] {
        for preset in [None, Some(Preset::Blender)] {
            let bytes = file_of(&poses_with_sigma(sigma_m), Gaps::Keep, preset);
            let seen = f32::from(0x0F00_u16) + 1.0;
            assert_eq!(
                cameras_and_residual(&bytes, 0),
                seen.to_bits(),
                "{sigma_m:?}, {preset:?}"
            );
        }
    }
}
