//! `farfield calibrate points`: computes camera poses from a single moving point.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::ensure;
use clap::{Args, ValueEnum};
use farfield_calibration::points::{
    Lenses, PointCamera, PointRequest, RigidBoard, Stage, Timing, calibrate, check_request, parse,
};
use farfield_node::process::{NodeError, say};

use super::convert::size;
use super::known::KnownArgs;
use super::lenses::{Lens, lens_of};
use super::metres::{OtherScale, metres};
use super::results::{OutputArgs, RequestFacts, without_pose, write_results};
use super::seen::{SeenArgs, by_camera};
use super::{Judged, read};

/// Arguments of `farfield calibrate points`.
#[derive(Debug, Args)]
pub(super) struct PointsArgs {
    /// Image positions of the point: NAME.txt, with `frame x y` per line.
    ///
    /// Distorted pixels; the centre of the first is (0, 0). The file has the name of the camera. At most one point per
    /// frame is allowed: the detector decides, and up to a tenth may be wrong.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    #[command(flatten)]
    solve: SolveArgs,
    /// The points are corners of a Charuco board: squares across and down.
    ///
    /// The board counts as one rigid body: the number of a sight is 1000 times the instant, plus the number of the
    /// corner, row by row as in OpenCV. Cameras are then connected even if each corner is seen by only two of them, and
    /// the squares give the scale.
    #[arg(long, value_name = "AxB", value_parser = size, requires = "square_mm", hide_short_help = true)]
    charuco: Option<[u32; 2]>,
    /// Side of a square of that board, millimetres.
    #[arg(long, value_name = "MM", requires = "charuco", hide_short_help = true)]
    square_mm: Option<f64>,
    #[command(flatten)]
    pub(super) output: OutputArgs,
}

/// Known facts, and options of the solver.
#[derive(Debug, Args)]
pub(super) struct SolveArgs {
    #[command(flatten)]
    pub(super) cameras: SeenArgs,
    #[command(flatten)]
    known: KnownArgs,
    /// Lens parameters to optimise: none, focal, all.
    ///
    /// none, the default: lenses stay as given; focal: focal lengths, near the given ones; all: the whole lens.
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "none",
        hide_default_value = true,
        hide_possible_values = true
    )]
    free: FreeLens,
    /// Distance in pixels within which sights agree during the rough estimate.
    #[arg(long, value_name = "PX", default_value_t = 3.0, hide_short_help = true)]
    gate_px: f64,
    /// Seed of the random samples.
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
}

/// Lens parameters to optimise.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum FreeLens {
    None,
    Focal,
    All,
}

/// Computes the camera poses, writes calibration and sheet, and prints their quality.
///
/// # Errors
/// [`NodeError::Refused`] where the input does not determine a calibration, [`NodeError::Failed`] for errors of the
/// disk.
pub(super) fn from_points(args: &PointsArgs) -> Result<Judged, NodeError> {
    let prepared = || {
        let files = by_camera(&args.seen)?;
        let lenses = args.solve.cameras.needed_lenses()?;
        let names: Vec<&str> = files.keys().map(String::as_str).collect();
        let request = args
            .solve
            .request(&names, |name| lens_of(&lenses, name).cloned())?;
        let request = PointRequest {
            board: args.board(),
            ..request
        };
        check_request(&request)?;
        Ok((request, files))
    };
    let (request, files) = prepared().map_err(NodeError::Refused)?;
    args.output.refuse_existing()?;
    solve(request, &files, &args.output)
}

impl PointsArgs {
    /// The board of the corners, if given.
    fn board(&self) -> Option<RigidBoard> {
        let (squares, square_mm) = self.charuco.zip(self.square_mm)?;
        Some(RigidBoard {
            squares,
            square_m: square_mm / 1000.0,
        })
    }
}

/// Solves `request` with the sightings in `files`; a camera without a file has none.
///
/// # Errors
/// As [`from_points`].
pub(super) fn solve(
    request: PointRequest,
    files: &BTreeMap<String, PathBuf>,
    output: &OutputArgs,
) -> Result<Judged, NodeError> {
    let names: Vec<String> = request.cameras.iter().map(|it| it.name.clone()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let known = request.anchors.clone();
    let request = with_sightings(request, files).map_err(NodeError::Refused)?;
    let progress = &mut |stage: Stage| {
        say(format_args!(
            "{}",
            match stage {
                Stage::Clocks => "estimating clock offsets",
                Stage::Poses => "estimating camera poses",
                Stage::Adjustment => "adjusting all cameras together",
                Stage::Report => "measuring the quality",
            }
        ));
    };
    let found = calibrate(&request, progress).map_err(NodeError::refused)?;
    let without = without_pose(&found, &names);
    let other = request
        .board
        .map_or(OtherScale::Nothing, |board| OtherScale::Board {
            square_mm: 1000.0 * board.square_m,
        });
    let facts = RequestFacts {
        metres: metres(&known, &without, other),
        has_clocks: request.timing != Timing::Synchronised,
        names,
    };
    write_results(&found, &facts, output)
}

/// Adds the sightings to `request`. Cameras without sightings are removed, with their anchors.
fn with_sightings(
    request: PointRequest,
    files: &BTreeMap<String, PathBuf>,
) -> anyhow::Result<PointRequest> {
    let (mut cameras, mut blind) = (Vec::new(), Vec::new());
    for camera in request.cameras {
        match files.get(&camera.name) {
            Some(path) => cameras.push(PointCamera {
                sightings: parse(&read(path)?.text, path)?,
                ..camera
            }),
            None => blind.push(camera.name),
        }
    }
    for name in &blind {
        if request.anchors.cameras().any(|camera| camera == name) {
            say(format_args!(
                "camera {name} has no sightings: its known facts are ignored"
            ));
        }
    }
    let blind: Vec<&str> = blind.iter().map(String::as_str).collect();
    Ok(PointRequest {
        cameras,
        anchors: request.anchors.without(&blind),
        ..request
    })
}

impl SolveArgs {
    /// The request for the cameras `names`, each with the lens that `lens_of` returns, still without sightings. All its
    /// errors are reported now, before minutes of work.
    ///
    /// # Errors
    /// Unknown names of cameras, cameras without a lens, unreadable files, invalid numbers.
    pub(super) fn request(
        &self,
        names: &[&str],
        lens_of: impl Fn(&str) -> anyhow::Result<Lens>,
    ) -> anyhow::Result<PointRequest> {
        let seen = &self.cameras;
        let timing = seen.timing();
        ensure!(
            timing != Timing::Synchronised || !seen.has_rates(),
            "--rate-hz has no effect on synchronised cameras: set --clocks given, or unknown"
        );
        seen.check_clocks()?;
        let anchors = self.known.anchors()?;
        seen.check_names(&anchors, names)?;
        for name in names {
            ensure!(
                timing == Timing::Synchronised || seen.rate_of(name).is_some(),
                "no rate of camera `{name}`: set it with --rate-hz {name}=HZ"
            );
            ensure!(
                timing != Timing::Clocks || seen.offset_of(name).is_some(),
                "no offset of camera `{name}`: set it with --offset-s {name}=SECONDS"
            );
        }
        let cameras = names.iter().map(|name| {
            let lens = lens_of(name)?;
            Ok(PointCamera {
                name: (*name).to_owned(),
                size_px: lens.size_px,
                intrinsics: lens.intrinsics,
                lens: lens.model,
                rate_hz: seen.rate_of(name),
                offset_s: seen.offset_of(name),
                sightings: Vec::new(),
            })
        });
        let request = PointRequest {
            lenses: match self.free {
                FreeLens::None => Lenses::Given,
                FreeLens::Focal => Lenses::Focal,
                FreeLens::All => Lenses::All,
            },
            gate_px: self.gate_px,
            seed: self.seed,
            anchors,
            ..PointRequest::new(cameras.collect::<anyhow::Result<_>>()?, timing)
        };
        check_request(&request)?;
        Ok(request)
    }
}
