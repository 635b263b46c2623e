//! `farfield calibrate people`: where cameras stand, from people who walk in the field.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::Args;
use farfield_calibration::alignment::Anchors;
use farfield_calibration::people::{
    DetectedFrame, PeopleCamera, PeopleRequest, PeopleStage, calibrate, check_request,
};
use farfield_calibration::points::Timing;
use farfield_node::process::{NodeError, say};

use super::Judged;
use super::filmed_people::{FilmedArgs, filmed, most_frames, rates_hz};
use super::handed_over::{Asked, FoundArgs, hand_over, without_pose};
use super::known::KnownArgs;
use super::lenses::lens_of;
use super::metres::{Otherwise, metres};
use super::recorded_people::{Part, PeopleRecording, is_recording};
use super::seen::{LEAST_FRAMES, SeenArgs, SeenCamera, by_camera};
use super::thin_files::ThinFiles;
use crate::init::recordings::Recording;

/// What `farfield calibrate people` is told.
#[derive(Debug, Args)]
pub(super) struct PeopleArgs {
    /// Videos or their folder; NAME.jsonl of keypoints; recording.mcap.
    ///
    /// Videos or folders of numbered pictures, called as the cameras, are looked through by networks (--network, --detector). Files
    /// of keypoints are as keypoint venues have them: a frame on each line, COCO's 17 keypoints, distorted pixels; the file's name is
    /// the camera's. Nobody says who is whom. A recording of fusion's has cameras, lenses and rate in it; a lens that is given counts
    /// before its own.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    #[command(flatten)]
    filmed: FilmedArgs,
    #[command(flatten)]
    cameras: SeenArgs,
    /// Mean stature of the people, in shoes.
    ///
    /// The scale, to 1 to 2 %, where nothing else tells it.
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
    args.found.refuse_existing()?;
    let request = request(args)?;
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
    let names: Vec<&str> = request.cameras.iter().map(|it| it.name.as_str()).collect();
    let without = without_pose(&found, &names);
    let asked = Asked {
        metres: metres(&request.anchors, &without, Otherwise::Stature),
        has_clocks: request.timing != Timing::Synchronised,
        names,
    };
    hand_over(&found, &asked, &args.found)
}

fn request(args: &PeopleArgs) -> Result<PeopleRequest, NodeError> {
    let anchors = args.known.anchors().map_err(NodeError::Refused)?;
    let request = match filmed(&args.seen).map_err(NodeError::Refused)? {
        Some(recordings) => of_videos(args, &recordings, &anchors)?,
        None => of_what_was_seen(args, &anchors).map_err(NodeError::Refused)?,
    };
    Ok(asked(args, request, anchors))
}

/// `request` with what the command line says of people and venue.
fn asked(args: &PeopleArgs, request: PeopleRequest, anchors: Anchors) -> PeopleRequest {
    PeopleRequest {
        stature_m: args.stature_m,
        seed: args.seed,
        anchors,
        ..request
    }
}

fn of_what_was_seen(args: &PeopleArgs, anchors: &Anchors) -> anyhow::Result<PeopleRequest> {
    args.filmed.refuse_without_videos()?;
    match args.seen.iter().find(|path| is_recording(path)) {
        Some(recording) => of_recording(args, recording, anchors),
        None => of_files(args, &args.cameras, &by_camera(&args.seen)?, anchors),
    }
}

/// What networks see in videos.
fn of_videos(
    args: &PeopleArgs,
    recordings: &[Recording],
    anchors: &Anchors,
) -> Result<PeopleRequest, NodeError> {
    let prepared = || {
        refuse_part(args)?;
        let names: Vec<&str> = recordings.iter().map(|it| it.name.as_str()).collect();
        args.cameras.check_clocks()?;
        args.cameras.check_names(anchors, &names)?;
        ensure!(
            names.len() >= 2,
            "found {} videos, expected one of each of two cameras or more",
            names.len()
        );
        let lenses = args.cameras.needed_lenses()?;
        let cameras = args.cameras.with_rates(&rates_hz(recordings)?);
        let cameras = cameras.with_one_rate(&names, || most_frames(recordings, &lenses))?;
        let seen_nobody = names.iter().map(|name| {
            Ok(SeenCamera {
                lens: lens_of(&lenses, name)?.clone(),
                rate_hz: cameras.rate_of(name),
                offset_s: cameras.offset_of(name),
                seen: Vec::new(),
                name: (*name).to_owned(),
            })
        });
        let seen_nobody = seen_nobody.collect::<anyhow::Result<_>>()?;
        // All that is known to be wrong is told before looks of minutes, whomever they will see.
        let beforehand = asked(args, of_seen(&cameras, seen_nobody)?, anchors.clone());
        check_request(&beforehand)?;
        args.filmed.check_looks(&beforehand)?;
        Ok((lenses, cameras))
    };
    let (lenses, cameras) = prepared().map_err(NodeError::Refused)?;
    let rate_of = |name: &str| cameras.rate_of(name);
    let files = args
        .filmed
        .look(recordings, &lenses, rate_of, args.found.replace)?;
    of_files(args, &cameras, &files, anchors).map_err(NodeError::Refused)
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
    for (option, s) in [("--from-s", args.from_s), ("--until-s", args.until_s)] {
        ensure!(
            s.is_none_or(f64::is_finite),
            "{option}: found {}, expected seconds",
            s.unwrap_or_default()
        );
    }
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

/// `--from-s` and `--until-s` are for recordings of fusion's.
fn refuse_part(args: &PeopleArgs) -> anyhow::Result<()> {
    ensure!(
        args.from_s.is_none() && args.until_s.is_none(),
        "--from-s and --until-s are for a recording: of files of keypoints leave out lines"
    );
    Ok(())
}

fn of_files(
    args: &PeopleArgs,
    given: &SeenArgs,
    files: &BTreeMap<String, PathBuf>,
    anchors: &Anchors,
) -> anyhow::Result<PeopleRequest> {
    refuse_part(args)?;
    let names: Vec<&str> = files.keys().map(String::as_str).collect();
    let one_rate = &given.with_one_rate(&names, || Ok(LEAST_FRAMES))?;
    let mut thinned = ThinFiles::new(one_rate, files.len());
    let read = |name: &str, path: &Path| thinned.read(name, path);
    let mut seen = one_rate.cameras(files, anchors, read)?;
    given.with_one_rate(&names, || Ok(frames_of(&seen)))?;
    thinned.level(&mut seen);
    of_seen(one_rate, seen)
}

/// From the first frame of all cameras to the last.
fn frames_of(seen: &[SeenCamera<Vec<DetectedFrame>>]) -> f64 {
    let numbers = || seen.iter().flat_map(|it| &it.seen).map(|it| it.frame);
    let first = numbers().reduce(f64::min).unwrap_or_default();
    let last = numbers().reduce(f64::max).unwrap_or_default();
    last - first + 1.0
}

/// What cameras saw, as it is asked about.
fn of_seen(
    given: &SeenArgs,
    seen: Vec<SeenCamera<Vec<DetectedFrame>>>,
) -> anyhow::Result<PeopleRequest> {
    let mut cameras = Vec::new();
    for it in seen {
        let name = it.name;
        let Some(rate_hz) = it.rate_hz else {
            bail!("no rate of camera `{name}`: give it by --rate-hz {name}=HZ");
        };
        cameras.push(PeopleCamera {
            size_px: it.lens.size_px,
            intrinsics: it.lens.intrinsics,
            lens: it.lens.model,
            rate_hz: Some(rate_hz),
            offset_s: it.offset_s,
            frames: it.seen,
            name,
        });
    }
    let rate_hz = cameras.first().and_then(|it| it.rate_hz).unwrap_or(1.0);
    Ok(PeopleRequest {
        timing: given.timing(),
        ..PeopleRequest::new(cameras, rate_hz)
    })
}
