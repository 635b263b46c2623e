//! Do the cameras of a venue agree?
//!
//! Swapped videos, an outdated calibration, a camera that is three frames late: all of these give skeletons, and wrong
//! ones. They show when the sightings and crops of each camera are compared with those of the others.
//!
//! ```text
//!   Pipeline::step -> AgreementWatch: keeps what cameras showed lately (`samples`), in bounded memory
//!                      '-> AgreementSamples, now and then, to another thread -> judge -> AgreementReport
//!   judge: `pairs` and `frozen` use sightings; `time_shift` uses crops, tick by tick; `pose_shift` uses sightings and poses;
//!          `lens` and `explain/displaced` use crops and sightings, if a person moved (which camera was moved, turned, zoomed);
//!          `exchanged` and `pictures_of_all` use people in all cameras; `standing` uses people, if all else fits
//!          -> a cause, with its sentences from `words`
//! ```
//!
//! Nothing here moves a pose. A report of 28 viewpoints takes some seconds. It is made on another thread, or at the end
//! of a run. A caller that judges repeatedly passes the earlier results ([`JudgedBefore`]).

mod explain;
#[cfg(test)]
mod fixture;
mod frozen;
mod geometry;
mod judge;
mod lens;
mod no_people;
mod pairs;
mod report;
mod samples;
mod standing;
#[cfg(test)]
mod tests;
mod time_shift;
mod words;

use std::collections::BTreeSet;
use std::sync::Arc;

use farfield_proto::camera::CameraModel;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::message::PoseSet;
use farfield_proto::message::agreement::{AgreementVerdict, CameraAgreement};
use farfield_proto::order_statistics::reached_by;
use farfield_proto::tick::Tick;
use farfield_proto::venue::parameters::BirthParameters;
use farfield_proto::venue::{Field, Venue};

pub use self::judge::before::JudgedBefore;
pub use self::report::{
    AgreementReport, CameraDetails, Disagreement, DisagreementCause, KeypointExchange,
    PictureOfAll, SightedReport,
};

use self::geometry::SightLines;
use self::judge::Judge;
use self::judge::changed::report_part_of_time;
use self::judge::exchanged::{ExchangeVotes, are_sides_exchanged};
use self::pairs::Partners;
use self::samples::Samples;
use self::standing::Standing;
use crate::align::TickGroup;
use crate::identity::track::Track;
use crate::sightings::diagnosis::Diagnosed;

/// Time between two samples of how tall people are and how high they stand, seconds.
const STANDING_EVERY_S: f64 = 0.1;
/// Share of the keypoints that lie beyond the reported reach.
const BEYOND_REACH_SHARE: f64 = 0.01;

#[derive(Debug)]
struct JudgedCamera {
    name: String,
    viewpoint: ViewpointIndex,
    size_px: [u32; 2],
    lines: SightLines,
}

/// Facts that stay the same during a run.
#[derive(Debug)]
struct AgreementCameras {
    all: Vec<JudgedCamera>,
    partners: Partners,
    rate_hz: f64,
    models: Vec<(ViewpointIndex, CameraModel)>,
    keypoints: KeypointSet,
    field: Field,
    births: BirthParameters,
}

impl AgreementCameras {
    fn lines(&self) -> Vec<SightLines> {
        self.all.iter().map(|camera| camera.lines.clone()).collect()
    }
}

/// Collects samples of what cameras show, to judge whether they agree.
#[derive(Debug)]
pub struct AgreementWatch {
    cameras: Arc<AgreementCameras>,
    samples: Samples,
    standing: Standing,
}

/// Samples that can be judged, on any thread.
#[derive(Debug, Clone)]
pub struct AgreementSamples {
    cameras: Arc<AgreementCameras>,
    samples: Samples,
    standing: Standing,
}

impl AgreementWatch {
    /// Starts without samples, for the cameras of `venue` and the `keypoints` of its network.
    pub fn new(venue: &Venue, keypoints: &KeypointSet) -> Self {
        let all: Vec<JudgedCamera> = venue
            .cameras
            .iter()
            .map(|camera| JudgedCamera {
                name: camera.model.name().to_owned(),
                viewpoint: camera.viewpoint,
                size_px: camera.model.size_px(),
                lines: SightLines::from_camera(&camera.model),
            })
            .collect();
        Self {
            samples: Samples::new(venue.rate_hz, all.len()),
            cameras: Arc::new(AgreementCameras {
                all,
                partners: partners(keypoints),
                rate_hz: venue.rate_hz,
                models: venue
                    .cameras
                    .iter()
                    .map(|camera| (camera.viewpoint, camera.model.clone()))
                    .collect(),
                keypoints: keypoints.clone(),
                field: venue.field,
                births: venue.parameters.births.clone(),
            }),
            standing: Standing::new(keypoints, venue),
        }
    }

    /// Keeps what crops show of tracked people at `tick`. Called before peaks are assigned.
    pub(crate) fn note_views(&mut self, tick: Tick, tracks: &[Track]) {
        self.samples.note_views(tick, tracks);
    }

    /// Keeps the sightings of a detection pass and the poses. Every 0.1 s it also keeps how tall tracked people are and how
    /// high they stand.
    pub(crate) fn note_found(&mut self, group: &TickGroup, tracks: &[Track], poses: &PoseSet) {
        self.samples.note_poses(poses);
        let every = ((STANDING_EVERY_S * self.cameras.rate_hz).round() as i64).max(1);
        if group.tick.0 % every == 0 {
            self.standing.note(tracks);
        }
        if group.sighting_sets.is_empty() {
            return;
        }
        let all = &self.cameras.all;
        let is_own = |camera: usize, viewpoint: u16| {
            let camera: Option<&JudgedCamera> = all.get(camera);
            camera.is_some_and(|camera| camera.viewpoint.0 == viewpoint)
        };
        let n_keypoints = self.cameras.partners.len();
        self.samples.note_pass(group, n_keypoints, is_own);
    }

    /// A copy of the samples so far.
    pub fn samples(&self) -> AgreementSamples {
        AgreementSamples {
            cameras: Arc::clone(&self.cameras),
            samples: self.samples.so_far(),
            standing: self.standing.clone(),
        }
    }
}

impl AgreementSamples {
    /// Judges the samples, which can take seconds.
    pub fn report(&self) -> AgreementReport {
        self.report_after(&mut JudgedBefore::default())
    }

    /// The same, with results of earlier samples of the venue in `before`: samples judged then are not judged again.
    pub fn report_after(&self, before: &mut JudgedBefore) -> AgreementReport {
        let judge = Judge::new(&self.cameras, &self.samples, before);
        let mut report = judge.report();
        if report.disagreements.iter().any(|it| it.cameras.is_empty()) {
            clear_unnamed_verdicts(&mut report);
        }
        let mut votes = ExchangeVotes::default();
        report.sighted = self.sighted(&mut votes, before);
        let of_all = judge
            .picture_of_all()
            .or_else(|| self.exchanged_keypoints(&votes, &report));
        if let Some(cause) = of_all {
            self.report_for_all(cause, &mut report);
        }
        // Any other mistake moves people, so their statures and heights prove nothing then.
        if report.disagreements.is_empty() {
            let standing = &self.standing;
            let scale = standing.suspect_scale();
            let tilt = scale.or_else(|| standing.suspect_tilt());
            let of_people = tilt.or_else(|| standing.suspect_floor());
            let of_people = of_people.map(|cause| self.without_cameras(cause));
            report.disagreements.extend(of_people);
        }
        report_part_of_time(&self.cameras, &self.samples, &mut report);
        report
    }

    fn without_cameras(&self, cause: DisagreementCause) -> Disagreement {
        Disagreement::new(Vec::new(), cause, self.cameras.rate_hz)
    }

    /// Which keypoints are exchanged in all cameras.
    fn exchanged_keypoints(
        &self,
        votes: &ExchangeVotes,
        report: &AgreementReport,
    ) -> Option<DisagreementCause> {
        let exchange = votes
            .winner()
            .filter(|it| *it != KeypointExchange::AllSides);
        if let Some(exchange) = exchange {
            return Some(DisagreementCause::ExchangedKeypoints { exchange });
        }
        let partners = self.cameras.partners.iter().enumerate();
        are_sides_exchanged(&report.sighted.diagnosis).then(|| DisagreementCause::KeypointOrder {
            moved: partners.filter(|(own, other)| own != *other).count(),
            sides: true,
        })
    }

    /// Reports a cause that all cameras share. It replaces all causes that depend on poses, because poses are wrong then.
    fn report_for_all(&self, cause: DisagreementCause, report: &mut AgreementReport) {
        let all = &mut report.disagreements;
        all.retain(|it| it.cause.is_of_pictures());
        clear_unnamed_verdicts(report);
        report.disagreements.insert(0, self.without_cameras(cause));
    }

    /// How far right and down keypoints are in the pictures, as shares of their size. One in a hundred may be farther.
    fn reach(&self) -> Option<[f64; 2]> {
        let passes = self.samples.passes.iter();
        let by_camera = passes.flat_map(|pass| pass.of_camera.iter().zip(&self.cameras.all));
        let shares = by_camera.flat_map(|(bodies, camera)| {
            let size_px = camera.size_px.map(f64::from);
            let seen = bodies.iter().flatten().flatten();
            seen.map(move |seen| {
                let [x, y] = seen.pixel.map(f64::from);
                [x / size_px[0], y / size_px[1]]
            })
        });
        let shares: Vec<[f64; 2]> = shares.collect();
        let along = |axis: usize| {
            let shares = shares.iter().map(|share| share[axis]);
            reached_by(shares, BEYOND_REACH_SHARE)
        };
        Some([along(0)?, along(1)?])
    }

    /// The sightings of detection passes and the bodies reconstructed from them. Adds every body to `votes`.
    fn sighted(&self, votes: &mut ExchangeVotes, before: &mut JudgedBefore) -> SightedReport {
        let AgreementCameras {
            all,
            models,
            keypoints,
            field,
            births,
            ..
        } = &*self.cameras;
        let diagnosed = Diagnosed {
            cameras: models,
            keypoints,
            field,
            parameters: births,
        };
        let mut report = SightedReport {
            passes: self.samples.n_passes,
            ..SightedReport::default()
        };
        for (camera, count) in all.iter().zip(&self.samples.n_sightings) {
            report.by_camera.insert(camera.name.clone(), *count);
        }
        let bodies = self.samples.passes.iter().map(|pass| {
            let known = before.bodies.take(pass);
            let bodies = known.unwrap_or_else(|| diagnosed.bodies(&pass.sightings()));
            votes.begin_pass();
            diagnosed.count(&bodies, &mut report.diagnosis, |body| votes.add(body));
            (Arc::clone(pass), bodies)
        });
        before.bodies = bodies.collect();
        report.reach = self.reach();
        let viewpoints: BTreeSet<ViewpointIndex> = all.iter().map(|c| c.viewpoint).collect();
        report.viewpoints = viewpoints.len() as u64;
        report
    }
}

/// Clears the results of cameras that disagree and that no disagreement names.
fn clear_unnamed_verdicts(report: &mut AgreementReport) {
    let all = &report.disagreements;
    for (name, camera) in &mut report.cameras {
        let is_named = all.iter().any(|it| it.cameras.contains(name));
        if camera.verdict == AgreementVerdict::Disagrees && !is_named {
            *camera = CameraAgreement::default();
        }
    }
}

/// Per keypoint its partner on the other side of the body, or itself if it has none.
fn partners(keypoints: &KeypointSet) -> Partners {
    let other = |name: &String| match name.split_once('_') {
        Some(("left", part)) => Some(format!("right_{part}")),
        Some(("right", part)) => Some(format!("left_{part}")),
        _ => None,
    };
    let names = keypoints.names().iter().enumerate();
    names
        .map(|(index, name)| {
            other(name)
                .and_then(|o| keypoints.index_of(&o))
                .unwrap_or(index)
        })
        .collect()
}
