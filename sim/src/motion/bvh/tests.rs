//! Files in the dialects of several programs, and broken files.

use std::f64::consts::FRAC_PI_2;

use proptest::prelude::*;

use super::*;

const SMALL: &str = "HIERARCHY\r\nROOT hips\r\n{\r\n\tOFFSET 1 2 3\r\n\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation\r\n\tJOINT upper leg {\r\n OFFSET 0 -4 0\r\nCHANNELS 3 Yrotation Zrotation Xrotation\r\n\tEnd Site\r\n{\r\nOFFSET 0 -5 0\r\n}\r\n}\r\n}\r\nMOTION\r\nFrames: 2\r\nFrame Time: 0.5\r\n0 0 0 0 0 0 0 0 0\r\n10 0 0 90 0 0 0 0 90\r\n\r\n";

fn refusal(text: &str) -> String {
    Bvh::parse(text, Path::new("a.bvh"))
        .unwrap_err()
        .to_string()
}

#[test]
fn channels_apply_in_the_order_of_the_file() {
    let bvh = Bvh::parse(SMALL, Path::new("a.bvh")).unwrap();
    assert_eq!(bvh.n_frames(), 2);
    assert_eq!(bvh.bones[1].name, "upper leg");
    assert_eq!(bvh.bones[1].end, Some(Vector3::new(0.0, -5.0, 0.0)));
    let first = bvh.placed(0);
    assert!((first[1].origin - Vector3::new(1.0, -2.0, 3.0)).norm() < 1e-12);
    let second = bvh.placed(1);
    assert!((second[0].origin - Vector3::new(11.0, 2.0, 3.0)).norm() < 1e-12);
    assert!((second[1].origin - Vector3::new(15.0, 2.0, 3.0)).norm() < 1e-12);
    let turned = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), FRAC_PI_2)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    assert!(second[1].rotation.angle_to(&turned) < 1e-12);
}

#[test]
fn repeated_offsets_of_inner_bones_are_replaced() {
    let file = |position: &str| {
        format!(
            "HIERARCHY ROOT a {{ OFFSET 0 0 0 CHANNELS 3 Xposition Yposition Zposition
            JOINT b\n {{ OFFSET 0 4 0 CHANNELS 3 Xposition Yposition Zposition\n }} }}
            MOTION\n Frames: 1\n Frame Time: 0.1\n 0 0 0 {position}\n"
        )
    };
    for (position, expected) in [("0 4.1 0", 4.1), ("0 0.1 0", 4.1), ("0 0 0", 4.0)] {
        let bvh = Bvh::parse(&file(position), Path::new("a.bvh")).unwrap();
        assert!((bvh.placed(0)[1].origin.y - expected).abs() < 1e-12);
    }
}

#[test]
fn refusals_name_file_line_found_and_expected() {
    assert_eq!(
        refusal("HIERARCHY\nBONE x\n"),
        "a.bvh:2: found `BONE`, expected `ROOT`"
    );
    let text = SMALL.replace("OFFSET 1 2 3", "OFFSET 1 two 3");
    assert_eq!(
        refusal(&text),
        "a.bvh:4: found `two`, expected a length of an offset"
    );
    let text = SMALL.replace("10 0 0 90 0 0 0 0 90", "10 0 0 90");
    assert_eq!(
        refusal(&text),
        "a.bvh:19: found 4 values, expected 9, one for each channel"
    );
    let text = SMALL.replace("Frames: 2", "Frames: 3");
    assert!(refusal(&text).ends_with("found 2 frames, expected 3"));
    let text = SMALL.replace("Frames: 2", "Frames: 1");
    assert_eq!(
        refusal(&text),
        "a.bvh:19: found one more frame, expected 1 frames"
    );
    let text = SMALL.replace("0.5", "inf");
    assert!(refusal(&text).contains("found `inf`, expected seconds"));
    let text = SMALL.replace("Yrotation\r\n\tJOINT", "Zrotation\r\n\tJOINT");
    assert!(refusal(&text).contains("found `Zrotation`, expected a channel"));
    assert!(refusal("").contains("found the end of the file, expected `HIERARCHY`"));
}

#[test]
fn large_counts_in_a_file_cause_no_allocation() {
    let text = SMALL.replace("Frames: 2", "Frames: 18446744073709551615");
    assert!(refusal(&text).contains("found 2 frames"));
    let text = SMALL.replace("CHANNELS 6", "CHANNELS 99999999999");
    assert!(refusal(&text).contains("expected a number of channels"));
    let deep = "JOINT a { OFFSET 0 0 0 CHANNELS 0\n".repeat(2 * MAX_BONES);
    let text = format!("HIERARCHY ROOT a\n {{ OFFSET 0 0 0 CHANNELS 1 Xposition {deep}");
    assert!(refusal(&text).contains("expected at most 1000 bones"));
}

proptest! {
    #[test]
    fn arbitrary_bytes_cause_no_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let text = String::from_utf8_lossy(&bytes);
        prop_assert!(Bvh::parse(&text, Path::new("a.bvh")).is_err());
    }

    #[test]
    fn damaged_files_cause_no_panic(
        at in 0..SMALL.len(),
        length in 0..60_usize,
        new in "(\\PC{0,8}|[-0-9.e]{0,12}|[{}\\n]{0,3})",
    ) {
        let end = (at + length).min(SMALL.len());
        let text = format!("{}{new}{}", &SMALL[..at], &SMALL[end..]);
        if let Ok(bvh) = Bvh::parse(&text, Path::new("a.bvh")) {
            for frame in 0..bvh.n_frames() {
                let finite = bvh.placed(frame).iter().all(|p| p.origin.norm().is_finite());
                prop_assert!(finite);
            }
        }
    }
}
