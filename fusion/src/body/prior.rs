//! The prior of a body: a subject of the venue, by a stored profile or by the stature.
//!
//! When a body is measured (`proportions.rs`), it replaces the lengths of an average body of that
//! stature.

use std::path::Path;

use farfield_proto::subject::SubjectProfile;
use farfield_proto::toml_file::FileError;
use nalgebra::Vector3;

use super::segment::Segment;
use crate::body::skeleton::{Joint, Proportions};

/// Error of a length that was measured in a fifth of a second, metres: a network's errors last for
/// seconds, so single ticks do not average out.
const LENGTH_SIGMA_M: f64 = 0.02;
/// Duration of a network's errors, seconds: a body that was seen n times as long is known as if it
/// had been measured n times.
const ERROR_LASTS_S: f64 = 2.0;
/// Additional difference of one length of one person between two sessions: other shoes, clothes,
/// light, cameras; metres.
const SESSION_SIGMA_M: f64 = 0.008;
/// Least error of a length, as a share of it: otherwise small lengths of a profile would count as
/// exact.
const LEAST_SHARE: f64 = 0.01;

/// Error of a length that was measured for `seconds`, metres: one sigma.
pub(crate) fn measured_sigma_m(seconds: f64) -> f64 {
    LENGTH_SIGMA_M / (1.0 + seconds.max(0.0) / ERROR_LASTS_S).sqrt()
}

/// A known body, left and right equal.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyPrior {
    /// Its lengths.
    body: Proportions,
    /// Error of each: one sigma, metres.
    sigma: Proportions,
}

impl BodyPrior {
    /// From a profile: its lengths, with its errors and the differences between sessions.
    ///
    /// # Errors
    /// The missing or impossible link, by the name of its joint or length.
    pub fn from_profile(profile: &SubjectProfile) -> Result<Self, String> {
        let body = profile_body(profile)?.checked();
        let body = body.map_err(|error| error.to_string())?;
        check_head(&body)?;
        Ok(Self {
            sigma: with_session(&body, &sigma_of(profile)),
            body,
        })
    }

    /// From the text of a profile, the content of `path`: the name and the body.
    ///
    /// # Errors
    /// What is wrong in the file, with its line.
    pub fn parse(text: &str, path: &Path) -> Result<(String, Self), FileError> {
        let profile = SubjectProfile::parse(text, path, &Joint::ends_of_links())?;
        let body = Self::from_profile(&profile).map_err(|problem| {
            FileError::new(path, format!("found an implausible link: {problem}")).at_field("link")
        })?;
        Ok((profile.name, body))
    }

    /// An average person of that stature (metres), with the spread of people of one stature.
    pub fn from_stature(stature_m: f64) -> Self {
        let body = Proportions::from_stature(stature_m);
        let shares = Proportions {
            nose_forward_m: 0.2,
            eye_forward_m: 0.2,
            eye_up_m: 0.2,
            eye_side_m: 0.2,
            ear_side_m: 0.2,
            hip_side_m: 0.07,
            ..uniform(LIMB_SHARE)
        };
        let spread = times(&shares, &body);
        Self {
            sigma: with_session(&body, &spread),
            body,
        }
    }

    /// Its lengths.
    pub(crate) fn body(&self) -> &Proportions {
        &self.body
    }

    /// Error of each of them, one sigma.
    pub(crate) fn sigma(&self) -> &Proportions {
        &self.sigma
    }

    /// The length of a segment and its sigma, metres.
    pub(crate) fn segment_m(&self, segment: Segment) -> (f64, f64) {
        (
            segment_of(segment, &self.body, |a, b| a + b, libm::hypot),
            // For a sum or a difference the sigmas add in quadrature.
            segment_of(segment, &self.sigma, libm::hypot, libm::hypot).abs(),
        )
    }
}

/// Refuses a body whose shoulders are not below its ears: this segment alone is a difference, which
/// may be impossible for positive lengths.
fn check_head(body: &Proportions) -> Result<(), String> {
    let above_m = segment_of(Segment::HeadHeight, body, |a, b| a + b, libm::hypot);
    if above_m > 0.0 {
        return Ok(());
    }
    Err(format!(
        "the head is {above_m:.3} m above the shoulders (the lengths of `neck` and `head` less the z of `left_scapula` and `right_scapula`), expected above 0"
    ))
}

/// The lengths of a profile, left and right equal.
fn profile_body(profile: &SubjectProfile) -> Result<Proportions, String> {
    let one = |name: &str| {
        let link = profile.links.get(name).ok_or_else(|| name.to_owned())?;
        Ok::<_, String>(link.offset_m)
    };
    let both = |name: &str| {
        let mirrored = one(&format!("right_{name}"))?.component_mul(&Vector3::new(1.0, -1.0, 1.0));
        Ok::<_, String>(0.5 * (one(&format!("left_{name}"))? + mirrored))
    };
    let (eye, scapula, hip) = (both("eye")?, both("scapula")?, both("hip")?);
    let (heel, toe) = (both("heel")?, both("toe")?);
    let (forearm_m, thigh_m, shank_m) = (
        both("wrist")?.norm(),
        both("knee")?.norm(),
        both("ankle")?.norm(),
    );
    let foot_height_m = -0.5 * (heel.z + toe.z);
    Ok(Proportions {
        pelvis_height_m: thigh_m + shank_m + foot_height_m - hip.z,
        lumbar_m: one("spine")?.norm(),
        trunk_m: one("neck")?.norm(),
        head_m: one("head")?.norm(),
        nose_forward_m: one("nose")?.norm(),
        eye_forward_m: eye.x,
        eye_up_m: eye.z,
        eye_side_m: eye.y,
        ear_side_m: both("ear")?.norm(),
        scapula_up_m: scapula.z,
        scapula_side_m: scapula.y,
        clavicle_m: both("shoulder")?.norm(),
        upper_arm_m: both("elbow")?.norm(),
        forearm_m,
        // The hand follows the elbow, as the wrist does.
        hand_m: both("hand")?.norm() - forearm_m,
        hip_side_m: hip.norm(),
        thigh_m,
        shank_m,
        foot_height_m,
        heel_back_m: -heel.x,
        toe_forward_m: toe.x,
    })
}

/// The sigmas of a profile, of two sides their root mean square.
fn sigma_of(profile: &SubjectProfile) -> Proportions {
    let one = |name: &str| profile.links.get(name).map_or(0.0, |link| link.sigma_m);
    let both = |name: &str| {
        let [left, right] = ["left", "right"].map(|side| one(&format!("{side}_{name}")));
        (0.5 * (left * left + right * right)).sqrt()
    };
    let (eye, scapula, heel) = (both("eye"), both("scapula"), both("heel"));
    Proportions {
        pelvis_height_m: both("knee"),
        lumbar_m: one("spine"),
        trunk_m: one("neck"),
        head_m: one("head"),
        nose_forward_m: one("nose"),
        eye_forward_m: eye,
        eye_up_m: eye,
        eye_side_m: eye,
        ear_side_m: both("ear"),
        scapula_up_m: scapula,
        scapula_side_m: scapula,
        clavicle_m: both("shoulder"),
        upper_arm_m: both("elbow"),
        forearm_m: both("wrist"),
        hand_m: both("hand"),
        hip_side_m: both("hip"),
        thigh_m: both("knee"),
        shank_m: both("ankle"),
        foot_height_m: heel,
        heel_back_m: heel,
        toe_forward_m: both("toe"),
    }
}

/// Spread of the length of a limb or the trunk among people of one stature, as a share of it.
const LIMB_SHARE: f64 = 0.04;

/// A body with all numbers equal to `value`.
fn uniform(value: f64) -> Proportions {
    let ones = Proportions::from_stature(1.0);
    let all: Vec<f64> = ones.lengths_m().map(|_| value).collect();
    Proportions::from_lengths(&all).unwrap_or(ones)
}

fn times(a: &Proportions, b: &Proportions) -> Proportions {
    combined(a, b, |a, b| a * b)
}

fn combined(a: &Proportions, b: &Proportions, with: impl Fn(f64, f64) -> f64) -> Proportions {
    let pairs = a.lengths_m().zip(b.lengths_m());
    let all: Vec<f64> = pairs.map(|((_, a), (_, b))| with(a, b)).collect();
    Proportions::from_lengths(&all).unwrap_or(*a)
}

/// `sigma` with the difference between sessions.
fn with_session(body: &Proportions, sigma: &Proportions) -> Proportions {
    combined(body, sigma, |length_m, sigma_m| {
        let session_m = SESSION_SIGMA_M.min(0.2 * length_m);
        libm::hypot(sigma_m, session_m).max(LEAST_SHARE * length_m)
    })
}

/// A segment of `p`; `sum` adds its parts, and `across` two directions.
fn segment_of(
    segment: Segment,
    p: &Proportions,
    sum: impl Fn(f64, f64) -> f64,
    across: impl Fn(f64, f64) -> f64,
) -> f64 {
    match segment {
        Segment::UpperArm => p.upper_arm_m,
        Segment::Forearm => p.forearm_m,
        Segment::Thigh => p.thigh_m,
        Segment::Shank => p.shank_m,
        Segment::ShoulderWidth => 2.0 * sum(p.scapula_side_m, p.clavicle_m),
        Segment::HipWidth => 2.0 * p.hip_side_m,
        Segment::Trunk => sum(p.lumbar_m, p.scapula_up_m),
        Segment::HeadHeight => sum(p.head_m, sum(p.trunk_m, -p.scapula_up_m)),
        Segment::EarWidth => 2.0 * p.ear_side_m,
        Segment::EyeWidth => 2.0 * p.eye_side_m,
        Segment::EyeForward => across(p.eye_forward_m, p.eye_up_m),
        Segment::NoseForward => p.nose_forward_m,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::fixture::{profile, profile_text};

    #[test]
    fn a_body_survives_its_profile() {
        let average = Proportions::from_stature(1.7);
        let body = Proportions {
            thigh_m: 1.1 * average.thigh_m,
            clavicle_m: 0.9 * average.clavicle_m,
            ..average
        };
        let prior = BodyPrior::from_profile(&profile(&body, 0.003)).unwrap();
        for ((name, was), (_, is)) in body.lengths_m().zip(prior.body().lengths_m()) {
            // The height of the pelvis follows from the legs.
            if name != "pelvis_height_m" {
                assert!((is - was).abs() < 1e-9, "{name}: {is} m, was {was} m");
            }
        }
        for (segment, length_m) in [
            (Segment::Thigh, body.thigh_m),
            (Segment::Trunk, body.lumbar_m + body.scapula_up_m),
            (
                Segment::ShoulderWidth,
                2.0 * (body.scapula_side_m + body.clavicle_m),
            ),
        ] {
            let (is_m, sigma_m) = prior.segment_m(segment);
            assert!((is_m - length_m).abs() < 1e-9, "{segment:?}");
            assert!(
                (SESSION_SIGMA_M..0.03).contains(&sigma_m),
                "{segment:?}: {sigma_m}"
            );
        }
    }

    #[test]
    fn a_stature_gives_the_table_with_more_spread_than_a_profile() {
        let stature_m = 1.8;
        let prior = BodyPrior::from_stature(stature_m);
        let known = BodyPrior::from_profile(&profile(&Proportions::from_stature(stature_m), 0.002));
        for segment in Segment::BODY {
            let (length_m, sigma_m) = prior.segment_m(segment);
            assert!(
                (length_m - segment.ratio() * stature_m).abs() < 1e-9,
                "{segment:?}"
            );
            assert!(
                sigma_m > known.as_ref().unwrap().segment_m(segment).1,
                "{segment:?}"
            );
        }
    }

    #[test]
    fn a_profile_without_a_link_is_refused_with_the_joint() {
        let mut profile = profile(&Proportions::from_stature(1.7), 0.0);
        profile.links.remove("left_knee");
        assert_eq!(BodyPrior::from_profile(&profile).unwrap_err(), "left_knee");
    }

    /// Regression: the range of lengths of such a head had its ends in the wrong order, which ended
    /// fusion when a person was recognised as the subject.
    #[test]
    fn a_profile_with_shoulders_above_the_head_is_refused() {
        let mut profile = profile(&Proportions::from_stature(1.7), 0.003);
        for side in ["left_scapula", "right_scapula"] {
            profile.links.get_mut(side).unwrap().offset_m.z = 1.0;
        }
        let (neck, head) = (Vector3::z() * 0.3, Vector3::z() * 0.2);
        profile.links.get_mut("neck").unwrap().offset_m = neck;
        profile.links.get_mut("head").unwrap().offset_m = head;
        let refused = BodyPrior::from_profile(&profile).unwrap_err();
        assert!(
            refused.contains("-0.500 m") && refused.contains("`left_scapula`"),
            "{refused}"
        );
        let text = profile_text(&profile);
        let refused = BodyPrior::parse(&text, Path::new("anna.toml")).unwrap_err();
        let refused = refused.to_string();
        assert!(
            refused
                .starts_with("anna.toml: `link`: found an implausible link: the head is -0.500 m"),
            "{refused}"
        );
    }
}
