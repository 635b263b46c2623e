//! `farfield calibrate people`: where cameras stand, from people who walk in the field.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::Args;
use farfield_calibration::alignment::Anchors;
use farfield_calibration::people::{PeopleCamera, PeopleRequest, PeopleStage, calibrate};
use farfield_calibration::points::Timing;
use farfield_node::process::{NodeError, say};

use super::Judged;
use super::handed_over::{Asked, FoundArgs, hand_over};
use super::known::KnownArgs;
use super::metres::{Otherwise, metres};
use super::recorded_people::{Part, PeopleRecording, is_recording};
use super::seen::{SeenArgs, by_camera};
use super::thin_files::ThinFiles;

/// What `farfield calibrate people` is told.
#[derive(Debug, Args)]
pub(super) struct PeopleArgs {
    /// Whom each camera saw: NAME.jsonl, as keypoint venues have them; or one recording (.mcap).
    ///
    /// A frame on each line, COCO's 17 keypoints, distorted pixels; the file's name is the camera's. Nobody says who is whom.
    /// A recording of fusion's has cameras, lenses and rate in it; a lens that is given counts before its own.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    #[command(flatten)]
    cameras: SeenArgs,
    /// Mean stature of the people, metres, in shoes: the scale, to 1 to 2 %, where nothing else tells it.
    #[arg(long, value_name = "METRES")]
    stature_m: Option<f64>,
    #[command(flatten)]
    known: KnownArgs,
    /// Of a recording only what is from here on, seconds from its beginning: after a camera was knocked.
    #[arg(long, value_name = "S", hide_short_help = true)]
    from_s: Option<f64>,
    /// Of a recording only what is before this, seconds from its beginning.
    #[arg(long, value_name = "S", hide_short_help = true)]
    until_s: Option<f64>,
    /// Seed of the random samples.
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
    #[command(flatten)]
    pub(super) found: FoundArgs,
}

/// Finds the cameras, writes calibration and sheet, and says how good they are.
///
/// # Errors
/// [`NodeError::Refused`] where the input cannot carry a calibration, [`NodeError::Failed`] where the disk is in the way.
pub(super) fn from_people(args: &PeopleArgs) -> Result<Judged, NodeError> {
    let request = request(args).map_err(NodeError::Refused)?;
    args.found.refuse_existing()?;
    let told = &mut |stage: PeopleStage| {
        say(format_args!(
            "{}",
            match stage {
                PeopleStage::Ground => "looking how each camera stands over the floor",
                PeopleStage::Clocks => "looking for the lags of the clocks",
                PeopleStage::Pairs => "looking how cameras stand to each other",
                PeopleStage::Adjustment => "adjusting all to all",
                PeopleStage::Report => "looking how good it is",
            }
        ));
    };
    let found = calibrate(&request, told).map_err(NodeError::refused)?;
    let asked = Asked {
        names: request.cameras.iter().map(|it| it.name.as_str()).collect(),
        has_clocks: request.timing != Timing::Synchronised,
        metres: metres(&request.anchors, Otherwise::Stature),
    };
    hand_over(&found, &asked, &args.found)
}

fn request(args: &PeopleArgs) -> anyhow::Result<PeopleRequest> {
    let anchors = args.known.anchors()?;
    let request = match args.seen.iter().find(|path| is_recording(path)) {
        Some(recording) => of_recording(args, recording, &anchors)?,
        None => of_files(args, &anchors)?,
    };
    Ok(PeopleRequest {
        stature_m: args.stature_m,
        seed: args.seed,
        anchors,
        ..request
    })
}

/// What a recording of fusion's own messages has of them.
fn of_recording(
    args: &PeopleArgs,
    path: &Path,
    anchors: &Anchors,
) -> anyhow::Result<PeopleRequest> {
    let shown = path.display();
    ensure!(
        args.seen.len() == 1,
        "{shown} is a recording of all cameras, expected it alone"
    );
    ensure!(
        !args.cameras.has_rates() && !args.cameras.has_offsets(),
        "{shown} is a recording, which knows its rate: leave out --rate-hz and --offset-s"
    );
    let part = Part {
        from_s: args.from_s.unwrap_or(0.0),
        until_s: args.until_s.unwrap_or(f64::INFINITY),
    };
    ensure!(
        part.from_s < part.until_s,
        "--until-s: found {} s, expected more than {} s, where the part begins",
        part.until_s,
        part.from_s
    );
    let lenses = args.cameras.lenses()?;
    let recording = PeopleRecording::open(path)?;
    let names = recording.names();
    args.cameras.check_names(anchors, &names)?;
    recording.request(&lenses, args.cameras.timing(), part)
}

fn of_files(args: &PeopleArgs, anchors: &Anchors) -> anyhow::Result<PeopleRequest> {
    ensure!(
        args.from_s.is_none() && args.until_s.is_none(),
        "--from-s and --until-s are for a recording: of files of keypoints leave out lines"
    );
    let files = by_camera(&args.seen)?;
    let mut thinned = ThinFiles::new(&args.cameras, files.len());
    let read = |name: &str, path: &Path| thinned.read(name, path);
    let mut seen = args.cameras.cameras(&files, anchors, read)?;
    thinned.level(&mut seen);
    let mut cameras = Vec::new();
    for it in seen {
        let name = it.name;
        let Some(rate_hz) = it.rate_hz else {
            bail!("no rate of camera `{name}`: give it by --rate-hz {name}=HZ");
        };
        cameras.push(PeopleCamera {
            size_px: it.lens.size_px,
            intrinsics: it.lens.intrinsics,
            distortion: it.lens.distortion,
            rate_hz: Some(rate_hz),
            offset_s: it.offset_s,
            frames: it.seen,
            name,
        });
    }
    let timing = args.cameras.timing();
    let rate_hz = cameras.first().and_then(|it| it.rate_hz).unwrap_or(1.0);
    let is_other = |it: &&PeopleCamera| it.rate_hz != Some(rate_hz);
    if timing == Timing::Synchronised
        && let Some(other) = cameras.iter().find(is_other)
    {
        bail!(
            "camera `{}` has another rate than the others, which cannot be synchronised: give --clocks given, or unknown",
            other.name
        );
    }
    Ok(PeopleRequest {
        timing,
        ..PeopleRequest::new(cameras, rate_hz)
    })
}
