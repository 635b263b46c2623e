//! A standing skeleton as a small BVH file, in the dialects of several programs.

use std::fmt::Write as _;
use std::path::Path;

use super::Clip;

/// How a program writes a standing skeleton with hanging arms.
pub(super) struct Dialect {
    /// Names of root and neck, and for each side shoulder, elbow, wrist, hip, knee, ankle, with `S`
    /// for the side.
    pub(super) names: [&'static str; 8],
    pub(super) sides: [&'static str; 2],
    pub(super) z_up: bool,
    pub(super) unit: f64,
}

/// Short names, y up, metres.
pub(super) const USUAL: Dialect = Dialect {
    names: [
        "hips",
        "neck",
        "S_shoulder",
        "S_elbow",
        "S_wrist",
        "S_hip",
        "S_knee",
        "S_ankle",
    ],
    sides: ["left", "right"],
    z_up: false,
    unit: 1.0,
};

impl Dialect {
    fn vector(&self, forward: f64, left: f64, up: f64) -> String {
        let [f, l, u] = [forward, left, up].map(|x| x * self.unit);
        if self.z_up {
            format!("{f} {l} {u}")
        } else {
            format!("{l} {u} {f}")
        }
    }

    /// One frame of a standing person, with the ankles `height` above the file's origin.
    pub(super) fn file(&self, height: f64) -> String {
        let [root, neck, arm @ .., hip, knee, ankle] = self.names;
        let mut text = format!(
            "HIERARCHY\nROOT {root}\n{{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Xrotation Yrotation Zrotation\n"
        );
        let mut n = 6;
        let mut bone = |text: &mut String, name: &str, offset: String| {
            n += 3;
            writeln!(
                text,
                "JOINT {name}\n{{\nOFFSET {offset}\nCHANNELS 3 Zrotation Xrotation Yrotation"
            )
            .unwrap();
        };
        bone(&mut text, neck, self.vector(0.0, 0.0, 0.5));
        text.push_str("}\n");
        for (side, left) in self.sides.into_iter().zip([1.0, -1.0]) {
            for (i, name) in arm.into_iter().enumerate() {
                let offset = if i == 0 {
                    self.vector(0.0, left * 0.18, 0.48)
                } else {
                    self.vector(0.0, 0.0, -0.3)
                };
                bone(&mut text, &name.replace('S', side), offset);
            }
            text.push_str("}\n}\n}\n");
            let offsets = [
                self.vector(0.0, left * 0.09, 0.0),
                self.vector(0.0, 0.0, -0.43),
                self.vector(0.0, 0.0, -0.43),
            ];
            for (name, offset) in [hip, knee, ankle].into_iter().zip(offsets) {
                bone(&mut text, &name.replace('S', side), offset);
            }
            text.push_str("}\n}\n}\n");
        }
        let zeros = "0 ".repeat(n - 3);
        let root = self.vector(3.0, 1.0, 0.86 + height);
        write!(
            text,
            "}}\nMOTION\nFrames: 1\nFrame Time: 0.02\n{root} {zeros}\n"
        )
        .unwrap();
        text
    }

    pub(super) fn clip(&self, height: f64) -> Clip {
        Clip::parse(&self.file(height), Path::new("a.bvh")).unwrap()
    }
}
