//! The report on the agreement of cameras, in words and numbers.

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
    /// More facts about each camera, by its name.
    #[serde(default)]
    pub details: BTreeMap<String, CameraDetails>,
    /// Disagreements, in the order of the searches.
    pub disagreements: Vec<Disagreement>,
    /// The sightings of detection passes.
    #[serde(default)]
    pub sighted: SightedReport,
}

/// Facts about a camera in addition to its agreement.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct CameraDetails {
    /// Share of its kept sightings that belong to tracked people, 0 to 1; `None` if no people are tracked.
    pub share_used: Option<f64>,
    /// Growth of its lateness, ticks per minute; `None` if the time was too short.
    pub drift_ticks_per_minute: Option<f64>,
}

impl CameraDetails {
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

/// The sightings of detection passes, and the bodies reconstructed from them.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct SightedReport {
    /// Detection passes with at least one sighting.
    pub passes: u64,
    /// Sightings by the name of the camera.
    pub by_camera: BTreeMap<String, u64>,
    /// Number of viewpoints.
    pub viewpoints: u64,
    /// How far right and down keypoints of the kept passes were in any picture, undistorted, as shares of its width and
    /// height; `None` without keypoints.
    #[serde(default)]
    pub reach: Option<[f64; 2]>,
    /// The bodies on which lines of sight of several viewpoints met, in the kept passes.
    pub diagnosis: SightingDiagnosis,
}

impl AgreementReport {
    /// A line per camera and a warning per disagreement, for people. Empty if nothing could be compared.
    pub fn lines(&self) -> Vec<String> {
        let width = self.cameras.keys().map(String::len).max().unwrap_or(0);
        let is_anything_known = self.cameras.values().any(CameraAgreement::is_known);
        let cameras = self.cameras.iter().filter(|_| is_anything_known);
        let mut lines: Vec<String> = cameras
            .map(|(name, camera)| {
                let sighted = self.sighted.by_camera.get(name).copied().unwrap_or(0);
                let is_compared = camera.is_known() && camera.keypoints > 0;
                // A disagreement without cameras is about each of them.
                let is_named = |d: &Disagreement| d.cameras.is_empty() || d.cameras.contains(name);
                let is_named = self.disagreements.iter().any(is_named);
                let alone = if is_compared || is_named {
                    String::new()
                } else if sighted == 0 {
                    ": it sighted no people".to_owned()
                } else {
                    format!(": it sighted people {sighted} times, but cameras elsewhere show too few of them")
                };
                let details = self.details.get(name).filter(|_| is_compared);
                let details = details.map_or_else(String::new, CameraDetails::words);
                format!("camera {name:width$}  {}{alone}{details}", camera.words())
            })
            .collect();
        lines.extend(self.warnings());
        lines
    }

    /// A line per disagreement: what was found, and the remedy.
    pub fn warnings(&self) -> impl Iterator<Item = String> {
        let warning = |d: &Disagreement| format!("warning: {}; {}", d.found, d.remedy);
        self.disagreements.iter().map(warning)
    }
}

/// Cameras that do not fit, and the likely cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Disagreement {
    /// The names of the cameras; empty if the cause is about all of them.
    pub cameras: Vec<String>,
    /// The likely cause.
    #[serde(flatten)]
    pub cause: DisagreementCause,
    /// The first and last tick of the part of the time in which it holds; `None` if it holds all the time.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_ticks: Option<[i64; 2]>,
    /// What was found, as a sentence.
    pub found: String,
    /// The remedy, as a sentence.
    pub remedy: String,
}

impl Disagreement {
    /// The cause and the cameras without numbers, and whether it holds in a part of the time only. It stays the same as
    /// long as the disagreement lasts.
    pub fn name(&self) -> String {
        let cause = std::mem::discriminant(&self.cause);
        let part = self.part_ticks.map_or("", |_| "in part ");
        format!("{cause:?} {part}{}", self.cameras.join(" "))
    }
}

impl DisagreementCause {
    /// Whether the pictures themselves are wrong, whatever the calibration.
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
    /// The pictures are late relative to those of the others (negative: early).
    Late {
        /// Ticks.
        ticks: f64,
    },
    /// The pictures are late or early from some tick on, or until then.
    LateInPart {
        /// Lateness before that tick, ticks.
        before_ticks: f64,
        /// Lateness from that tick on, ticks.
        after_ticks: f64,
        /// The tick, approximately.
        since_tick: i64,
    },
    /// The pictures have another rate.
    Drifts {
        /// Growth of the lateness, ticks per minute.
        ticks_per_minute: f64,
    },
    /// Left and right are exchanged in the pictures.
    Mirrored,
    /// The pictures are upside down.
    HalfTurned,
    /// Two cameras have each other's pictures, or each other's calibration.
    Swapped,
    /// Three cameras or more have each other's pictures, in a cycle: each fits the calibration of the next.
    Permuted,
    /// Two cameras show the same picture.
    SamePictures,
    /// The pictures fit the calibration of another camera.
    OtherCalibration,
    /// Its keypoints are in another order than the network's, as in a file of another program.
    KeypointOrder {
        /// Number of keypoints in the wrong place.
        moved: usize,
        /// Whether only left and right are exchanged.
        sides: bool,
    },
    /// In all cameras, some keypoints are written in the place of others, or all are in the order of another program.
    ExchangedKeypoints {
        /// Which keypoints.
        exchange: KeypointExchange,
    },
    /// The keypoints are at the right places, but their scores are too low to count: of some cameras, or of all.
    LowScores {
        /// Share of keypoints with low scores, among bodies with mostly such keypoints, 0 to 1.
        share: f64,
    },
    /// The keypoints of all cameras are at other places in the pictures, in the same way: found in smaller pictures,
    /// for example.
    PictureOfAll {
        /// How the pictures differ.
        change: PictureOfAll,
    },
    /// The keypoints of one camera are at other places in its pictures.
    OtherPicture {
        /// How the pictures differ.
        change: PictureOfAll,
    },
    /// The focal length differs from the calibration: of one camera, or of several by one factor.
    FocalLength {
        /// True length as a factor of the calibrated one.
        factor: f64,
    },
    /// The lens distortion differs from the calibration.
    Distortion {
        /// Calibrated k1 less the true one, approximately.
        k1_over: f64,
    },
    /// The pictures do not change while people move in front of the camera.
    Frozen {
        /// The tick since which they do not change, as far as is known.
        since_tick: i64,
    },
    /// The camera shows no people while people are in its view.
    Silent {
        /// The tick since which it shows none, as far as is known; `None` if it never showed any.
        since_tick: Option<i64>,
    },
    /// The camera was turned since it was calibrated.
    Turned {
        /// Degrees.
        degrees: f64,
    },
    /// The camera was moved since it was calibrated, and turned with it.
    Moved {
        /// Distance, metres.
        distance_m: f64,
        /// Turn, degrees.
        degrees: f64,
    },
    /// Lenses are of another kind than calibrated: of one camera, or of all that are calibrated as that kind.
    LensKind {
        /// Whether they seem to be fisheyes that are not calibrated as such.
        fisheye: bool,
    },
    /// People are too small or too tall: the unit or the scale of the calibration.
    WorldScale {
        /// Median stature of all people, metres.
        stature_m: f64,
        /// Number of measured people.
        people: usize,
        /// The shortest and the tallest of them, metres.
        range_m: [f64; 2],
        /// The shortest and the tallest stature given in the venue file, metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        expected_m: Option<[f64; 2]>,
    },
    /// The floor and the people on it are tilted: z of the calibration is not up.
    WorldTilted {
        /// Degrees.
        degrees: f64,
    },
    /// All people stand under the floor, or all above it: the origin of the calibration, or the venue's `floor_m`.
    FloorHeight {
        /// Height of the feet of standing people above the floor, metres, from the lower quartile of each person's
        /// lower ankle: of the highest person if all are under the floor, of the lowest if all are above it.
        above_m: f64,
        /// Height of the floor, world z, metres.
        floor_m: f64,
    },
    /// None of these explains it.
    Unexplained,
}

/// Which keypoints are exchanged.
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

/// How the pictures in which keypoints are given differ from the calibrated ones.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PictureOfAll {
    /// Left and right are exchanged.
    Mirrored,
    /// y is counted from below.
    FromBelow,
    /// They are upside down.
    HalfTurned,
    /// x and y are exchanged.
    XAndYExchanged,
    /// They are turned by 90 degrees.
    QuarterTurned,
    /// They were scaled or cropped.
    Resized {
        /// Factors by which x and y of a keypoint must be multiplied.
        scale: [f64; 2],
        /// Shift that must be added then, as shares of the calibrated picture's width and height.
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
