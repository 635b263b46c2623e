//! The degrees of freedom: which link each one turns, about which axis, and which links follow.
//!
//! The 40 DoF are the root's 6 (translation along the world's x, y, z; then rotation about the
//! pelvis' own x, y, z), the trunk's 3, the neck's 3, and 14 for the right and 14 for the left
//! side. [`Pose::dof`](super::Pose) has the 34 after the root; DoF `i` of the pose is DoF
//! `N_ROOT_DOF + i` of the whole. A DoF comes after all DoF further in, so that the normal
//! equations can be eliminated from the leaves without fill-in.
//!
//! Joints with three axes turn as in OpenSim's Rajagopal model: flexion about the mediolateral axis,
//! then bending or adduction about the anteroposterior, then rotation about the longitudinal one
//! (its z, x, y, which are our -y, x, z), each axis carried along by the ones before. The shoulder
//! alone is different, see `shoulder.rs`.

use std::ops::Range;

use super::joint::{Joint, Link, N_LINKS, Side};

/// All degrees of freedom.
pub const N_DOF: usize = 40;
/// Those of the root.
pub const N_ROOT_DOF: usize = 6;
/// Those of the joints: the length of [`Pose::dof`](super::Pose).
pub const N_JOINT_DOF: usize = N_DOF - N_ROOT_DOF;
/// Most DoF that move one point: root, trunk, scapula, shoulder and elbow.
pub const MAX_CHAIN: usize = 16;

/// Index in [`Pose::dof`](super::Pose) of the trunk's extension, bending and rotation.
pub const LUMBAR: usize = 0;
/// Index of the neck's flexion, bending and rotation.
pub const NECK: usize = 3;

/// A joint of one side of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DofGroup {
    /// Elevation, protraction, tilt.
    Scapula,
    /// Raising swing, inward swing, twist.
    Shoulder,
    /// Flexion.
    Elbow,
    /// Flexion, adduction, rotation.
    Hip,
    /// Flexion.
    Knee,
    /// Dorsiflexion, inversion, toe-in.
    Ankle,
}

/// Index in [`Pose::dof`](super::Pose) of the first DoF of a joint.
pub const fn first_of(side: Side, part: DofGroup) -> usize {
    let base = match side {
        Side::Right => 6,
        Side::Left => 20,
    };
    base + match part {
        DofGroup::Scapula => 0,
        DofGroup::Shoulder => 3,
        DofGroup::Elbow => 6,
        DofGroup::Hip => 7,
        DofGroup::Knee => 10,
        DofGroup::Ankle => 11,
    }
}

/// An axis of a link frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

/// An elementary rotation: about an axis of the link frame, by `sign` times the coordinate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Turn {
    pub(crate) axis: Axis,
    pub(crate) sign: f64,
}

const fn turn(axis: Axis, sign: f64) -> Turn {
    Turn { axis, sign }
}

/// How a link moves relative to its parent.
#[derive(Debug, Clone, Copy)]
pub(crate) enum DofMotion {
    /// Freely: the pelvis in the world.
    Free,
    /// By elementary rotations, one after the other.
    Turns(&'static [Turn]),
    /// By swing and twist.
    Shoulder(Side),
}

/// One link of the tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LinkSpec {
    pub(crate) parent: Link,
    /// The joint that is the link's origin and the centre of its rotations.
    pub(crate) origin: Joint,
    /// The first DoF, of all 40.
    pub(crate) first_dof: usize,
    pub(crate) motion: DofMotion,
}

impl LinkSpec {
    /// The DoF by which the link moves relative to its parent, of all 40.
    pub(crate) const fn dofs(&self) -> Range<usize> {
        self.first_dof..self.first_dof + self.motion.n_dof()
    }
}

impl DofMotion {
    const fn n_dof(&self) -> usize {
        match self {
            Self::Free => N_ROOT_DOF,
            Self::Turns(turns) => turns.len(),
            Self::Shoulder(_) => 3,
        }
    }
}

const TRUNK: [Turn; 3] = [turn(Axis::Y, -1.0), turn(Axis::X, 1.0), turn(Axis::Z, 1.0)];
// The neck is not in the Rajagopal model: flexion is positive, as its name suggests.
const NECK_TURNS: [Turn; 3] = [turn(Axis::Y, 1.0), turn(Axis::X, 1.0), turn(Axis::Z, 1.0)];
const ELBOW: [Turn; 1] = [turn(Axis::Y, -1.0)];
const KNEE: [Turn; 1] = [turn(Axis::Y, 1.0)];
/// Hip and ankle: flexion (dorsiflexion), adduction (inversion), internal rotation (toe-in).
const LEG_RIGHT: [Turn; 3] = [turn(Axis::Y, -1.0), turn(Axis::X, 1.0), turn(Axis::Z, 1.0)];
const LEG_LEFT: [Turn; 3] = [
    turn(Axis::Y, -1.0),
    turn(Axis::X, -1.0),
    turn(Axis::Z, -1.0),
];
/// Elevation (up), protraction (forward), tilt (the top forward).
const SCAPULA_RIGHT: [Turn; 3] = [turn(Axis::X, -1.0), turn(Axis::Z, 1.0), turn(Axis::Y, 1.0)];
const SCAPULA_LEFT: [Turn; 3] = [turn(Axis::X, 1.0), turn(Axis::Z, -1.0), turn(Axis::Y, 1.0)];

/// The elementary rotations of a scapula.
pub(crate) const fn scapula_turns(side: Side) -> &'static [Turn; 3] {
    match side {
        Side::Right => &SCAPULA_RIGHT,
        Side::Left => &SCAPULA_LEFT,
    }
}

const fn spec(parent: Link, origin: Joint, first: usize, motion: DofMotion) -> LinkSpec {
    LinkSpec {
        parent,
        origin,
        first_dof: N_ROOT_DOF + first,
        motion,
    }
}

/// The tree, in the order of [`Link::ALL`]. (The pelvis is its own parent.)
pub(crate) const LINKS: [LinkSpec; N_LINKS] = {
    use Side::{Left, Right};
    let (leg_r, leg_l) = (DofMotion::Turns(&LEG_RIGHT), DofMotion::Turns(&LEG_LEFT));
    let (elbow, knee) = (DofMotion::Turns(&ELBOW), DofMotion::Turns(&KNEE));
    let (arm_r, arm_l) = (DofMotion::Shoulder(Right), DofMotion::Shoulder(Left));
    let (scapula_r, scapula_l) = (
        DofMotion::Turns(&SCAPULA_RIGHT),
        DofMotion::Turns(&SCAPULA_LEFT),
    );
    [
        LinkSpec {
            parent: Link::Pelvis,
            origin: Joint::Pelvis,
            first_dof: 0,
            motion: DofMotion::Free,
        },
        spec(Link::Pelvis, Joint::Spine, LUMBAR, DofMotion::Turns(&TRUNK)),
        spec(
            Link::Trunk,
            Joint::Neck,
            NECK,
            DofMotion::Turns(&NECK_TURNS),
        ),
        spec(
            Link::Trunk,
            Joint::RightScapula,
            first_of(Right, DofGroup::Scapula),
            scapula_r,
        ),
        spec(
            Link::RightScapula,
            Joint::RightShoulder,
            first_of(Right, DofGroup::Shoulder),
            arm_r,
        ),
        spec(
            Link::RightUpperArm,
            Joint::RightElbow,
            first_of(Right, DofGroup::Elbow),
            elbow,
        ),
        spec(
            Link::Pelvis,
            Joint::RightHip,
            first_of(Right, DofGroup::Hip),
            leg_r,
        ),
        spec(
            Link::RightThigh,
            Joint::RightKnee,
            first_of(Right, DofGroup::Knee),
            knee,
        ),
        spec(
            Link::RightShank,
            Joint::RightAnkle,
            first_of(Right, DofGroup::Ankle),
            leg_r,
        ),
        spec(
            Link::Trunk,
            Joint::LeftScapula,
            first_of(Left, DofGroup::Scapula),
            scapula_l,
        ),
        spec(
            Link::LeftScapula,
            Joint::LeftShoulder,
            first_of(Left, DofGroup::Shoulder),
            arm_l,
        ),
        spec(
            Link::LeftUpperArm,
            Joint::LeftElbow,
            first_of(Left, DofGroup::Elbow),
            elbow,
        ),
        spec(
            Link::Pelvis,
            Joint::LeftHip,
            first_of(Left, DofGroup::Hip),
            leg_l,
        ),
        spec(
            Link::LeftThigh,
            Joint::LeftKnee,
            first_of(Left, DofGroup::Knee),
            knee,
        ),
        spec(
            Link::LeftShank,
            Joint::LeftAnkle,
            first_of(Left, DofGroup::Ankle),
            leg_l,
        ),
    ]
};

/// The DoF that move one link, ascending.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain {
    dofs: [usize; MAX_CHAIN],
    len: usize,
    /// How many of them, from the start, are consecutive from 0.
    front: usize,
}

impl Chain {
    pub(crate) fn dofs(&self) -> &[usize] {
        &self.dofs[..self.len]
    }

    /// The same DoF as two runs without a gap: from DoF 0 on, and those of a limb.
    pub(crate) fn runs(&self) -> [Range<usize>; 2] {
        let own = if self.front < self.len {
            self.dofs[self.front]
        } else {
            self.front
        };
        [0..self.front, own..own + self.len - self.front]
    }
}

/// The chain of every link.
pub(crate) const CHAINS: [Chain; N_LINKS] = {
    let mut chains = [Chain {
        dofs: [0; MAX_CHAIN],
        len: 0,
        front: 0,
    }; N_LINKS];
    let mut l = 0;
    while l < N_LINKS {
        let mut chain = chains[LINKS[l].parent as usize];
        let mut k = 0;
        while k < LINKS[l].motion.n_dof() {
            let dof = LINKS[l].first_dof + k;
            if dof == chain.len {
                chain.front += 1;
            }
            chain.dofs[chain.len] = dof;
            chain.len += 1;
            k += 1;
        }
        chains[l] = chain;
        l += 1;
    }
    chains
};

/// The DoF of the chain of `link`, of all 40, ascending: the only ones with a nonzero Jacobian
/// column for its points.
pub fn chain_of(link: Link) -> &'static [usize] {
    static STORED: [Chain; N_LINKS] = CHAINS;
    STORED[link as usize].dofs()
}

/// The DoF further in than each DoF, ascending, without itself.
pub(crate) static ANCESTORS: [Chain; N_DOF] = {
    let mut ancestors = [Chain {
        dofs: [0; MAX_CHAIN],
        len: 0,
        front: 0,
    }; N_DOF];
    let mut l = 0;
    while l < N_LINKS {
        let mut k = 0;
        while k < CHAINS[l].len {
            let dof = CHAINS[l].dofs[k];
            let front = CHAINS[l].front;
            ancestors[dof] = Chain {
                dofs: CHAINS[l].dofs,
                len: k,
                front: if k < front { k } else { front },
            };
            k += 1;
        }
        l += 1;
    }
    ancestors
};

/// The DoF further out than each DoF, without itself, as two runs without a gap.
pub(crate) static DESCENDANTS: [[Range<usize>; 2]; N_DOF] = {
    let mut descendants = [const { [0..0, 0..0] }; N_DOF];
    let mut dof = 0;
    while dof < N_DOF {
        let first = descendants_from(dof, dof + 1);
        let second = descendants_from(dof, first.end);
        descendants[dof] = [first, second];
        dof += 1;
    }
    descendants
};

/// The first run of DoF further out than `dof`, from `from` on.
const fn descendants_from(dof: usize, from: usize) -> Range<usize> {
    let mut start = from;
    while start < N_DOF && !hangs_from(start, dof) {
        start += 1;
    }
    let mut end = start;
    while end < N_DOF && hangs_from(end, dof) {
        end += 1;
    }
    start..end
}

const fn hangs_from(dof: usize, from: usize) -> bool {
    let chain = &ANCESTORS[dof];
    let mut at = 0;
    while at < chain.len {
        if chain.dofs[at] == from {
            return true;
        }
        at += 1;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn descendants_are_the_inverse_of_ancestors() {
        for (dof, runs) in DESCENDANTS.iter().enumerate() {
            let below = (0..N_DOF).filter(|&i| ANCESTORS[i].dofs().contains(&dof));
            assert!(below.eq(runs.iter().cloned().flatten()), "{dof}");
        }
    }

    #[test]
    fn every_dof_has_one_link_and_follows_its_ancestors() {
        let mut owners = [0; N_DOF];
        for link in LINKS {
            for dof in link.dofs() {
                owners[dof] += 1;
            }
        }
        assert_eq!(owners, [1; N_DOF]);
        for (dof, chain) in ANCESTORS.iter().enumerate() {
            assert!(chain.dofs().iter().all(|&a| a < dof), "{dof}");
            let in_runs = chain.runs().into_iter().flatten();
            assert!(in_runs.eq(chain.dofs().iter().copied()), "{dof}");
        }
        assert_eq!(chain_of(Link::RightForearm).len(), MAX_CHAIN);
    }

    #[test]
    fn a_link_turns_about_a_joint_of_its_parent() {
        for link in LINKS {
            assert_eq!(link.origin.link(), link.parent);
        }
    }
}
