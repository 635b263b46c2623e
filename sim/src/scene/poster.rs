//! Life-size posters of people in a scene: flat and upright.
//!
//! A poster shows the outline of a person who looks out of it; there is no paper around the
//! outline. The back is empty.

use farfield_fusion::body::skeleton::Joint;
use farfield_fusion::body::skeleton::Joints;
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::file::PosterEntry;
use super::truth::{PersonTruth, SITE_JOINTS};
use crate::body::{Build, Volume};
use crate::motion::Clip;

/// Remaining depth of a printed body, as a share: enough to distinguish front and back.
const RELIEF: f64 = 0.02;

/// A poster of a person.
#[derive(Debug, Clone, PartialEq)]
pub struct Poster {
    /// Stature of the printed person, metres.
    pub stature_m: f64,
    /// Seed of shape, skin and clothes.
    pub build_seed: u64,
    /// The joints of the person before printing, world, metres.
    joints_m: Joints,
    /// A point of the paper, world, metres.
    at_m: Vector3<f64>,
    /// Unit normal of the printed side.
    outward: Vector3<f64>,
}

impl Poster {
    pub(super) fn new(entry: &PosterEntry, clip: &Clip, build_seed: u64) -> Self {
        let posture = clip.posture(entry.time_s);
        let yaw_rad = entry.heading_rad - posture.facing_rad();
        let at_m = Vector3::new(entry.at_m[0], entry.at_m[1], 0.0);
        let turned = posture.moved(yaw_rad, Vector3::zeros());
        let joints_m = turned.scaled(entry.height_m);
        let pelvis_m = joints_m[Joint::Pelvis.index()];
        let shift_m = at_m - Vector3::new(pelvis_m.x, pelvis_m.y, 0.0);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), entry.heading_rad);
        Self {
            stature_m: entry.height_m,
            build_seed,
            joints_m: joints_m.map(|joint| joint + shift_m),
            at_m,
            outward: turn * Vector3::x(),
        }
    }

    /// The flat body of the printed person.
    pub fn volume(&self, build: &Build) -> Volume {
        let before = self.volume_before(build);
        before.squeezed(&self.flattening(RELIEF), &self.at_m)
    }

    /// The body before printing.
    pub fn volume_before(&self, build: &Build) -> Volume {
        Volume::new(&self.joints_m, build)
    }

    /// The position of a printed point (world, metres) before printing.
    pub fn before_print(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.at_m + self.flattening(1.0 / RELIEF) * (point_m - self.at_m)
    }

    /// The printed person, flat.
    pub fn printed(&self) -> PersonTruth {
        let joints_m = self.joints_m.map(|joint| self.flat(&joint));
        PersonTruth {
            joints_m,
            sites_m: SITE_JOINTS.map(|joint| joints_m[joint.index()]),
        }
    }

    /// The printed position of a point (world, metres).
    fn flat(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.at_m + self.flattening(RELIEF) * (point_m - self.at_m)
    }

    /// Keeps directions along the paper and scales those across it by `share`.
    fn flattening(&self, share: f64) -> Matrix3<f64> {
        Matrix3::identity() - self.outward * self.outward.transpose() * (1.0 - share)
    }

    /// Whether a point (world, metres) is on the printed side.
    pub fn is_before(&self, point_m: &Vector3<f64>) -> bool {
        (point_m - self.at_m).dot(&self.outward) > 0.0
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::embedded::CLIPS;

    fn poster(heading_rad: f64) -> Poster {
        let (name, text) = CLIPS[0];
        let clip = PathBuf::from(name).with_extension("bvh");
        let entry = PosterEntry {
            at_m: [2.0, -1.0],
            heading_rad,
            height_m: 1.8,
            clip: clip.clone(),
            time_s: 0.4,
        };
        Poster::new(&entry, &Clip::parse(text, &clip).unwrap(), 3)
    }

    #[test]
    fn a_life_size_poster_is_flat_and_faces_outward() {
        for heading_rad in [0.0, 1.0, -2.5] {
            let printed = poster(heading_rad).printed();
            let (sin, cos) = f64::sin_cos(heading_rad);
            let depth_m = |p: &Vector3<f64>| (p.x - 2.0) * cos + (p.y + 1.0) * sin;
            assert!(printed.joints_m.iter().all(|p| depth_m(p).abs() < 0.01));
            let width_m = |p: &Vector3<f64>| (p.y + 1.0) * cos - (p.x - 2.0) * sin;
            let [left, right] = [Joint::LeftShoulder, Joint::RightShoulder];
            let [left_m, right_m] = [left, right].map(|j| width_m(&printed.joint_m(j)));
            assert!(left_m > right_m + 0.2, "{left_m} {right_m}");
            assert!((1.6..1.9).contains(&printed.joint_m(Joint::Head).z));
            let poster = poster(heading_rad);
            for (before, flat) in poster.joints_m.iter().zip(&printed.joints_m) {
                assert!((poster.before_print(flat) - before).norm() < 1e-9);
            }
        }
    }

    #[test]
    fn a_poster_is_visible_from_the_front_only() {
        let poster = poster(0.0);
        assert!(poster.is_before(&Vector3::new(2.1, 5.0, 1.0)));
        assert!(!poster.is_before(&Vector3::new(1.9, 5.0, 1.0)));
    }
}
