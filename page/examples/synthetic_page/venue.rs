//! A synthetic venue: four viewpoints around a field with two cameras each, and the names of bodies
//! as in fusion.

use std::fmt::Write as _;
use std::path::Path;

use farfield_page::{Angle, AngleUnit, Skeleton};
use farfield_proto::calibration::Calibration;
use farfield_proto::keypoints::COCO17;
use farfield_proto::venue::Venue;
use nalgebra::{Matrix3, Point3, Vector3};

/// Half the length and half the width of the field, metres.
pub(crate) const HALF_FIELD_M: [f64; 2] = [14.0, 8.0];
/// Ticks per second.
pub(crate) const RATE_HZ: f64 = 60.0;
/// The viewpoints.
pub(crate) const VIEWPOINTS: [&str; 4] = ["north-east", "north-west", "south-west", "south-east"];

/// The joints with their parents.
pub(crate) const JOINTS: [(&str, Option<usize>); 29] = [
    ("pelvis", None),
    ("spine", Some(0)),
    ("neck", Some(1)),
    ("head", Some(2)),
    ("nose", Some(3)),
    ("left_eye", Some(3)),
    ("right_eye", Some(3)),
    ("left_ear", Some(3)),
    ("right_ear", Some(3)),
    ("left_scapula", Some(1)),
    ("right_scapula", Some(1)),
    ("left_shoulder", Some(9)),
    ("right_shoulder", Some(10)),
    ("left_elbow", Some(11)),
    ("right_elbow", Some(12)),
    ("left_wrist", Some(13)),
    ("right_wrist", Some(14)),
    ("left_hand", Some(13)),
    ("right_hand", Some(14)),
    ("left_hip", Some(0)),
    ("right_hip", Some(0)),
    ("left_knee", Some(19)),
    ("right_knee", Some(20)),
    ("left_ankle", Some(21)),
    ("right_ankle", Some(22)),
    ("left_heel", Some(23)),
    ("right_heel", Some(24)),
    ("left_toe", Some(23)),
    ("right_toe", Some(24)),
];

/// The angles with their ranges, degrees.
pub(crate) const ANGLES: [(&str, Option<[f32; 2]>); 40] = [
    ("pelvis_tilt", None),
    ("pelvis_list", None),
    ("pelvis_rotation", None),
    ("pelvis_tx", None),
    ("pelvis_ty", None),
    ("pelvis_tz", None),
    ("lumbar_extension", Some([-45.0, 30.0])),
    ("lumbar_bending", Some([-50.0, 50.0])),
    ("lumbar_rotation", Some([-40.0, 40.0])),
    ("neck_flexion", Some([-50.0, 60.0])),
    ("neck_bending", Some([-50.0, 50.0])),
    ("neck_rotation", Some([-60.0, 60.0])),
    ("scapula_elevation_r", Some([-10.0, 30.0])),
    ("scapula_protraction_r", Some([-20.0, 20.0])),
    ("scapula_tilt_r", Some([-30.0, 10.0])),
    ("arm_flex_r", None),
    ("arm_add_r", None),
    ("arm_rot_r", None),
    ("elbow_flex_r", Some([-5.0, 145.0])),
    ("hip_flexion_r", Some([-15.0, 125.0])),
    ("hip_adduction_r", Some([-45.0, 20.0])),
    ("hip_rotation_r", Some([-45.0, 45.0])),
    ("knee_angle_r", Some([0.0, 130.0])),
    ("ankle_angle_r", Some([-45.0, 20.0])),
    ("subtalar_angle_r", Some([-20.0, 30.0])),
    ("foot_rotation_r", Some([-10.0, 20.0])),
    ("scapula_elevation_l", Some([-10.0, 30.0])),
    ("scapula_protraction_l", Some([-20.0, 20.0])),
    ("scapula_tilt_l", Some([-30.0, 10.0])),
    ("arm_flex_l", None),
    ("arm_add_l", None),
    ("arm_rot_l", None),
    ("elbow_flex_l", Some([-5.0, 145.0])),
    ("hip_flexion_l", Some([-15.0, 125.0])),
    ("hip_adduction_l", Some([-45.0, 20.0])),
    ("hip_rotation_l", Some([-45.0, 45.0])),
    ("knee_angle_l", Some([0.0, 130.0])),
    ("ankle_angle_l", Some([-45.0, 20.0])),
    ("subtalar_angle_l", Some([-20.0, 30.0])),
    ("foot_rotation_l", Some([-10.0, 20.0])),
];

/// The skeleton of the synthetic people.
pub(crate) fn skeleton() -> Skeleton {
    let angles = ANGLES
        .iter()
        .enumerate()
        .map(|(index, (name, range))| Angle {
            name: (*name).to_owned(),
            unit: if (3..6).contains(&index) {
                AngleUnit::Metres
            } else {
                AngleUnit::Radians
            },
            range: range.map(|bounds| bounds.map(f32::to_radians)),
        });
    let joints = JOINTS.map(|(name, parent)| (name.to_owned(), parent));
    Skeleton::of_tree(joints, COCO17.map(str::to_owned).to_vec(), angles.collect())
}

/// The venue.
///
/// # Panics
/// Never: the texts that it parses are written here.
pub(crate) fn venue() -> Venue {
    let [x, y] = HALF_FIELD_M;
    let corners = [[x, y], [-x, y], [-x, -y], [x, -y]];
    let mut calibration = String::new();
    let mut text = format!(
        "name = \"synthetic\"\nrate_hz = {RATE_HZ:.1}\ncalibration = \"calibration.toml\"\n\
         [link]\nbudget_bytes_per_s = 250000.0\n\
         [field]\nmin_m = [{:.1}, {:.1}, 0.0]\nmax_m = [{x:.1}, {y:.1}, 2.5]\ncourt = \"volleyball\"\n",
        -x, -y
    );
    for (name, [x, y]) in VIEWPOINTS.iter().zip(corners) {
        writeln!(text, "[[viewpoint]]\nname = \"{name}\"").expect("text");
        for (side, aim) in [
            ("left", [0.35 * x, -0.35 * y]),
            ("right", [-0.35 * x, 0.35 * y]),
        ] {
            let camera = format!("{name}-{side}");
            writeln!(
                text,
                "[[viewpoint.camera]]\nname = \"{camera}\"\nsource = {{ kind = \"keypoints\", path = \"{camera}.jsonl\" }}"
            )
            .expect("text");
            let from = Point3::new(1.35 * x, 1.35 * y, 4.5);
            calibration.push_str(&camera_table(
                &camera,
                from,
                Point3::new(aim[0], aim[1], 1.0),
            ));
        }
    }
    let path = Path::new("synthetic.toml");
    let calibration =
        Calibration::parse(&calibration, path).expect("the calibration was written here");
    Venue::parse(&text, path, calibration).expect("the venue was written here")
}

/// A camera at `from` that looks at `at`, upright.
fn camera_table(name: &str, from: Point3<f64>, at: Point3<f64>) -> String {
    let forward = (at - from).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let rotation = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
    let translation = -(rotation * from.coords);
    let row = |i: usize| {
        format!(
            "[{:.9}, {:.9}, {:.9}]",
            rotation[(i, 0)],
            rotation[(i, 1)],
            rotation[(i, 2)]
        )
    };
    format!(
        "[{name}]\nname = \"{name}\"\nsize = [1920, 1080]\n\
         matrix = [[1400.0, 0.0, 959.5], [0.0, 1400.0, 539.5], [0.0, 0.0, 1.0]]\n\
         distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [{}, {}, {}]\n\
         translation = [{:.6}, {:.6}, {:.6}]\n",
        row(0),
        row(1),
        row(2),
        translation.x,
        translation.y,
        translation.z
    )
}
