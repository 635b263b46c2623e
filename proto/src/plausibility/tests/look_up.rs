//! Cameras that look up.

use super::*;

#[test]
fn cameras_above_people_that_all_look_up_are_a_mirror_image() {
    let looking_at = |z_m: f64, height_m: f64| {
        with_all(|camera| {
            camera.center_m.z = height_m;
            let at_m = Vector3::new(0.0, 0.0, z_m);
            camera.rotation = looking(camera.center_m, at_m);
        })
    };
    let causes = |cameras: &[Given]| -> Vec<Cause> {
        findings(cameras)
            .iter()
            .map(|finding| finding.cause)
            .collect()
    };
    let mirrored = looking_at(4.0, 2.5);
    assert!(
        causes(&mirrored).contains(&Cause::LookUp),
        "{:?}",
        findings(&mirrored)
    );
    // Level on tripods, from the ground, and one that looks up among others.
    let mut one = hall();
    one[1] = mirrored[1].clone();
    for (what, cameras) in [
        ("level", looking_at(1.8, 1.6)),
        ("from the ground", looking_at(1.5, 0.3)),
        ("one", one),
    ] {
        assert!(!causes(&cameras).contains(&Cause::LookUp), "{what}");
    }
}
