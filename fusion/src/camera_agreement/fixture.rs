//! Test fixture: a hall with two walking people and four cameras, some of which have a mistake.

#![expect(clippy::cast_possible_wrap, reason = "a few hundred ticks")]

use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use farfield_proto::id::{PersonId, SessionId};
use farfield_proto::message::{PersonPose, PersonState};
use nalgebra::{Rotation3, Vector3};

use super::samples::{Burst, PassSample, SeenBody, SeenKeypoint, Trail};
use super::*;
use crate::body::fixture::{Noise, standing};
use crate::sightings::fixture::{hall, looking_at};

pub(super) const RATE_HZ: f64 = 60.0;
pub(super) const TICKS: usize = 120;

/// A mistake of a camera or its pictures.
#[derive(Clone, Copy, Default)]
pub(super) struct Mistake {
    pub(super) late_ticks: i64,
    /// Growth of the lateness from burst to burst, ticks.
    pub(super) later_each_burst: i64,
    /// Only this burst is late.
    pub(super) late_in_burst: Option<usize>,
    /// The first and the last burst with the mistake; `None` is all.
    pub(super) in_bursts: Option<[usize; 2]>,
    pub(super) mirrored: bool,
    pub(super) half_turned: bool,
    /// Per keypoint the one written in its place.
    pub(super) order: Option<[u8; 17]>,
    /// True focal length as a factor of the calibrated one; 0 means 1.
    pub(super) focal_factor: f32,
    /// Calibrated k1 less the true one.
    pub(super) k1_over: f32,
    /// Turn since the calibration about its axes (right, down, ahead), degrees.
    pub(super) turned_deg: [f64; 3],
    /// Shift since the calibration, world, metres.
    pub(super) moved_m: [f64; 3],
    /// Maps the pixel of a keypoint to the written one.
    pub(super) rewritten: Option<fn([f32; 2]) -> [f32; 2]>,
    /// Maps scores to the written ones, which are too low to count.
    pub(super) scores_written: Option<fn(f32) -> f32>,
    /// The only person that the camera shows, 0 or 1.
    pub(super) sees_only: Option<usize>,
    /// Whether its crops of the first person show the second, and it has no crops of the second.
    pub(super) crops_of_the_other: bool,
    /// The camera whose pictures it shows instead of its own.
    pub(super) of_camera: Option<usize>,
}

/// The hall. `shows` gives per camera whose pictures it shows, with which mistake; `scale` multiplies the world.
pub(super) struct Hall {
    pub(super) shows: [(usize, Mistake); 4],
    pub(super) bursts: usize,
    pub(super) burst_ticks: usize,
    pub(super) scale: f64,
    /// Height of the feet of all people, metres.
    pub(super) floor_m: f64,
    /// Whether each camera shows one half of the field only.
    pub(super) narrow: bool,
    /// If set, cameras stand side by side and point at a place so far beyond the people, metres.
    pub(super) row: Option<f64>,
    /// If set, the second camera hangs at this distance from the first and points in the same direction, metres.
    pub(super) second_offset_m: Option<f64>,
    /// Whether people stand still.
    pub(super) still: bool,
    /// Whether both people walk in the same direction.
    pub(super) one_way: bool,
}

impl Default for Hall {
    fn default() -> Self {
        Self {
            shows: std::array::from_fn(|camera| (camera, Mistake::default())),
            bursts: 2,
            burst_ticks: TICKS,
            scale: 1.0,
            floor_m: 0.0,
            narrow: false,
            row: None,
            second_offset_m: None,
            still: false,
            one_way: false,
        }
    }
}

impl Hall {
    pub(super) fn with(camera: usize, mistake: Mistake) -> Self {
        let mut hall = Self::default();
        hall.shows[camera].1 = mistake;
        hall
    }

    pub(super) fn report(&self) -> AgreementReport {
        self.samples().report()
    }

    #[expect(
        clippy::too_many_lines,
        reason = "one hall, from its cameras to what they show"
    )]
    pub(super) fn samples(&self) -> AgreementSamples {
        let mut hall = hall();
        if self.narrow {
            hall.cameras = narrow_cameras();
        }
        if let Some(beyond_m) = self.row {
            hall.cameras = cameras_in_a_row(beyond_m);
        }
        if let Some(offset_m) = self.second_offset_m {
            let second = looking_at(
                "second",
                [-5.0, -4.0 + offset_m, 2.5],
                [0.0, 0.0, 0.9],
                1000.0,
            );
            hall.cameras[1].1 = second;
        }
        let mut noise = Noise(5);
        let keypoints = KeypointSet::coco17();
        let shape = [
            standing(0.0, 0.0, 1.7, &mut noise),
            standing(0.0, 0.0, 1.85, &mut noise),
        ];
        let judged = hall
            .cameras
            .iter()
            .enumerate()
            .map(|(i, (viewpoint, model))| JudgedCamera {
                name: format!("cam{i}"),
                viewpoint: *viewpoint,
                size_px: model.size_px(),
                lines: SightLines::from_camera(model),
            });
        let cameras = AgreementCameras {
            all: judged.collect(),
            partners: partners(&keypoints),
            rate_hz: RATE_HZ,
            models: hall.cameras.clone(),
            keypoints: keypoints.clone(),
            field: Field {
                min_m: [-4.0, -3.0, -0.3],
                max_m: [4.0, 3.0, 2.6],
                floor_m: 0.0,
            },
            births: BirthParameters::default(),
        };
        let partners = cameras.partners.clone();
        let mut samples = Samples::new(RATE_HZ, 4);
        let mut see = |camera: usize, person: usize, (burst, tick): (usize, usize)| -> SeenBody {
            let (whose, mistake) = self.shows[camera];
            let is_wrong = |[first, last]: [usize; 2]| (first..=last).contains(&burst);
            let mistake = if mistake.in_bursts.is_none_or(is_wrong) {
                mistake
            } else {
                Mistake::default()
            };
            let whose = mistake.of_camera.unwrap_or(whose);
            let in_burst = mistake.late_in_burst.is_none_or(|of| of == burst);
            let late =
                mistake.late_ticks * i64::from(in_burst) + mistake.later_each_burst * burst as i64;
            if mistake.sees_only.is_some_and(|only| only != person) {
                return vec![None; 17];
            }
            let at = (burst * 600 + tick) as f64 - late as f64;
            let at = if self.still { 0.0 } else { at };
            let mut body = walking(&shape[person], person, at / RATE_HZ, self.scale);
            if self.one_way {
                // At 3 m/s, from one end of the hall to the other in two seconds.
                let along = Vector3::x() * (3.0 * (at.rem_euclid(600.0) / RATE_HZ - 1.0));
                for point in &mut body {
                    *point += along;
                }
            }
            let seen: SeenBody = body
                .iter()
                .map(|p| p - Vector3::from(mistake.moved_m))
                .map(|p| pixel(&hall.cameras[whose].1, &p, &mut noise))
                .collect();
            changed(&seen, mistake, &partners)
        };
        for burst in 0..self.bursts {
            for tick in [0, 30, 60, 90] {
                let bodies = |camera| {
                    (0..2)
                        .map(|person| see(camera, person, (burst, tick)))
                        .filter(|body| body.iter().any(Option::is_some))
                        .collect()
                };
                let shown: Vec<Vec<SeenBody>> = (0..4).map(bodies).collect();
                samples
                    .passes
                    .push_back(Arc::new(self.pass(burst, tick, shown)));
            }
            let trails = (0..4).flat_map(|camera| (0..2).map(move |person| (camera, person)));
            let trails = trails.map(|(camera, person)| {
                let is_of_the_other = self.shows[camera].1.crops_of_the_other;
                let bodies = (0..self.burst_ticks).map(|tick| match (is_of_the_other, person) {
                    (true, 0) => see(camera, 1, (burst, tick)),
                    (true, _) => vec![None; 17],
                    (false, _) if self.shows[camera].1.scores_written.is_some() => vec![None; 17],
                    (false, _) => see(camera, person, (burst, tick)),
                });
                let bodies: Vec<SeenBody> = bodies.collect();
                Trail::from_bodies(person as u32, camera, &bodies)
            });
            let trails = trails.collect();
            samples.bursts.push_back(Arc::new(Burst {
                first: Tick(burst as i64 * 600),
                trails,
            }));
        }
        for tick in 0..(self.bursts * 600) as i64 {
            samples.note_poses(&self.poses(&shape, tick));
        }
        AgreementSamples {
            cameras: Arc::new(cameras),
            samples,
            standing: Standing::from_statures(&[self.stature_m(); 2], self.floor_m),
        }
    }

    /// A detection pass with these sightings per camera.
    fn pass(&self, burst: usize, tick: usize, shown: Vec<Vec<SeenBody>>) -> PassSample {
        let mut pass = PassSample {
            tick: Tick((burst * 600 + tick) as i64),
            unsure: vec![Vec::new(); shown.len()],
            of_camera: shown,
        };
        for (camera, (_, mistake)) in self.shows.iter().enumerate() {
            if let Some(written) = mistake.scores_written {
                let none = vec![vec![None; 17]; pass.of_camera[camera].len()];
                pass.unsure[camera] = std::mem::replace(&mut pass.of_camera[camera], none);
                let all = pass.unsure[camera].iter_mut().flatten().flatten();
                all.for_each(|seen| seen.score = written(seen.score));
            }
        }
        pass
    }

    /// Estimated stature, which is smaller if all focal lengths are.
    fn stature_m(&self) -> f64 {
        let factors = self.shows.map(|(_, mistake)| mistake.focal_factor);
        let are_all_alike = factors[0] > 0.0
            && factors
                .iter()
                .all(|it| (it - factors[0]).abs() < f32::EPSILON);
        let focal_factor = if are_all_alike {
            f64::from(factors[0])
        } else {
            1.0
        };
        1.75 * self.scale * focal_factor
    }

    /// The poses of both people at a tick.
    fn poses(&self, shape: &[Vec<Vector3<f64>>; 2], tick: i64) -> PoseSet {
        let at_s = if self.still {
            0.0
        } else {
            tick as f64 / RATE_HZ
        };
        let person = |index: usize| {
            let body = walking(&shape[index], index, at_s, self.scale);
            PersonPose {
                person: PersonId(index as u32),
                state: PersonState::Tracked,
                joints_m: Vec::new(),
                keypoints_m: body
                    .iter()
                    .map(|p| [p.x, p.y, p.z].map(|m| m as f32))
                    .collect(),
                sigma_m: Vec::new(),
                angles: Vec::new(),
                unobserved: 0,
                views: 4,
            }
        };
        PoseSet {
            session: SessionId(1),
            tick: Tick(tick),
            persons: (0..2).map(person).collect(),
        }
    }

    /// The reported causes, each with its cameras.
    pub(super) fn causes(&self) -> Vec<(Vec<String>, DisagreementCause)> {
        let disagreements = self.report().disagreements.into_iter();
        disagreements.map(|d| (d.cameras, d.cause)).collect()
    }
}

/// Four cameras at the sides of the field. Two show the half of one person, two that of the other.
fn narrow_cameras() -> Vec<(ViewpointIndex, CameraModel)> {
    let places = [[-9.0, -2.8], [9.0, -2.2], [-9.0, 2.2], [9.0, 2.8]];
    let camera = |(index, [x, y]): (usize, [f64; 2])| {
        let aim_m = [0.0, if y < 0.0 { -1.4 } else { 1.4 }, 0.9];
        let model = looking_at(&format!("narrow-{index}"), [x, y, 2.5], aim_m, 6000.0);
        (ViewpointIndex(index as u16), model)
    };
    places.into_iter().enumerate().map(camera).collect()
}

/// Four cameras side by side along the field.
fn cameras_in_a_row(beyond_m: f64) -> Vec<(ViewpointIndex, CameraModel)> {
    let camera = |index: u16| {
        let x = 2.0 * f64::from(index) - 3.0;
        // The common place is straight ahead of the middle of the row.
        let aim_m = [x * beyond_m / (8.0 + beyond_m), 0.0, 0.9];
        let model = looking_at(&format!("row-{index}"), [x, -8.0, 2.5], aim_m, 1000.0);
        (ViewpointIndex(index), model)
    };
    (0..4).map(camera).collect()
}

/// A body that walks back and forth with swinging limbs.
fn walking(shape: &[Vector3<f64>], person: usize, at_s: f64, scale: f64) -> Vec<Vector3<f64>> {
    let side = if person == 0 { 1.0 } else { -1.0 };
    let place = Vector3::new(side * (1.5 * libm::sin(0.9 * at_s)), side * 1.2, 0.0);
    let swing = |k: usize| {
        let phase = if k.is_multiple_of(2) { 0.0 } else { 3.0 };
        let reach = if k >= 7 { 0.25 } else { 0.02 };
        Vector3::new(reach * libm::sin(6.0 * at_s + phase), 0.0, 0.0)
    };
    let moved = shape.iter().enumerate();
    moved.map(|(k, p)| scale * (p + place + swing(k))).collect()
}

fn pixel(model: &CameraModel, p: &Vector3<f64>, noise: &mut Noise) -> Option<SeenKeypoint> {
    let pixel = model.project(Point::new((*p).into()))?;
    let off = [noise.normal() * 2.0, noise.normal() * 2.0];
    Some(SeenKeypoint {
        pixel: [(pixel.x() + off[0]) as f32, (pixel.y() + off[1]) as f32],
        score: 0.8,
    })
}

fn changed(seen: &SeenBody, mistake: Mistake, partners: &Partners) -> SeenBody {
    let keypoint = |k: usize| {
        let from = if mistake.mirrored { partners[k] } else { k };
        let from = mistake.order.map_or(from, |order| usize::from(order[from]));
        let mut keypoint = seen[from]?;
        if mistake.focal_factor > 0.0 {
            let middle = [959.5, 599.5];
            for (pixel, middle) in keypoint.pixel.iter_mut().zip(middle) {
                *pixel = middle + mistake.focal_factor * (*pixel - middle);
            }
        }
        if mistake.k1_over.abs() > 0.0 {
            keypoint.pixel = bent(keypoint.pixel, mistake.k1_over);
        }
        if mistake.turned_deg.iter().any(|deg| deg.abs() > 0.0) {
            keypoint.pixel = turned(keypoint.pixel, mistake.turned_deg);
        }
        if let Some(rewritten) = mistake.rewritten {
            keypoint.pixel = rewritten(keypoint.pixel);
        }
        if mistake.mirrored != mistake.half_turned {
            keypoint.pixel[0] = 1919.0 - keypoint.pixel[0];
        }
        if mistake.half_turned {
            keypoint.pixel[1] = 1199.0 - keypoint.pixel[1];
        }
        Some(keypoint)
    };
    (0..seen.len()).map(keypoint).collect()
}

/// Where a camera of the hall with another k1 shows what it showed at `pixel`.
fn bent(pixel: [f32; 2], k1_over: f32) -> [f32; 2] {
    let [x, y] = [pixel[0] - 959.5, pixel[1] - 599.5].map(|px| px / 1000.0);
    let factor = 1.0 - k1_over * (x * x + y * y);
    [959.5 + 1000.0 * x * factor, 599.5 + 1000.0 * y * factor]
}

/// Where a turned camera of the hall shows what it showed at `pixel` before.
fn turned(pixel: [f32; 2], by_deg: [f64; 3]) -> [f32; 2] {
    let [x, y] = pixel.map(f64::from);
    let ray = Vector3::new(x - 959.5, y - 599.5, 1000.0);
    let turn = Rotation3::from_scaled_axis(Vector3::from(by_deg.map(f64::to_radians)));
    let ray = turn.inverse() * ray;
    [
        (959.5 + 1000.0 * ray.x / ray.z) as f32,
        (599.5 + 1000.0 * ray.y / ray.z) as f32,
    ]
}

pub(super) fn names(cameras: &[usize]) -> Vec<String> {
    cameras
        .iter()
        .map(|camera| format!("cam{camera}"))
        .collect()
}
