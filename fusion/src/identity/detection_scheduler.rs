//! Which cameras run the detector, and when.
//!
//! Every camera runs a detection pass regularly. All do so at the ticks that the period divides, so
//! that edges know these ticks without a request. In between, fusion requests passes from some
//! cameras:
//! - for the next few ticks, after a sighting that no track explains, and for a newcomer that other
//!   cameras should also see;
//! - now and then, for lost people.
//!
//! A sighting that stays unexplained (a bystander in one view, a mirror) causes fewer
//! and fewer requests while it stays where it is.
//!
//! Passes are planned as many ticks ahead as boxes are made; a request takes effect at that time.
//!
//! **Budget.** Requests may use [`BirthParameters::look_share`] of a camera's ticks. A camera has
//! an allowance of passes. It grows by that share per tick up to
//! [`BirthParameters::look_again_ticks`]. Each pass, also a regular one, takes one from it. A
//! camera without a whole one left gets no request. So in any n ticks a camera runs at most
//! `look_again_ticks + look_share n` passes, or those that are regular.

use std::collections::VecDeque;

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Field;
use farfield_proto::venue::parameters::BirthParameters;
use nalgebra::Vector3;

use crate::sightings::contradiction::in_sight;
use crate::sightings::rays::SightedBody;

/// Step along a ray through the field, metres: a body is wider than half of it.
const RAY_STEP_M: f64 = 0.5;
/// Greatest distance along a ray, metres.
const FARTHEST_M: f64 = 200.0;
/// Longest wait before the next request for a sighting that stays unexplained, regular passes.
const LONGEST_WAIT: i64 = 8;
/// Two unexplained sightings of one viewpoint are the same if their rays differ by less, radians (2
/// degrees, 0.35 m at 10 m).
const SAME_RAY_RAD: f64 = 0.035;
/// Most sightings that are remembered; the oldest are forgotten first.
const MAX_REMEMBERED: usize = 256;
/// Ticks between two passes for lost people.
const LOST_EVERY_TICKS: i64 = 5;
/// Greatest distance from the carried place within which a lost person is searched, metres: farther
/// away, the regular passes find it.
const LOST_REACH_M: f64 = 3.0;

/// A sighting that no track explains.
#[derive(Debug, Clone)]
struct UnexplainedSighting {
    viewpoint: ViewpointIndex,
    direction: Vector3<f64>,
    seen: Tick,
    /// When the next request is made.
    next: Tick,
    /// Ticks from `next` to the request after it.
    wait: i64,
}

/// A request: cameras that run detection passes for some more ticks.
#[derive(Debug, Clone)]
struct Request {
    until: Tick,
    cameras: Vec<bool>,
}

/// Decides which cameras run the detector at each tick.
#[derive(Debug, Clone)]
pub(crate) struct DetectionScheduler {
    cameras: Vec<(ViewpointIndex, CameraModel)>,
    field: Field,
    period: i64,
    again_ticks: i64,
    share: f64,
    /// Per camera: passes that may still be requested.
    allowance: Vec<f64>,
    remembered: Vec<UnexplainedSighting>,
    requests: Vec<Request>,
    /// Per tick from `planned_from` on: which cameras run.
    planned: VecDeque<Vec<bool>>,
    planned_from: Tick,
    /// How many ticks ahead is planned, at least 1.
    ahead: i64,
}

impl DetectionScheduler {
    pub(crate) fn new(
        cameras: Vec<(ViewpointIndex, CameraModel)>,
        field: Field,
        births: &BirthParameters,
        rate_hz: f64,
    ) -> Self {
        let n = cameras.len();
        let again_ticks = births.look_again_ticks(rate_hz);
        Self {
            cameras,
            field,
            period: births.ticks_per_look(rate_hz),
            again_ticks,
            share: births.look_share,
            allowance: vec![again_ticks as f64; n],
            remembered: Vec::new(),
            requests: Vec::new(),
            planned: VecDeque::new(),
            planned_from: Tick::default(),
            ahead: 1,
        }
    }

    /// Begins a run at `tick`, at which all cameras run the detector.
    pub(crate) fn begin(&mut self, tick: Tick) {
        self.planned_from = tick;
        self.planned.clear();
        self.planned.push_back(vec![true; self.cameras.len()]);
    }

    /// Plans `ticks` ahead from now on, at least 1.
    pub(crate) fn plan_ahead(&mut self, ticks: i64) {
        self.ahead = ticks.max(1);
    }

    /// How many ticks after the next one the boxes made now will be used.
    pub(crate) fn awaited_ticks(&self) -> u32 {
        u32::try_from(self.ahead - 1).unwrap_or(0)
    }

    /// Per camera, whether it runs the detector at `tick`; empty if nothing is planned (any more).
    pub(crate) fn runs_at(&self, tick: Tick) -> &[bool] {
        let at = usize::try_from(tick - self.planned_from).ok();
        at.and_then(|at| self.planned.get(at))
            .map_or(&[], Vec::as_slice)
    }

    /// The cameras among `own` that run the detector at `tick`.
    pub(crate) fn detecting(&self, own: &[CameraIndex], tick: Tick) -> Vec<CameraIndex> {
        let runs = self.runs_at(tick);
        let runs = |camera: &CameraIndex| runs.get(usize::from(camera.0)) == Some(&true);
        own.iter().copied().filter(runs).collect()
    }

    /// Whether any camera runs the detector at `tick`.
    pub(crate) fn is_pass(&self, tick: Tick) -> bool {
        self.runs_at(tick).contains(&true)
    }

    /// Plans from the next tick, `tick`, on, as far ahead as required.
    pub(crate) fn plan(&mut self, tick: Tick) {
        let mut spare = Vec::new();
        while self.planned_from < tick && !self.planned.is_empty() {
            spare = self.planned.pop_front().unwrap_or_default();
            self.planned_from = self.planned_from + 1;
        }
        if self.planned.is_empty() {
            self.planned_from = tick;
        }
        loop {
            let next = self.planned_from + self.planned.len().cast_signed() as i64;
            if next >= tick + self.ahead {
                break;
            }
            let mut runs = std::mem::take(&mut spare);
            self.plan_one(next, &mut runs);
            self.planned.push_back(runs);
        }
    }

    fn plan_one(&mut self, tick: Tick, runs: &mut Vec<bool>) {
        let regular = tick.0.rem_euclid(self.period) == 0;
        let most = (self.again_ticks as f64).max(1.0);
        runs.clear();
        for (camera, left) in self.allowance.iter_mut().enumerate() {
            *left = (*left + self.share).min(most);
            let requested = self.requests.iter().any(|request| request.cameras[camera]);
            let is_run = regular || requested && *left >= 1.0;
            runs.push(is_run);
            if is_run {
                *left = (*left - 1.0).max(0.0);
            }
        }
        self.requests.retain(|request| request.until > tick);
    }

    /// Records the unexplained sightings of the detection pass at `tick`, and requests passes for
    /// those that are new or due.
    pub(crate) fn record_unexplained<'a>(
        &mut self,
        tick: Tick,
        unexplained: impl Iterator<Item = &'a SightedBody>,
    ) {
        let mut requested = Vec::new();
        for witness in unexplained {
            let Some((origin_m, direction)) = middle_ray(witness) else {
                continue;
            };
            let same = |known: &&mut UnexplainedSighting| {
                known.viewpoint == witness.viewpoint
                    && known.direction.angle(&direction) < SAME_RAY_RAD
            };
            match self.remembered.iter_mut().find(same) {
                Some(known) => {
                    known.seen = tick;
                    known.direction = direction;
                    if tick < known.next {
                        continue;
                    }
                    known.wait = (2 * known.wait).min(LONGEST_WAIT * self.period);
                    known.next = tick + known.wait;
                }
                None => self.remembered.push(UnexplainedSighting {
                    viewpoint: witness.viewpoint,
                    direction,
                    seen: tick,
                    next: tick + self.period,
                    wait: self.period,
                }),
            }
            requested.push((origin_m, direction));
        }
        self.remembered
            .retain(|known| tick - known.seen <= 2 * self.period);
        let surplus = self.remembered.len().saturating_sub(MAX_REMEMBERED);
        self.remembered.drain(..surplus);
        if !requested.is_empty() {
            let along = |(origin, direction): &(Vector3<f64>, Vector3<f64>)| {
                self.inside_field(origin, direction)
            };
            let points: Vec<Vector3<f64>> = requested.iter().flat_map(along).collect();
            self.request_where(tick, self.again_ticks, |model| {
                points.iter().any(|&point| sees(model, point))
            });
        }
    }

    /// Requests passes from the cameras that should see a newcomer with these keypoints (world
    /// metres), for the next few ticks after `tick`.
    pub(crate) fn request_for_tentative(&mut self, tick: Tick, keypoints_m: &[Vector3<f64>]) {
        self.request_where(tick, self.again_ticks, |model| {
            !in_sight(model, keypoints_m).is_empty()
        });
    }

    /// Requests passes, now and then, from the cameras that see where a lost person could be,
    /// within `reach_m` of `place_m` (world).
    pub(crate) fn request_for_lost(&mut self, tick: Tick, place_m: Vector3<f64>, reach_m: f64) {
        if tick.0.rem_euclid(LOST_EVERY_TICKS) != 0 {
            return;
        }
        let reach = reach_m.min(LOST_REACH_M);
        let around = [
            [0.0, 0.0],
            [reach, 0.0],
            [-reach, 0.0],
            [0.0, reach],
            [0.0, -reach],
        ];
        let around = around.map(|[x, y]| place_m + Vector3::new(x, y, 0.0));
        self.request_where(tick, 1, |model| {
            around.iter().any(|&point| sees(model, point))
        });
    }

    fn request_where(&mut self, tick: Tick, ticks: i64, sees: impl Fn(&CameraModel) -> bool) {
        let cameras = self.cameras.iter().map(|(_, model)| sees(model)).collect();
        let until = tick + (self.ahead - 1 + ticks);
        if ticks > 0 {
            self.requests.push(Request { until, cameras });
        }
    }

    /// Points along a ray that lie in the field.
    fn inside_field(&self, origin_m: &Vector3<f64>, direction: &Vector3<f64>) -> Vec<Vector3<f64>> {
        let (low, high) = (
            Vector3::from(self.field.min_m),
            Vector3::from(self.field.max_m),
        );
        let steps = (FARTHEST_M / RAY_STEP_M) as u32;
        let points = (1..=steps).map(|i| origin_m + direction * (f64::from(i) * RAY_STEP_M));
        points.filter(|p| *p >= low && *p <= high).collect()
    }
}

fn sees(model: &CameraModel, point_m: Vector3<f64>) -> bool {
    let pixel = model.project(Point::new(point_m.into()));
    pixel.is_some_and(|pixel| model.sees(pixel))
}

/// The ray through the middle of a sighted body: pinhole and unit direction.
fn middle_ray(witness: &SightedBody) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let mut rays = witness.rays.iter().flatten();
    let origin_m = rays.next()?.origin_m;
    let sum: Vector3<f64> = witness.rays.iter().flatten().map(|ray| ray.direction).sum();
    Some((origin_m, sum.try_normalize(1e-9)?))
}

#[cfg(test)]
#[path = "detection_scheduler_tests.rs"]
mod tests;
