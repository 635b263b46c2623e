//! Parameters with named values, and the TOML form of each type.

use serde::Deserialize;
use toml::Value;

use crate::patch::CompressionLevel;

/// Prediction of the next pose, paper (3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predictor {
    /// The paper's formula, 3/2 P(t) - P(t-1) + 1/2 P(t-2); no motion at constant velocity.
    Paper,
    /// The filter's position and velocity, the velocity damped per tick.
    DampedVelocity,
    /// True constant acceleration, 3 P(t) - 3 P(t-1) + P(t-2).
    ConstantAcceleration,
}

/// The choice of the camera for a person's crop within a viewpoint, paper (5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraChoice {
    /// The camera that sees most of the person, then with the most pixels, then nearest its centre;
    /// kept until another is clearly better.
    BestView,
    /// The paper's choice: the camera whose image centre is nearest to the projected torso, in
    /// pixels, whatever it sees. For comparisons.
    NearestCenter,
}

/// A type of a parameter.
pub(super) trait ParameterValue {
    /// Its named values; empty for other types.
    const WORDS: &'static [&'static str] = &[];

    /// The value in a venue file; `None` if it is omitted.
    fn to_toml(self) -> Option<Value>;
}

impl ParameterValue for f64 {
    fn to_toml(self) -> Option<Value> {
        Some(Value::Float(self))
    }
}

impl ParameterValue for u32 {
    fn to_toml(self) -> Option<Value> {
        Some(Value::Integer(self.into()))
    }
}

impl ParameterValue for bool {
    const WORDS: &'static [&'static str] = &["false", "true"];

    fn to_toml(self) -> Option<Value> {
        Some(Value::Boolean(self))
    }
}

impl ParameterValue for CompressionLevel {
    fn to_toml(self) -> Option<Value> {
        Some(Value::String(self.to_string()))
    }
}

impl<T: ParameterValue> ParameterValue for Option<T> {
    const WORDS: &'static [&'static str] = T::WORDS;

    fn to_toml(self) -> Option<Value> {
        self.and_then(T::to_toml)
    }
}

impl ParameterValue for Predictor {
    const WORDS: &'static [&'static str] = &["paper", "damped-velocity", "constant-acceleration"];

    fn to_toml(self) -> Option<Value> {
        let word = match self {
            Self::Paper => "paper",
            Self::DampedVelocity => "damped-velocity",
            Self::ConstantAcceleration => "constant-acceleration",
        };
        Some(word.into())
    }
}

impl ParameterValue for CameraChoice {
    const WORDS: &'static [&'static str] = &["best-view", "nearest-center"];

    fn to_toml(self) -> Option<Value> {
        let word = match self {
            Self::BestView => "best-view",
            Self::NearestCenter => "nearest-center",
        };
        Some(word.into())
    }
}
