//! Prints ROS 2 messages of synthetic people as hexadecimal bytes with their expected content, for
//! `tests/readers/ros.py`.

use std::fmt::Write as _;

use farfield_fusion::body::skeleton::Joint;
use farfield_streams::ros::{MARKERS_TYPE, Stamp, TF_TYPE, marker_array, tf_message};
use farfield_streams::synthetic;

fn hex(bytes: &[u8]) -> Result<String, std::fmt::Error> {
    let mut text = String::new();
    for byte in bytes {
        write!(text, "{byte:02x}")?;
    }
    Ok(text)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let frame = synthetic::frame(100);
    let stamp = Stamp {
        secs: 1_700_000_000,
        nanos: 123_456_789,
    };
    let names = Joint::ALL.map(Joint::name);
    let joints: Vec<_> = frame
        .persons
        .iter()
        .map(|person| {
            person
                .joints_m
                .map(|at_m| [at_m.x, at_m.y, at_m.z])
                .to_vec()
        })
        .collect();
    let output = serde_json::json!({
        "tf": hex(&tf_message(&frame, stamp))?, "markers": hex(&marker_array(&frame, stamp))?,
        "tf_type": TF_TYPE, "markers_type": MARKERS_TYPE, "secs": stamp.secs, "nanos": stamp.nanos,
        "joints": names.as_slice(), "joints_m": joints, "names": frame.persons.iter().map(|p| &*p.name).collect::<Vec<_>>(),
    });
    println!("{output}");
    Ok(())
}
