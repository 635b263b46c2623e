//! Where viewpoints would have to stand for lines of sight to meet.
//!
//! ```text
//!   r_i = P_i (x - o_i - t_v)     o_i: where a line of sight begins, P_i: across it, x: a keypoint, t_v: how its viewpoint moves
//!   t   = sum over k of a_k b_k   b_k: ways in which all move together, a_k: by how much
//! ```
//!
//! The a of least squares: linear, but for weights after Geman and `McClure`, whose width goes from coarse to fine. Nothing tells how
//! all move alike, nor whether all is larger, which no line of sight shows: no b has a part of these.

use farfield_proto::id::ViewpointIndex;
use farfield_proto::order_statistics::percentile;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Distances at which a line of sight weighs a quarter, metres, and rounds with each.
const WEIGHTS_M: [f64; 5] = [0.6, 0.3, 0.12, 0.06, 0.04];
const ROUNDS: usize = 3;
/// Rounds of weighting for each keypoint.
const POINT_ROUNDS: usize = 3;
/// Distance that costs one half, metres.
const COST_M: f64 = 0.03;
/// What is added to the diagonal of the normal equations, as a share of it: what nothing tells stays as it is.
const DAMPING: f64 = 1e-6;
/// Which share of all ankles, of whichever foot, is taken to be of feet that stand.
const STANDING: f64 = 0.25;
/// Least ankles by which it is told how high they are.
const MIN_ANKLES: usize = 12;
/// Ways that are shorter are made of others.
const LEAST_WAY: f64 = 1e-6;

/// A line of sight.
#[derive(Debug, Clone)]
pub(super) struct Sight {
    /// Of those that are compared.
    pub(super) viewpoint: usize,
    /// World, metres.
    origin_m: Vector3<f64>,
    across: Matrix3<f64>,
}

impl Sight {
    pub(super) fn new(viewpoint: usize, origin_m: Vector3<f64>, unit: &Vector3<f64>) -> Self {
        Self {
            viewpoint,
            origin_m,
            across: Matrix3::identity() - unit * unit.transpose(),
        }
    }
}

/// How all viewpoints move together: three numbers each.
pub(super) type Way = DVector<f64>;

/// How viewpoints moved.
pub(super) struct Fit {
    /// By how much along each way.
    pub(super) amounts: Vec<f64>,
    /// Each of them, world, metres.
    pub(super) moved_m: Vec<Vector3<f64>>,
    /// What lines of sight cost then, 0 to 1.
    pub(super) cost: f64,
}

/// Keypoints that three viewpoints show, and these.
pub(super) struct Places {
    points: Vec<Vec<Sight>>,
    /// Those of ankles alone.
    ankles: Vec<Vec<Sight>>,
    viewpoints: Vec<ViewpointIndex>,
    /// Where they stand, from the middle of all, metres.
    centers_m: Vec<Vector3<f64>>,
}

/// A keypoint as lines of sight meet.
struct Met {
    place_m: Vector3<f64>,
    /// What each counts, and how far it passes, metres.
    weights: Vec<f64>,
    gaps_m: Vec<f64>,
    inverse: Matrix3<f64>,
}

impl Places {
    /// Of these keypoints, of which `ankles` are kept beside.
    pub(super) fn new(
        (points, ankles): (Vec<Vec<Sight>>, Vec<Vec<Sight>>),
        viewpoints: Vec<ViewpointIndex>,
    ) -> Self {
        let center_m = |viewpoint: usize| {
            let own = points
                .iter()
                .flatten()
                .filter(|it| it.viewpoint == viewpoint);
            let (sum, n) = own.fold((Vector3::zeros(), 0), |(sum, n), it| {
                (sum + it.origin_m, n + 1)
            });
            sum / f64::from(n.max(1))
        };
        let centers_m: Vec<Vector3<f64>> = (0..viewpoints.len()).map(center_m).collect();
        let middle_m = centers_m.iter().sum::<Vector3<f64>>() / centers_m.len().max(1) as f64;
        Self {
            points,
            ankles,
            viewpoints,
            centers_m: centers_m.into_iter().map(|it| it - middle_m).collect(),
        }
    }

    /// Which of those that are compared a viewpoint is.
    pub(super) fn viewpoint_of(&self, viewpoint: ViewpointIndex) -> Option<usize> {
        self.viewpoints.iter().position(|it| *it == viewpoint)
    }

    /// How far keypoints are spread along the floor, metres: the diagonal of all but a tenth of them.
    pub(super) fn spread_m(&self) -> f64 {
        let moved = Way::zeros(3 * self.viewpoints.len());
        let met = self
            .points
            .iter()
            .filter_map(|point| met(point, &moved, WEIGHTS_M[0]));
        let places_m: Vec<Vector3<f64>> = met.map(|met| met.place_m).collect();
        let along = |axis: usize| {
            let mut at_m: Vec<f64> = places_m.iter().map(|m| m[axis]).collect();
            at_m.sort_by(f64::total_cmp);
            let ends_m = percentile(&at_m, 0.05).zip(percentile(&at_m, 0.95));
            ends_m.map_or(0.0, |(low_m, high_m)| high_m - low_m)
        };
        libm::hypot(along(0), along(1))
    }

    fn way(&self, of: impl Fn(usize) -> Vector3<f64>) -> Way {
        let numbers = (0..self.viewpoints.len()).flat_map(|it| {
            let moved: [f64; 3] = of(it).into();
            moved
        });
        Way::from_iterator(3 * self.viewpoints.len(), numbers)
    }

    /// Ways that nothing tells, of length 1 and square to each other.
    fn untold(&self) -> Vec<Way> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let mut untold: Vec<Way> = axes.map(|axis| self.way(|_| axis)).to_vec();
        untold.push(self.way(|viewpoint| self.centers_m[viewpoint]));
        square(Vec::new(), untold)
    }

    /// Each for itself.
    pub(super) fn free(&self) -> Vec<Way> {
        let n = 3 * self.viewpoints.len();
        let singles = (0..n).map(|at| Way::from_fn(n, |i, _| f64::from(u8::from(i == at))));
        let untold = self.untold();
        let n_untold = untold.len();
        square(untold, singles.collect()).split_off(n_untold)
    }

    /// Farther from the middle along x, and nearer along y, as shares.
    pub(super) fn along_axes(&self) -> Way {
        self.told(self.way(|viewpoint| {
            let center_m = self.centers_m[viewpoint];
            Vector3::new(center_m.x, -center_m.y, 0.0)
        }))
    }

    /// How high the ankles of feet that stand are, world z, metres, once all viewpoints are so much farther from the middle along x, y
    /// and z; `None` where too few tell.
    pub(super) fn ankles_m(&self, factors: [f64; 3]) -> Option<f64> {
        let moved = self.way(|viewpoint| {
            let farther = Vector3::from(factors).add_scalar(-1.0);
            self.centers_m[viewpoint].component_mul(&farther)
        });
        let weight_m = WEIGHTS_M[WEIGHTS_M.len() - 1];
        let ankles = self.ankles.iter();
        let met = ankles.filter_map(|point| met(point, &moved, weight_m));
        let mut heights_m: Vec<f64> = met.map(|met| met.place_m.z).collect();
        heights_m.sort_by(f64::total_cmp);
        let standing = percentile(&heights_m, STANDING);
        standing.filter(|_| heights_m.len() >= MIN_ANKLES)
    }

    /// Those of one group against the others, along each axis, metres.
    pub(super) fn apart(&self, group: &[bool]) -> Vec<Way> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let along = |axis: Vector3<f64>| {
            self.told(self.way(|viewpoint| {
                let side = if group[viewpoint] { 0.5 } else { -0.5 };
                side * axis
            }))
        };
        axes.map(along).to_vec()
    }

    /// What is told of a way.
    fn told(&self, mut way: Way) -> Way {
        for untold in self.untold() {
            let part = way.dot(&untold);
            way -= untold * part;
        }
        way
    }

    pub(super) fn cost_as_calibrated(&self) -> f64 {
        self.cost(&Way::zeros(3 * self.viewpoints.len()))
    }

    /// As all move along these ways for lines of sight to meet best.
    pub(super) fn fitted(&self, ways: &[Way]) -> Fit {
        let ways = DMatrix::from_columns(ways);
        let mut amounts = DVector::zeros(ways.ncols());
        for weight_m in WEIGHTS_M {
            for _ in 0..ROUNDS {
                let (matrix, vector) = self.normal(&(&ways * &amounts), weight_m);
                let mut matrix = ways.transpose() * matrix * &ways;
                let vector = ways.transpose() * vector;
                let damping = DAMPING * matrix.trace() / matrix.nrows().max(1) as f64;
                for i in 0..matrix.nrows() {
                    matrix[(i, i)] += damping.max(f64::MIN_POSITIVE);
                }
                if let Some(solved) = matrix.cholesky() {
                    amounts -= solved.solve(&vector);
                }
            }
        }
        let moved = &ways * &amounts;
        let moved_m = moved.as_slice().chunks_exact(3);
        Fit {
            cost: self.cost(&moved),
            moved_m: moved_m.map(Vector3::from_column_slice).collect(),
            amounts: amounts.as_slice().to_vec(),
        }
    }

    /// The normal equations for how viewpoints move from where they are `moved`, with keypoints where that is best for each.
    fn normal(&self, moved: &Way, weight_m: f64) -> (DMatrix<f64>, DVector<f64>) {
        let n = moved.len();
        let (mut matrix, mut vector) = (DMatrix::zeros(n, n), DVector::zeros(n));
        for point in &self.points {
            let Some(met) = met(point, moved, weight_m) else {
                continue;
            };
            let weighted = |i: usize| met.weights[i] * point[i].across;
            for (i, sight) in point.iter().enumerate() {
                let across = weighted(i);
                let off_m = origin_m(sight, moved) - met.place_m;
                let row = 3 * sight.viewpoint;
                let mut own = vector.fixed_rows_mut::<3>(row);
                own += across * off_m;
                let mut own = matrix.fixed_view_mut::<3, 3>(row, row);
                own += across;
                for (j, other) in point.iter().enumerate() {
                    let mut both = matrix.fixed_view_mut::<3, 3>(row, 3 * other.viewpoint);
                    both -= across * met.inverse * weighted(j);
                }
            }
        }
        (matrix, vector)
    }

    fn cost(&self, moved: &Way) -> f64 {
        let weight_m = WEIGHTS_M[WEIGHTS_M.len() - 1];
        let (mut sum, mut n) = (0.0, 0_u32);
        for point in &self.points {
            let met = met(point, moved, weight_m);
            for i in 0..point.len() {
                let squared = met
                    .as_ref()
                    .map_or(f64::MAX.sqrt(), |met| met.gaps_m[i].powi(2));
                sum += squared / (squared + COST_M * COST_M);
                n += 1;
            }
        }
        sum / f64::from(n.max(1))
    }
}

/// Those ways that follow, each without what is of those before it, all of length 1.
fn square(mut known: Vec<Way>, new: Vec<Way>) -> Vec<Way> {
    for mut way in new {
        for other in &known {
            let part = way.dot(other);
            way -= other * part;
        }
        let length = way.norm();
        if length > LEAST_WAY {
            known.push(way / length);
        }
    }
    known
}

fn origin_m(sight: &Sight, moved: &Way) -> Vector3<f64> {
    sight.origin_m + moved.fixed_rows::<3>(3 * sight.viewpoint)
}

/// Where lines of sight meet; `None` where they are parallel.
fn met(point: &[Sight], moved: &Way, weight_m: f64) -> Option<Met> {
    let mut met = Met {
        place_m: Vector3::zeros(),
        weights: vec![1.0; point.len()],
        gaps_m: vec![0.0; point.len()],
        inverse: Matrix3::zeros(),
    };
    for _ in 0..POINT_ROUNDS {
        let (mut matrix, mut vector) = (Matrix3::zeros(), Vector3::zeros());
        for ((sight, weight), gap_m) in point.iter().zip(&mut met.weights).zip(&met.gaps_m) {
            let off = gap_m / weight_m;
            *weight = 1.0 / ((1.0 + off * off) * (1.0 + off * off));
            let across = *weight * sight.across;
            matrix += across;
            vector += across * origin_m(sight, moved);
        }
        met.inverse = matrix.try_inverse()?;
        met.place_m = met.inverse * vector;
        for (sight, gap_m) in point.iter().zip(&mut met.gaps_m) {
            *gap_m = (sight.across * (met.place_m - origin_m(sight, moved))).norm();
        }
    }
    Some(met)
}
