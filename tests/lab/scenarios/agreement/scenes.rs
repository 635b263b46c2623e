//! Scenes with correct cameras whose clocks run free, and with errors of networks.

use crate::farfield::farfield;

#[test]
fn ten_scenes_with_free_running_cameras_raise_no_alarm() {
    let scenes = ["own", "hug", "lost"];
    let run = farfield(&[&["agreement"], &scenes[..], &["--seconds", "3"]].concat());
    println!("{}", run.stdout);
    assert_eq!(run.code, 0, "{}\n{}", run.stdout, run.stderr);
    assert!(
        run.stdout.contains("10 scenes, 0 false alarms"),
        "{}",
        run.stdout
    );
    assert!(
        run.stdout.contains("agrees with the others"),
        "{}",
        run.stdout
    );
}
