//! `farfield calibrate people`: computes camera poses from people who walk in the field.

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
use super::known::KnownArgs;
use super::lenses::lens_of;
use super::metres::{OtherScale, metres};
use super::recorded_people::{Part, PeopleRecording, is_recording};
use super::results::{OutputArgs, RequestFacts, without_pose, write_results};
use super::seen::{LEAST_FRAMES, SeenArgs, SeenCamera, by_camera};
use super::thin_files::ThinFiles;
use crate::init::recordings::Recording;

/// Arguments of `farfield calibrate people`.
#[derive(Debug, Args)]
pub(super) struct PeopleArgs {
    /// Videos or their folder; NAME.jsonl of keypoints; recording.mcap.
    ///
    /// Videos or folders of numbered images, named after the cameras, are processed by networks (--network,
    /// --detector). Keypoint files have the format of keypoint venues: a frame per line, COCO's 17 keypoints or those with feet, distorted
    /// pixels; the file has the name of the camera. People need no identities. A recording of fusion contains cameras,
    /// lenses and rate; a given lens has priority.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    #[command(flatten)]
    filmed: FilmedArgs,
    #[command(flatten)]
    cameras: SeenArgs,
    /// Mean stature of the people, in shoes.
    ///
    /// Gives the scale, with an error of 1 to 2 %, if nothing else does.
    #[arg(long, value_name = "METRES")]
    stature_m: Option<f64>,
    #[command(flatten)]
    known: KnownArgs,
    /// Start of the part of a recording to use, seconds from its beginning, for example after a camera was moved.
    #[arg(long, value_name = "S", hide_short_help = true)]
    from_s: Option<f64>,
    /// End of the part of a recording to use, seconds from its beginning.
    #[arg(long, value_name = "S", hide_short_help = true)]
    until_s: Option<f64>,
    /// Seed of the random samples.
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
    #[command(flatten)]
    pub(super) output: OutputArgs,
}

/// Computes the camera poses, writes calibration and sheet, and prints their quality.
///
/// # Errors
/// [`NodeError::Refused`] where the input does not determine a calibration, [`NodeError::Failed`] for errors of the
/// disk.
pub(super) fn from_people(args: &PeopleArgs) -> Result<Judged, NodeError> {
    args.output.refuse_existing()?;
    let request = request(args)?;
    let progress = &mut |stage: PeopleStage| {
        say(format_args!(
            "{}",
            match stage {
                PeopleStage::Ground => "estimating the pose of each camera over the floor",
                PeopleStage::Clocks => "estimating clock offsets",
                PeopleStage::Pairs => "estimating relative camera poses",
                PeopleStage::Adjustment => "adjusting all cameras together",
                PeopleStage::Report => "measuring the quality",
            }
        ));
    };
    let found = calibrate(&request, progress).map_err(NodeError::refused)?;
    let names: Vec<&str> = request.cameras.iter().map(|it| it.name.as_str()).collect();
    let without = without_pose(&found, &names);
    let facts = RequestFacts {
        metres: metres(&request.anchors, &without, OtherScale::Stature),
        has_clocks: request.timing != Timing::Synchronised,
        names,
    };
    write_results(&found, &facts, &args.output)
}

fn request(args: &PeopleArgs) -> Result<PeopleRequest, NodeError> {
    let anchors = args.known.anchors().map_err(NodeError::Refused)?;
    let request = match filmed(&args.seen).map_err(NodeError::Refused)? {
        Some(recordings) => request_of_videos(args, &recordings, &anchors)?,
        None => request_of_detections(args, &anchors).map_err(NodeError::Refused)?,
    };
    Ok(with_options(args, request, anchors))
}

/// Adds the options on people and venue to `request`.
fn with_options(args: &PeopleArgs, request: PeopleRequest, anchors: Anchors) -> PeopleRequest {
    PeopleRequest {
        stature_m: args.stature_m,
        seed: args.seed,
        anchors,
        ..request
    }
}

fn request_of_detections(args: &PeopleArgs, anchors: &Anchors) -> anyhow::Result<PeopleRequest> {
    args.filmed.refuse_without_videos()?;
    match args.seen.iter().find(|path| is_recording(path)) {
        Some(recording) => request_of_recording(args, recording, anchors),
        None => request_of_files(args, &args.cameras, &by_camera(&args.seen)?, anchors),
    }
}

/// The request from people that networks detect in videos.
fn request_of_videos(
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
            "found {} videos, expected videos of two cameras or more",
            names.len()
        );
        let lenses = args.cameras.needed_lenses()?;
        let cameras = args.cameras.with_rates(&rates_hz(recordings)?);
        let cameras = cameras.with_one_rate(&names, || most_frames(recordings, &lenses))?;
        let without_people = names.iter().map(|name| {
            Ok(SeenCamera {
                lens: lens_of(&lenses, name)?.clone(),
                rate_hz: cameras.rate_of(name),
                offset_s: cameras.offset_of(name),
                seen: Vec::new(),
                name: (*name).to_owned(),
            })
        });
        let without_people = without_people.collect::<anyhow::Result<_>>()?;
        // Known errors are reported before minutes of work.
        let beforehand = with_options(
            args,
            new_request(&cameras, without_people)?,
            anchors.clone(),
        );
        check_request(&beforehand)?;
        args.filmed.check_scan_rate(&beforehand)?;
        Ok((lenses, cameras))
    };
    let (lenses, cameras) = prepared().map_err(NodeError::Refused)?;
    let rate_of = |name: &str| cameras.rate_of(name);
    let files = args
        .filmed
        .scan(recordings, &lenses, rate_of, args.output.replace)?;
    request_of_files(args, &cameras, &files, anchors).map_err(NodeError::Refused)
}

/// The request from a recording of fusion's messages.
fn request_of_recording(
    args: &PeopleArgs,
    path: &Path,
    anchors: &Anchors,
) -> anyhow::Result<PeopleRequest> {
    let shown = path.display();
    ensure!(
        args.seen.len() == 1,
        "{shown} is a recording of all cameras, expected no other file"
    );
    ensure!(
        !args.cameras.has_rates() && !args.cameras.has_offsets(),
        "{shown} is a recording, which contains its rate: remove --rate-hz and --offset-s"
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
        "--until-s: found {} s, expected more than {} s, the start of the part",
        part.until_s,
        part.from_s
    );
    let lenses = args.cameras.lenses()?;
    let recording = PeopleRecording::open(path)?;
    let names = recording.names();
    args.cameras.check_names(anchors, &names)?;
    recording.request(&lenses, args.cameras.timing(), part)
}

/// `--from-s` and `--until-s` are for recordings of fusion.
fn refuse_part(args: &PeopleArgs) -> anyhow::Result<()> {
    ensure!(
        args.from_s.is_none() && args.until_s.is_none(),
        "--from-s and --until-s are for a recording: in keypoint files remove lines"
    );
    Ok(())
}

fn request_of_files(
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
    new_request(one_rate, seen)
}

/// Frames from the first to the last of all cameras.
fn frames_of(seen: &[SeenCamera<Vec<DetectedFrame>>]) -> f64 {
    let numbers = || seen.iter().flat_map(|it| &it.seen).map(|it| it.frame);
    let first = numbers().reduce(f64::min).unwrap_or_default();
    let last = numbers().reduce(f64::max).unwrap_or_default();
    last - first + 1.0
}

/// The request from the detections of the cameras.
fn new_request(
    given: &SeenArgs,
    seen: Vec<SeenCamera<Vec<DetectedFrame>>>,
) -> anyhow::Result<PeopleRequest> {
    let mut cameras = Vec::new();
    for it in seen {
        let name = it.name;
        let Some(rate_hz) = it.rate_hz else {
            bail!("no rate of camera `{name}`: set it with --rate-hz {name}=HZ");
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
