//! Units and axes: from our world (metres, right-handed, z up) to those of other programs.

use std::str::FromStr;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// A program with its units and axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Preset {
    /// Blender: metres, z up; its BVH and glTF importers expect y up.
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
        crate::options::named(name, &Self::ALL)
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
    /// Units per metre.
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

/// Directions of a file's axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Orientation {
    /// As our world: right-handed, z up.
    ZUp,
    /// Right-handed, y up: (x, y, z) = (y, z, x) of the world; a person who faces the world's x
    /// faces z.
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

    /// Axes that `preset` expects in files of positions (CSV, Parquet, C3D).
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

    /// Axes that `preset` expects in BVH files. Blender's importer expects y up and converts.
    pub const fn of_bvh(preset: Preset) -> Self {
        match preset {
            Preset::Blender => Self {
                unit: Unit::Metre,
                orientation: Orientation::YUp,
            },
            _ => Self::of_points(preset),
        }
    }

    /// Rows: the file's axes in the world. Orthogonal; the determinant is -1 for left-handed files.
    pub fn from_world(self) -> Matrix3<f64> {
        match self.orientation {
            Orientation::ZUp => Matrix3::identity(),
            Orientation::YUp => Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),
            Orientation::LeftYUp => Matrix3::new(0.0, -1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0),
            Orientation::LeftZUp => Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0),
        }
    }

    /// Converts a point or offset from metres in our axes to the file's units and axes.
    pub fn point(self, ours_m: &Vector3<f64>) -> Vector3<f64> {
        self.from_world() * ours_m * self.unit.per_metre()
    }

    /// Converts a rotation from our axes to the file's: A R A⁻¹.
    pub fn rotation(self, ours: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        let a = self.from_world();
        // The axis is converted like a vector; mirroring reverses the sense of rotation.
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
        fn rotation_and_axis_conversion_commute(
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
    fn presets_map_forward_left_and_up_correctly() {
        let choice = |preset| {
            let axes = Axes::of_points(preset);
            [Vector3::x(), Vector3::y(), Vector3::z()].map(|v: Vector3<f64>| axes.point(&v).into())
        };
        let [forward, left, up]: [[f64; 3]; 3] = choice(Preset::Unreal);
        assert_eq!(
            [forward, left, up],
            [[100.0, 0.0, 0.0], [0.0, -100.0, 0.0], [0.0, 0.0, 100.0]]
        );
        let [forward, left, up]: [[f64; 3]; 3] = choice(Preset::Unity);
        assert_eq!(
            [forward, left, up],
            [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        );
        let [forward, left, up]: [[f64; 3]; 3] = choice(Preset::OpenSim);
        assert_eq!(
            [forward, left, up],
            [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
        );
    }
}
