//! What a line says of all joints, and how sure it says it is.

use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use farfield_proto::message::PersonState;
use nalgebra::Vector3;

/// The joints of one line, and what it says of them; world, metres, NaN where unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct JointDetail {
    /// The 29 joints. (f32 is 0.01 mm within 100 m.)
    pub joints_m: [[f32; 3]; N_JOINTS],
    /// How sure the pose is; none of a truth, and of poses that do not say.
    pub sureness: Option<Sureness>,
}

/// How sure a pose says it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Sureness {
    /// Its state.
    pub state: PersonState,
    /// Viewpoints that gave evidence.
    pub views: u16,
    /// One standard deviation per joint and axis, metres; NaN where unknown.
    pub sigma_m: [f32; N_JOINTS],
}

impl JointDetail {
    /// The joints that `joint` knows.
    pub fn gather(
        joint: impl Fn(&str) -> Option<Vector3<f64>>,
        sureness: Option<Sureness>,
    ) -> Self {
        let unknown = Vector3::repeat(f64::NAN);
        let at = |j: Joint| {
            let at_m = joint(j.name()).unwrap_or(unknown);
            [at_m.x as f32, at_m.y as f32, at_m.z as f32]
        };
        Self {
            joints_m: Joint::ALL.map(at),
            sureness,
        }
    }
}
