//! Keypoints of another program: written in its format, imported, run.

use std::cell::Cell;
use std::fs;

use serde_json::{Value, json};

use crate::data::SampleFolder;
use crate::farfield::{farfield, poses, run};

/// Index in `OpenPose`'s `BODY_25` of each of COCO's 17 keypoints (`OpenPose`'s documentation, "Pose Output Format").
const BODY_25_OF_COCO: [usize; 17] = [0, 16, 15, 18, 17, 5, 2, 6, 3, 7, 4, 12, 9, 13, 10, 14, 11];

/// A frame of the sample in the format of `OpenPose`: x, y, confidence, flat; zeros for missing keypoints.
fn as_openpose(line: &Value) -> Value {
    let people = line["persons"].as_array().unwrap().iter().map(|person| {
        let mut flat = vec![json!(0.0); 75];
        let keypoints = person["keypoints"].as_array().unwrap();
        for (keypoint, at) in keypoints.iter().zip(BODY_25_OF_COCO) {
            if let Some(seen) = keypoint.as_array() {
                flat[3 * at..3 * at + 3].clone_from_slice(seen);
            }
        }
        json!({"person_id": [-1], "pose_keypoints_2d": flat})
    });
    json!({"version": 1.3, "people": people.collect::<Vec<_>>()})
}

/// Writes the sample's calibration and keypoints as a Pose2Sim project to `project`.
fn write_openpose_project(folder: &SampleFolder) {
    write_project(folder, |_, frame| frame.to_string());
}

/// [`write_openpose_project`] with `text` made from a camera's name and a frame of `OpenPose`.
fn write_project(folder: &SampleFolder, text: impl Fn(&str, &Value) -> String) {
    for corner in ["north-east", "north-west", "south-west", "south-east"] {
        let pose = folder.path(&format!("project/pose/{corner}_json"));
        fs::create_dir_all(&pose).unwrap();
        let lines = fs::read_to_string(folder.path(&format!("{corner}.jsonl"))).unwrap();
        for (frame, line) in lines.lines().enumerate() {
            let line = serde_json::from_str(line).unwrap();
            let name = format!("{corner}_{frame:012}_keypoints.json");
            fs::write(pose.join(name), text(corner, &as_openpose(&line))).unwrap();
        }
    }
    fs::copy(
        folder.path("calibration.toml"),
        folder.path("project/Calib_hall.toml"),
    )
    .unwrap();
}

/// The largest distance between joints of the same people in the same ticks, metres.
fn largest_difference_m(ours: &[Value], theirs: &[Value]) -> f64 {
    let numbers = |pose: &Value| -> Vec<f64> {
        let joints = pose["joints"].as_object().unwrap();
        assert_eq!(joints.len(), 29);
        let each = joints.values().flat_map(|joint| joint.as_array().unwrap());
        each.map(|number| number.as_f64().unwrap()).collect()
    };
    let pairs = ours.iter().zip(theirs).flat_map(|(a, b)| {
        assert_eq!((&a["tick"], &a["person"]), (&b["tick"], &b["person"]));
        numbers(a).into_iter().zip(numbers(b))
    });
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn imported_keypoints_of_openpose_give_the_poses_of_our_format() {
    let folder = SampleFolder::new();
    // Other programs have no field: both runs derive it from the cameras.
    folder.replace(
        "venue.toml",
        "[field]\nmin_m = [-4.0, -4.0, -0.3]\nmax_m = [4.0, 4.0, 2.4]\n",
        "",
    );
    write_openpose_project(&folder);
    let project = folder.path("project");
    let imported = farfield(&[
        "import",
        project.to_str().unwrap(),
        "--rate",
        "30",
        "--json",
    ]);
    assert_eq!(imported.code, 0, "{}", imported.stderr);

    run(&folder.path("venue.toml"), &folder.path("by_hand"), &[]);
    let venue = folder.path("project/farfield/venue.toml");
    run(&venue, &folder.path("imported"), &[]);
    let by_hand = poses(&folder.path("by_hand"));
    let imported = poses(&folder.path("imported"));
    // Two people in each of 120 frames.
    assert_eq!((by_hand.len(), imported.len()), (240, 240));
    let difference_m = largest_difference_m(&by_hand, &imported);
    assert!(difference_m < 1e-3, "{difference_m} m");
    // A calibration in our format is copied to the last bit. On the Shelf, a rotation that went through a matrix and back moved
    // joints by 132 mm where two people were hard to distinguish.
    let written = fs::read(folder.path("project/farfield/calibration.toml")).unwrap();
    assert!(written == fs::read(folder.path("calibration.toml")).unwrap());
}

#[test]
fn an_import_without_a_rate_is_refused_and_writes_nothing() {
    let folder = SampleFolder::new();
    write_openpose_project(&folder);
    let project = folder.path("project");
    let refused = farfield(&["import", project.to_str().unwrap()]);
    assert_eq!(refused.code, 2, "{}", refused.stdout);
    assert!(refused.stderr.contains("--rate"), "{}", refused.stderr);
    assert!(!project.join("farfield").exists());
}

/// Scores of 0.70 to 0.95, and two in a hundred of 1.3.
fn usual_score(number: usize) -> f64 {
    match number % 50 {
        0 => 1.3,
        _ => 0.70 + 0.05 * (number % 6) as f64,
    }
}

/// Symptom to prevent: a single score of 9.7 divided all others by 9.7, and no people were found.
#[test]
fn a_few_wild_scores_and_percent_lose_no_people() {
    let folder = SampleFolder::new();
    let count = Cell::new(0);
    write_project(&folder, |corner, frame| {
        let mut frame = frame.clone();
        for person in frame["people"].as_array_mut().unwrap() {
            let flat = person["pose_keypoints_2d"].as_array_mut().unwrap();
            for score in flat.iter_mut().skip(2).step_by(3) {
                if score.as_f64().unwrap() > 0.0 {
                    count.set(count.get() + 1);
                    let percent = if corner == "south-west" { 100.0 } else { 1.0 };
                    *score = (percent * usual_score(count.get())).into();
                    // One of each kind among thousands.
                    if let Some(wild) =
                        [9.7, 1e9, -5.0, 424_242.0].get(usize::wrapping_sub(count.get(), 100))
                    {
                        *score = (*wild).into();
                    }
                }
            }
        }
        frame.to_string().replace("424242.0", "NaN")
    });
    let project = folder.path("project");
    let import = [
        "import",
        project.to_str().unwrap(),
        "--rate",
        "30",
        "--json",
    ];
    let imported = farfield(&import);
    assert_eq!(imported.code, 0, "{}", imported.stderr);
    for remark in ["read as percent", "scores are above 1.25, the largest"] {
        assert!(imported.stdout.contains(remark), "{}", imported.stdout);
    }
    run(
        &project.join("farfield/venue.toml"),
        &folder.path("out"),
        &[],
    );
    // Two people in each of 120 frames.
    assert_eq!(poses(&folder.path("out")).len(), 240);
}
