//! Which cameras look for people, and when.
//!
//! Every camera looks regularly, all at the same ticks: those that the period divides, so that edges know them
//! without being told. In between, cameras are asked: for the next
//! few ticks by a sighting that nothing explains and by a newcomer whom others should see too, and now
//! and then for those who are lost. A sighting that was asked about in vain (a bystander whom one viewpoint sees,
//! a mirror) is asked about less and less often for as long as it stays where it is.
//!
//! Who looks is planned as many ticks ahead as the boxes are made: what is asked for now is looked at
//! then.
//!
//! **What looking may cost.** A camera may be asked for [`BirthParameters::look_share`] of its ticks.
//! It has an allowance of passes, which grows by that share per tick up to [`BirthParameters::look_again_ticks`]; each pass, a
//! regular one too, takes one, and a camera without a whole one left is not asked. So in any n ticks a
//! camera looks at most `look_again_ticks + look_share n` times, or whenever passes are regular.

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

/// Steps in which a ray is followed through the field, metres: a body is wider than half of it.
const RAY_STEP_M: f64 = 0.5;
/// Farthest that a ray is followed, metres.
const FARTHEST_M: f64 = 200.0;
/// Longest wait before a sighting that stays unexplained is asked about again, regular passes.
const LONGEST_WAIT: i64 = 8;
/// Two unexplained sightings of one viewpoint are the same while their rays differ by less, radians
/// (2 degrees, 0.35 m at 10 m).
const SAME_RAY_RAD: f64 = 0.035;
/// Most sightings that are kept in mind; of more, the oldest are forgotten.
const MAX_KEPT: usize = 256;
/// Ticks between two passes for those who are lost.
const LOST_EVERY_TICKS: i64 = 5;
/// Farthest from where a lost person is carried that it is looked for, metres: beyond, the regular
/// looks find it.
const LOST_REACH_M: f64 = 3.0;

/// A sighting that nothing explains.
#[derive(Debug, Clone)]
struct AskedSighting {
    viewpoint: ViewpointIndex,
    direction: Vector3<f64>,
    seen: Tick,
    /// When it is asked about again.
    next: Tick,
    /// Ticks from then to the time after.
    wait: i64,
}

/// Cameras that shall look for some ticks more.
#[derive(Debug, Clone)]
struct Ask {
    until: Tick,
    cameras: Vec<bool>,
}

/// Decides who looks at each tick.
#[derive(Debug, Clone)]
pub(crate) struct DetectionScheduler {
    cameras: Vec<(ViewpointIndex, CameraModel)>,
    field: Field,
    period: i64,
    again_ticks: i64,
    share: f64,
    /// Per camera: passes that it may still be asked for.
    allowance: Vec<f64>,
    kept: Vec<AskedSighting>,
    asks: Vec<Ask>,
    /// Per tick from `planned_from` on: who looks.
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
            kept: Vec::new(),
            asks: Vec::new(),
            planned: VecDeque::new(),
            planned_from: Tick::default(),
            ahead: 1,
        }
    }

    /// Begins a run at `tick`, at which everybody looks.
    pub(crate) fn begin(&mut self, tick: Tick) {
        self.planned_from = tick;
        self.planned.clear();
        self.planned.push_back(vec![true; self.cameras.len()]);
    }

    /// Plans `ticks` ahead from now on, at least 1.
    pub(crate) fn look_ahead(&mut self, ticks: i64) {
        self.ahead = ticks.max(1);
    }

    /// How much later than at the next tick boxes that are made now are used.
    pub(crate) fn awaited_ticks(&self) -> u32 {
        u32::try_from(self.ahead - 1).unwrap_or(0)
    }

    /// Per camera, whether it looks at `tick`; empty where nothing is planned (any more).
    pub(crate) fn looks_at(&self, tick: Tick) -> &[bool] {
        let at = usize::try_from(tick - self.planned_from).ok();
        at.and_then(|at| self.planned.get(at))
            .map_or(&[], Vec::as_slice)
    }

    /// The cameras among `own` that look at `tick`.
    pub(crate) fn looking(&self, own: &[CameraIndex], tick: Tick) -> Vec<CameraIndex> {
        let looks = self.looks_at(tick);
        let looks = |camera: &CameraIndex| looks.get(usize::from(camera.0)) == Some(&true);
        own.iter().copied().filter(looks).collect()
    }

    /// Whether anybody looks at `tick`.
    pub(crate) fn is_pass(&self, tick: Tick) -> bool {
        self.looks_at(tick).contains(&true)
    }

    /// Plans who looks from `tick` on, the next one, as far ahead as is to be planned.
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
            let mut looks = std::mem::take(&mut spare);
            self.plan_one(next, &mut looks);
            self.planned.push_back(looks);
        }
    }

    /// Plans who looks at `tick`.
    fn plan_one(&mut self, tick: Tick, looks: &mut Vec<bool>) {
        let regular = tick.0.rem_euclid(self.period) == 0;
        let most = (self.again_ticks as f64).max(1.0);
        looks.clear();
        for (camera, left) in self.allowance.iter_mut().enumerate() {
            *left = (*left + self.share).min(most);
            let asked = self.asks.iter().any(|ask| ask.cameras[camera]);
            let look = regular || asked && *left >= 1.0;
            looks.push(look);
            if look {
                *left = (*left - 1.0).max(0.0);
            }
        }
        self.asks.retain(|ask| ask.until > tick);
    }

    /// Takes note, after the detection pass at `tick`, of those whom nothing explains, and asks about the new ones.
    pub(crate) fn keep<'a>(
        &mut self,
        tick: Tick,
        unexplained: impl Iterator<Item = &'a SightedBody>,
    ) {
        let mut asked = Vec::new();
        for witness in unexplained {
            let Some((origin_m, direction)) = middle_ray(witness) else {
                continue;
            };
            let same = |kept: &&mut AskedSighting| {
                kept.viewpoint == witness.viewpoint
                    && kept.direction.angle(&direction) < SAME_RAY_RAD
            };
            match self.kept.iter_mut().find(same) {
                Some(kept) => {
                    kept.seen = tick;
                    kept.direction = direction;
                    if tick < kept.next {
                        continue;
                    }
                    kept.wait = (2 * kept.wait).min(LONGEST_WAIT * self.period);
                    kept.next = tick + kept.wait;
                }
                None => self.kept.push(AskedSighting {
                    viewpoint: witness.viewpoint,
                    direction,
                    seen: tick,
                    next: tick + self.period,
                    wait: self.period,
                }),
            }
            asked.push((origin_m, direction));
        }
        self.kept.retain(|kept| tick - kept.seen <= 2 * self.period);
        let surplus = self.kept.len().saturating_sub(MAX_KEPT);
        self.kept.drain(..surplus);
        if !asked.is_empty() {
            let along = |(origin, direction): &(Vector3<f64>, Vector3<f64>)| {
                self.inside_field(origin, direction)
            };
            let points: Vec<Vector3<f64>> = asked.iter().flat_map(along).collect();
            self.ask_where(tick, self.again_ticks, |model| {
                points.iter().any(|&point| sees(model, point))
            });
        }
    }

    /// Asks those who should see a newcomer with these keypoints (world metres), for the next few ticks
    /// after `tick`.
    pub(crate) fn ask_about_tentative(&mut self, tick: Tick, keypoints_m: &[Vector3<f64>]) {
        self.ask_where(tick, self.again_ticks, |model| {
            !in_sight(model, keypoints_m).is_empty()
        });
    }

    /// Asks, now and then, those who see where a lost person could have got to, `reach_m` around
    /// `place_m` (world).
    pub(crate) fn ask_for_lost(&mut self, tick: Tick, place_m: Vector3<f64>, reach_m: f64) {
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
        self.ask_where(tick, 1, |model| {
            around.iter().any(|&point| sees(model, point))
        });
    }

    fn ask_where(&mut self, tick: Tick, ticks: i64, sees: impl Fn(&CameraModel) -> bool) {
        let cameras = self.cameras.iter().map(|(_, model)| sees(model)).collect();
        let until = tick + (self.ahead - 1 + ticks);
        if ticks > 0 {
            self.asks.push(Ask { until, cameras });
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
