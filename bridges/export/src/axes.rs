//! Units and axes: from our world (metres, right-handed, z up) to what another program expects.

use std::str::FromStr;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// A program whose units and axes are asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Blender: metres, z up; its importers of BVH and glTF take y up.
    Blender,
    /// Unreal Engine: centimetres, left-handed, z up, x forward, y right.
    Unreal,
    /// Unity: metres, left-handed, y up, z forward, x right.
    Unity,
    /// OpenSim: metres, y up.
    OpenSim,
    /// `Visual3D`: millimetres, z up.
    Visual3d,
}

impl Preset {
    /// Every preset with its name on the command line.
    pub const ALL: [(&'static str, Self); 5] = [
        ("blender", Self::Blender),
        ("unreal", Self::Unreal),
        ("unity", Self::Unity),
        ("opensim", Self::OpenSim),
        ("visual3d", Self::Visual3d),
    ];
}

impl FromStr for Preset {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        crate::choice::named(name, &Self::ALL)
    }
}

/// A length unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Metres.
    Metre,
    /// Centimetres.
    Centimetre,
    /// Millimetres.
    Millimetre,
}

impl Unit {
    /// Units in a metre.
    pub const fn per_metre(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 100.0,
            Self::Millimetre => 1000.0,
        }
    }

    /// Its symbol.
    pub const fn symbol(self) -> &'static str {
        match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
        }
    }
}

/// Which way the axes of a file point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// As our world: right-handed, z up.
    ZUp,
    /// Right-handed, y up: (x, y, z) = (y, z, x) of the world, so that who faces the world's x faces z.
    YUp,
    /// Unity's: left-handed, y up: (-y, z, x) of the world.
    LeftYUp,
    /// Unreal's: left-handed, z up: (x, -y, z) of the world.
    LeftZUp,
}

/// Units and axes of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Axes {
    /// Of lengths.
    pub unit: Unit,
    /// Of directions.
    pub orientation: Orientation,
}

impl Axes {
    /// Metres in the axes of our world.
    pub const WORLD: Self = Self {
        unit: Unit::Metre,
        orientation: Orientation::ZUp,
    };

    /// What `preset` expects of a file of positions (CSV, Parquet, C3D).
    pub const fn of_points(preset: Preset) -> Self {
        let (unit, orientation) = match preset {
            Preset::Blender => (Unit::Metre, Orientation::ZUp),
            Preset::Unreal => (Unit::Centimetre, Orientation::LeftZUp),
            Preset::Unity => (Unit::Metre, Orientation::LeftYUp),
            Preset::OpenSim => (Unit::Metre, Orientation::YUp),
            Preset::Visual3d => (Unit::Millimetre, Orientation::ZUp),
        };
        Self { unit, orientation }
    }

    /// What `preset` expects of a BVH file. Blender's importer takes y up, and turns it.
    pub const fn of_bvh(preset: Preset) -> Self {
        match preset {
            Preset::Blender => Self {
                unit: Unit::Metre,
                orientation: Orientation::YUp,
            },
            _ => Self::of_points(preset),
        }
    }

    /// Rows: the file's axes in the world's. Orthogonal; its determinant is -1 where the file is left-handed.
    pub fn from_world(self) -> Matrix3<f64> {
        match self.orientation {
            Orientation::ZUp => Matrix3::identity(),
            Orientation::YUp => Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),
            Orientation::LeftYUp => Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),
            Orientation::LeftZUp => Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0),
        }
    }

    /// A point or offset in metres of our axes, in the file's units and axes.
    pub fn point(self, ours_m: &Vector3<f64>) -> Vector3<f64> {
        self.from_world() * ours_m * self.unit.per_metre()
    }

    /// A rotation in our axes, in the file's: A R A⁻¹.
    pub fn rotation(self, ours: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let a = self.from_world();
        // The axis turns with the axes; a mirror turns the sense of rotation round.
        let axis = a * ours.imag() * a.determinant();
        UnitQuaternion::new_unchecked(Quaternion::from_parts(ours.w, axis))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn turning_and_changing_axes_commute(
            turn in prop::array::uniform3(-3.0f64..3.0), at in prop::array::uniform3(-9.0f64..9.0), pick in 0usize..5,
        ) {
            let axes = Axes::of_points(Preset::ALL[pick].1);
            let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(turn));
            let at = Vector3::from(at);
            let there = axes.rotation(&rotation) * axes.point(&at);
            prop_assert!((there - axes.point(&(rotation * at))).norm() < 1e-8);
        }
    }

    #[test]
    fn up_forward_and_left_are_where_programs_expect_them() {
        let of = |preset| {
            let axes = Axes::of_points(preset);
            [Vector3::x(), Vector3::y(), Vector3::z()].map(|v: Vector3<f64>| axes.point(&v).into())
        };
        let [forward, left, up]: [[f64; 3]; 3] = of(Preset::Unreal);
        assert_eq!(
            [forward, left, up],
            [[100.0, 0.0, 0.0], [0.0, -100.0, 0.0], [0.0, 0.0, 100.0]]
        );
        let [forward, left, up]: [[f64; 3]; 3] = of(Preset::Unity);
        assert_eq!(
            [forward, left, up],
            [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        );
        let [forward, left, up]: [[f64; 3]; 3] = of(Preset::OpenSim);
        assert_eq!(
            [forward, left, up],
            [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        );
    }
}
