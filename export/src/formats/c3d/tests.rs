//! The bytes of C3D files, read by their places in the format's description.

use crate::fixture::{KEYPOINTS, poses_jsonl, summary_json};
use crate::formats::points::determined;
use crate::timeline::Gaps;
use crate::{Existing, ExportRequest, Format, Options, export};

fn file(gaps: Gaps) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("poses.jsonl"), poses_jsonl(&[2], 40)).unwrap();
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
            ..Options::default()
        },
        existing: Existing::Refuse,
    };
    std::fs::read(&export(&request, |_| ()).unwrap()[0].path).unwrap()
}

fn word(bytes: &[u8], number: usize) -> u16 {
    u16::from_le_bytes([bytes[2 * number - 2], bytes[2 * number - 1]])
}

/// The bits of a floating-point number: numbers that are written as they are come back so.
fn float(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// Cameras and residual of the first point of a frame from 0.
fn told(bytes: &[u8], frame: usize) -> u32 {
    let n_points = usize::from(word(bytes, 2));
    let start = 512 * (usize::from(word(bytes, 9)) - 1);
    float(bytes, start + 16 * n_points * frame + 12)
}

#[test]
fn the_head_says_where_what_lies() {
    let bytes = file(Gaps::Keep);
    // Nose, left knee and right wrist: what hangs from none of them is left out, as in a TRC file.
    let kept = determined(&KEYPOINTS.map(str::to_owned));
    let n_joints = kept.iter().take(29).filter(|is_kept| **is_kept).count() as u16;
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
    // The parameters have as many blocks as lie before the data.
    assert_eq!(u16::from(bytes[514]) + 2, word(&bytes, 9));
    assert_eq!(bytes[515], 84);
}

#[test]
fn absent_points_have_no_residual_and_filled_ones_no_camera() {
    // Person 2 is away between ticks 20 and 30; others are seen by 4 views, 12 mm sure.
    let (kept, filled) = (file(Gaps::Keep), file(Gaps::Fill));
    let seen = f32::from(0x0F00_u16) + 12.0;
    let [kept_gap, filled_gap] =
        [-1.0, 0.0].map(|gap: f32| [seen, gap, gap, seen].map(f32::to_bits));
    assert_eq!([19, 20, 29, 30].map(|frame| told(&kept, frame)), kept_gap);
    assert_eq!(
        [19, 20, 29, 30].map(|frame| told(&filled, frame)),
        filled_gap
    );
}
