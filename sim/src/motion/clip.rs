//! A clip: the posture of one person as a function of time.
//!
//! Between frames bones turn by slerp and the root moves linearly. Before the start and after the
//! end the first and the last frame apply.
//!
//! **Units.** Clips may use centimetres, metres or any other unit. The clip's own skeleton gives
//! its stature in file units ([`Clip::stature_units`], see [`super::rig`]). [`Clip::posture`] uses
//! statures.
//!
//! **Floor.** The origin's height may be relative to the floor, to the hips' first height or to
//! anything else, so the floor is estimated from the body. The estimate takes the lowest of the 29
//! joints in every frame (the ball instead of the tip for a foot without toe bone), and the 20 %
//! quantile of these heights. A clip that never stands (a crawl) rests on its lowest parts. Flight,
//! a cartwheel, or a foot that briefly dips below the floor does not change the estimate.
//!
//! **Couples** recorded in one coordinate frame keep it through [`Clip::posture_relative_to`],
//! which uses the stature and floor of the first person for both.

use std::fs;
use std::path::Path;

use farfield_fusion::body::skeleton::Joints;
use farfield_fusion::body::skeleton::{Joint, N_JOINTS};
use farfield_proto::toml_file::FileError;
use nalgebra::{UnitQuaternion, Vector3};

use super::bvh::{Bvh, PlacedBone};
use super::posture::Posture;
use super::rig::{BonePoint, BoneRig, Family};

/// Larger files are no clip of one person.
const MAX_FILE_BYTES: u64 = 512 << 20;

/// Share of frames whose lowest joint may be below the floor.
const FLOOR_QUANTILE: f64 = 0.2;

/// Largest bend of the toes at the ball of the foot, radians (70 degrees).
const LARGEST_BEND_RAD: f64 = 1.22;

/// Upward component of the back of the foot above which toes bend fully: 30 degrees.
const STEEP_BACK: f64 = 0.5;

/// The motion of one skeleton.
#[derive(Debug, Clone, PartialEq)]
pub struct Clip {
    family: Family,
    frame_time_s: f64,
    n_frames: usize,
    stature_units: f64,
    floor_units: f64,
    mean_lengths: [f64; N_JOINTS],
    z_up: UnitQuaternion<f64>,
    /// The bones that carry joints, and their ancestors; parents first.
    tracks: Vec<BoneMotion>,
    sites: [BonePoint; N_JOINTS],
    /// Under the balls of the feet, if there are no toe bones that bend.
    balls: Option<[BonePoint; 2]>,
}

/// One bone over time, in its parent's axes.
#[derive(Debug, Clone, PartialEq)]
struct BoneMotion {
    parent: Option<usize>,
    rotations: Vec<UnitQuaternion<f64>>,
    /// One origin if it is constant, else one per frame.
    origins: Vec<Vector3<f64>>,
}

impl Clip {
    /// Reads a BVH file.
    ///
    /// # Errors
    /// [`FileError`] for an unreadable or invalid BVH file, or a skeleton that is not a person;
    /// with the line if known.
    pub fn load(path: &Path) -> Result<Self, FileError> {
        let unreadable = |e: std::io::Error| {
            let problem = format!("cannot be read: {e}, expected a motion clip (BVH)");
            FileError::new(path, problem)
        };
        let bytes = fs::metadata(path).map_err(unreadable)?.len();
        if bytes > MAX_FILE_BYTES {
            let problem = format!("found {bytes} bytes, expected at most {MAX_FILE_BYTES}");
            return Err(FileError::new(path, problem));
        }
        let bytes = fs::read(path).map_err(unreadable)?;
        Self::parse(&String::from_utf8_lossy(&bytes), path)
    }

    /// Parses the text of a BVH file; errors name `path`.
    ///
    /// # Errors
    /// As [`Clip::load`].
    pub fn parse(text: &str, path: &Path) -> Result<Self, FileError> {
        let bvh = Bvh::parse(text, path)?;
        let rig = BoneRig::recognise(&bvh, path)?;
        let lead = rig.family.lead_frames();
        if bvh.n_frames() <= lead {
            let problem = format!(
                "found {} frames, expected more than the {lead} that such clips start with",
                bvh.n_frames()
            );
            return Err(FileError::new(path, problem));
        }
        let (tracks, track_of) = tracks(&bvh, &rig, lead);
        let site = |site: BonePoint| BonePoint {
            bone: track_of[site.bone],
            ..site
        };
        let mut clip = Self {
            family: rig.family,
            frame_time_s: bvh.frame_time_s,
            n_frames: bvh.n_frames() - lead,
            stature_units: rig.stature_units,
            floor_units: f64::NEG_INFINITY,
            mean_lengths: [0.0; N_JOINTS],
            z_up: rig.z_up,
            tracks,
            sites: rig.sites.map(site),
            balls: rig.balls.map(|balls| balls.map(site)),
        };
        clip.measure();
        Ok(clip)
    }

    /// The kind of skeleton.
    pub fn family(&self) -> Family {
        self.family
    }

    /// Seconds from the first frame to the last.
    pub fn duration_s(&self) -> f64 {
        (self.n_frames - 1) as f64 * self.frame_time_s
    }

    /// Seconds from one frame to the next.
    pub fn frame_time_s(&self) -> f64 {
        self.frame_time_s
    }

    /// The stature of the clip's own skeleton in file units, as the sum of its segments; see
    /// [`super::rig`].
    pub fn stature_units(&self) -> f64 {
        self.stature_units
    }

    /// The height of the floor in file units, z up.
    pub fn floor_units(&self) -> f64 {
        self.floor_units
    }

    /// Mean distance of each joint from its parent over the clip, in statures; 0 for the pelvis.
    pub fn mean_lengths(&self) -> [f64; N_JOINTS] {
        self.mean_lengths
    }

    /// The posture at `time_s`, in statures, z up, with the floor at z = 0, in the clip's own
    /// horizontal axes and origin.
    pub fn posture(&self, time_s: f64) -> Posture {
        self.posture_relative_to(time_s, self)
    }

    /// The posture at `time_s` in statures of `first` and above the floor of `first`. Two people
    /// recorded in one coordinate frame stay in it and keep their difference in size.
    pub fn posture_relative_to(&self, time_s: f64, first: &Self) -> Posture {
        let mut posture = self.posture_units(time_s);
        let floor = Vector3::z() * first.floor_units;
        for joint in &mut posture.joints {
            *joint = (*joint - floor) / first.stature_units;
        }
        posture
    }

    /// The posture at `time_s` in file units, z up, from the file's own origin.
    pub fn posture_units(&self, time_s: f64) -> Posture {
        let placed = self.placed(time_s);
        let mut joints = self.joints(&placed);
        if let Some(balls) = self.balls(&placed) {
            let feet = [
                (Joint::LeftToe, Joint::LeftAnkle),
                (Joint::RightToe, Joint::RightAnkle),
            ];
            for ((toe, ankle), ball) in feet.into_iter().zip(balls) {
                let to_ankle = joints[ankle.index()] - ball;
                let toes = joints[toe.index()] - ball;
                let bent = bent_toes(toes, to_ankle, self.floor_units - ball.z);
                joints[toe.index()] = ball + bent;
            }
        }
        Posture { joints }
    }

    /// The poses of the bones of the tracks at `time_s`, in the file's own axes.
    fn placed(&self, time_s: f64) -> Vec<PlacedBone> {
        let last = (self.n_frames - 1) as f64;
        let at = time_s / self.frame_time_s;
        // In this form NaN also gives the start.
        let at = if at > 0.0 { at.min(last) } else { 0.0 };
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between the first frame and the last"
        )]
        let frame = at as usize;
        let next = (frame + 1).min(self.n_frames - 1);
        let share = at - frame as f64;
        let mut placed: Vec<PlacedBone> = Vec::with_capacity(self.tracks.len());
        for track in &self.tracks {
            let local = track.between(frame, next, share);
            placed.push(match track.parent {
                None => local,
                Some(parent) => placed[parent].then(&local),
            });
        }
        placed
    }

    fn joints(&self, placed: &[PlacedBone]) -> Joints {
        let mut joints = self.sites.map(|site| self.site(placed, site));
        let hips = joints[Joint::LeftHip.index()] + joints[Joint::RightHip.index()];
        joints[Joint::Pelvis.index()] = hips / 2.0;
        joints
    }

    fn balls(&self, placed: &[PlacedBone]) -> Option<[Vector3<f64>; 2]> {
        Some(self.balls?.map(|ball| self.site(placed, ball)))
    }

    fn site(&self, placed: &[PlacedBone], site: BonePoint) -> Vector3<f64> {
        self.z_up * placed[site.bone].at(site.offset)
    }

    /// Estimates the floor, then the mean lengths above it.
    fn measure(&mut self) {
        let times = |clip: &Self| {
            let frame_time_s = clip.frame_time_s;
            (0..clip.n_frames).map(move |frame| frame as f64 * frame_time_s)
        };
        let mut lowest: Vec<f64> = times(self).map(|time_s| self.lowest(time_s)).collect();
        lowest.sort_by(f64::total_cmp);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count"
        )]
        let rank = (FLOOR_QUANTILE * (self.n_frames - 1) as f64) as usize;
        self.floor_units = lowest[rank];
        let mut sums = [0.0; N_JOINTS];
        for time_s in times(self) {
            let posture = self.posture_units(time_s);
            for joint in Joint::ALL {
                if let Some(parent) = joint.parent() {
                    sums[joint.index()] += (posture.at(joint) - posture.at(parent)).norm();
                }
            }
        }
        self.mean_lengths = sums.map(|sum| sum / self.n_frames as f64 / self.stature_units);
    }

    /// The height of the lowest point that may stand on the floor, file units.
    fn lowest(&self, time_s: f64) -> f64 {
        let placed = self.placed(time_s);
        let mut joints = self.joints(&placed);
        if let Some([left, right]) = self.balls(&placed) {
            joints[Joint::LeftToe.index()] = left;
            joints[Joint::RightToe.index()] = right;
        }
        joints.iter().map(|p| p.z).fold(f64::INFINITY, f64::min)
    }
}

/// Bends the toes (vector from the ball of the foot to the tip) at the ball towards the back of the
/// foot, where `to_ankle` points. The angle is the smallest that lifts the tip to `floor` (a height
/// relative to the ball), or levels the toes if the ball itself is below the floor. It is at most
/// [`LARGEST_BEND_RAD`], and smaller if the foot lies on its side.
fn bent_toes(toes: Vector3<f64>, to_ankle: Vector3<f64>, floor: f64) -> Vector3<f64> {
    let length = toes.norm();
    let along = toes / length;
    let Some(back) = (to_ankle - along * to_ankle.dot(&along)).try_normalize(f64::EPSILON) else {
        return toes;
    };
    let wanted = (floor / length).min(0.0);
    if !length.is_normal() || along.z >= wanted {
        return toes;
    }
    // Height over the angle: along.z cos + back.z sin = top cos(angle - angle of the top).
    let top = along.z.hypot(back.z);
    let least = back.z.atan2(along.z) - (wanted / top).clamp(-1.0, 1.0).acos();
    let most = LARGEST_BEND_RAD * (back.z / STEEP_BACK).clamp(0.0, 1.0);
    let (sin, cos) = least.clamp(0.0, most).sin_cos();
    (along * cos + back * sin) * length
}

impl BoneMotion {
    fn between(&self, frame: usize, next: usize, share: f64) -> PlacedBone {
        let origin = |frame: usize| self.origins[frame.min(self.origins.len() - 1)];
        let (from, to) = (&self.rotations[frame], &self.rotations[next]);
        PlacedBone {
            origin: origin(frame).lerp(&origin(next), share),
            rotation: from
                .try_slerp(to, share, f64::EPSILON)
                .unwrap_or(if share < 0.5 { *from } else { *to }),
        }
    }
}

/// The bones that carry sites and their ancestors, from frame `lead` on, and the new index of each
/// bone.
fn tracks(bvh: &Bvh, rig: &BoneRig, lead: usize) -> (Vec<BoneMotion>, Vec<usize>) {
    let mut used = vec![false; bvh.bones.len()];
    for site in &rig.sites {
        let mut at = Some(site.bone);
        while let Some(bone) = at {
            used[bone] = true;
            at = bvh.bones[bone].parent;
        }
    }
    let mut track_of = vec![0; bvh.bones.len()];
    let mut tracks = Vec::new();
    for (i, bone) in bvh.bones.iter().enumerate().filter(|(i, _)| used[*i]) {
        track_of[i] = tracks.len();
        let frames = (lead..bvh.n_frames()).map(|frame| bvh.local(frame, i));
        let (mut origins, rotations): (Vec<_>, Vec<_>) =
            frames.map(|local| (local.origin, local.rotation)).unzip();
        if origins.iter().all(|origin| *origin == origins[0]) {
            origins.truncate(1);
        }
        tracks.push(BoneMotion {
            parent: bone.parent.map(|parent| track_of[parent]),
            rotations,
            origins,
        });
    }
    (tracks, track_of)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::motion::sample::USUAL;

    #[test]
    fn toes_bend_only_up_to_the_floor() {
        let toes = |pitch: f64| Vector3::new(pitch.cos(), 0.0, -pitch.sin());
        let ankle = |pitch: f64| Vector3::new(pitch.sin() - 1.5 * pitch.cos(), 0.0, pitch.cos());
        // In the air and on a flat foot no toes bend.
        assert_eq!(bent_toes(toes(0.5), ankle(0.5), -2.0), toes(0.5));
        assert_eq!(bent_toes(toes(0.0), ankle(0.0), 0.0), toes(0.0));
        for pitch in [0.1, 0.5, 1.0] {
            for floor in [0.0, -0.05] {
                let bent = bent_toes(toes(pitch), ankle(pitch), floor);
                assert!((bent.z - floor).abs() < 1e-9 && bent.x > 0.9);
                assert!((bent.norm() - 1.0).abs() < 1e-9);
            }
            // Below the floor toes become level, without passing through the foot.
            assert!(bent_toes(toes(pitch), ankle(pitch), 0.3).z.abs() < 1e-9);
        }
        let steep = bent_toes(toes(1.5), ankle(1.5), 0.0);
        assert!(steep.angle(&toes(1.5)) <= LARGEST_BEND_RAD + 1e-9);
        // A foot on its back keeps its toes.
        assert_eq!(bent_toes(toes(2.8), ankle(2.8), 0.0), toes(2.8));
    }

    #[test]
    fn frames_are_interpolated_and_the_ends_are_held() {
        let text = USUAL.file(0.0);
        let frame = text.lines().last().unwrap();
        // The root moves by two metres and turns by 60 degrees about the vertical.
        let next = frame.replacen("1 0.86 3 0 0 0", "1 0.86 5 0 60 0", 1);
        assert_ne!(frame, next);
        let text = text.replace("Frames: 1", "Frames: 2") + &next + "\n";
        let clip = Clip::parse(&text, Path::new("a.bvh")).unwrap();
        let stature = clip.stature_units();
        let last = clip.duration_s();
        let [start, half, end] = [0.0, last / 2.0, last].map(|time_s| clip.posture(time_s));
        let way = (half.at(Joint::Pelvis) - start.at(Joint::Pelvis)) * stature;
        assert!((way - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-9);
        let turn = half.facing_rad() - start.facing_rad();
        assert!((turn - std::f64::consts::FRAC_PI_6).abs() < 1e-9);
        for (time_s, same) in [
            (-1.0, &start),
            (f64::NAN, &start),
            (last + 1.0, &end),
            (f64::INFINITY, &end),
        ] {
            assert_eq!(clip.posture(time_s), *same);
        }
    }

    proptest! {
        #[test]
        fn damaged_files_cause_no_panic_and_no_nan(
            at in 0..1200_usize,
            length in 0..30_usize,
            new in "([-0-9.e]{0,12}|[{}\\n]{0,3}|[a-z_ ]{0,12})",
        ) {
            let text = USUAL.file(0.0);
            let start = at.min(text.len());
            let end = (start + length).min(text.len());
            let text = format!("{}{new}{}", &text[..start], &text[end..]);
            if let Ok(clip) = Clip::parse(&text, Path::new("a.bvh")) {
                let posture = clip.posture(0.0);
                prop_assert!(posture.joints.iter().all(|joint| joint.norm().is_finite()));
            }
        }
    }
}
