//! The faults of a scene's maps and their strength: the table `[faults]` of a scene file.
//!
//! ```toml
//! [faults]
//! profile = "standard"          # or "none", the default
//! hidden = false                # overrides the profile: disables one fault,
//! bias = { share_of_sigma = 0.6 }   # or sets its numbers; omitted numbers are the standard's
//! free_running = true           # cameras with their own clock, in no profile
//! ```

use std::fmt;
use std::marker::PhantomData;

use serde::de::value::MapAccessDeserializer;
use serde::de::{Error as _, MapAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// The faults of a scene's maps; `None` where one is disabled.
///
/// Lengths in the image plane are metres at the person's depth. `sigma_k s` is the OKS scale of a
/// keypoint, with s = 0.71 m x stature / 1.75 m.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct FaultProfile {
    /// A slow error of each keypoint in each view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias: Option<Bias>,
    /// A new error at every tick.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub jitter: Option<Jitter>,
    /// Partial confusion of left and right.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mirror: Option<MirrorFault>,
    /// The keypoint of the person in front appears in the map.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leak: Option<Leak>,
    /// Keypoints behind a body have larger errors.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hidden: Option<Hidden>,
    /// Keypoints without a peak, independent of the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing: Option<Missing>,
    /// The network's own definition of a joint's position.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub definition: Option<Definition>,
    /// Noise in cells without a peak.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseFault>,
    /// Whether every camera captures at its own constant offset from the tick, uniform within half
    /// a frame either way.
    pub free_running: bool,
}

/// A first-order autoregressive error, independent per camera, person and keypoint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Bias {
    /// RMS of the 2D error, in `sigma_k s`.
    pub share_of_sigma: f64,
    /// Time in which its autocorrelation falls to 1/e, seconds.
    pub time_constant_s: f64,
}

/// A white error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Jitter {
    /// RMS of the 2D error, in `sigma_k s`.
    pub share_of_sigma: f64,
}

/// Elbows, wrists, knees and ankles: a second peak at the keypoint of the opposite limb.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MirrorFault {
    /// Share of the time, 0 to 1.
    pub share: f64,
    /// Mean length of a burst, seconds.
    pub burst_s: f64,
    /// Height of the second peak relative to the true one: minimum and maximum, uniform per burst.
    pub height: [f64; 2],
}

/// The effect while another person's body covers the keypoint.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Leak {
    /// Height of the person's own peak.
    pub own_height: f64,
    /// Share of the bursts in which the other person's keypoint shows, 0 to 1.
    pub probability: f64,
    /// Mean length of a burst, seconds.
    pub burst_s: f64,
    /// Height of the other person's peak.
    pub height: f64,
}

/// The effect while any body covers the keypoint, including the person's own.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Hidden {
    /// Factor on the bias.
    pub bias_factor: f64,
    /// Height of the peak: minimum and maximum, uniform per burst.
    pub height: [f64; 2],
    /// Share of the bursts without any peak, 0 to 1.
    pub no_peak: f64,
    /// Mean length of a burst, seconds.
    pub burst_s: f64,
}

/// Intervals without a peak.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Missing {
    /// Share of the time, 0 to 1.
    pub share: f64,
    /// Mean length of a burst, seconds.
    pub burst_s: f64,
}

/// Hips and knees: a constant offset, fixed to the body and the same in all views. It changes the
/// keypoint sites of the truth, not its joints.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Definition {
    /// Length of the offset, metres; its direction is drawn per person.
    pub offset_m: f64,
}

/// Uniform noise in every cell.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseFault {
    /// Highest value, 0 to 1; the lowest is 0.
    pub floor: f64,
}

impl FaultProfile {
    /// An estimate of the faults of real networks; published figures use this profile.
    pub fn standard() -> Self {
        Self {
            bias: Some(Bias::default()),
            jitter: Some(Jitter::default()),
            mirror: Some(MirrorFault::default()),
            leak: Some(Leak::default()),
            hidden: Some(Hidden::default()),
            missing: Some(Missing::default()),
            definition: Some(Definition::default()),
            noise: Some(NoiseFault::default()),
            free_running: false,
        }
    }

    /// No fault: peaks of height 1 at the sites of the keypoints.
    pub fn none() -> Self {
        Self::default()
    }
}

impl Default for Bias {
    fn default() -> Self {
        Self {
            share_of_sigma: 0.4,
            time_constant_s: 2.0,
        }
    }
}

impl Default for Jitter {
    fn default() -> Self {
        Self {
            share_of_sigma: 0.1,
        }
    }
}

impl Default for MirrorFault {
    fn default() -> Self {
        Self {
            share: 0.03,
            burst_s: 0.3,
            height: [0.3, 1.1],
        }
    }
}

impl Default for Leak {
    fn default() -> Self {
        Self {
            own_height: 0.5,
            probability: 0.5,
            burst_s: 0.3,
            height: 0.8,
        }
    }
}

impl Default for Hidden {
    fn default() -> Self {
        Self {
            bias_factor: 2.0,
            height: [0.3, 0.8],
            no_peak: 0.2,
            burst_s: 0.3,
        }
    }
}

impl Default for Missing {
    fn default() -> Self {
        Self {
            share: 0.01,
            burst_s: 0.2,
        }
    }
}

impl Default for Definition {
    fn default() -> Self {
        Self { offset_m: 0.03 }
    }
}

impl Default for NoiseFault {
    fn default() -> Self {
        Self { floor: 0.02 }
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum ProfileName {
    None,
    Standard,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Raw {
    profile: Option<ProfileName>,
    bias: Option<FaultSetting<Bias>>,
    jitter: Option<FaultSetting<Jitter>>,
    mirror: Option<FaultSetting<MirrorFault>>,
    leak: Option<FaultSetting<Leak>>,
    hidden: Option<FaultSetting<Hidden>>,
    missing: Option<FaultSetting<Missing>>,
    definition: Option<FaultSetting<Definition>>,
    noise: Option<FaultSetting<NoiseFault>>,
    free_running: Option<bool>,
}

impl<'de> Deserialize<'de> for FaultProfile {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let raw = Raw::deserialize(deserializer)?;
        let base = match raw.profile {
            Some(ProfileName::Standard) => Self::standard(),
            Some(ProfileName::None) | None => Self::none(),
        };
        Ok(Self {
            bias: or(raw.bias, base.bias),
            jitter: or(raw.jitter, base.jitter),
            mirror: or(raw.mirror, base.mirror),
            leak: or(raw.leak, base.leak),
            hidden: or(raw.hidden, base.hidden),
            missing: or(raw.missing, base.missing),
            definition: or(raw.definition, base.definition),
            noise: or(raw.noise, base.noise),
            free_running: raw.free_running.unwrap_or(base.free_running),
        })
    }
}

/// The setting of a fault, or the profile's.
fn or<T>(written: Option<FaultSetting<T>>, profile: Option<T>) -> Option<T> {
    written.map_or(profile, |setting| setting.0)
}

/// One fault in the file: `false`, `true` (the standard's numbers) or a table of numbers.
struct FaultSetting<T>(Option<T>);

impl<'de, T: FaultNumbers + Deserialize<'de>> Deserialize<'de> for FaultSetting<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(FaultSettingVisitor(PhantomData))
    }
}

struct FaultSettingVisitor<T>(PhantomData<T>);

impl<'de, T: FaultNumbers + Deserialize<'de>> Visitor<'de> for FaultSettingVisitor<T> {
    type Value = FaultSetting<T>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("true, false or a table of the fault's numbers")
    }

    fn visit_bool<E>(self, on: bool) -> Result<Self::Value, E> {
        Ok(FaultSetting(on.then(T::default)))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Self::Value, A::Error> {
        let fault = T::deserialize(MapAccessDeserializer::new(map))?;
        for (field, value, most) in fault.numbers() {
            if !(0.0..=most).contains(&value) {
                let expected = format!("a number from 0 to {most} in `{field}`");
                return Err(A::Error::invalid_value(
                    Unexpected::Float(value),
                    &expected.as_str(),
                ));
            }
        }
        Ok(FaultSetting(Some(fault)))
    }
}

/// Longest time of a fault, seconds: in any scene it never changes.
const LONGEST_S: f64 = 1e6;
/// Largest error, in multiples of its unit.
const LARGEST: f64 = 100.0;

/// The numbers of a fault, for the range check.
trait FaultNumbers: Default {
    /// Every number with its field and its maximum; the minimum is 0.
    fn numbers(&self) -> Vec<(&'static str, f64, f64)>;
}

impl FaultNumbers for Bias {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![
            ("share_of_sigma", self.share_of_sigma, LARGEST),
            ("time_constant_s", self.time_constant_s, LONGEST_S),
        ]
    }
}

impl FaultNumbers for Jitter {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![("share_of_sigma", self.share_of_sigma, LARGEST)]
    }
}

impl FaultNumbers for MirrorFault {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![
            ("share", self.share, 1.0),
            ("burst_s", self.burst_s, LONGEST_S),
            ("height", self.height[1], LARGEST),
            ("height", self.height[0], self.height[1]),
        ]
    }
}

impl FaultNumbers for Leak {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![
            ("own_height", self.own_height, 1.0),
            ("probability", self.probability, 1.0),
            ("burst_s", self.burst_s, LONGEST_S),
            ("height", self.height, 1.0),
        ]
    }
}

impl FaultNumbers for Hidden {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![
            ("bias_factor", self.bias_factor, LARGEST),
            ("height", self.height[1], 1.0),
            ("height", self.height[0], self.height[1]),
            ("no_peak", self.no_peak, 1.0),
            ("burst_s", self.burst_s, LONGEST_S),
        ]
    }
}

impl FaultNumbers for Missing {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![
            ("share", self.share, 1.0),
            ("burst_s", self.burst_s, LONGEST_S),
        ]
    }
}

impl FaultNumbers for Definition {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![("offset_m", self.offset_m, 1.0)]
    }
}

impl FaultNumbers for NoiseFault {
    fn numbers(&self) -> Vec<(&'static str, f64, f64)> {
        vec![("floor", self.floor, 1.0)]
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::toml_file::{FileError, TomlFile};

    use super::*;

    #[derive(Debug, Deserialize)]
    struct File {
        faults: FaultProfile,
    }

    fn read(text: &str) -> Result<FaultProfile, FileError> {
        let file = TomlFile::parse(text, Path::new("scene.toml")).unwrap();
        file.read::<File>().map(|file| file.faults)
    }

    fn refusal(text: &str) -> String {
        read(text).unwrap_err().to_string()
    }

    #[test]
    fn a_profile_is_read_by_its_name() {
        let standard = read("[faults]\nprofile = \"standard\"\n").unwrap();
        assert_eq!(standard, FaultProfile::standard());
        let none = read("[faults]\nprofile = \"none\"\n").unwrap();
        assert_eq!(none, FaultProfile::none());
        assert_eq!(read("[faults]\n").unwrap(), none);
    }

    #[test]
    fn a_single_fault_overrides_the_profile() {
        let text = "[faults]\nprofile = \"standard\"\nhidden = false\nbias = { share_of_sigma = 0.6 }\nfree_running = true\n";
        let expected = FaultProfile {
            hidden: None,
            bias: Some(Bias {
                share_of_sigma: 0.6,
                time_constant_s: 2.0,
            }),
            free_running: true,
            ..FaultProfile::standard()
        };
        assert_eq!(read(text).unwrap(), expected);
    }

    #[test]
    fn without_a_profile_only_named_faults_are_active() {
        let text = "[faults]\njitter = true\n[faults.missing]\nshare = 0.5\nburst_s = 1\n";
        let expected = FaultProfile {
            jitter: Some(Jitter::default()),
            missing: Some(Missing {
                share: 0.5,
                burst_s: 1.0,
            }),
            ..FaultProfile::none()
        };
        assert_eq!(read(text).unwrap(), expected);
    }

    #[test]
    fn a_written_profile_is_read_back() {
        let changed = FaultProfile {
            mirror: None,
            free_running: true,
            ..FaultProfile::standard()
        };
        for profile in [changed, FaultProfile::none()] {
            let table = toml::to_string(&profile).unwrap();
            assert_eq!(toml::from_str::<FaultProfile>(&table).unwrap(), profile);
        }
    }

    #[test]
    fn an_unknown_name_is_refused_with_the_nearest_name() {
        assert_eq!(
            refusal("[faults]\nhiden = false\n"),
            "scene.toml:2: `faults.hiden`: unknown field `hiden`, did you mean `hidden`?"
        );
        assert_eq!(
            refusal("[faults]\nprofile = \"standart\"\n"),
            "scene.toml:2: `faults.profile`: unknown value `standart`, did you mean `standard`?"
        );
        let message = refusal("[faults]\nbias = { share_of_sgma = 1 }\n");
        assert!(
            message.contains("did you mean `share_of_sigma`?"),
            "{message}"
        );
    }

    #[test]
    fn a_number_out_of_its_range_is_refused_with_its_line() {
        let message = refusal("[faults]\nprofile = \"none\"\nmissing = { share = 1.5 }\n");
        assert!(
            message.starts_with("scene.toml:3: `faults.missing"),
            "{message}"
        );
        assert!(message.contains("`share`"), "{message}");
        for wrong in [
            "bias = { share_of_sigma = nan }",
            "mirror = { height = [0.8, 0.3] }",
            "hidden = 3",
            "leak = { burst_s = -1 }",
        ] {
            assert!(refusal(&format!("[faults]\n{wrong}\n")).starts_with("scene.toml:2"));
        }
    }
}
