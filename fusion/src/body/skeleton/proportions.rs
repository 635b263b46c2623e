//! The lengths of one person, left and right equal.

use thiserror::Error;

/// A body cannot have this length.
#[derive(Debug, Clone, PartialEq, Error)]
#[error("length `{name}` is {found_m} m, expected a finite number above 0")]
pub struct ProportionsError {
    /// The field.
    pub name: &'static str,
    /// What it holds, metres.
    pub found_m: f64,
}

macro_rules! proportions {
    ($($(#[$doc:meta])* $field:ident = $ratio:literal,)*) => {
        /// Named lengths in metres, measured in the neutral pose (upright, arms hanging) from a
        /// joint to its parent.
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct Proportions {
            $($(#[$doc])* pub $field: f64,)*
        }

        impl Proportions {
            /// The average body of that stature (metres): the ratios of `formats.md`, after Drillis
            /// and Contini where these have them.
            pub fn from_stature(stature_m: f64) -> Self {
                Self { $($field: $ratio * stature_m,)* }
            }

            /// The body of these lengths (metres), in the order of the fields; `None` of another number of them.
            pub fn from_lengths(lengths_m: &[f64]) -> Option<Self> {
                let mut left = lengths_m.iter().copied();
                let proportions = Self { $($field: left.next()?,)* };
                left.next().is_none().then_some(proportions)
            }

            /// Every length with its name, in the order of the fields.
            pub fn lengths_m(&self) -> impl Iterator<Item = (&'static str, f64)> {
                [$((stringify!($field), self.$field)),*].into_iter()
            }
        }
    };
}

proportions! {
    /// Pelvis above the floor when standing.
    pelvis_height_m = 0.53,
    /// Pelvis to spine, up.
    lumbar_m = 0.07,
    /// Spine to neck, up.
    trunk_m = 0.22,
    /// Neck to head, up.
    head_m = 0.10,
    /// Head to nose, forward.
    nose_forward_m = 0.06,
    /// Head to eye, forward.
    eye_forward_m = 0.05,
    /// Head to eye, up.
    eye_up_m = 0.015,
    /// Head to eye, to its side.
    eye_side_m = 0.019,
    /// Head to ear, to its side.
    ear_side_m = 0.042,
    /// Spine to scapula (sternoclavicular joint), up.
    scapula_up_m = 0.20,
    /// Spine to scapula, to its side.
    scapula_side_m = 0.02,
    /// Scapula to shoulder, to its side.
    clavicle_m = 0.09,
    /// Shoulder to elbow, down.
    upper_arm_m = 0.172,
    /// Elbow to wrist, down.
    forearm_m = 0.157,
    /// Wrist to hand, beyond the wrist.
    hand_m = 0.05,
    /// Pelvis to hip, to its side.
    hip_side_m = 0.05,
    /// Hip to knee, down.
    thigh_m = 0.245,
    /// Knee to ankle, down.
    shank_m = 0.246,
    /// Ankle to heel and toe, down.
    foot_height_m = 0.035,
    /// Ankle to heel, back.
    heel_back_m = 0.03,
    /// Ankle to toe, forward.
    toe_forward_m = 0.12,
}

impl Proportions {
    /// The same body, if every length is possible.
    ///
    /// # Errors
    /// The first length that is not a finite number above 0.
    pub fn checked(self) -> Result<Self, ProportionsError> {
        match self.lengths_m().find(|(_, m)| !(m.is_finite() && *m > 0.0)) {
            None => Ok(self),
            Some((name, found_m)) => Err(ProportionsError { name, found_m }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_is_its_lengths() {
        let body = Proportions::from_stature(1.68);
        let mut lengths_m: Vec<f64> = body.lengths_m().map(|(_, m)| m).collect();
        assert_eq!(Proportions::from_lengths(&lengths_m), Some(body));
        lengths_m.push(1.0);
        assert_eq!(Proportions::from_lengths(&lengths_m), None);
        assert_eq!(Proportions::from_lengths(&lengths_m[..5]), None);
    }

    #[test]
    fn an_impossible_length_is_refused_by_name() {
        assert!(Proportions::from_stature(1.75).checked().is_ok());
        for bad in [0.0, -0.1, f64::NAN, f64::INFINITY] {
            let body = Proportions {
                thigh_m: bad,
                ..Proportions::from_stature(1.75)
            };
            assert_eq!(body.checked().unwrap_err().name, "thigh_m");
        }
    }
}
