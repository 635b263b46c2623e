//! All steps of a calibration from a moving point.

use std::collections::{BTreeMap, BTreeSet};

use farfield_proto::camera::{CameraError, CameraModel};
use farfield_proto::frames::Transform;
use nalgebra::{Isometry3, Translation3};

use super::assess::{Found, assess};
use super::board::{CORNERS_PER_INSTANT, by_board};
use super::chain::{Chain, chain};
use super::curve::{Clocks, refine_curve};
use super::refine::{Refined, refine};
use super::request::{CalibrationError, PointCamera, PointRequest, RigidBoard, Timing};
use super::timing::{at_common_moments, join_clocks, set_own_clock};
use super::venue::alignment_findings;
use super::view::{Track, View};
use crate::adjustment::{CameraState, Path, Problem, covariance};
use crate::alignment::{Alignment, Anchors, Known, Similarity};
use crate::formats::{CameraRecord, ExportError, Format, export};
use crate::report::{FieldReport, Report, field_camera};

/// Least number of sightings of a camera.
const LEAST_SIGHTINGS: usize = 20;
/// Accepted frame rates, 1/s.
const RATES_HZ: [f64; 2] = [0.1, 1e5];
/// Accepted gates, pixels: below, a search takes too long; above, anything agrees.
const GATES_PX: [f64; 2] = [0.1, 50.0];
/// Tolerance for the number of a frame to be whole.
const WHOLE: f64 = 1e-6;
/// Factor on the gate for the search of clocks, which are slightly off.
const CLOCK_GATE: f64 = 2.0;
/// Factor on the gate for poses from interpolated sights.
const INTERPOLATED_GATE: f64 = 4.0;

/// A stage of a calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stage {
    /// Finds the lags of the clocks: the longest stage if they are unknown.
    Clocks,
    /// Finds rough poses.
    Poses,
    /// Adjusts all cameras and points together.
    Adjustment,
    /// Assesses the result.
    Report,
}

/// One camera with its pose.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundCamera {
    /// Its name.
    pub name: String,
    /// Width and height of its pictures, pixels.
    pub size_px: [u32; 2],
    /// Lens, pose in the venue, and clock.
    pub state: CameraState,
}

impl FoundCamera {
    /// The camera model for the other crates.
    ///
    /// # Errors
    /// [`CameraError`] if its numbers are invalid, or its lens model folds inside the picture.
    pub fn model(&self) -> Result<CameraModel, CameraError> {
        CameraModel::new(
            &self.name,
            self.size_px,
            self.state.intrinsics,
            self.state.lens(),
            Transform::new(self.camera_from_world()),
        )
    }

    /// The record for calibration files.
    pub fn record(&self) -> CameraRecord {
        CameraRecord {
            name: self.name.clone(),
            size_px: self.size_px,
            intrinsics: self.state.intrinsics,
            lens: self.state.lens(),
            camera_from_world: Some(self.camera_from_world()),
        }
    }

    fn camera_from_world(&self) -> Isometry3<f64> {
        let rotation = self.state.camera_from_world;
        let shift = Translation3::from(-(rotation * self.state.center_w));
        Isometry3::from_parts(shift, rotation)
    }
}

/// A position of the point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Seconds on the clock of the camera with the most sights; the frame if cameras are synchronised.
    pub time_s: f64,
    /// Venue, metres.
    pub position_m: [f64; 3],
    /// The number of cameras that saw it.
    pub cameras: usize,
}

/// The result of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct PointCalibration {
    /// The cameras that have a pose, in the order of the request.
    pub cameras: Vec<FoundCamera>,
    /// The positions of the point that at least two of them saw, in the order of time.
    pub path: Vec<PathPoint>,
    /// The assessment. Check [`Report::passes`] before use.
    pub report: Report,
}

impl PointCalibration {
    /// The calibration file.
    ///
    /// # Errors
    /// If no camera has a pose.
    pub fn toml(&self) -> Result<String, ExportError> {
        let records: Vec<CameraRecord> = self.cameras.iter().map(FoundCamera::record).collect();
        let files = export(&records, Format::Farfield)?;
        Ok(files.into_iter().map(|file| file.text).collect())
    }

    /// Adds the report on the field if `alignment` gives metres and a floor. The field contains the path, the known places, and
    /// the court that was clicked.
    pub(crate) fn with_field(mut self, alignment: &Alignment, anchors: &Anchors) -> Self {
        if !(alignment.has_scale && alignment.has_floor) {
            return self;
        }
        let cameras = self.cameras.iter().zip(&self.report.cameras);
        let cameras = cameras.map(|(it, report)| field_camera(it.state, it.size_px, report));
        let path = self.path.iter().map(|it| it.position_m);
        let known = anchors.marks.iter().flat_map(|marks| &marks.known);
        let known = known.filter_map(|it| match it.known {
            Known::Place(at_m) => Some(at_m),
            Known::OnLine(_) => None,
        });
        let court = anchors.marks.as_ref().and_then(|it| it.court.as_ref());
        let field = FieldReport::new(&cameras.collect::<Vec<_>>(), path, known, court);
        let finding = field.as_ref().and_then(FieldReport::finding);
        self.report.findings.extend(finding);
        self.report.field = field;
        self
    }
}

/// Finds the poses and clocks of cameras from their sightings of one moving point. `progress` is called at the start of every
/// stage.
///
/// A result can still fail: its findings are in [`PointCalibration::report`]. The same request gives the same bits.
///
/// # Errors
/// [`CalibrationError`] if the request is unusable: too few cameras or sightings, impossible lenses or rates, no two cameras
/// that agree, known places that do not fit (such as those of a mirror image).
pub fn calibrate(
    request: &PointRequest,
    progress: &mut dyn FnMut(Stage),
) -> Result<PointCalibration, CalibrationError> {
    check_request(request)?;
    let tracks = request.cameras.iter().map(|camera| {
        let track = Track::new(camera)?;
        if track.seen.len() < LEAST_SIGHTINGS {
            return Err(CalibrationError::TooFewSightings {
                camera: camera.name.clone(),
                found: track.seen.len(),
                least: LEAST_SIGHTINGS,
            });
        }
        Ok(track)
    });
    let mut tracks: Vec<Track> = tracks.collect::<Result<_, _>>()?;
    let (chain, refined) = if request.timing == Timing::Synchronised {
        synchronised(&tracks, request, progress)?
    } else {
        by_clocks(&mut tracks, request, progress)?
    };
    progress(Stage::Report);
    finish(request, &chain, refined)
}

/// Refuses a request that would fail whatever the cameras saw. A caller checks this before it detects the point.
///
/// # Errors
/// [`CalibrationError`] for too few cameras or two of one name, and for invalid numbers: rates, offsets, the gate, known facts
/// about the venue.
pub fn check_request(request: &PointRequest) -> Result<(), CalibrationError> {
    if request.cameras.len() < 2 {
        return Err(CalibrationError::TooFewCameras {
            found: request.cameras.len(),
        });
    }
    let mut names: Vec<&str> = request.cameras.iter().map(|c| c.name.as_str()).collect();
    names.sort_unstable();
    if let Some(twice) = names.windows(2).find(|w| w[0] == w[1]) {
        return Err(CalibrationError::SameName {
            camera: twice[0].to_owned(),
        });
    }
    check_gate(request.gate_px)?;
    check_frames(request)?;
    if let Some(board) = &request.board {
        check_board(board, request)?;
    }
    check_anchors(&request.anchors)?;
    let clocks = request
        .cameras
        .iter()
        .filter(|_| request.timing != Timing::Synchronised);
    for camera in clocks {
        let found = camera.rate_hz.unwrap_or(f64::NAN);
        if !(RATES_HZ[0]..=RATES_HZ[1]).contains(&found) {
            return Err(CalibrationError::Rate {
                camera: camera.name.clone(),
                found,
            });
        }
        let offset_s = camera.offset_s.unwrap_or(f64::NAN);
        if request.timing == Timing::Clocks && !offset_s.is_finite() {
            return Err(CalibrationError::Offset {
                camera: camera.name.clone(),
            });
        }
    }
    Ok(())
}

/// Refuses gates with which the search for clocks would not end.
fn check_gate(gate_px: f64) -> Result<(), CalibrationError> {
    if (GATES_PX[0]..=GATES_PX[1]).contains(&gate_px) {
        return Ok(());
    }
    let [least, most] = GATES_PX;
    Err(CalibrationError::Request(format!(
        "`gate_px`: found {gate_px}, expected {least} to {most} pixels"
    )))
}

/// Refuses fractional frame numbers of synchronised cameras, which belong to no moment.
fn check_frames(request: &PointRequest) -> Result<(), CalibrationError> {
    if request.timing != Timing::Synchronised {
        return Ok(());
    }
    for camera in &request.cameras {
        let is_between = |frame: f64| !frame.is_finite() || (frame - frame.round()).abs() > WHOLE;
        if let Some(sighting) = camera.sightings.iter().find(|s| is_between(s.frame)) {
            return Err(CalibrationError::Request(format!(
                "camera `{}`: found frame {}, expected whole frames of synchronised cameras; give rates and offsets, or \
                 let the clocks be estimated",
                camera.name, sighting.frame
            )));
        }
    }
    Ok(())
}

/// Refuses an impossible board, and sights whose numbers do not belong to its corners.
fn check_board(board: &RigidBoard, request: &PointRequest) -> Result<(), CalibrationError> {
    let refuse = |text: String| Err(CalibrationError::Request(text));
    let RigidBoard { squares, square_m } = board;
    if request.timing != Timing::Synchronised {
        return refuse(
            "a board needs synchronised cameras: found clocks that are given or unknown; leave out the board, or --clocks"
                .to_owned(),
        );
    }
    let is_square = square_m.is_finite() && *square_m > 0.0;
    let count = board.corner_count();
    if !is_square || !(4..=CORNERS_PER_INSTANT).contains(&count) {
        return refuse(format!(
            "a board of {} x {} squares of {square_m} m: expected 4 to {CORNERS_PER_INSTANT} inner corners, and a side above 0",
            squares[0], squares[1]
        ));
    }
    for camera in &request.cameras {
        let number = |frame: f64| frame.round() as usize % CORNERS_PER_INSTANT;
        let beyond = camera.sightings.iter().find(|it| number(it.frame) >= count);
        if let Some(found) = beyond {
            return refuse(format!(
                "camera `{}`: found number {}, which is corner {}, expected corners below {count} of a board of {} x {} squares: a number is \
                 {CORNERS_PER_INSTANT} times the instant, plus the corner",
                camera.name,
                found.frame,
                number(found.frame),
                squares[0],
                squares[1]
            ));
        }
    }
    Ok(())
}

pub(crate) fn check_anchors(anchors: &Anchors) -> Result<(), CalibrationError> {
    let refuse = |text: String| Err(CalibrationError::Request(text));
    let places = anchors.centers_m.iter().map(|(name, at)| (name, at));
    let places = places.chain(anchors.points.iter().map(|it| (&it.name, &it.position_m)));
    for (name, at_m) in places {
        if !at_m.iter().all(|v| v.is_finite()) {
            return refuse(format!(
                "known place of `{name}`: found {at_m:?}, expected three finite numbers of metres"
            ));
        }
    }
    for it in &anchors.distances {
        if !(it.distance_m.is_finite() && it.distance_m > 0.0) {
            return refuse(format!(
                "distance of `{}` and `{}`: found {} m, expected a finite number above 0",
                it.first, it.second, it.distance_m
            ));
        }
        if it.first == it.second {
            return refuse(format!(
                "found a distance of `{}` to itself, expected two cameras",
                it.first
            ));
        }
    }
    let known = anchors.centers_m.len() + anchors.points.len();
    if (1..3).contains(&known) && anchors.distances.is_empty() && anchors.marks.is_none() {
        let names: Vec<&str> = anchors.centers_m.iter().map(|(n, _)| n.as_str()).collect();
        return refuse(format!(
            "found {known} known places ({}), which determine nothing: give three places, or a distance",
            names.join(", ")
        ));
    }
    Ok(())
}

fn synchronised(
    tracks: &[Track],
    request: &PointRequest,
    progress: &mut dyn FnMut(Stage),
) -> Result<(Chain, Refined), CalibrationError> {
    progress(Stage::Poses);
    let views: Vec<View> = tracks.iter().map(Track::by_frame).collect();
    if let Some(board) = &request.board {
        let (chain, refined) = by_board(&views, board, request.lenses, request.gate_px);
        check_chain(&chain, request)?;
        return Ok((chain, refined));
    }
    let chain = chain(&views, request.gate_px, request.seed);
    check_chain(&chain, request)?;
    progress(Stage::Adjustment);
    let refined = refine(&views, &chain.cameras, request.lenses, request.gate_px);
    Ok((chain, refined))
}

fn by_clocks(
    tracks: &mut [Track],
    request: &PointRequest,
    progress: &mut dyn FnMut(Stage),
) -> Result<(Chain, Refined), CalibrationError> {
    progress(Stage::Clocks);
    let rates = request.cameras.iter().map(|c| c.rate_hz.unwrap_or(1.0));
    let rates: Vec<f64> = rates.collect();
    let (joined, clocks) = if request.timing == Timing::Clocks {
        for ((track, camera), rate_hz) in tracks.iter_mut().zip(&request.cameras).zip(&rates) {
            set_own_clock(track, *rate_hz);
            track.state.pivot_s += camera.offset_s.unwrap_or(0.0);
        }
        (vec![true; tracks.len()], Clocks::Given)
    } else {
        let gate_px = CLOCK_GATE * request.gate_px;
        let joined = join_clocks(tracks, &rates, gate_px, request.seed);
        (joined, Clocks::Free)
    };
    progress(Stage::Poses);
    let views = at_common_moments(tracks, &joined);
    let gate_px = INTERPOLATED_GATE * request.gate_px;
    let chain = chain(&views, gate_px, request.seed);
    check_chain(&chain, request)?;
    progress(Stage::Adjustment);
    let gate_px = CLOCK_GATE * request.gate_px;
    let refined = refine_curve(
        tracks,
        &views,
        &chain.cameras,
        request.lenses,
        clocks,
        gate_px,
    );
    let refined = refined.ok_or_else(|| nothing_agrees(&chain, request))?;
    Ok((chain, refined))
}

fn check_chain(chain: &Chain, request: &PointRequest) -> Result<(), CalibrationError> {
    if chain.count() >= 2 {
        return Ok(());
    }
    Err(nothing_agrees(chain, request))
}

fn nothing_agrees(chain: &Chain, request: &PointRequest) -> CalibrationError {
    let best = chain
        .pairs
        .iter()
        .max_by(|a, b| a.share().total_cmp(&b.share()));
    let name = |index: Option<usize>| {
        let camera = index.and_then(|i| request.cameras.get(i));
        camera.map_or_else(String::new, |camera: &PointCamera| camera.name.clone())
    };
    CalibrationError::NothingAgrees {
        first: name(best.map(|pair| pair.first)),
        second: name(best.map(|pair| pair.second)),
        moments: best.map_or(0, |pair| pair.common),
        share_percent: best.map_or(0.0, |pair| 100.0 * pair.share()),
    }
}

fn finish(
    request: &PointRequest,
    chain: &Chain,
    refined: Refined,
) -> Result<PointCalibration, CalibrationError> {
    let named = refined.posed.iter().zip(&refined.problem.cameras);
    let named: Vec<(String, CameraState)> = named
        .filter_map(|(i, camera)| Some((request.cameras.get(*i)?.name.clone(), camera.state)))
        .collect();
    let has_pose = |camera: &&PointCamera| named.iter().any(|(name, _)| *name == camera.name);
    let cameras = request.cameras.iter();
    let without: Vec<&str> = cameras
        .filter(|camera| !has_pose(camera))
        .map(|camera| camera.name.as_str())
        .collect();
    let anchors = request.anchors.without(&without);
    let mut alignment = anchors.align(&named).map_err(CalibrationError::Alignment)?;
    // Otherwise metres are those of the squares.
    alignment.has_scale |= request.board.is_some();
    let found = Found {
        request,
        chain,
        covariance: covariance(&refined.problem),
        problem: refined.problem,
        posed: refined.posed,
        alignment,
        named,
        anchors,
    };
    let mut report = assess(&found);
    report
        .findings
        .extend(alignment_findings(&found, &report.cameras));
    report.findings.sort_by_key(|finding| !finding.is_wrong());
    let cameras = found.posed.iter().zip(&found.problem.cameras);
    let cameras = cameras.filter_map(|(i, adjusted)| {
        let camera = request.cameras.get(*i)?;
        Some(FoundCamera {
            name: camera.name.clone(),
            size_px: camera.size_px,
            state: alignment.venue_from_found.apply_to_camera(&adjusted.state),
        })
    });
    let calibration = PointCalibration {
        cameras: cameras.collect(),
        path: path(&found.problem, &alignment.venue_from_found),
        report,
    };
    Ok(calibration.with_field(&alignment, &found.anchors))
}

/// The point at each moment that at least two cameras saw; along a curve, one moment per knot's span.
fn path(problem: &Problem, venue: &Similarity) -> Vec<PathPoint> {
    let mut seen: BTreeMap<usize, (f64, BTreeSet<usize>)> = BTreeMap::new();
    for observation in &problem.observations {
        let Some(camera) = problem.cameras.get(observation.camera) else {
            continue;
        };
        let (moment, time_s) = match &problem.path {
            Path::Points(_) => (observation.point, observation.frame),
            Path::Bodies(bodies) => (bodies.moment(observation.point), observation.frame),
            Path::Curve(spline) => {
                let time_s = camera.state.time_s(observation.frame);
                let span = (time_s - spline.start_s) / spline.spacing_s;
                (span.max(0.0) as usize, time_s)
            }
        };
        let entry = seen.entry(moment).or_insert((time_s, BTreeSet::new()));
        entry.1.insert(observation.camera);
    }
    let several = seen
        .into_iter()
        .filter(|(_, (_, cameras))| cameras.len() >= 2);
    let points = several.filter_map(|(moment, (time_s, cameras))| {
        let point = match &problem.path {
            Path::Points(points) => *points.get(moment)?,
            Path::Bodies(bodies) => bodies.poses.get(moment)?.translation.vector,
            Path::Curve(spline) => spline.at(time_s)?,
        };
        Some(PathPoint {
            time_s,
            position_m: venue.apply(&point).into(),
            cameras: cameras.len(),
        })
    });
    points.collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_proto::calibration::Calibration;
    use farfield_proto::camera::{Distortion, Intrinsics};
    use nalgebra::{UnitQuaternion, Vector3};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_written_calibration_reads_back(
            turn in prop::array::uniform3(-1.8f64..1.8),
            center in prop::array::uniform3(-50.0f64..50.0),
            k1 in -0.05f64..0.05,
            k4 in prop::sample::select(vec![0.0, 0.01]),
        ) {
            let intrinsics = Intrinsics { fx_px: 1234.5, fy_px: 1230.1, cx_px: 955.2, cy_px: 601.7 };
            let lens = Distortion { k1, k4, ..Distortion::default() };
            let state = CameraState {
                camera_from_world: UnitQuaternion::from_scaled_axis(Vector3::from(turn)),
                center_w: Vector3::from(center),
                ..CameraState::at_origin(intrinsics, lens)
            };
            let found = FoundCamera {
                name: "north \"east\"".to_owned(),
                size_px: [1920, 1200],
                state,
            };
            let text = PointCalibration { cameras: vec![found], path: Vec::new(), report: Report::default() }.toml().unwrap();
            let read = Calibration::parse(&text, Path::new("calibration.toml")).unwrap();
            let camera = &read.cameras["north \"east\""];
            prop_assert_eq!(camera.intrinsics(), &intrinsics);
            prop_assert_eq!(*camera.lens(), lens.into());
            prop_assert_eq!(camera.size_px(), [1920, 1200]);
            prop_assert!((camera.center().coordinates_m().coords - state.center_w).norm() < 1e-9);
            let rotation = camera.camera_from_world().isometry().rotation;
            prop_assert!(rotation.angle_to(&state.camera_from_world) < 1e-9);
        }
    }
}
