//! `farfield calibrate points`: where cameras stand, from a single moving point that they saw.

use std::path::{Path, PathBuf};

use anyhow::ensure;
use clap::{Args, ValueEnum};
use farfield_calibration::points::{
    Lenses, PointCamera, PointRequest, Stage, Timing, calibrate, parse,
};
use farfield_node::process::{NodeError, say};

use super::handed_over::{Asked, FoundArgs, hand_over};
use super::known::KnownArgs;
use super::seen::SeenArgs;
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
    /// What of the lenses may move: none, focal, all.
    #[arg(
        long,
        value_name = "WHAT",
        default_value = "none",
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
    solve(&args.seen, &args.asked, &args.found)
}

/// The same from the files `seen`.
///
/// # Errors
/// As [`from_points`].
pub(super) fn solve(
    seen: &[PathBuf],
    asked: &AskedArgs,
    told: &FoundArgs,
) -> Result<Judged, NodeError> {
    let request = request(seen, asked).map_err(NodeError::Refused)?;
    told.refuse_existing()?;
    let has_clocks = request.timing != Timing::Synchronised;
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
    let asked = Asked {
        names: request.cameras.iter().map(|it| it.name.as_str()).collect(),
        has_clocks,
    };
    hand_over(&found, &asked, told)
}

fn request(seen: &[PathBuf], args: &AskedArgs) -> anyhow::Result<PointRequest> {
    let timing = args.cameras.timing();
    ensure!(
        timing != Timing::Synchronised || !args.cameras.has_rates(),
        "--rate-hz says nothing of cameras that are synchronised: give --clocks given, or unknown"
    );
    let read = |_: &str, path: &Path| Ok(parse(&read(path)?.text, path)?);
    let seen = args.cameras.cameras(seen, &args.known, read)?;
    let cameras = seen.into_iter().map(|it| PointCamera {
        name: it.name,
        size_px: it.lens.size_px,
        intrinsics: it.lens.intrinsics,
        distortion: it.lens.distortion,
        rate_hz: it.rate_hz,
        offset_s: it.offset_s,
        sightings: it.seen,
    });
    Ok(PointRequest {
        lenses: match args.free {
            FreeLens::None => Lenses::Given,
            FreeLens::Focal => Lenses::Focal,
            FreeLens::All => Lenses::All,
        },
        gate_px: args.gate_px,
        seed: args.seed,
        anchors: args.known.anchors()?,
        ..PointRequest::new(cameras.collect(), timing)
    })
}
