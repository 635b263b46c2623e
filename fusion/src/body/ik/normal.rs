//! Normal equations of a tree.
//!
//! Entry (i, j) of H = `Σ w JᵀJ` is zero unless both DoF are on one chain. So a row keeps only the
//! entries with the DoF further in, one after the other: a row of an ancestor has the length of the
//! front of its own.

use nalgebra::{Matrix3, Vector3};

use super::composite::{Composite, Motions, Twist};
use crate::body::skeleton::dof::{ANCESTORS, LINKS, MAX_CHAIN};
use crate::body::skeleton::{Joint, Kinematics, Link, N_DOF, N_LINKS};

/// The entries of a row of a symmetric matrix with the DoF further in than its own, ascending, and
/// with itself.
pub(super) type Row = [f64; MAX_CHAIN];

/// H and gradient of the targets' part of the cost.
#[derive(Debug, Clone)]
pub(super) struct NormalEquations {
    /// The pelvis, in the world, metres: origin of the motions.
    origin_m: Vector3<f64>,
    /// Of each link alone; after [`Self::gather`] with all links further out.
    links: Box<[Composite; N_LINKS]>,
    /// Of each DoF, and the place of its axis, from the origin.
    twists: [Twist; N_DOF],
    /// The same, number by number.
    motions: Motions,
    centres_m: [Vector3<f64>; N_DOF],
    /// Whether H includes the curvature of the targets' part, or only its first order.
    is_curved: bool,
    h: Box<[Row; N_DOF]>,
    g: [f64; N_DOF],
}

impl NormalEquations {
    pub(super) fn new() -> Self {
        Self {
            origin_m: Vector3::zeros(),
            links: Box::new([Composite::default(); N_LINKS]),
            twists: [Twist::default(); N_DOF],
            motions: Motions::default(),
            centres_m: [Vector3::zeros(); N_DOF],
            is_curved: false,
            h: Box::new([[0.0; MAX_CHAIN]; N_DOF]),
            g: [0.0; N_DOF],
        }
    }

    /// Begins the equations of `body` in its pose, without any target.
    pub(super) fn begin(&mut self, body: &Kinematics) {
        self.origin_m = body.joint_m(Joint::Pelvis);
        *self.links = [Composite::default(); N_LINKS];
    }

    /// Adds ½ rᵀ I r for a point fixed to `link`; I = `information`, the inverse covariance of its place, 1/m², and
    /// `pull` = I r with r = point - target.
    pub(super) fn add(
        &mut self,
        link: Link,
        point_m: &Vector3<f64>,
        information: &Matrix3<f64>,
        pull: &Vector3<f64>,
    ) {
        let x_m = point_m - self.origin_m;
        self.links[link as usize].add(&x_m, information, pull);
    }

    /// Builds the equations of everything added since [`Self::begin`], for the same `body`. With
    /// `is_curved`, H is the second derivative of the cost (as if the DoF of a shoulder turned one
    /// after the other), which may have negative eigenvalues; else the first order of Gauss and
    /// Newton.
    pub(super) fn gather(&mut self, body: &Kinematics, is_curved: bool) {
        for l in (1..N_LINKS).rev() {
            let (above, rest) = self.links.split_at_mut(l);
            above[LINKS[l].parent as usize] += &rest[0];
        }
        for (centre_m, in_world_m) in self.centres_m.iter_mut().zip(&body.centres_m) {
            *centre_m = in_world_m - self.origin_m;
        }
        for ((twist, axis), centre_m) in
            (self.twists.iter_mut().zip(&body.axes)).zip(&self.centres_m)
        {
            *twist = Twist::about(axis, centre_m);
        }
        for (twist, axis) in self.twists.iter_mut().zip(&body.axes[..3]) {
            *twist = Twist::along(axis);
        }
        self.motions.set(&self.twists);
        self.fill(is_curved);
    }

    /// Removes the curvature.
    pub(super) fn straighten(&mut self) {
        if self.is_curved {
            self.fill(false);
        }
    }

    /// Fills H and gradient from the links' sums.
    fn fill(&mut self, is_curved: bool) {
        self.is_curved = is_curved;
        for (link, composite) in LINKS.iter().zip(&*self.links) {
            let push = composite.push();
            for i in link.dofs() {
                let twist = &self.twists[i];
                let mut resistance = composite.resistance(twist);
                if is_curved {
                    resistance.turn_by(&composite.turned_moment(twist, &self.centres_m[i]));
                }
                let [front, limb] = ANCESTORS[i].runs();
                let (of_front, rest) = self.h[i].split_at_mut(front.len());
                let (of_limb, own) = rest.split_at_mut(limb.len());
                self.motions.dot(front, &resistance, of_front);
                self.motions.dot(limb, &resistance, of_limb);
                own[0] = twist.dot(&resistance);
                self.g[i] = twist.dot(&push);
            }
        }
    }

    /// Whether H includes the curvature.
    pub(super) fn is_curved(&self) -> bool {
        self.is_curved
    }

    /// Motion of the outer links by each DoF, about [`Self::origin_m`].
    pub(super) fn twists(&self) -> &[Twist; N_DOF] {
        &self.twists
    }

    /// The pelvis' place at [`Self::begin`], world, metres: the origin of the twists.
    pub(super) fn origin_m(&self) -> &Vector3<f64> {
        &self.origin_m
    }

    /// Gradient of the targets' part.
    pub(super) fn gradient(&self) -> &[f64; N_DOF] {
        &self.g
    }

    /// Row of DoF `i`.
    pub(super) fn row(&self, i: usize) -> &Row {
        &self.h[i]
    }

    /// Diagonal entry of the targets' part.
    pub(super) fn diagonal(&self, i: usize) -> f64 {
        self.h[i][ANCESTORS[i].dofs().len()]
    }

    /// Subtracts the effect of the prescribed steps of the `held` DoF from `rhs` of the free ones.
    pub(super) fn move_prescribed(
        &self,
        held: &[bool; N_DOF],
        step: &[f64; N_DOF],
        rhs: &mut [f64; N_DOF],
    ) {
        for (i, ancestors) in ANCESTORS.iter().enumerate() {
            for (entry, &j) in self.h[i].iter().zip(ancestors.dofs()) {
                match (held[i], held[j]) {
                    (true, false) => rhs[j] -= entry * step[i],
                    (false, true) => rhs[i] -= entry * step[j],
                    _ => {}
                }
            }
        }
    }
}
