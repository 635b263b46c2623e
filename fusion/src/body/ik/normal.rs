//! Normal equations of a tree, and their factor.
//!
//! Entry (i, j) of H = `Σ w JᵀJ` is zero unless both DoF are on one chain. So a row keeps only the
//! entries with the DoF further in, one after the other: a row of an ancestor has the length of the
//! front of its own.
//!
//! The factor has no fill-in. Eliminating the leaves first, H = `LᵀDL` with L lower triangular and
//! ones on its diagonal keeps exactly the zeros of H (R. Featherstone, "Efficient factorization of
//! the joint-space inertia matrix for branched kinematic trees", IJRR 2005). A factor costs about
//! 2,000 multiplications instead of the 10,700 of a dense one.

use nalgebra::{Matrix3, Vector3};

use super::composite::{Composite, Motions, Twist};
use crate::body::skeleton::dof::{ANCESTORS, DESCENDANTS, LINKS, MAX_CHAIN};
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

/// Least pivot: an undetermined DoF does not move.
const MIN_PIVOT: f64 = 1e-9;

/// Entries of a row that are processed at once.
const LANES: usize = 4;

/// L and D of H + diag = `LᵀDL`.
#[derive(Debug, Clone)]
pub(super) struct Factor {
    /// The row of a DoF ends with its diagonal entry before elimination.
    l: Box<[Row; N_DOF]>,
    /// DL.
    reduced: Box<[Row; N_DOF]>,
    /// 1/D.
    inverse_pivot: [f64; N_DOF],
}

impl Factor {
    pub(super) fn new() -> Self {
        Self {
            l: Box::new([[0.0; MAX_CHAIN]; N_DOF]),
            reduced: Box::new([[0.0; MAX_CHAIN]; N_DOF]),
            inverse_pivot: [1.0; N_DOF],
        }
    }

    /// Factors `normal` with `diagonal` added, without the DoF that are `held`; returns whether
    /// that is positive definite. Otherwise it is made so.
    pub(super) fn compute(
        &mut self,
        normal: &NormalEquations,
        diagonal: &[f64; N_DOF],
        held: &[bool; N_DOF],
    ) -> bool {
        let any_held = held.contains(&true);
        let mut is_positive = true;
        for (k, ancestors) in ANCESTORS.iter().enumerate().rev() {
            let n = ancestors.dofs().len();
            let mut row = *normal.row(k);
            row[n] += diagonal[k];
            if any_held {
                leave_out_held(&mut row, k, held);
            }
            match n / LANES {
                0 => self.eliminate::<1>(k, &mut row),
                1 => self.eliminate::<2>(k, &mut row),
                2 => self.eliminate::<3>(k, &mut row),
                _ => self.eliminate::<4>(k, &mut row),
            }
            let pivot = row[n];
            is_positive &= pivot > MIN_PIVOT;
            let inverse_pivot = 1.0 / pivot.max(MIN_PIVOT);
            self.inverse_pivot[k] = inverse_pivot;
            self.reduced[k] = row;
            self.l[k] = row.map(|entry| entry * inverse_pivot);
        }
        is_positive
    }

    /// Subtracts the contributions of the outer DoF from the row of DoF `k`, whose entries all lie
    /// within the first `N` of its lanes. `N` is a compile-time constant, so the row stays in
    /// registers.
    #[inline]
    fn eliminate<const N: usize>(&self, k: usize, row: &mut Row) {
        let n = ANCESTORS[k].dofs().len();
        let Some(own) = row.as_chunks_mut::<LANES>().0.first_chunk_mut::<N>() else {
            return;
        };
        let mut left = *own;
        for run in DESCENDANTS[k].iter().rev() {
            let below = self.l[run.clone()].iter().zip(&self.reduced[run.clone()]);
            for (l, reduced) in below.rev() {
                let (factor, entries) = (l[n], reduced.as_chunks::<LANES>().0);
                for (left, entries) in left.iter_mut().zip(entries) {
                    for (left, entry) in left.iter_mut().zip(entries) {
                        *left -= factor * entry;
                    }
                }
            }
        }
        *own = left;
    }

    /// Replaces `b` by the solution of (`LᵀDL`) x = b.
    pub(super) fn solve(&self, b: &mut [f64; N_DOF]) {
        for (k, ancestors) in ANCESTORS.iter().enumerate().rev() {
            let (own, [front, limb]) = (b[k], ancestors.runs());
            let (l_front, l_limb) = self.l[k].split_at(front.len());
            for (b, entry) in b[front].iter_mut().zip(l_front) {
                *b -= entry * own;
            }
            for (b, entry) in b[limb].iter_mut().zip(l_limb) {
                *b -= entry * own;
            }
        }
        for (k, ancestors) in ANCESTORS.iter().enumerate() {
            let (mut x, [front, limb]) = (b[k] * self.inverse_pivot[k], ancestors.runs());
            let (l_front, l_limb) = self.l[k].split_at(front.len());
            for (b, entry) in b[front].iter().zip(l_front) {
                x -= entry * b;
            }
            for (b, entry) in b[limb].iter().zip(l_limb) {
                x -= entry * b;
            }
            b[k] = x;
        }
    }

    /// The entries of the inverse between DoF on one chain: the covariance. Entries of a row beyond
    /// its diagonal are unused.
    ///
    /// ```text
    ///   Σₖⱼ = -Σₘ Lₖₘ Σₘⱼ,   Σₖₖ = 1/Dₖ - Σₘ Lₖₘ Σₘₖ        j, m: the DoF that k hangs from
    /// ```
    ///
    /// (K. Takahashi, J. Fagan, M. Chen, "Formation of a sparse bus impedance matrix and its application to short
    /// circuit study", PICA 1973.) No other entry of the inverse is needed for these.
    pub(super) fn invert(&self, into: &mut [Row; N_DOF]) {
        let mut known = ChainCovariance::new();
        for (k, ancestors) in ANCESTORS.iter().enumerate() {
            let (l, n) = (&self.l[k], ancestors.dofs().len());
            known.follow(ancestors.dofs(), into);
            let row = &mut into[k];
            match n / LANES {
                0 => known.negative_product::<1>((l, n), row),
                1 => known.negative_product::<2>((l, n), row),
                2 => known.negative_product::<3>((l, n), row),
                _ => known.negative_product::<4>((l, n), row),
            }
            let shared: f64 = l[..n].iter().zip(&*row).map(|(l, entry)| l * entry).sum();
            row[n] = self.inverse_pivot[k] - shared;
        }
    }
}

/// The covariance of the DoF further in than one DoF, as a whole matrix, so that products with it
/// use many entries at once.
struct ChainCovariance {
    /// Its DoF, in the order of the chain.
    dofs: &'static [usize],
    variance: Row,
    /// Zero on the diagonal.
    across: [Row; MAX_CHAIN],
}

impl ChainCovariance {
    fn new() -> Self {
        Self {
            dofs: &[],
            variance: [0.0; MAX_CHAIN],
            across: [[0.0; MAX_CHAIN]; MAX_CHAIN],
        }
    }

    /// Becomes that of the DoF of `chain`, from their rows in `covariance`.
    fn follow(&mut self, chain: &'static [usize], covariance: &[Row; N_DOF]) {
        let same = self.dofs.iter().zip(chain).take_while(|(a, b)| a == b);
        for at in same.count()..chain.len() {
            let row = &covariance[chain[at]];
            let (before, own_and_after) = self.across.split_at_mut(at);
            for (before, entry) in before.iter_mut().zip(row) {
                before[at] = *entry;
            }
            own_and_after[0] = *row;
            own_and_after[0][at] = 0.0;
            self.variance[at] = row[at];
        }
        self.dofs = chain;
    }

    /// Minus the first `n` entries of `l` times this, in the first `N` lanes of `row`; each entry
    /// begins with the contribution of the diagonal.
    #[inline]
    fn negative_product<const N: usize>(&self, (l, n): (&Row, usize), row: &mut Row) {
        let lanes = |row: &Row| {
            let lanes = row.as_chunks::<LANES>().0.first_chunk::<N>();
            lanes.copied().unwrap_or([[0.0; LANES]; N])
        };
        let (variance, l_lanes) = (lanes(&self.variance), lanes(l));
        let mut sums = [[0.0; LANES]; N];
        for (sum, (variance, l)) in sums.iter_mut().zip(variance.iter().zip(&l_lanes)) {
            for (sum, (variance, l)) in sum.iter_mut().zip(variance.iter().zip(l)) {
                *sum -= l * variance;
            }
        }
        for (factor, across) in l[..n].iter().zip(&self.across) {
            for (sum, across) in sums.iter_mut().zip(across.as_chunks::<LANES>().0) {
                for (sum, across) in sum.iter_mut().zip(across) {
                    *sum -= factor * across;
                }
            }
        }
        row[..N * LANES].copy_from_slice(sums.as_flattened());
    }
}

/// Removes the `held` DoF from the row of DoF `i`.
fn leave_out_held(row: &mut Row, i: usize, held: &[bool; N_DOF]) {
    let ancestors = ANCESTORS[i].dofs();
    if held[i] {
        *row = [0.0; MAX_CHAIN];
        row[ancestors.len()] = 1.0;
    }
    for (entry, &j) in row.iter_mut().zip(ancestors) {
        if held[j] {
            *entry = 0.0;
        }
    }
}
