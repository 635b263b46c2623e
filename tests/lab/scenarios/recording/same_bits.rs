//! The same recording gives the same bits whatever the processor and however many threads: given maps, solved again.

use std::fs;
use std::path::{Path, PathBuf};

use crate::data::checkout;
use crate::farfield::{command, farfield, finish, run};

/// What the C library is told, so that it takes the functions of a processor without fused multiply-add.
const WITHOUT_FMA: (&str, &str) = ("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-AVX2,-FMA");
/// Two people who dance: so many ticks that the last bit of a function of the C library has come to light in a published
/// pose.
const COUPLE: (&str, u32) = ("hug", 300);
/// Five people: from four on also what is decided between them is decided on several threads.
const FIVE: (&str, u32) = ("five", 90);

/// A scene in maps, run over so many ticks and recorded: the recording, and the folder of the run.
fn recorded(dir: &Path, (scene, ticks): (&str, u32)) -> (PathBuf, PathBuf) {
    let (venue, out) = (dir.join("venue"), dir.join("run"));
    let scene = checkout().join(format!("sim/scenes/{scene}.toml"));
    let ticks = format!("0..{ticks}");
    let made = farfield(&[
        "simulate".as_ref(),
        scene.as_os_str(),
        "--as".as_ref(),
        "maps".as_ref(),
        "--ticks".as_ref(),
        ticks.as_ref(),
        "--out".as_ref(),
        venue.as_os_str(),
    ]);
    assert_eq!(made.code, 0, "{}\n{}", made.stdout, made.stderr);
    run(&venue.join("venue.toml"), &out, &["--record"]);
    (out.join("recording.mcap"), out)
}

/// Solves a scene's recording again with each of these settings: every tick has the bits that were published.
fn replayed(scene: (&str, u32), settings: &[(&str, &str)]) {
    let dir = tempfile::tempdir().unwrap();
    let (recording, out) = recorded(dir.path(), scene);
    let poses = |out: &Path| fs::read(out.join("poses.jsonl")).unwrap();
    for (index, (name, value)) in settings.iter().enumerate() {
        let again = dir.path().join(format!("again-{index}"));
        let mut replay = command();
        replay.arg("replay").arg(&recording).arg("--json");
        let output = replay.arg("--out").arg(&again).env(name, value).output();
        let finished = finish(&output.unwrap());
        assert_eq!(finished.code, 0, "{}\n{}", finished.stdout, finished.stderr);
        let said: serde_json::Value = serde_json::from_str(&finished.stdout).unwrap();
        let counts = ["same_ticks", "different_ticks"].map(|count| &said["replay"][count]);
        assert_eq!(counts, [scene.1, 0], "{}: with {name}={value}", scene.0);
        assert!(
            poses(&again) == poses(&out),
            "{}: poses.jsonl differs with {name}={value}",
            scene.0
        );
    }
}

#[test]
fn a_replay_has_the_same_bits_without_fma_and_on_any_number_of_threads() {
    let [one, two, eight] = ["1", "2", "8"].map(|n| ("RAYON_NUM_THREADS", n));
    replayed(COUPLE, &[WITHOUT_FMA, one, eight]);
    replayed(FIVE, &[one, two, eight]);
}
