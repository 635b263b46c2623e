//! Places the 29 joints on the recognised bones.

use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use nalgebra::Vector3;

use super::names::NamedBones;
use super::{Axes, BodyAxes, BonePoint};
use crate::motion::bvh::{Bvh, PlacedBone};

/// Sole below ankle, in statures.
pub(super) const SOLE: f64 = 0.035;

/// Tip of the foot in front of the ankle, in statures.
const TOE_AHEAD: f64 = 0.12;

/// Ball of the foot in front of the ankle, in statures.
const BALL_AHEAD: f64 = 0.073;

/// The input of the placement.
pub(super) struct Placing<'a> {
    bvh: &'a Bvh,
    named: &'a NamedBones,
    axes: BodyAxes,
    /// The first frame. Bones without motion of their own have their constant pose in it.
    placed: Vec<PlacedBone>,
    pub(super) stature: f64,
}

impl<'a> Placing<'a> {
    pub(super) fn new(bvh: &'a Bvh, named: &'a NamedBones, axes: BodyAxes) -> Self {
        let mut placing = Self {
            bvh,
            named,
            axes,
            placed: bvh.placed(0),
            stature: 0.0,
        };
        placing.stature = placing.stature();
        placing
    }

    fn origin(&self, bone: usize) -> Vector3<f64> {
        self.placed[bone].origin
    }

    fn distance(&self, from: usize, to: usize) -> f64 {
        (self.origin(from) - self.origin(to)).norm()
    }

    /// A bone's origin in the axes of another.
    fn inside(&self, bone: usize, of: usize) -> Vector3<f64> {
        self.placed[of].inside(self.origin(bone))
    }

    fn mid_hips(&self) -> Vector3<f64> {
        (self.origin(self.named.hip[0]) + self.origin(self.named.hip[1])) / 2.0
    }

    /// The midpoint of the eyes in the axes of the head bone, if there are both.
    fn mid_eyes(&self) -> Option<Vector3<f64>> {
        let head = self.named.head?;
        let [left, right] = self.named.eye?;
        Some((self.inside(left, head) + self.inside(right, head)) / 2.0)
    }

    fn stature(&self) -> f64 {
        let named = self.named;
        let leg = |side: usize| {
            self.distance(named.hip[side], named.knee[side])
                + self.distance(named.knee[side], named.ankle[side])
        };
        let legs = f64::midpoint(leg(0), leg(1));
        let mut trunk = (self.origin(named.first_spine) - self.mid_hips()).norm();
        trunk += self.path(named.first_spine, named.neck);
        match (self.mid_eyes(), named.head) {
            (Some(eyes), Some(head)) => {
                let head_length = self.path(named.neck, head) + eyes.dot(&self.axes.body.column(2));
                (legs + trunk + head_length) / (1.0 - SOLE - 0.065)
            }
            _ => (legs + trunk) / (1.0 - SOLE - 0.10 - 0.08),
        }
    }

    /// The length of the bones from `top` down the tree to `end`.
    fn path(&self, top: usize, end: usize) -> f64 {
        let mut length = 0.0;
        let mut at = end;
        while let Some(parent) = self.bvh.bones[at].parent.filter(|_| at != top) {
            length += self.distance(at, parent);
            at = parent;
        }
        length
    }

    /// Forward, left and up in statures, as a vector in file units in a bone's axes.
    fn shares(&self, axes: &Axes, forward: f64, left: f64, up: f64) -> Vector3<f64> {
        axes * Vector3::new(forward, left, up) * self.stature
    }

    pub(super) fn sites(&self) -> [BonePoint; N_JOINTS] {
        let named = self.named;
        let at = |bone: usize| BonePoint {
            bone,
            offset: Vector3::zeros(),
        };
        let mut sites = [at(named.pelvis); N_JOINTS];
        let mut set = |joint: Joint, site: BonePoint| sites[joint.index()] = site;
        set(Joint::Spine, self.spine());
        set(Joint::Neck, at(named.neck));
        self.face(&mut set);
        for side in 0..2 {
            let of_side = |joints: [Joint; 2]| joints[side];
            for ((left, right), bone) in [
                ((Joint::LeftShoulder, Joint::RightShoulder), named.shoulder),
                ((Joint::LeftElbow, Joint::RightElbow), named.elbow),
                ((Joint::LeftWrist, Joint::RightWrist), named.wrist),
                ((Joint::LeftHip, Joint::RightHip), named.hip),
                ((Joint::LeftKnee, Joint::RightKnee), named.knee),
                ((Joint::LeftAnkle, Joint::RightAnkle), named.ankle),
            ] {
                set(of_side([left, right]), at(bone[side]));
            }
            set(
                of_side([Joint::LeftScapula, Joint::RightScapula]),
                named
                    .collar
                    .map_or_else(|| self.scapula(side), |c| at(c[side])),
            );
            set(
                of_side([Joint::LeftHand, Joint::RightHand]),
                self.hand(side),
            );
            let heel = self.shares(&self.axes.foot, -0.032, 0.0, -SOLE);
            set(
                of_side([Joint::LeftHeel, Joint::RightHeel]),
                BonePoint {
                    bone: named.ankle[side],
                    offset: heel,
                },
            );
            set(of_side([Joint::LeftToe, Joint::RightToe]), self.toe(side));
        }
        sites
    }

    fn spine(&self) -> BonePoint {
        let named = self.named;
        let mid_hips = self.placed[named.pelvis].inside(self.mid_hips());
        let first = self.inside(named.first_spine, named.pelvis) - mid_hips;
        let up = first.dot(&self.axes.body.column(2)) / self.stature;
        if (0.03..=0.10).contains(&up) {
            return BonePoint {
                bone: named.first_spine,
                offset: Vector3::zeros(),
            };
        }
        BonePoint {
            bone: named.pelvis,
            offset: mid_hips + self.shares(&self.axes.body, 0.0, 0.0, 0.07),
        }
    }

    fn face(&self, set: &mut impl FnMut(Joint, BonePoint)) {
        let axes = &self.axes.body;
        let bone = self.named.head.unwrap_or(self.named.neck);
        let eyes = self.mid_eyes().unwrap_or_else(|| {
            let to_head = self.path(self.named.neck, bone);
            self.shares(axes, 0.05, 0.0, 0.10 + 0.015) - axes.column(2) * to_head
        });
        let head = eyes - self.shares(axes, 0.05, 0.0, 0.015);
        set(Joint::Head, BonePoint { bone, offset: head });
        let nose = eyes + self.shares(axes, 0.013, 0.0, -0.022);
        set(Joint::Nose, BonePoint { bone, offset: nose });
        for (side, left, eye, ear) in [
            (0, 1.0, Joint::LeftEye, Joint::LeftEar),
            (1, -1.0, Joint::RightEye, Joint::RightEar),
        ] {
            let ear_at = head + self.shares(axes, 0.0, left * 0.042, 0.0);
            set(
                ear,
                BonePoint {
                    bone,
                    offset: ear_at,
                },
            );
            let default_m = eyes + self.shares(axes, 0.0, left * 0.018, 0.0);
            let eye_at = self.named.eye.zip(self.named.head);
            let offset = eye_at.map_or(default_m, |(eyes, head)| self.inside(eyes[side], head));
            set(eye, BonePoint { bone, offset });
        }
    }

    fn scapula(&self, side: usize) -> BonePoint {
        let neck = &self.bvh.bones[self.named.neck];
        let bone = neck.parent.unwrap_or(self.named.neck);
        let left = if side == 0 { 0.02 } else { -0.02 };
        let offset = self.inside(self.named.neck, bone);
        BonePoint {
            bone,
            offset: offset + self.shares(&self.axes.body, 0.02, left, -0.01),
        }
    }

    fn hand(&self, side: usize) -> BonePoint {
        let bone = self.named.wrist[side];
        let plausible =
            |offset: &Vector3<f64>| (0.02..=0.12).contains(&(offset.norm() / self.stature));
        let knuckles = &self.named.knuckles[side];
        let sum: Vector3<f64> = knuckles.iter().map(|&k| self.inside(k, bone)).sum();
        let offset = Some(sum / knuckles.len() as f64)
            .filter(plausible)
            .or(self.bvh.bones[bone].end.filter(plausible))
            .unwrap_or_else(|| {
                let elbow = self.inside(self.named.elbow[side], bone);
                -elbow.try_normalize(f64::EPSILON).unwrap_or_default() * (0.05 * self.stature)
            });
        BonePoint { bone, offset }
    }

    fn toe(&self, side: usize) -> BonePoint {
        let foot = &self.axes.foot;
        let ankle = self.named.ankle[side];
        let Some(toe) = self.named.toe.map(|toe| toe[side]) else {
            let end = self.bvh.bones[ankle].end;
            let ahead = self.ahead(end, TOE_AHEAD);
            return BonePoint {
                bone: ankle,
                offset: foot * ahead * self.stature,
            };
        };
        let ball = foot.transpose() * self.bvh.bones[toe].offset / self.stature;
        if let Some(end) = self.bvh.bones[toe].end {
            let tip = ball + self.axes.toe.transpose() * end / self.stature;
            if (0.09..=0.16).contains(&tip.x) {
                return BonePoint {
                    bone: toe,
                    offset: end,
                };
            }
        }
        let beyond = self.ahead(Some(self.bvh.bones[toe].offset), TOE_AHEAD) - ball;
        BonePoint {
            bone: toe,
            offset: self.axes.toe * beyond * self.stature,
        }
    }

    pub(super) fn ball(&self, side: usize) -> BonePoint {
        let ankle = self.named.ankle[side];
        let ahead = self.ahead(self.bvh.bones[ankle].end, BALL_AHEAD);
        BonePoint {
            bone: ankle,
            offset: self.axes.foot * ahead * self.stature,
        }
    }

    /// The point of the sole that is `far` in front of the ankle towards `along` (in the foot
    /// bone's axes), relative to the ankle: forward, left and up in statures.
    fn ahead(&self, along: Option<Vector3<f64>>, far: f64) -> Vector3<f64> {
        let along = along.map_or(Vector3::x(), |along| self.axes.foot.transpose() * along);
        let level = Vector3::new(along.x, along.y, 0.0);
        let direction = level.try_normalize(f64::EPSILON).unwrap_or(Vector3::x());
        direction * far - Vector3::z() * SOLE
    }
}
