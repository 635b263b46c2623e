//! Recordings that the project does not carry, for tests.

use std::fs;
use std::path::{Path, PathBuf};

use farfield_proto::camera::{Distortion, Intrinsics};

use super::*;

/// A folder below `$FARFIELD_DATA`, else `../shared` beside the repository's root; says that the test is skipped otherwise.
pub(super) fn folder(test: &str, needed: &str) -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared");
    let root = std::env::var_os("FARFIELD_DATA").map_or(beside, PathBuf::from);
    let path = root.join(needed);
    if path.exists() {
        return Some(path);
    }
    println!(
        "{test} skipped: {} is not there (set FARFIELD_DATA to the folder that holds it)",
        path.display()
    );
    None
}

/// The six cameras. `cam5` is `sonyG_2`: with it the focal length found is 0.999 of the given one, with `sonyG_1` 0.968.
pub(super) fn drone(folder: &Path) -> Vec<PointCamera> {
    let names = [
        "gopro3",
        "mate7",
        "mate10_1",
        "sony5n_1440x1080",
        "sony5100",
        "sonyG_2",
    ];
    let each = names.into_iter().enumerate().map(|(i, lens)| {
        let text = fs::read_to_string(folder.join(format!("intrinsics/{lens}.json"))).unwrap();
        let json: serde_json::Value = serde_json::from_str(&text).unwrap();
        let number = |v: &serde_json::Value| v.as_f64().unwrap();
        let k = &json["K-matrix"];
        let c: Vec<f64> = json["distCoeff"]
            .as_array()
            .unwrap()
            .iter()
            .map(number)
            .collect();
        let path = folder.join(format!("detections/cam{i}.txt"));
        let sightings = parse(&fs::read_to_string(&path).unwrap(), &path).unwrap();
        PointCamera {
            name: format!("cam{i}"),
            size_px: [0, 1].map(|axis| number(&json["resolution"][axis]) as u32),
            intrinsics: Intrinsics {
                fx_px: number(&k[0][0]),
                fy_px: number(&k[1][1]),
                cx_px: number(&k[0][2]),
                cy_px: number(&k[1][2]),
            },
            lens: Distortion {
                k1: c[0],
                k2: c[1],
                p1: c[2],
                p2: c[3],
                k3: c.get(4).copied().unwrap_or(0.0),
                ..Distortion::default()
            }
            .into(),
            rate_hz: Some(number(&json["fps"])),
            offset_s: None,
            sightings,
        }
    });
    each.collect()
}
