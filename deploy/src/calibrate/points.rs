//! `farfield calibrate points`: where cameras stand, from a single moving point that they saw.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::ensure;
use clap::{Args, ValueEnum};
use farfield_calibration::points::{
    Lenses, PointCamera, PointRequest, RigidBoard, Stage, Timing, calibrate, check_request, parse,
};
use farfield_node::process::{NodeError, say};

use super::convert::size;
use super::handed_over::{Asked, FoundArgs, hand_over, without_pose};
use super::known::KnownArgs;
use super::lenses::{Lens, lens_of};
use super::metres::{Otherwise, metres};
use super::seen::{SeenArgs, by_camera};
use super::{Judged, read};

/// What `farfield calibrate points` is told.
#[derive(Debug, Args)]
pub(super) struct PointsArgs {
    /// Where each camera saw the point: NAME.txt, with `frame x y` on each line.
    ///
    /// Distorted pixels, the centre of the first is (0, 0); the file's name is the camera's. More than one in a frame is not
    /// allowed: the detector decides, and up to a tenth may be wrong.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    #[command(flatten)]
    asked: AskedArgs,
    /// The points are corners of a Charuco board: squares across and down.
    ///
    /// It is taken as one rigid body: the number of a sight is 1000 times the instant, plus the number of the corner, counted row
    /// by row as OpenCV does. Cameras then hang together though each corner is seen by two of them only, and metres come from the squares.
    #[arg(long, value_name = "AxB", value_parser = size, requires = "square_mm", hide_short_help = true)]
    charuco: Option<[u32; 2]>,
    /// Side of a square of that board, millimetres.
    #[arg(long, value_name = "MM", requires = "charuco", hide_short_help = true)]
    square_mm: Option<f64>,
    #[command(flatten)]
    pub(super) found: FoundArgs,
}

/// What is known beforehand, and what is to be found.
#[derive(Debug, Args)]
pub(super) struct AskedArgs {
    #[command(flatten)]
    pub(super) cameras: SeenArgs,
    #[command(flatten)]
    known: KnownArgs,
    /// What of lenses may move: none, focal, all.
    ///
    /// none, the default: as given; focal: focal lengths, about the given ones; all: the whole lens.
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "none",
        hide_default_value = true,
        hide_possible_values = true
    )]
    free: FreeLens,
    /// Distance in pixels within which sights agree while poses are rough.
    #[arg(long, value_name = "PX", default_value_t = 3.0, hide_short_help = true)]
    gate_px: f64,
    /// Seed of the random samples.
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
}

/// What of the lenses may move.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum FreeLens {
    None,
    Focal,
    All,
}

/// Finds the cameras, writes calibration and sheet, and says how good they are.
///
/// # Errors
/// [`NodeError::Refused`] where the input cannot carry a calibration, [`NodeError::Failed`] where the disk is in the way.
pub(super) fn from_points(args: &PointsArgs) -> Result<Judged, NodeError> {
    let prepared = || {
        let files = by_camera(&args.seen)?;
        let lenses = args.asked.cameras.needed_lenses()?;
        let names: Vec<&str> = files.keys().map(String::as_str).collect();
        let request = args
            .asked
            .request(&names, |name| lens_of(&lenses, name).cloned())?;
        let request = PointRequest {
            board: args.board(),
            ..request
        };
        check_request(&request)?;
        Ok((request, files))
    };
    let (request, files) = prepared().map_err(NodeError::Refused)?;
    args.found.refuse_existing()?;
    solve(request, &files, &args.found)
}

impl PointsArgs {
    /// The board whose corners were seen.
    fn board(&self) -> Option<RigidBoard> {
        let (squares, square_mm) = self.charuco.zip(self.square_mm)?;
        Some(RigidBoard {
            squares,
            square_m: square_mm / 1000.0,
        })
    }
}

/// The same for `request`, with what each of its cameras saw in `files`; one without a file saw nothing.
///
/// # Errors
/// As [`from_points`].
pub(super) fn solve(
    request: PointRequest,
    files: &BTreeMap<String, PathBuf>,
    told: &FoundArgs,
) -> Result<Judged, NodeError> {
    let names: Vec<String> = request.cameras.iter().map(|it| it.name.clone()).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let known = request.anchors.clone();
    let request = with_sightings(request, files).map_err(NodeError::Refused)?;
    let progress = &mut |stage: Stage| {
        say(format_args!(
            "{}",
            match stage {
                Stage::Clocks => "looking for the lags of the clocks",
                Stage::Poses => "looking for poses",
                Stage::Adjustment => "adjusting all to all",
                Stage::Report => "looking how good it is",
            }
        ));
    };
    let found = calibrate(&request, progress).map_err(NodeError::refused)?;
    let without = without_pose(&found, &names);
    let otherwise = request
        .board
        .map_or(Otherwise::Nothing, |board| Otherwise::Board {
            square_mm: 1000.0 * board.square_m,
        });
    let asked = Asked {
        metres: metres(&known, &without, otherwise),
        has_clocks: request.timing != Timing::Synchronised,
        names,
    };
    hand_over(&found, &asked, told)
}

/// `request` with what its cameras saw, without those that saw nothing, and without what is known of these.
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
        if request.anchors.cameras().any(|of| of == name) {
            say(format_args!(
                "camera {name} saw nothing: what is known of it is left out"
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

impl AskedArgs {
    /// What is asked for of the cameras `names`, each through the lens that `lens_of` says, before anybody knows what they saw: all that can be wrong with it is told now,
    /// and not after minutes of looking.
    ///
    /// # Errors
    /// Names of cameras that are not among these, cameras without a lens, files that cannot be read, numbers that are none.
    pub(super) fn request(
        &self,
        names: &[&str],
        lens_of: impl Fn(&str) -> anyhow::Result<Lens>,
    ) -> anyhow::Result<PointRequest> {
        let seen = &self.cameras;
        let timing = seen.timing();
        ensure!(
            timing != Timing::Synchronised || !seen.has_rates(),
            "--rate-hz says nothing of cameras that are synchronised: give --clocks given, or unknown"
        );
        seen.check_clocks()?;
        let anchors = self.known.anchors()?;
        seen.check_names(&anchors, names)?;
        for name in names {
            ensure!(
                timing == Timing::Synchronised || seen.rate_of(name).is_some(),
                "no rate of camera `{name}`: give it by --rate-hz {name}=HZ"
            );
            ensure!(
                timing != Timing::Clocks || seen.offset_of(name).is_some(),
                "no offset of camera `{name}`: give it by --offset-s {name}=SECONDS"
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
