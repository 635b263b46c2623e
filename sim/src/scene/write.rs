//! Writes the files of a scene: its cameras as a calibration, its truth line by line, and a
//! summary.

use std::fmt::Write as _;
use std::io;
use std::ops::Range;

use farfield_fusion::body::skeleton::Joint;
use farfield_proto::camera::CameraModel;
use farfield_proto::keypoints::COCO17;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;
use serde::Serialize;

use super::{PersonTruth, Scene};

/// The cameras in the calibration format.
pub fn calibration_text<'a>(cameras: impl IntoIterator<Item = &'a CameraModel>) -> String {
    let mut text = String::new();
    for camera in cameras {
        let (i, [w, h]) = (camera.intrinsics(), camera.size_px());
        let distortions: Vec<String> = camera
            .lens()
            .coefficients()
            .iter()
            .map(|k| format!("{k:?}"))
            .collect();
        let (distortions, is_fisheye) = (distortions.join(", "), camera.lens().is_fisheye());
        let isometry = camera.camera_from_world().isometry();
        let (r, t) = (isometry.rotation.scaled_axis(), isometry.translation.vector);
        // Writing to a String cannot fail.
        let _infallible = write!(
            text,
            "[{name}]\nname = \"{name}\"\nsize = [{w}, {h}]\n\
             matrix = [[{:?}, 0.0, {:?}], [0.0, {:?}, {:?}], [0.0, 0.0, 1.0]]\n\
             distortions = [{distortions}]\n\
             rotation = [{:?}, {:?}, {:?}]\ntranslation = [{:?}, {:?}, {:?}]\nfisheye = {is_fisheye}\n\n",
            i.fx_px,
            i.cx_px,
            i.fy_px,
            i.cy_px,
            r.x,
            r.y,
            r.z,
            t.x,
            t.y,
            t.z,
            name = camera.name(),
        );
    }
    text
}

/// One line of `truth.jsonl` without line end: world metres, 5 decimals.
pub fn truth_line(tick: Tick, person: u32, truth: &PersonTruth) -> String {
    let mut line = format!("{{\"tick\": {tick}, \"person\": {person}, \"joints\": {{");
    let joints = Joint::ALL.iter().map(|joint| joint.name());
    push_points(&mut line, joints.zip(&truth.joints_m));
    line.push_str("}, \"keypoints\": {");
    push_points(&mut line, COCO17.into_iter().zip(&truth.sites_m));
    line.push_str("}}");
    line
}

fn push_points<'a>(line: &mut String, points: impl Iterator<Item = (&'a str, &'a Vector3<f64>)>) {
    for (i, (name, point)) in points.enumerate() {
        let separator = if i == 0 { "" } else { ", " };
        // Adding 0 makes a negative zero positive.
        let [x, y, z] = [point.x, point.y, point.z].map(|v| (v * 1e5).round() / 1e5 + 0.0);
        // Writing to a String cannot fail.
        let _infallible = write!(line, "{separator}\"{name}\": [{x:.5}, {y:.5}, {z:.5}]");
    }
}

/// Writes the lines of `ticks` for all people of `scene`, sorted by tick, then number.
///
/// # Errors
/// An error of `out`.
pub fn write_truth(scene: &Scene, ticks: &Range<Tick>, out: &mut impl io::Write) -> io::Result<()> {
    let ticks = (ticks.start.0..ticks.end.0).map(Tick);
    write_truth_at(scene, ticks.map(|tick| (tick, scene.time_s(tick))), out)
}

/// As [`write_truth`], for recordings whose scene time does not follow the ticks: every tick with
/// the time that it shows, seconds.
///
/// # Errors
/// An error of `out`.
pub fn write_truth_at(
    scene: &Scene,
    moments: impl Iterator<Item = (Tick, f64)>,
    out: &mut impl io::Write,
) -> io::Result<()> {
    let mut order: Vec<usize> = (0..scene.people().len()).collect();
    order.sort_by_key(|&person| scene.people()[person].number);
    order.retain(|&person| scene.is_in_truth(person));
    for (tick, time_s) in moments {
        for &person in &order {
            if let Some(truth) = scene.person_at(person, time_s) {
                let number = scene.people()[person].number;
                writeln!(out, "{}", truth_line(tick, number, &truth))?;
            }
        }
    }
    Ok(())
}

/// A summary of a scene, for people and for `summary.json`.
#[derive(Debug, Clone, Serialize)]
pub struct SceneSummary {
    /// Ticks per second.
    pub rate_hz: f64,
    /// Number of ticks.
    pub ticks: i64,
    /// Seed of every draw.
    pub seed: u64,
    /// Field, x by y, metres.
    pub size_m: [f64; 2],
    /// Names of the viewpoints.
    pub viewpoints: Vec<String>,
    /// Names of the cameras.
    pub cameras: Vec<String>,
    /// Name, stature (metres), first and last tick of all people who are present for at least one
    /// tick.
    pub people: Vec<ScenePersonSummary>,
    /// Whether there is a ball.
    pub ball: bool,
}

/// One person of a [`SceneSummary`].
#[derive(Debug, Clone, Serialize)]
pub struct ScenePersonSummary {
    /// Number in the truth file.
    pub person: u32,
    /// Name in the scene file.
    pub name: String,
    /// Stature, metres.
    pub stature_m: f64,
    /// First tick of the presence.
    pub first_tick: i64,
    /// Last tick of the presence.
    pub last_tick: i64,
}

impl SceneSummary {
    /// The summary of `scene`.
    pub fn new(scene: &Scene) -> Self {
        let ticks = scene.ticks().start.0..scene.ticks().end.0;
        let people = scene.people().iter().enumerate().filter_map(|(i, person)| {
            let there = |tick: &i64| {
                let time_s = scene.time_s(Tick(*tick));
                scene.is_there(i, time_s)
            };
            Some(ScenePersonSummary {
                person: person.number,
                name: person.name.clone(),
                stature_m: person.stature_m,
                first_tick: ticks.clone().find(there)?,
                last_tick: ticks.clone().rev().find(there)?,
            })
        });
        Self {
            rate_hz: scene.rate_hz(),
            ticks: ticks.end,
            seed: scene.seed(),
            size_m: scene.size_m(),
            viewpoints: scene.viewpoints().iter().map(|v| v.name.clone()).collect(),
            cameras: scene
                .cameras()
                .iter()
                .map(|c| c.name().to_owned())
                .collect(),
            people: people.collect(),
            ball: scene.ball_at(0.0).is_some(),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_fusion::body::skeleton::N_JOINTS;
    use farfield_proto::calibration::Calibration;

    use super::*;
    use crate::scene::N_SITES;

    /// A scene without people.
    fn empty() -> Scene {
        empty_with("")
    }

    /// The same with additional camera settings.
    fn empty_with(more: &str) -> Scene {
        let text = format!(
            "rate_hz = 60\nseconds = 2\nsize_m = [7, 5]\n\
             [cameras]\nviewpoints = 4\nper_viewpoint = 2\n{more}"
        );
        Scene::parse(&text, Path::new("empty.toml"), &mut |clip| {
            panic!("{} is asked for", clip.display())
        })
        .unwrap()
    }

    #[test]
    fn written_cameras_are_read_back() {
        let mixed =
            "fisheye = [-0.02, 0.005, -0.002, 0.0003]\nfisheye_viewpoints = [\"north-west\"]\n";
        for scene in [empty(), empty_with(mixed)] {
            are_read_back(&scene);
        }
    }

    fn are_read_back(scene: &Scene) {
        let text = calibration_text(scene.cameras());
        let read = Calibration::parse(&text, Path::new("calibration.toml")).unwrap();
        for camera in scene.cameras() {
            let again = &read.cameras[camera.name()];
            assert_eq!(again.intrinsics(), camera.intrinsics());
            assert_eq!(again.lens(), camera.lens());
            let off = again.camera_from_world().isometry().inverse()
                * camera.camera_from_world().isometry();
            assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-9);
        }
    }

    #[test]
    fn a_scene_takes_its_cameras_from_a_calibration() {
        let folder = tempfile::tempdir().unwrap();
        let scene = empty();
        std::fs::write(
            folder.path().join("calibration.toml"),
            calibration_text(scene.cameras()),
        )
        .unwrap();
        let text = |camera: &str| {
            format!(
                "rate_hz = 60\nseconds = 2\nsize_m = [7, 5]\ncalibration = \"calibration.toml\"\n\
                 [[viewpoint]]\nname = \"west\"\n[[viewpoint.camera]]\nname = \"{camera}\"\n"
            )
        };
        let path = folder.path().join("scene.toml");
        std::fs::write(&path, text("south-west-2")).unwrap();
        let read = Scene::load(&path).unwrap();
        assert_eq!(read.cameras()[0].name(), "south-west-2");
        assert_eq!(read.viewpoints()[0].cameras, [0]);
        std::fs::write(&path, text("south-west-9")).unwrap();
        let refused = Scene::load(&path).unwrap_err().to_string();
        assert!(
            refused.contains("scene.toml:8: `viewpoint[0].camera[0].name`"),
            "{refused}"
        );
        assert!(
            refused.contains("unknown camera `south-west-9`, did you mean"),
            "{refused}"
        );
    }

    #[test]
    fn a_line_of_truth_has_every_joint_and_keypoint() {
        let truth = PersonTruth {
            joints_m: [Vector3::new(1.0, -1e-9, 0.123_456_78); N_JOINTS],
            sites_m: [Vector3::new(-2.0, 0.5, 0.0); N_SITES],
        };
        let line: serde_json::Value =
            serde_json::from_str(&truth_line(Tick(3), 7, &truth)).unwrap();
        assert_eq!(
            (line["tick"].as_i64(), line["person"].as_i64()),
            (Some(3), Some(7))
        );
        assert_eq!(line["joints"].as_object().unwrap().len(), N_JOINTS);
        assert_eq!(line["keypoints"].as_object().unwrap().len(), N_SITES);
        assert_eq!(line["joints"]["left_toe"].to_string(), "[1.0,0.0,0.12346]");
        assert!(!truth_line(Tick(0), 1, &truth).contains("-0.00000"));
    }

    #[test]
    fn a_summary_lists_people_cameras_and_ticks() {
        let summary = SceneSummary::new(&empty());
        assert_eq!(
            (summary.ticks, summary.people.len(), summary.ball),
            (120, 0, false)
        );
        assert_eq!(
            summary.viewpoints,
            ["north-east", "north-west", "south-west", "south-east"]
        );
        assert_eq!(summary.cameras[1], "north-east-2");
    }
}
