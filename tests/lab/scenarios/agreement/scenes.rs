//! Scenes in which nothing is wrong with the cameras but that each runs by a clock of its own, and that networks err.

use crate::farfield::farfield;

#[test]
fn of_ten_scenes_with_free_running_cameras_nothing_is_said() {
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
