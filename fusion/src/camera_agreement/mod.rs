//! Do the cameras of a venue agree?
//!
//! Swapped videos, a calibration of last week, a camera that is three frames late: all of these give skeletons, and
//! wrong ones. What tells them is how the sightings and the crops of each camera meet those of the others.
//!
//! ```text
//!   Pipeline::step -> AgreementWatch: keeps what cameras showed lately (`samples`), in bounded memory
//!                      '-> AgreementSamples, now and then, to another thread -> judge -> AgreementReport
//!   judge: `pairs` of cameras on sightings; `time_shift`, `refit`, `lens` on what crops show tick by tick (`lens` on sightings, too),
//!          `refit/resection` on both where somebody moved (which camera was moved, turned or zoomed);
//!          `pose_shift` on sightings and poses, `frozen` on sightings -> a cause in `words`; `sides`, `exchanged`,
//!          `pictures_of_all` on whom all sight alike, or one camera in a picture of its own;
//!          `standing` on people, where all that fits
//! ```
//!
//! Nothing here moves a pose. A report of 28 viewpoints takes some seconds, and is made beside the loop, or at the end of a run.
//! Who judges again and again hands in what was found before ([`JudgedBefore`]).

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
use self::judge::changed::tell_of_changes;
use self::judge::exchanged::ExchangeVotes;
use self::judge::{Judge, sides};
use self::pairs::Partners;
use self::samples::Samples;
use self::standing::Standing;
use crate::align::TickGroup;
use crate::identity::track::Track;
use crate::sightings::diagnosis::Diagnosed;

/// Time between two instants at which it is kept how tall people are and how high they stand, seconds.
const STANDING_EVERY_S: f64 = 0.1;
/// How far keypoints reach in pictures is how far this share of them does.
const REACHING_SHARE: f64 = 0.01;

/// A camera as it is judged.
#[derive(Debug)]
struct JudgedCamera {
    name: String,
    viewpoint: ViewpointIndex,
    size_px: [u32; 2],
    lines: SightLines,
}

/// What does not change during a run.
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

/// Keeps what is needed to say whether the cameras agree.
#[derive(Debug)]
pub struct AgreementWatch {
    cameras: Arc<AgreementCameras>,
    samples: Samples,
    standing: Standing,
}

/// What was kept, for whoever judges it.
#[derive(Debug, Clone)]
pub struct AgreementSamples {
    cameras: Arc<AgreementCameras>,
    samples: Samples,
    standing: Standing,
}

impl AgreementWatch {
    /// Nothing kept yet of the cameras of `venue`, whose network knows `keypoints`.
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

    /// Keeps what crops show of the people who are followed at `tick`; before their peaks are assigned.
    pub(crate) fn note_views(&mut self, tick: Tick, tracks: &[Track]) {
        self.samples.note_views(tick, tracks);
    }

    /// Keeps whom a detection pass found, where people are, and now and then how tall those are who are followed, and how
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

    /// What is kept so far.
    pub fn samples(&self) -> AgreementSamples {
        AgreementSamples {
            cameras: Arc::clone(&self.cameras),
            samples: self.samples.so_far(),
            standing: self.standing.clone(),
        }
    }
}

impl AgreementSamples {
    /// Judges them: for whoever has time to wait.
    pub fn report(&self) -> AgreementReport {
        self.report_after(&mut JudgedBefore::default())
    }

    /// The same where others of the venue were judged `before`: what was kept then already is not looked at again.
    pub fn report_after(&self, before: &mut JudgedBefore) -> AgreementReport {
        let judge = Judge::new(&self.cameras, &self.samples, before);
        let mut report = judge.report();
        if report
            .disagreements
            .iter()
            .any(|told| told.cameras.is_empty())
        {
            forget_who_disagrees(&mut report);
        }
        let mut votes = ExchangeVotes::default();
        report.sighted = self.sighted(&mut votes, before);
        let of_all = judge
            .picture_of_all()
            .or_else(|| self.all_keypoints(&votes, &report));
        if let Some(cause) = of_all {
            self.tell_of_all(cause, &mut report);
        }
        // If anything else is wrong, people stand wherever that puts them.
        if report.disagreements.is_empty() {
            let standing = &self.standing;
            let scale = standing.suspect_scale();
            let tilt = scale.or_else(|| standing.suspect_tilt());
            let of_people = tilt.or_else(|| standing.suspect_floor());
            let of_people = of_people.map(|cause| self.of_all(cause));
            report.disagreements.extend(of_people);
        }
        tell_of_changes(&self.cameras, &self.samples, &mut report);
        report
    }

    /// Something that no camera is named for.
    fn of_all(&self, cause: DisagreementCause) -> Disagreement {
        Disagreement::new(Vec::new(), cause, self.cameras.rate_hz)
    }

    /// Which keypoints are exchanged in all cameras.
    fn all_keypoints(
        &self,
        votes: &ExchangeVotes,
        report: &AgreementReport,
    ) -> Option<DisagreementCause> {
        let exchange = votes.told().filter(|it| *it != KeypointExchange::AllSides);
        if let Some(exchange) = exchange {
            return Some(DisagreementCause::ExchangedKeypoints { exchange });
        }
        let partners = self.cameras.partners.iter().enumerate();
        sides::are_exchanged(&report.sighted.diagnosis).then(|| DisagreementCause::KeypointOrder {
            moved: partners.filter(|(own, other)| own != *other).count(),
            sides: true,
        })
    }

    /// Says what is wrong with all cameras alike, in the place of all that rests on poses, which no body fits then.
    fn tell_of_all(&self, cause: DisagreementCause, report: &mut AgreementReport) {
        let all = &mut report.disagreements;
        all.retain(|told| told.cause.is_of_pictures());
        forget_who_disagrees(report);
        report.disagreements.insert(0, self.of_all(cause));
    }

    /// How far right and down keypoints are in the pictures, as shares of these; one in a hundred may be farther.
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
            reached_by(shares, REACHING_SHARE)
        };
        Some([along(0)?, along(1)?])
    }

    /// What detection passes found, and what became of it; asks all bodies for `votes`.
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
            diagnosed.count(&bodies, &mut report.diagnosis, |body| votes.ask(body));
            (Arc::clone(pass), bodies)
        });
        before.bodies = bodies.collect();
        report.reach = self.reach();
        let viewpoints: BTreeSet<ViewpointIndex> = all.iter().map(|c| c.viewpoint).collect();
        report.viewpoints = viewpoints.len() as u64;
        report
    }
}

/// Knows nothing any more of cameras that disagree, but for those of which something is told.
fn forget_who_disagrees(report: &mut AgreementReport) {
    let all = &report.disagreements;
    for (name, camera) in &mut report.cameras {
        let is_told = all.iter().any(|told| told.cameras.contains(name));
        if camera.verdict == AgreementVerdict::Disagrees && !is_told {
            *camera = CameraAgreement::default();
        }
    }
}

/// Per keypoint the one on the other side of the body; itself where there is none.
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
