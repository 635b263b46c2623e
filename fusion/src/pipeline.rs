//! One step of fusion: the patches and sightings of a tick in, skeletons and the next boxes out.
//!
//! ```text
//!   patches -> estimate, each person in parallel -> registry: facts, decisions, events
//!   sightings -> registry: new or returning people -> detection schedule -> boxes
//! ```
//!
//! Pure: the same groups in the same order give the same bits. Persons are computed in parallel,
//! with barriers where they interact (the occlusion weights need all predictions).

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU32, Ordering};

use farfield_proto::id::{CameraIndex, SessionId, ViewpointIndex};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::identity_event::IdentityEvent;
use farfield_proto::message::naming::Naming;
use farfield_proto::message::{BoxSet, Order, PatchSet, PersonBoxes, PoseSet};
use farfield_proto::model_card::{HeatmapCard, PEAK_SIGMA_OF_WIDTH};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use rayon::prelude::*;

use crate::align::TickGroup;
use crate::body::ik::relative_sigmas;
use crate::body::skeleton::{RangeOfMotion, sites_of};
use crate::boxes::BoxShape;
use crate::camera_agreement::{AgreementSamples, AgreementWatch};
use crate::estimate::occlusion::BodyCapsules;
use crate::estimate::peak_assignment::PeakAssignment;
use crate::estimate::separation::Separation;
use crate::identity::known::KnownPeople;
use crate::identity::registry::Registry;
use crate::identity::subjects::Subject;
use crate::identity::track::Track;
use crate::journal::Journal;
use crate::method::{Method, VenueView};
use crate::smoother::{Delay, FixedLagSmoother};

/// Margin of a box if neither the venue nor a network's card has one.
const DEFAULT_BOX_MARGIN: f64 = 1.25;

/// Longest horizon of boxes, ticks: beyond it a prediction is meaningless.
pub const LONGEST_HORIZON_TICKS: i64 = 240;

/// A part of a step, for time measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Decoding patches, and all work on whole maps: expected keypoints, occlusion weights,
    /// left-right swaps, peaks.
    Views,
    /// Stores what crops show, for camera agreement.
    AgreementViews,
    /// Assigns peaks that maps show twice to persons.
    PeakAssignment,
    /// The lattice search.
    Lattice,
    /// The first inverse kinematics.
    Ik1,
    /// The low-pass filter.
    Filter,
    /// The second inverse kinematics.
    Ik2,
    /// The registry of identities.
    Persons,
    /// Stores the detected people, for camera agreement.
    AgreementFound,
    /// The boxes of the next tick.
    Boxes,
}

impl Stage {
    /// All, in the order of a step.
    pub const ALL: [Self; 10] = [
        Self::Views,
        Self::AgreementViews,
        Self::PeakAssignment,
        Self::Lattice,
        Self::Ik1,
        Self::Filter,
        Self::Ik2,
        Self::Persons,
        Self::AgreementFound,
        Self::Boxes,
    ];

    /// Name of the stage in published and printed times.
    pub fn name(self) -> &'static str {
        match self {
            Self::Views => "views",
            Self::AgreementViews => "agreement_views",
            Self::PeakAssignment => "peak_assignment",
            Self::Lattice => "lattice",
            Self::Ik1 => "ik1",
            Self::Filter => "filter",
            Self::Ik2 => "ik2",
            Self::Persons => "persons",
            Self::AgreementFound => "agreement_found",
            Self::Boxes => "boxes",
        }
    }
}

/// The result of a step.
#[derive(Debug, Clone, PartialEq)]
pub struct StepOutput {
    /// The poses of this tick, without tentative persons.
    pub poses: PoseSet,
    /// Ticks whose poses are final, in order, with the tentative ticks of confirmed persons.
    pub finished: Vec<PoseSet>,
    /// Ticks whose smoothed poses are final now, in order: usually the one `smoothing.delay_ms`
    /// before this. Empty until that time has passed, and without a delay.
    pub smoothed: Vec<PoseSet>,
    /// One per viewpoint, for the tick of its horizon.
    pub boxes: Vec<BoxSet>,
    /// Patches that could not be used.
    pub unusable_patches: u32,
    /// Sightings that could not be used.
    pub unusable_sightings: u32,
    /// Identity events of this tick, in order.
    pub events: Vec<IdentityEvent>,
    /// Results of the comparison with the venue's subjects at this tick, by id.
    pub namings: Vec<Naming>,
}

/// The fusion node's core.
pub struct Pipeline {
    session: SessionId,
    cameras: Vec<VenueView>,
    viewpoints: Vec<Vec<CameraIndex>>,
    /// Per viewpoint: how many ticks ahead its boxes are made.
    horizons: Vec<i64>,
    method: Method,
    registry: Registry,
    journal: Journal,
    bodies: Vec<BodyCapsules>,
    peak_assignment: PeakAssignment,
    separation: Separation,
    /// Per person and viewpoint, the predicted boxes.
    boxes: Vec<Vec<Option<PersonBoxes>>>,
    smoother: Option<FixedLagSmoother>,
    agreement: AgreementWatch,
}

impl Pipeline {
    /// The core for `venue`, whose network has the card `card` (`None`: the venue has
    /// no pictures).
    pub fn new(venue: &Venue, card: Option<&HeatmapCard>, session: SessionId) -> Self {
        let keypoints = card.map_or(&venue.keypoints, |card| &card.output.keypoints);
        let no_offsets = BTreeMap::new();
        let parameters = venue.parameters.clone();
        let margin = parameters
            .boxes
            .margin
            .or(card.map(|card| card.box_margin))
            .unwrap_or(DEFAULT_BOX_MARGIN);
        let range = &parameters.range_of_motion;
        let method = Method {
            dt_s: 1.0 / venue.rate_hz,
            sites: sites_of(
                keypoints,
                card.map_or(&no_offsets, |card| &card.keypoint_offsets),
            ),
            relative_sigmas: relative_sigmas(
                keypoints,
                card.map_or(&BTreeMap::new(), |card| &card.relative_sigma),
            ),
            peak_sigma_of_width: card.map_or(PEAK_SIGMA_OF_WIDTH, |card| {
                card.output.peak_sigma_of_width()
            }),
            map_size: card.map(|card| {
                let side = |cells: u32| u16::try_from(cells).unwrap_or(u16::MAX);
                [side(card.output.width), side(card.output.height)]
            }),
            floor_m: venue.field.floor_m,
            range_of_motion: range.enabled.then(|| RangeOfMotion::new(range.factor)),
            box_shape: BoxShape {
                margin,
                reach_m: 0.0,
                parameters: parameters.boxes.clone(),
            },
            keypoints: keypoints.clone(),
            parameters,
        };
        let delay = Delay::of_ms(method.parameters.smoothing.delay_ms, venue.rate_hz);
        Self {
            session,
            smoother: delay.map(|delay| FixedLagSmoother::new(session, delay, &method)),
            registry: Registry::new(venue, method.keypoints.clone()),
            agreement: AgreementWatch::new(venue, &method.keypoints),
            peak_assignment: PeakAssignment::new(&method.keypoints, venue.viewpoints.len()),
            cameras: venue
                .cameras
                .iter()
                .map(|camera| VenueView {
                    viewpoint: camera.viewpoint,
                    model: camera.model.clone(),
                })
                .collect(),
            viewpoints: venue
                .viewpoints
                .iter()
                .map(|viewpoint| viewpoint.cameras.clone())
                .collect(),
            horizons: vec![1; venue.viewpoints.len()],
            method,
            separation: Separation::default(),
            boxes: Vec::new(),
            journal: Journal::default(),
            bodies: Vec::new(),
        }
    }

    /// The keypoints that patches must have maps for.
    pub fn keypoints(&self) -> &KeypointSet {
        &self.method.keypoints
    }

    /// All tracks after the last step, also tentative ones, in the order of their initiation: for
    /// studies of the stages.
    #[cfg(feature = "study")]
    pub fn tracks(&self) -> &[Track] {
        self.registry.tracks()
    }

    /// Sets how many ticks after the stepped one each viewpoint's boxes are made: `BoxSet.tick =
    /// tick + round(horizon)`. One number per viewpoint of the venue, in its order; 1 (the next
    /// tick) until it is set. Below 1, or not finite, counts as 1; the maximum is
    /// [`LONGEST_HORIZON_TICKS`]. Missing ones do not change, surplus ones are ignored. Detection
    /// passes are planned as far ahead as the longest horizon, so that all viewpoints get the same
    /// ticks.
    pub fn set_horizons(&mut self, horizons: &[f64]) {
        for (own, horizon) in self.horizons.iter_mut().zip(horizons) {
            let whole = if horizon.is_finite() {
                horizon.round() as i64
            } else {
                1
            };
            *own = whole.clamp(1, LONGEST_HORIZON_TICKS);
        }
        let longest = self.horizons.iter().copied().max().unwrap_or(1);
        self.registry.plan_ahead(longest);
    }

    /// The boxes with which a run begins at `tick`, with a detection pass of every edge.
    pub fn first_boxes(&mut self, tick: Tick) -> Vec<BoxSet> {
        self.registry.begin(tick, &self.method);
        let next = vec![1; self.viewpoints.len()];
        self.boxes_after(tick + -1, &next)
    }

    /// Adds the people of the previous run, before this one begins at `tick`; must be called before
    /// [`Self::first_boxes`].
    pub fn expect(&mut self, known: &KnownPeople, tick: Tick) {
        self.registry.expect(known, tick, &self.method);
    }

    /// Sets the subjects and their bodies; must be called before [`Self::first_boxes`].
    pub fn know(&mut self, subjects: Vec<Subject>) {
        self.registry.know(subjects);
    }

    /// The people that a run after `tick`, the last one, would expect.
    pub fn known_people(&self, tick: Tick) -> KnownPeople {
        self.registry.known_people(tick)
    }

    /// Processes one tick. Calls `mark` after each stage.
    pub fn step(&mut self, group: &TickGroup, mark: &mut dyn FnMut(Stage)) -> StepOutput {
        let unusable_patches = self.see(group);
        mark(Stage::Views);
        self.agreement
            .note_views(group.tick, self.registry.tracks());
        mark(Stage::AgreementViews);
        self.assign_peaks();
        mark(Stage::PeakAssignment);
        self.solve(|track, method| track.estimator.search(method));
        mark(Stage::Lattice);
        self.solve(Track::fit_keypoints);
        mark(Stage::Ik1);
        self.solve(|track, method| track.estimator.smooth(method));
        mark(Stage::Filter);
        self.separate();
        self.solve(|track, method| track.estimator.fit_joints(method));
        mark(Stage::Ik2);
        let outcome = self.registry.step(group, &self.method);
        let poses = PoseSet {
            session: self.session,
            tick: group.tick,
            persons: self.registry.published(),
        };
        self.journal.push(poses.clone());
        self.journal.insert(outcome.confirmed);
        let finished = self.journal.release(self.registry.undecided_from());
        let smoothed = self.smoothed(group.tick);
        mark(Stage::Persons);
        self.agreement
            .note_found(group, self.registry.tracks(), &poses);
        mark(Stage::AgreementFound);
        let horizons = std::mem::take(&mut self.horizons);
        let boxes = self.boxes_after(group.tick, &horizons);
        self.horizons = horizons;
        mark(Stage::Boxes);
        StepOutput {
            poses,
            finished,
            smoothed,
            boxes,
            unusable_patches,
            unusable_sightings: outcome.unusable_sightings,
            events: outcome.events,
            namings: outcome.namings,
        }
    }

    /// Samples for camera agreement, as far as they are stored.
    pub fn agreement(&self) -> AgreementSamples {
        self.agreement.samples()
    }

    /// Ends the run: returns the ticks still held, without people who were never confirmed.
    pub fn finish(&mut self) -> Vec<PoseSet> {
        self.journal.release(None)
    }

    /// Ends the run: returns the smoothed poses of the ticks still inside the delay, in order.
    pub fn finish_smoothed(&mut self) -> Vec<PoseSet> {
        let smoother = self.smoother.as_mut();
        smoother.map_or_else(Vec::new, |smoother| smoother.finish(&self.method))
    }

    /// Smooths in two passes, forward and back, instead of with the delay of the venue: for
    /// recordings. Must be called before the first step. [`StepOutput::smoothed`] then comes in
    /// blocks of some seconds, with all people of [`StepOutput::finished`].
    pub fn smooth_in_two_passes(&mut self) {
        let delay = Delay::two_passes(1.0 / self.method.dt_s);
        self.smoother = Some(FixedLagSmoother::new(self.session, delay, &self.method));
    }

    /// Adds a set that came after its tick was stepped to the smoothed poses. Returns for how many
    /// persons it is useful: none without a delay, of another session, or if its tick has left the
    /// delay. Live poses, boxes and identities do not change.
    pub fn add_late(&mut self, set: &PatchSet) -> u32 {
        let smoother = self
            .smoother
            .as_mut()
            .filter(|_| set.session == self.session);
        smoother.map_or(0, |smoother| {
            smoother.add_late(set, &self.cameras, &self.method)
        })
    }

    fn smoothed(&mut self, tick: Tick) -> Vec<PoseSet> {
        let Some(smoother) = &mut self.smoother else {
            return Vec::new();
        };
        let registry = &self.registry;
        smoother.step(
            tick,
            registry.tracks(),
            registry.undecided_from(),
            &self.method,
        )
    }

    fn see(&mut self, group: &TickGroup) -> u32 {
        let (bodies, method) = (&mut self.bodies, &self.method);
        bodies.clear();
        for track in self.registry.tracks_mut() {
            track.begin(method);
            bodies.push(track.estimator.occluder(method));
        }
        let (cameras, unusable) = (&self.cameras, AtomicU32::new(0));
        let finds_people = self.registry.finds_people();
        let bodies = &*bodies;
        // All work on whole maps, person by person: together the maps are larger than a processor's
        // caches.
        each(self.registry.tracks_mut(), |index, track| {
            let dropped = track.see_all(group, cameras, method, finds_people);
            let estimator = &mut track.estimator;
            estimator.place_views(bodies, index, method);
            estimator.undo_left_right_swaps(method);
            estimator.find_peaks(method);
            // A sum of counts is the same in any order.
            unusable.fetch_add(dropped, Ordering::Relaxed);
        });
        unusable.into_inner()
    }

    fn assign_peaks(&mut self) {
        let (assignments, method) = (&mut self.peak_assignment, &self.method);
        assignments.decide(self.registry.tracks(), &self.bodies, method);
        let assignments = &*assignments;
        each(self.registry.tracks_mut(), |index, track| {
            assignments.carve(index, &mut track.estimator);
        });
    }

    fn separate(&mut self) {
        let (separation, method) = (&mut self.separation, &self.method);
        separation.find(self.registry.tracks(), &self.bodies, method);
        for (index, track) in self.registry.tracks_mut().iter_mut().enumerate() {
            track.estimator.push(separation.push_m(index));
        }
    }

    fn solve(&mut self, stage: fn(&mut Track, &Method)) {
        each(self.registry.tracks_mut(), |_, track| {
            stage(track, &self.method);
        });
    }

    /// The boxes per viewpoint, `horizons` (ticks, one per viewpoint) after the stepped `tick`.
    fn boxes_after(&mut self, tick: Tick, horizons: &[i64]) -> Vec<BoxSet> {
        let (cameras, method) = (&self.cameras, &self.method);
        let viewpoints = self.viewpoints.iter().map(Vec::as_slice);
        let viewpoints = viewpoints.zip(horizons.iter().copied());
        let (tracks, made) = (self.registry.tracks_mut(), &mut self.boxes);
        made.resize_with(tracks.len(), Vec::new);
        each_with(tracks, made, |track, made| {
            track.boxes(viewpoints.clone(), cameras, method, made);
        });
        let set = |(index, (own, horizon)): (usize, (&[CameraIndex], i64))| BoxSet {
            session: self.session,
            tick: tick + horizon,
            viewpoint: ViewpointIndex(index as u16),
            part: 0,
            parts: 1,
            order: Order::Track,
            live: None,
            detection_cameras: self.registry.detecting(own, tick + horizon),
            persons: Vec::new(),
        };
        let mut sets: Vec<BoxSet> = viewpoints.enumerate().map(set).collect();
        for own in &mut self.boxes {
            for (set, boxes) in sets.iter_mut().zip(own.drain(..)) {
                set.persons.extend(boxes);
            }
        }
        sets
    }
}

/// Runs a stage for every person with its index, in parallel if there are several.
fn each(tracks: &mut [Track], stage: impl Fn(usize, &mut Track) + Sync) {
    match tracks {
        [] => {}
        [only] => stage(0, only),
        tracks => tracks
            .par_iter_mut()
            .enumerate()
            .for_each(|(index, track)| stage(index, track)),
    }
}

/// Runs a stage for every person with its element of `results`, in parallel if there are several.
fn each_with<T: Send>(
    tracks: &mut [Track],
    results: &mut [T],
    stage: impl Fn(&mut Track, &mut T) + Sync,
) {
    if let ([only], [result]) = (&mut *tracks, &mut *results) {
        stage(only, result);
        return;
    }
    let own = tracks.par_iter_mut().zip(results.par_iter_mut());
    own.for_each(|(track, result)| stage(track, result));
}
