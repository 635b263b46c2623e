//! Patches that came after their tick was solved, and before the tick leaves the delay.
//!
//! The late view is searched alone, around the found or predicted keypoints of its tick. Its
//! keypoints are joined with the existing ones by their information:
//!
//! ```text
//!   (I + Iₗ) x = I p + Iₗ pₗ            I: inverse covariance (a view knows nothing along its ray)
//! ```
//!
//! Then the first inverse kinematics of that tick is solved again. Occlusion and peak assignment
//! are not repeated: the search is local, and it is one view among several.

use farfield_proto::message::{PersonPatch, PersonState};
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::IkParameters;
use nalgebra::{Matrix3, Vector3};

use crate::body::ik::{IkSolver, JointSpread, Priors, Target};
use crate::body::observed::KeypointEstimate;
use crate::body::skeleton::{Joint, Kinematics, Pose, Site, Skeleton};
use crate::estimate::estimator::TickSnapshot;
use crate::estimate::evidence::{PatchReader, View};
use crate::estimate::keypoint_targets::aim_at_keypoints;
use crate::estimate::lattice::LatticeSearch;
use crate::estimate::uncertainty::{BodyObservation, MadeOf, weigh_views};
use crate::method::{Method, VenueView};

/// Sine of the angle between two rays from which they determine a place, and not only a line (10
/// degrees).
const CROSSING: f64 = 0.174;
/// Distance of a late keypoint from the place that several views agreed on, beyond which it belongs
/// to another person, metres.
const SAME_M: f64 = 0.15;
/// Inverse variance that keeps a place along a ray common to all views, 1/m².
const KEEP_INFORMATION: f64 = 1.0;

/// A late patch with its camera and tick.
pub(super) struct Late<'a> {
    pub(super) patch: &'a PersonPatch,
    pub(super) camera: &'a VenueView,
    pub(super) tick: Tick,
}

/// The body of a late patch.
pub(super) struct LateBody<'a> {
    pub(super) skeleton: &'a Skeleton,
    pub(super) sites: &'a [Option<Site>],
    /// Its pose at the previous tick.
    pub(super) before: Pose,
}

/// The buffers for late patches.
pub(super) struct LateSearch {
    reader: PatchReader,
    view: [View; 1],
    search: LatticeSearch,
    found: Vec<KeypointEstimate>,
    expected_m: Vec<Vector3<f64>>,
    targets: Vec<Target>,
    solver: IkSolver,
    spread: JointSpread,
    kinematics: Kinematics,
}

impl LateSearch {
    pub(super) fn new(method: &Method) -> Self {
        Self {
            reader: PatchReader::default(),
            view: [View::default()],
            search: LatticeSearch::new(&method.keypoints),
            found: Vec::new(),
            expected_m: Vec::new(),
            targets: Vec::new(),
            solver: IkSolver::new(&method.parameters.ik),
            spread: JointSpread::default(),
            kinematics: Kinematics::default(),
        }
    }

    /// Adds the evidence of `late` to `moment`, for the person with `body`; returns whether there
    /// is any.
    pub(super) fn add(
        &mut self,
        late: &Late<'_>,
        body: &LateBody<'_>,
        moment: &mut TickSnapshot,
        method: &Method,
    ) -> bool {
        if !method.takes(&late.patch.maps) {
            return false;
        }
        let LateSearch { view, reader, .. } = self;
        let filled = view[0].fill(
            reader,
            late.patch,
            late.camera.viewpoint,
            &late.camera.model,
        );
        if filled.is_err() {
            return false;
        }
        self.expect(body, moment);
        let lattice = &method.parameters.lattice;
        self.search
            .search(&mut self.view, &self.expected_m, lattice, &mut self.found);
        weigh_views(
            &self.view,
            &self.expected_m,
            &method.relative_sigmas,
            &mut self.found,
        );
        if moment.estimates.len() != self.found.len() {
            moment.estimates.clear();
            let nothing = |place_m: &Vector3<f64>| KeypointEstimate::unsupported(*place_m, 0.0);
            moment.estimates.extend(self.expected_m.iter().map(nothing));
        }
        let pairs = moment.estimates.iter_mut().zip(&self.found);
        let joined = pairs.map(|(own, late)| u32::from(join(own, late)));
        if joined.sum::<u32>() == 0 {
            return false;
        }
        self.solve(body, moment, method);
        true
    }

    /// Sets the places to search: the found or predicted ones.
    fn expect(&mut self, body: &LateBody<'_>, moment: &TickSnapshot) {
        body.skeleton.forward(&moment.pose, &mut self.kinematics);
        let kinematics = &self.kinematics;
        let site_m =
            |site: &Option<Site>| site.map_or(moment.pose.root_m, |site| kinematics.site_m(&site));
        self.expected_m.clear();
        self.expected_m.extend(body.sites.iter().map(site_m));
        for (expected_m, estimate) in self.expected_m.iter_mut().zip(&moment.estimates) {
            *expected_m = estimate.position_m;
        }
        let view = &mut self.view[0];
        let moved_s = view.capture_offset_s;
        for (k, place_m) in self.expected_m.iter().enumerate() {
            let velocity_m_s = body.sites[k].map_or(Vector3::zeros(), |site| {
                moment.velocity_m_s[site.joint.index()]
            });
            view.expect(k, place_m + velocity_m_s * moved_s);
        }
    }

    /// Solves the first inverse kinematics of `moment` again.
    fn solve(&mut self, body: &LateBody<'_>, moment: &mut TickSnapshot, method: &Method) {
        aim_at_keypoints(&moment.estimates, body.sites, method, &mut self.targets);
        let ik: &IkParameters = &method.parameters.ik;
        let priors = Priors::new(ik, &body.before, method.dt_s);
        let solution = self
            .solver
            .solve(body.skeleton, &moment.pose, &self.targets, &priors, None);
        self.kinematics.clone_from(self.solver.body());
        moment.measured_m = Joint::ALL.map(|joint| self.kinematics.joint_m(joint));
        moment.unobserved = solution.unobserved;
        moment.views = moment.estimates.iter().map(|e| e.views).max().unwrap_or(0);
        moment.made_of = MadeOf::from_estimates(&moment.estimates, method.enough_keypoints());
        if moment.made_of == MadeOf::Motion {
            return;
        }
        let observation = BodyObservation {
            estimates: &moment.estimates,
            sites: body.sites,
            body: &self.kinematics,
        };
        moment.variance_m2 = observation.variances_m2(&mut self.spread, moment.made_of);
        if moment.made_of == MadeOf::Views && moment.state == PersonState::Coasting {
            moment.state = PersonState::Tracked;
        }
        let lasting_m2 = moment.variance_m2.iter().zip(Joint::ALL);
        let surer_m2 = lasting_m2.map(|(m2, joint)| m2 + BodyObservation::lasting_m2(joint));
        for (published_m2, surer_m2) in moment.published_m2.iter_mut().flatten().zip(surer_m2) {
            *published_m2 = published_m2.min(surer_m2);
        }
    }
}

/// Adds the late estimate of a keypoint to the existing one; returns whether it changed.
fn join(own: &mut KeypointEstimate, late: &KeypointEstimate) -> bool {
    if late.weight <= 0.0 {
        return false;
    }
    if own.weight <= 0.0 {
        own.clone_from(late);
        return true;
    }
    if own.views >= 2 && (late.position_m - own.position_m).norm() > SAME_M {
        return false;
    }
    let information = own.information + late.information;
    let held = Matrix3::identity() * KEEP_INFORMATION;
    let pull = (own.information + held) * own.position_m + late.information * late.position_m;
    let Some(position_m) = (information + held)
        .cholesky()
        .map(|known| known.solve(&pull))
    else {
        return false;
    };
    let n = f64::from(own.views.max(1));
    own.position_m = position_m;
    own.weight = (own.weight * n + late.weight) / (n + 1.0);
    own.support = (own.support * n + late.support) / (n + 1.0);
    own.information = information;
    let is_line = (own.ray.zip(late.ray)).is_some_and(|(a, b)| a.cross(&b).norm() < CROSSING);
    if !is_line {
        own.views += 1;
        own.ray = None;
    }
    true
}
