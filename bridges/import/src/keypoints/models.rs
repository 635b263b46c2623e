//! Keypoint models of other programs, named as in Pose2Sim.
//!
//! Sources: `OpenPose`'s `doc/02_output.md` (`BODY_25`, COCO, MPII) and its `train/` for `BODY_25B`
//! and `BODY_135`; `AlphaPose`'s `docs/MODEL_ZOO.md` and `Halpe-FullBody` (`HALPE_26`, `HALPE_68`,
//! `HALPE_136`); `COCO-WholeBody` (`COCO_133`); `MediaPipe`'s pose landmarks (BLAZEPOSE). All were
//! compared with Pose2Sim's `skeletons.py`.

use std::fmt;

use farfield_proto::keypoints::{COCO17, COCO23};

use super::Mapping;

/// A set of keypoints with a fixed order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Model {
    /// `OpenPose`'s default.
    Body25,
    /// `OpenPose`'s experimental model, which begins with COCO's keypoints.
    Body25B,
    /// `OpenPose`'s whole body.
    Body135,
    /// `OpenPose`'s COCO, with a neck.
    Coco18,
    /// `OpenPose`'s MPII.
    Mpii15,
    /// COCO's own.
    Coco17,
    /// COCO with six keypoints of the feet.
    Coco23,
    /// COCO's whole body.
    Coco133,
    /// Halpe's body with feet.
    Halpe26,
    /// Halpe's body with feet and hands.
    Halpe68,
    /// Halpe's whole body.
    Halpe136,
    /// `MediaPipe`'s pose.
    BlazePose,
}

/// COCO's 17 keypoints at the start of the list.
const AS_COCO: [usize; COCO17.len()] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16];

/// Marks a keypoint that the model lacks.
const NOT_THERE: usize = usize::MAX;

/// Places of the feet in the order of [`COCO23`]: left big toe, small toe and heel, then right.
type Feet = [usize; COCO23.len() - COCO17.len()];
const NO_FEET: Feet = [NOT_THERE; 6];
const FEET_OF_OPENPOSE: Feet = [19, 20, 21, 22, 23, 24];
const FEET_OF_COCO: Feet = [17, 18, 19, 20, 21, 22];
const FEET_OF_HALPE: Feet = [20, 22, 24, 21, 23, 25];
/// Its foot indices are the tips of the big toes.
const FEET_OF_BLAZEPOSE: Feet = [31, NOT_THERE, 29, 32, NOT_THERE, 30];

/// A row of the table.
struct Row {
    model: Model,
    /// Name in Pose2Sim.
    name: &'static str,
    /// Number of keypoints of one person.
    count: usize,
    /// Indices of COCO's keypoints: nose; eyes, ears, shoulders, elbows, wrists, hips, knees,
    /// ankles, left before right.
    places: [usize; COCO17.len()],
    feet: Feet,
    /// Descriptions of the other keypoints.
    left_out: &'static [&'static str],
}

const ROWS: [Row; 12] = [
    Row {
        model: Model::Body25,
        name: "BODY_25",
        count: 25,
        places: [0, 16, 15, 18, 17, 5, 2, 6, 3, 7, 4, 12, 9, 13, 10, 14, 11],
        feet: FEET_OF_OPENPOSE,
        left_out: &["neck", "mid hip"],
    },
    Row {
        model: Model::Body25B,
        name: "BODY_25B",
        count: 25,
        places: AS_COCO,
        feet: FEET_OF_OPENPOSE,
        left_out: &["upper neck", "head top"],
    },
    Row {
        model: Model::Body135,
        name: "BODY_135",
        count: 135,
        places: AS_COCO,
        feet: FEET_OF_OPENPOSE,
        left_out: &["upper neck", "head top", "hands", "face"],
    },
    Row {
        model: Model::Coco18,
        name: "COCO_18",
        count: 18,
        places: [0, 15, 14, 17, 16, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10],
        feet: NO_FEET,
        left_out: &["neck"],
    },
    Row {
        model: Model::Mpii15,
        name: "MPII",
        count: 15,
        places: [
            NOT_THERE, NOT_THERE, NOT_THERE, NOT_THERE, NOT_THERE, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9,
            13, 10,
        ],
        feet: NO_FEET,
        left_out: &["head", "neck", "chest"],
    },
    Row {
        model: Model::Coco17,
        name: "COCO_17",
        count: 17,
        places: AS_COCO,
        feet: NO_FEET,
        left_out: &[],
    },
    Row {
        model: Model::Coco23,
        name: "COCO_23",
        count: 23,
        places: AS_COCO,
        feet: FEET_OF_COCO,
        left_out: &[],
    },
    Row {
        model: Model::Coco133,
        name: "COCO_133",
        count: 133,
        places: AS_COCO,
        feet: FEET_OF_COCO,
        left_out: &["face", "hands"],
    },
    Row {
        model: Model::Halpe26,
        name: "HALPE_26",
        count: 26,
        places: AS_COCO,
        feet: FEET_OF_HALPE,
        left_out: &["head", "neck", "mid hip"],
    },
    Row {
        model: Model::Halpe68,
        name: "HALPE_68",
        count: 68,
        places: AS_COCO,
        feet: FEET_OF_HALPE,
        left_out: &["head", "neck", "mid hip", "hands"],
    },
    Row {
        model: Model::Halpe136,
        name: "HALPE_136",
        count: 136,
        places: AS_COCO,
        feet: FEET_OF_HALPE,
        left_out: &["head", "neck", "mid hip", "face", "hands"],
    },
    Row {
        model: Model::BlazePose,
        name: "BLAZEPOSE",
        count: 33,
        places: [
            0, 2, 5, 7, 8, 11, 12, 13, 14, 15, 16, 23, 24, 25, 26, 27, 28,
        ],
        feet: FEET_OF_BLAZEPOSE,
        left_out: &["corners of the eyes, mouth", "fingers"],
    },
];

/// Other model names: Pose2Sim's for `RTMPose` models, and those of the programs themselves.
const OTHER_NAMES: [(&str, Model); 12] = [
    ("BODY_WITH_FEET", Model::Halpe26),
    ("LOWER_BODY", Model::Halpe26),
    ("WHOLE_BODY", Model::Coco133),
    ("WHOLE_BODY_WRIST", Model::Coco133),
    ("COCO_133_WRIST", Model::Coco133),
    ("COCO_WHOLEBODY", Model::Coco133),
    ("BODY", Model::Coco17),
    ("COCO", Model::Coco18),
    ("MPII_15", Model::Mpii15),
    ("MPI", Model::Mpii15),
    ("MEDIAPIPE", Model::BlazePose),
    ("BODY_25A", Model::Body25),
];

impl Model {
    fn row(self) -> &'static Row {
        // A test checks that every model has a row; the first row is an unreachable fallback.
        ROWS.iter()
            .find(|row| row.model == self)
            .unwrap_or(&ROWS[0])
    }

    /// Name in Pose2Sim.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// Number of keypoints of one person.
    pub fn count(self) -> usize {
        self.row().count
    }

    /// Finds a model by name, in any case, with `-` or `_`. `COCO` is `OpenPose`'s model of 18, as
    /// in Pose2Sim.
    pub fn from_name(name: &str) -> Option<Self> {
        let name = name.trim().to_uppercase().replace('-', "_");
        let named = ROWS
            .iter()
            .find(|row| row.name == name)
            .map(|row| row.model);
        let other = || OTHER_NAMES.iter().find(|(other, _)| *other == name);
        named.or_else(|| other().map(|(_, model)| *model))
    }

    /// The model with this many keypoints; the more common of two.
    pub fn of_count(count: usize) -> Option<Self> {
        ROWS.iter()
            .find(|row| row.count == count)
            .map(|row| row.model)
    }

    /// All names, for error messages.
    pub fn list() -> String {
        let names: Vec<String> = ROWS
            .iter()
            .map(|row| format!("{} ({})", row.name, row.count))
            .collect();
        names.join(", ")
    }

    /// Indices of its keypoints.
    pub fn mapping(self) -> Mapping {
        let row = self.row();
        let mut all = row.places.into_iter().chain(row.feet);
        Mapping {
            name: row.name.to_owned(),
            count: row.count,
            places: std::array::from_fn(|_| all.next().filter(|place| *place != NOT_THERE)),
            left_out: row.left_out.iter().map(|it| (*it).to_owned()).collect(),
        }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_is_in_the_model_and_used_once() {
        for row in &ROWS {
            assert_eq!(row.model.name(), row.name);
            let mut places: Vec<usize> = row.model.mapping().places.into_iter().flatten().collect();
            places.sort_unstable();
            let n = places.len();
            places.dedup();
            assert_eq!(places.len(), n, "{}", row.name);
            assert!(
                places.iter().all(|place| *place < row.count),
                "{}",
                row.name
            );
        }
    }

    /// Keypoint names in the order of each program's documentation, an independent check of the
    /// table.
    const BODY_25: &str = "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist MidHip RHip RKnee RAnkle LHip LKnee \
        LAnkle REye LEye REar LEar LBigToe LSmallToe LHeel RBigToe RSmallToe RHeel";
    const COCO_18: &str = "Nose Neck RShoulder RElbow RWrist LShoulder LElbow LWrist RHip RKnee RAnkle LHip LKnee LAnkle REye \
        LEye REar LEar";
    const BLAZEPOSE: &str = "nose left_eye_inner left_eye left_eye_outer right_eye_inner right_eye right_eye_outer left_ear \
        right_ear mouth_left mouth_right left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist left_pinky \
        right_pinky left_index right_index left_thumb right_thumb left_hip right_hip left_knee right_knee left_ankle \
        right_ankle left_heel right_heel left_foot_index right_foot_index";
    const HALPE_26: &str = "Nose LEye REye LEar REar LShoulder RShoulder LElbow RElbow LWrist RWrist LHip RHip LKnee RKnee \
        LAnkle RAnkle Head Neck Hip LBigToe RBigToe LSmallToe RSmallToe LHeel RHeel";
    const MPII: &str = "Head Neck RShoulder RElbow RWrist LShoulder LElbow LWrist RHip RKnee RAnkle LHip LKnee LAnkle Chest";

    #[test]
    fn the_table_matches_the_names_of_each_program() {
        for (model, names) in [
            (Model::Body25, BODY_25),
            (Model::Coco18, COCO_18),
            (Model::BlazePose, BLAZEPOSE),
            (Model::Halpe26, HALPE_26),
            (Model::Mpii15, MPII),
        ] {
            let names: Vec<String> = names.split_whitespace().map(str::to_owned).collect();
            let by_name = Mapping::of_names(&names).unwrap();
            let by_table = model.mapping();
            assert_eq!(by_name.count, by_table.count, "{model}");
            assert_eq!(by_name.places, by_table.places, "{model}");
        }
    }

    #[test]
    fn pose2sim_names_are_recognised() {
        for (name, model) in [
            ("Body_with_feet", Model::Halpe26),
            ("HALPE_26", Model::Halpe26),
            ("COCO_133", Model::Coco133),
            ("COCO_17", Model::Coco17),
            ("BODY_25B", Model::Body25B),
            ("COCO", Model::Coco18),
            ("blazepose", Model::BlazePose),
        ] {
            assert_eq!(Model::from_name(name), Some(model), "{name}");
        }
        assert_eq!(Model::from_name("ANIMAL2D_17"), None);
    }
}
