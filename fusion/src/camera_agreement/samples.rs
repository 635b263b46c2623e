//! The newest observations of all cameras, in bounded memory.
//!
//! - Sightings of detection passes. They need no help by fusion, so they reveal large errors.
//! - Keypoints of tracked people in crops, in bursts of ticks. They reveal small shifts in time.
//! - Poses of tracked people. With sightings they reveal shifts in time of seconds.
//!
//! Samples are shared, not copied, when they are passed to the judge.

use std::collections::VecDeque;
use std::sync::Arc;

use farfield_proto::id::CameraIndex;
use farfield_proto::message::{KeypointPeak, PersonPose, PersonState, PoseSet, Sighting};
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::align::TickGroup;
use crate::estimate::evidence::View;
use crate::identity::track::Track;

/// Number of detection passes that are kept.
const MAX_PASSES: usize = 48;
/// Number of sightings that are kept per camera and pass, those with the highest scores. If there
/// are more, it is unknown who is missing.
pub(super) const MAX_BODIES: usize = 24;
/// Number of these that are compared with those of other cameras, in any order.
pub(super) const MAX_COMPARED: usize = 6;
/// Least time between two passes that are kept, seconds, after the first ones.
const PASS_EVERY_S: f64 = 0.5;
/// Number of passes that are kept whatever the time between them.
const FIRST_PASSES: usize = 6;
/// Length of a burst, seconds: twice the longest shift of the search in crops.
const BURST_S: f64 = 2.0;
/// Least length of all bursts together, seconds. During half a second networks err to one side:
/// right cameras of the treadmill seemed a tick early, or turned by four degrees.
pub(super) const LEAST_BURSTS_S: f64 = 0.75;
/// One burst in so many is kept, because finding peaks in whole maps takes some percent of a tick.
const ONE_BURST_IN: u64 = 5;
/// Number of bursts that are kept.
const MAX_BURSTS: usize = 6;
/// Number of people per tick whose keypoints are kept.
const MAX_PEOPLE: usize = 2;
/// Number of trails per burst. People who come and go do not make it grow without end.
const MAX_TRAILS: usize = 256;
/// Least score of a peak, 0 to 1.
pub(super) const MIN_SCORE: f32 = 0.3;

/// Time between two ticks whose poses are kept, and the age at which poses are dropped, seconds.
const POSES_EVERY_S: f64 = 1.0 / 30.0;
const POSES_S: f64 = 60.0;
/// Number of people per tick whose poses are kept.
pub(super) const MAX_POSED: usize = 12;

/// A keypoint in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SeenKeypoint {
    /// Undistorted pixels.
    pub(super) pixel: [f32; 2],
    /// 0 to 1.
    pub(super) score: f32,
}

/// Entry of a trail for a keypoint that is not seen.
const UNSEEN: SeenKeypoint = SeenKeypoint {
    pixel: [0.0; 2],
    score: 0.0,
};

/// The keypoints of a sighting, in the order of the network.
pub(super) type SeenBody = Vec<Option<SeenKeypoint>>;

/// The sightings of a detection pass, per camera of the venue.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PassSample {
    pub(super) tick: Tick,
    pub(super) of_camera: Vec<Vec<SeenBody>>,
    /// The sightings in which most scores are below `MIN_SCORE`, with all keypoints.
    pub(super) unsure: Vec<Vec<SeenBody>>,
}

impl PassSample {
    /// The sightings of a camera with the highest scores, which are compared with other cameras.
    pub(super) fn surest(&self, camera: usize) -> &[SeenBody] {
        let bodies = &self.of_camera[camera];
        &bodies[..bodies.len().min(MAX_COMPARED)]
    }

    /// The surest sightings of all cameras, in the form of the message.
    pub(super) fn sightings(&self) -> Vec<Sighting> {
        let bodies = (0..self.of_camera.len())
            .flat_map(|camera| self.surest(camera).iter().map(move |body| (camera, body)));
        let keypoint = |seen: &Option<SeenKeypoint>| {
            seen.map(|seen| KeypointPeak {
                position_px: seen.pixel,
                score: seen.score,
            })
        };
        bodies
            .map(|(camera, body)| Sighting {
                camera: CameraIndex(camera as u16),
                score: 1.0,
                keypoints: body.iter().map(keypoint).collect(),
            })
            .collect()
    }
}

/// The poses of tracked people at a tick.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PosedTick {
    pub(super) tick: Tick,
    /// The id and the keypoints (world, metres) of each person.
    pub(super) people: Vec<(u32, Vec<[f32; 3]>)>,
}

/// The middle of the keypoints of a person, world, metres.
pub(super) fn middle_m(body: &[[f32; 3]]) -> Vector3<f32> {
    let sum: Vector3<f32> = body.iter().map(|&m| Vector3::from(m)).sum();
    sum / body.len().max(1) as f32
}

/// One person in one camera during a burst.
#[derive(Debug, Clone)]
pub(super) struct Trail {
    pub(super) person: u32,
    pub(super) camera: usize,
    n_keypoints: usize,
    /// Capture time after the tick, ticks, from the first tick of the burst; NaN without a picture.
    late_ticks: Vec<f32>,
    /// All keypoints of each tick; the score is 0 if a keypoint is not seen.
    seen: Vec<SeenKeypoint>,
}

impl Trail {
    /// Number of ticks from the first of the burst to the last with a picture.
    pub(super) fn len(&self) -> usize {
        self.late_ticks.len()
    }

    /// Capture time after a tick of the burst, ticks, and the keypoints.
    pub(super) fn at(&self, tick: usize) -> Option<(f64, &[SeenKeypoint])> {
        let late = f64::from(*self.late_ticks.get(tick)?);
        let seen = self.seen.get(tick * self.n_keypoints..)?;
        late.is_finite().then(|| (late, &seen[..self.n_keypoints]))
    }

    /// A trail of these sightings, tick by tick, that is on time.
    #[cfg(test)]
    pub(super) fn from_bodies(person: u32, camera: usize, bodies: &[SeenBody]) -> Self {
        Self {
            person,
            camera,
            n_keypoints: bodies.first().map_or(0, Vec::len),
            late_ticks: vec![0.0; bodies.len()],
            seen: bodies
                .iter()
                .flatten()
                .map(|seen| seen.unwrap_or(UNSEEN))
                .collect(),
        }
    }

    fn add(&mut self, at: usize, view: &View, rate_hz: f64) {
        if view.n_keypoints() != self.n_keypoints || self.late_ticks.len() > at {
            return;
        }
        self.late_ticks.resize(at, f32::NAN);
        self.seen.resize(at * self.n_keypoints, UNSEEN);
        self.late_ticks
            .push((view.capture_offset_s * rate_hz) as f32);
        self.seen.extend((0..self.n_keypoints).map(|keypoint| {
            let peak = view.highest_peak(keypoint);
            peak.filter(|(_, score)| *score >= f64::from(MIN_SCORE))
                .map_or(UNSEEN, |(pixel, score)| SeenKeypoint {
                    pixel: [pixel.x() as f32, pixel.y() as f32],
                    score: score as f32,
                })
        }));
    }
}

/// The keypoints of tracked people in some ticks in a row.
#[derive(Debug, Clone)]
pub(super) struct Burst {
    pub(super) first: Tick,
    pub(super) trails: Vec<Trail>,
}

/// All samples that are kept.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    rate_hz: f64,
    n_cameras: usize,
    first: Option<Tick>,
    pub(super) passes: VecDeque<Arc<PassSample>>,
    pub(super) bursts: VecDeque<Arc<Burst>>,
    current: Option<(u64, Burst)>,
    pub(super) poses: VecDeque<Arc<PosedTick>>,
    /// Number of detection passes with a sighting, since the start.
    pub(super) n_passes: u64,
    /// Number of sightings per camera, since the start.
    pub(super) n_sightings: Vec<u64>,
    /// The last pass with a sighting per camera, since the start.
    last_shown: Vec<Option<Tick>>,
    /// For each kept pass, the cameras whose viewpoint sent nothing.
    absent: VecDeque<(Tick, Vec<usize>)>,
}

impl Samples {
    pub(super) fn new(rate_hz: f64, n_cameras: usize) -> Self {
        Self {
            rate_hz,
            n_cameras,
            first: None,
            passes: VecDeque::new(),
            bursts: VecDeque::new(),
            current: None,
            poses: VecDeque::new(),
            n_passes: 0,
            n_sightings: vec![0; n_cameras],
            last_shown: vec![None; n_cameras],
            absent: VecDeque::new(),
        }
    }

    /// Whether the viewpoint of a camera sent nothing in the pass at `tick`.
    pub(super) fn is_absent(&self, camera: usize, tick: Tick) -> bool {
        let pass = self.absent.iter().find(|(at, _)| *at == tick);
        pass.is_some_and(|(_, absent)| absent.contains(&camera))
    }

    /// The last detection pass with a sighting of a camera, since the start.
    pub(super) fn last_shown(&self, camera: usize) -> Option<Tick> {
        self.last_shown.get(camera).copied().flatten()
    }

    /// Poses are kept once in so many ticks.
    pub(super) fn pose_every_ticks(&self) -> i64 {
        ((POSES_EVERY_S * self.rate_hz).round() as i64).max(1)
    }

    /// Keeps poses when they are due. The pose of a coasting person is a prediction, not evidence.
    pub(super) fn note_poses(&mut self, poses: &PoseSet) {
        let every = self.pose_every_ticks();
        let last = self.poses.back().map(|posed| posed.tick);
        let is_later = last.is_none_or(|last| last < poses.tick);
        let is_due = poses.tick.0.rem_euclid(every) == 0
            || last.is_none_or(|last| poses.tick - last >= every);
        if !is_later || !is_due {
            return;
        }
        let is_seen = |person: &&PersonPose| person.state != PersonState::Coasting;
        let seen = poses.persons.iter().filter(is_seen).take(MAX_POSED);
        let people: Vec<_> = seen
            .map(|person| (person.person.0, person.keypoints_m.clone()))
            .collect();
        if people.is_empty() {
            return;
        }
        self.poses.push_back(Arc::new(PosedTick {
            tick: poses.tick,
            people,
        }));
        let oldest = poses.tick + -((POSES_S * self.rate_hz) as i64);
        while self
            .poses
            .pop_front_if(|posed| posed.tick < oldest)
            .is_some()
        {}
    }

    /// Keeps the detection pass in `group`. `is_own(camera, viewpoint)` returns whether the camera
    /// belongs to the viewpoint.
    pub(super) fn note_pass(
        &mut self,
        group: &TickGroup,
        n_keypoints: usize,
        is_own: impl Fn(usize, u16) -> bool,
    ) {
        let mut all: Vec<_> = group
            .sighting_sets
            .iter()
            .flat_map(|set| {
                set.sightings
                    .iter()
                    .map(|sighting| (set.viewpoint, sighting))
            })
            .filter(|(viewpoint, sighting)| {
                let camera = usize::from(sighting.camera.0);
                is_own(camera, viewpoint.0) && sighting.keypoints.len() == n_keypoints
            })
            .map(|(_, sighting)| sighting)
            .collect();
        self.n_passes += u64::from(!all.is_empty());
        for sighting in &all {
            self.n_sightings[usize::from(sighting.camera.0)] += 1;
            self.last_shown[usize::from(sighting.camera.0)] = Some(group.tick);
        }
        if all.is_empty() || !self.is_due(group.tick) {
            return;
        }
        all.sort_by(|a, b| b.score.total_cmp(&a.score));
        let mut of_camera = vec![Vec::new(); self.n_cameras];
        let mut unsure = of_camera.clone();
        for sighting in all {
            let camera = usize::from(sighting.camera.0);
            let bodies: &mut Vec<SeenBody> = &mut of_camera[camera];
            if bodies.len() < MAX_BODIES {
                let body = seen_body(&sighting.keypoints, MIN_SCORE);
                let at_any_score = seen_body(&sighting.keypoints, 0.0);
                let count = |body: &SeenBody| body.iter().flatten().count();
                if 2 * count(&body) < count(&at_any_score) {
                    unsure[camera].push(at_any_score);
                }
                bodies.push(body);
            }
        }
        if self.passes.len() == MAX_PASSES {
            self.passes.pop_front();
            self.absent.pop_front();
        }
        let is_present = |camera: usize| {
            let mut sets = group.sighting_sets.iter();
            sets.any(|set| is_own(camera, set.viewpoint.0))
        };
        let absent = (0..self.n_cameras).filter(|&camera| !is_present(camera));
        self.absent.push_back((group.tick, absent.collect()));
        self.passes.push_back(Arc::new(PassSample {
            tick: group.tick,
            of_camera,
            unsure,
        }));
    }

    fn is_due(&self, tick: Tick) -> bool {
        let last = self.passes.back().map(|pass| pass.tick);
        let is_later = last.is_none_or(|last| (tick - last) as f64 >= PASS_EVERY_S * self.rate_hz);
        is_later || self.passes.len() < FIRST_PASSES && last.is_none_or(|last| tick > last)
    }

    /// Time from the first to the last kept pass, seconds.
    pub(super) fn passes_last_s(&self) -> f64 {
        let both = self.passes.front().zip(self.passes.back());
        both.map_or(0.0, |(first, last)| {
            (last.tick.0 - first.tick.0) as f64 / self.rate_hz
        })
    }

    /// Keeps the keypoints of some people in the views of `tick`, during a burst.
    pub(super) fn note_views(&mut self, tick: Tick, tracks: &[Track]) {
        let has_views = tracks
            .iter()
            .any(|track| !track.estimator().views().is_empty());
        if self.first.is_none() && !has_views {
            return;
        }
        let first = *self.first.get_or_insert(tick);
        let length = self.burst_ticks();
        let number = (tick - first).unsigned_abs() / length;
        if self.current.as_ref().is_some_and(|(n, _)| *n != number) {
            self.end_burst();
        }
        // Two bursts of a short recording are kept: a camera may be late in only one of them.
        let is_kept = number.is_multiple_of(ONE_BURST_IN) || number == 1;
        if tick < first || !is_kept {
            return;
        }
        let burst_first = first + (number * length).cast_signed();
        let (_, burst) = self.current.get_or_insert_with(|| {
            let burst = Burst {
                first: burst_first,
                trails: Vec::new(),
            };
            (number, burst)
        });
        let at = (tick - burst_first).unsigned_abs() as usize;
        let seen = tracks
            .iter()
            .filter(|track| !track.estimator().views().is_empty());
        for track in seen.take(MAX_PEOPLE) {
            for view in track.estimator().views() {
                if let Some(trail) = burst.trail(view, track.wire_id().0, length as usize) {
                    trail.add(at, view, self.rate_hz);
                }
            }
        }
    }

    fn burst_ticks(&self) -> u64 {
        ((BURST_S * self.rate_hz).round() as u64).max(2)
    }

    fn end_burst(&mut self) {
        if let Some((_, burst)) = self.current.take()
            && !burst.trails.is_empty()
        {
            if self.bursts.len() == MAX_BURSTS {
                self.bursts.pop_front();
            }
            self.bursts.push_back(Arc::new(burst));
        }
    }

    /// All bursts if their total length is sufficient, otherwise none.
    pub(super) fn bursts_if_long_enough(&self) -> Vec<&Arc<Burst>> {
        let all: usize = self.bursts.iter().map(|burst| burst.n_ticks()).sum();
        let is_long = all as f64 >= LEAST_BURSTS_S * self.rate_hz;
        self.bursts.iter().filter(|_| is_long).collect()
    }

    /// The samples of the ticks from `from` to before `end`, with the bursts that lie wholly in
    /// them. Counts since the start do not change.
    pub(super) fn between(&self, from: Tick, end: Tick) -> Self {
        let is_in = |tick: Tick| from <= tick && tick < end;
        let mut part = self.clone();
        part.passes.retain(|pass| is_in(pass.tick));
        part.absent.retain(|(tick, _)| is_in(*tick));
        part.poses.retain(|posed| is_in(posed.tick));
        part.bursts.retain(|burst| {
            is_in(burst.first) && burst.first + burst.n_ticks().cast_signed() as i64 <= end
        });
        part.current = None;
        part
    }

    /// A copy in which the current burst is the last one.
    pub(super) fn so_far(&self) -> Self {
        let mut samples = self.clone();
        samples.end_burst();
        samples
    }
}

/// The keypoints of a sighting with at least this score.
fn seen_body(keypoints: &[Option<KeypointPeak>], min_score: f32) -> SeenBody {
    let seen = |peak: &Option<KeypointPeak>| {
        let peak = peak.as_ref()?;
        let is_number = peak.position_px.iter().all(|v| v.is_finite());
        (peak.score >= min_score && is_number).then_some(SeenKeypoint {
            pixel: peak.position_px,
            score: peak.score,
        })
    };
    keypoints.iter().map(seen).collect()
}

impl Burst {
    /// Number of ticks.
    pub(super) fn n_ticks(&self) -> usize {
        self.trails.iter().map(Trail::len).max().unwrap_or(0)
    }

    /// Largest number of ticks in which a camera shows one person.
    pub(super) fn n_shown(&self, camera: usize) -> usize {
        let own = self.trails.iter().filter(|trail| trail.camera == camera);
        let shown = own.map(|trail| {
            (0..trail.len())
                .filter(|&at| trail.at(at).is_some())
                .count()
        });
        shown.max().unwrap_or(0)
    }

    /// The trail of a person in a camera, a new one if there is none; `None` if there are too many.
    fn trail(&mut self, view: &View, person: u32, n_ticks: usize) -> Option<&mut Trail> {
        let camera = usize::from(view.camera.0);
        let is_it = |trail: &Trail| trail.person == person && trail.camera == camera;
        let known = self.trails.iter().position(is_it);
        if known.is_none() && self.trails.len() < MAX_TRAILS {
            self.trails.push(Trail {
                person,
                camera,
                n_keypoints: view.n_keypoints(),
                late_ticks: Vec::with_capacity(n_ticks),
                seen: Vec::with_capacity(n_ticks * view.n_keypoints()),
            });
            return self.trails.last_mut();
        }
        self.trails.get_mut(known?)
    }
}

/// Results per sample. A kept sample does not change, so its result stays valid.
#[derive(Debug)]
pub(super) struct ResultCache<S, R>(Vec<(Arc<S>, R)>);

impl<S, R> Default for ResultCache<S, R> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<S, R> ResultCache<S, R> {
    /// Removes and returns the result of `sample`.
    pub(super) fn take(&mut self, sample: &Arc<S>) -> Option<R> {
        let at = self.0.iter().position(|(of, _)| Arc::ptr_eq(of, sample))?;
        Some(self.0.swap_remove(at).1)
    }
}

impl<S, R> FromIterator<(Arc<S>, R)> for ResultCache<S, R> {
    fn from_iter<I: IntoIterator<Item = (Arc<S>, R)>>(all: I) -> Self {
        Self(all.into_iter().collect())
    }
}
