//! What is found of the agreement of cameras, in words and numbers.

use std::collections::BTreeMap;

use farfield_proto::message::agreement::CameraAgreement;
use farfield_proto::printed::signed;
use serde::{Deserialize, Serialize};

use crate::sightings::diagnosis::SightingDiagnosis;

/// How the cameras of a venue agree.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct AgreementReport {
    /// By the name of the camera.
    pub cameras: BTreeMap<String, CameraAgreement>,
    /// What else is known of them, by name.
    #[serde(default)]
    pub details: BTreeMap<String, CameraDetails>,
    /// What does not fit, the surest first.
    pub disagreements: Vec<Disagreement>,
    /// Whom detection passes found.
    #[serde(default)]
    pub sighted: SightedReport,
}

/// What is known of a camera beside its agreement.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraDetails {
    /// Which share of its sightings, those that are kept, is of people who are followed, 0 to 1; `None` where nobody is.
    pub share_used: Option<f64>,
    /// By how many ticks more its pictures are late every minute; `None` where too short a time tells.
    pub drift_ticks_per_minute: Option<f64>,
}

impl CameraDetails {
    /// It in a few words, to stand behind others.
    fn words(&self) -> String {
        let used = self.share_used.map_or_else(String::new, |share| {
            format!(", {:.0} % of its sightings used", 100.0 * share)
        });
        let drift = self
            .drift_ticks_per_minute
            .map_or_else(String::new, |drift| {
                format!(", drifts {} ticks a minute", signed(drift, 1))
            });
        used + &drift
    }
}

/// What detection passes found, and what became of it.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SightedReport {
    /// Detection passes in which anybody was sighted.
    pub passes: u64,
    /// Sightings by the name of the camera.
    pub by_camera: BTreeMap<String, u64>,
    /// How many viewpoints there are.
    pub viewpoints: u64,
    /// How far right and how far down keypoints were in any picture, undistorted, as shares of its width and height, in those
    /// passes that are kept; `None` where there were none.
    #[serde(default)]
    pub reach: Option<[f64; 2]>,
    /// The bodies on which the lines of sight of several viewpoints met, in those passes that are kept.
    pub diagnosis: SightingDiagnosis,
}

impl AgreementReport {
    /// A line per camera, and a warning per disagreement, for people; empty where nothing could be compared.
    pub fn lines(&self) -> Vec<String> {
        let width = self.cameras.keys().map(String::len).max().unwrap_or(0);
        let is_anything_known = self.cameras.values().any(CameraAgreement::is_known);
        let cameras = self.cameras.iter().filter(|_| is_anything_known);
        let mut lines: Vec<String> = cameras
            .map(|(name, camera)| {
                let sighted = self.sighted.by_camera.get(name).copied().unwrap_or(0);
                let is_compared = camera.is_known() && camera.keypoints > 0;
                // What is told of all of them is told of each.
                let is_told = |d: &Disagreement| d.cameras.is_empty() || d.cameras.contains(name);
                let is_told = self.disagreements.iter().any(is_told);
                let alone = if is_compared || is_told {
                    String::new()
                } else if sighted == 0 {
                    ": it sighted nobody".to_owned()
                } else {
                    format!(": it sighted people {sighted} times, of whom cameras elsewhere show too few")
                };
                let details = self.details.get(name).filter(|_| is_compared);
                let details = details.map_or_else(String::new, CameraDetails::words);
                format!("camera {name:width$}  {}{alone}{details}", camera.words())
            })
            .collect();
        lines.extend(self.warnings());
        lines
    }

    /// What does not fit, and what to do: a line each.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        let warning = |d: &Disagreement| format!("warning: {}; {}", d.found, d.remedy);
        self.disagreements.iter().map(warning)
    }
}

/// Something that does not fit, and what may be the cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Disagreement {
    /// The cameras, by name; none where it is about what all of them show.
    pub cameras: Vec<String>,
    /// The likely cause.
    #[serde(flatten)]
    pub cause: DisagreementCause,
    /// Where it is so in a part of the time and not in the rest: the first and the last tick of which it was told.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_ticks: Option<[i64; 2]>,
    /// What was found, in words.
    pub found: String,
    /// What to do about it, in words.
    pub remedy: String,
}

impl Disagreement {
    /// The cause and the cameras, without numbers, and whether it is of a part of the time: the same for as long as it is the same
    /// disagreement.
    pub fn name(&self) -> String {
        let cause = std::mem::discriminant(&self.cause);
        let part = self.part_ticks.map_or("", |_| "in part ");
        format!("{cause:?} {part}{}", self.cameras.join(" "))
    }
}

impl DisagreementCause {
    /// Whether it is of what a camera shows at all, wherever that is: no other calibration makes it so.
    pub(super) fn is_of_pictures(&self) -> bool {
        matches!(
            self,
            Self::Frozen { .. } | Self::SamePictures | Self::Silent { .. } | Self::LowScores { .. }
        )
    }
}

/// Why cameras do not agree.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "cause", rename_all = "snake_case")]
pub enum DisagreementCause {
    /// The pictures come so many ticks after those of the others (negative: before).
    Late {
        /// Ticks.
        ticks: f64,
    },
    /// The pictures come late, or early, from some tick on, or until then.
    LateInPart {
        /// By how many ticks before it.
        before_ticks: f64,
        /// By how many from there on.
        after_ticks: f64,
        /// The tick, nearly.
        since_tick: i64,
    },
    /// The pictures come at another rate.
    Drifts {
        /// By how many ticks more per minute they are late.
        ticks_per_minute: f64,
    },
    /// Left and right are exchanged in the pictures.
    Mirrored,
    /// The pictures stand on their heads.
    HalfTurned,
    /// Two cameras have each other's pictures, or each other's calibration.
    Swapped,
    /// Three cameras or more have each other's pictures: each fits the calibration of the next, the last that of the first.
    Permuted,
    /// Two cameras show the same picture.
    SamePictures,
    /// The pictures fit the calibration of another camera.
    OtherCalibration,
    /// The keypoints that come of it are in another order than the network's: in a file that another program wrote.
    KeypointOrder {
        /// How many are where another should be.
        moved: usize,
        /// Whether left and right are exchanged, and nothing else.
        sides: bool,
    },
    /// Some keypoints are written in the place of others in all cameras alike, or all in the order of another program.
    ExchangedKeypoints {
        /// Which.
        exchange: KeypointExchange,
    },
    /// The keypoints are where people are, and have scores that are too low to count: of some cameras, or of all.
    LowScores {
        /// Which share of them, of those bodies of which most are so, 0 to 1.
        share: f64,
    },
    /// The keypoints of all cameras alike are elsewhere in the pictures: found in smaller ones, say.
    PictureOfAll {
        /// Where.
        change: PictureOfAll,
    },
    /// The keypoints of one camera are elsewhere in its pictures.
    OtherPicture {
        /// Where.
        change: PictureOfAll,
    },
    /// The focal length is another than the calibration says: of one camera, or of several by one factor.
    FocalLength {
        /// True length as a factor of the calibrated one.
        factor: f64,
    },
    /// The lens distortion is another than the calibration says.
    Distortion {
        /// By how much k1 of the calibration is larger than it should be, nearly.
        k1_over: f64,
    },
    /// The pictures stand still while people move before the camera.
    Frozen {
        /// The tick since which they do, as far as is known.
        since_tick: i64,
    },
    /// The camera shows nobody while people are in its picture.
    Silent {
        /// The tick since which it does, as far as is known; `None` where it never showed anybody.
        since_tick: Option<i64>,
    },
    /// The camera was turned since it was calibrated.
    Turned {
        /// Degrees.
        degrees: f64,
    },
    /// The camera was moved since it was calibrated, and turned with it.
    Moved {
        /// How far, metres.
        distance_m: f64,
        /// By what, degrees.
        degrees: f64,
    },
    /// Lenses are of the other kind than calibrated: of one camera, or of all that are called that kind.
    LensKind {
        /// Whether they seem to be fisheyes, and are not called so.
        fisheye: bool,
    },
    /// People have sizes that people do not have: the unit of the calibration, or its scale.
    WorldScale {
        /// Median stature of all people, metres.
        stature_m: f64,
        /// How many were measured.
        people: usize,
        /// The shortest and the tallest of them, metres.
        range_m: [f64; 2],
        /// The shortest and the tallest whom the venue names with a stature, metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        expected_m: Option<[f64; 2]>,
    },
    /// The floor on which people stand is tilted, and so are they: z of the calibration is not up.
    WorldTilted {
        /// Degrees.
        degrees: f64,
    },
    /// People stand under the floor, or nobody on it: the origin of the calibration, or the venue's `floor_m`.
    FloorHeight {
        /// How high the feet of those who stand are above the floor, metres: of the highest of them where all are under it,
        /// of the lowest where all are above it; the median over time.
        above_m: f64,
        /// Where the floor is, world z, metres.
        floor_m: f64,
    },
    /// None of these explains it.
    Unexplained,
}

/// What is in the place of what.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum KeypointExchange {
    /// Left and right of everything.
    AllSides,
    /// Left and right of hips, knees and ankles.
    SidesOfLegs,
    /// Left and right of shoulders, elbows and wrists.
    SidesOfArms,
    /// Left and right of all but the face.
    SidesOfLimbs,
    /// Left and right of elbows and wrists.
    SidesOfElbowsAndWrists,
    /// Left and right of knees and ankles.
    SidesOfKneesAndAnkles,
    /// Left and right of the wrists.
    SidesOfWrists,
    /// Left and right of the hips.
    SidesOfHips,
    /// Elbows and wrists.
    ElbowsAndWrists,
    /// Knees and ankles.
    KneesAndAnkles,
    /// Elbow and wrist of the left arm.
    LeftElbowAndWrist,
    /// Elbow and wrist of the right arm.
    RightElbowAndWrist,
    /// Knee and ankle of the left leg.
    LeftKneeAndAnkle,
    /// Knee and ankle of the right leg.
    RightKneeAndAnkle,
    /// Hips and shoulders.
    HipsAndShoulders,
    /// Shoulders and elbows.
    ShouldersAndElbows,
    /// Hips and knees.
    HipsAndKnees,
    /// The first keypoints of `OpenPose`'s `BODY_25`.
    Body25,
    /// Those of `OpenPose`'s model of COCO, with a neck.
    OpenPoseCoco,
    /// Those of Human3.6M.
    Human36m,
}

/// Where the keypoints of all cameras are, or of one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PictureOfAll {
    /// In pictures with left and right exchanged.
    Mirrored,
    /// With y counted from below.
    FromBelow,
    /// In pictures that stand on their heads.
    HalfTurned,
    /// With y in the place of x.
    XAndYExchanged,
    /// In pictures turned by a quarter.
    QuarterTurned,
    /// In pictures that were scaled or cut after they were calibrated, or before.
    Resized {
        /// What x and y of a keypoint must be multiplied by.
        scale: [f64; 2],
        /// What must be added to them then, as shares of the calibrated picture's width and height.
        shift: [f64; 2],
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drift_that_rounds_to_nothing_has_no_minus() {
        let words = |drift: f64| {
            let details = CameraDetails {
                drift_ticks_per_minute: Some(drift),
                ..CameraDetails::default()
            };
            details.words()
        };
        assert_eq!(words(-0.04), ", drifts +0.0 ticks a minute");
        assert_eq!(words(-0.16), ", drifts -0.2 ticks a minute");
    }
}
