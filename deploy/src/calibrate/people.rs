//! `farfield calibrate people`: where cameras stand, from people who walk in the field.

use std::collections::BTreeMap;
use std::path::PathBuf;

use anyhow::{bail, ensure};
use clap::Args;
use farfield_calibration::people::{PeopleCamera, PeopleRequest, PeopleStage, calibrate, parse};
use farfield_calibration::points::Timing;
use farfield_node::process::{NodeError, say};
use farfield_proto::keypoints::COCO17;

use super::known::KnownArgs;
use super::lenses::{LensFile, lenses};
use super::points::{Asked, Clocks, hand_over, offset, rate};
use super::{Judged, read, refuse_existing};

/// What `farfield calibrate people` is told.
#[derive(Debug, Args)]
pub(super) struct PeopleArgs {
    /// Whom each camera saw: NAME.jsonl, a frame on each line, as keypoint venues have them.
    ///
    /// COCO's 17 keypoints, distorted pixels; the file's name is the camera's. Nobody says who is whom.
    #[arg(required = true)]
    seen: Vec<PathBuf>,
    /// Lenses: a calibration of any format, or NAME=FILE for one camera.
    #[arg(long, value_name = "[NAME=]FILE", required = true)]
    lens: Vec<LensFile>,
    /// Frames per second: of all cameras, or NAME=HZ.
    #[arg(long, value_name = "[NAME=]HZ", value_parser = rate, required = true)]
    rate_hz: Vec<(Option<String>, f64)>,
    /// Whether frames are of one moment: synchronised, given, unknown.
    ///
    /// synchronised: frames of one number; given: by --rate-hz and --offset-s; unknown: rates are right, offsets are looked
    /// for.
    #[arg(
        long,
        value_name = "HOW",
        default_value = "synchronised",
        hide_possible_values = true
    )]
    clocks: Clocks,
    /// Time of a camera's frame 0, seconds, on a clock that all share.
    #[arg(long, value_name = "NAME=S", value_parser = offset)]
    offset_s: Vec<(String, f64)>,
    /// Mean stature of the people, metres, in shoes: the scale, to 1 to 2 %, where nothing else tells it.
    #[arg(long, value_name = "METRES")]
    stature_m: Option<f64>,
    #[command(flatten)]
    known: KnownArgs,
    /// Seed of the random samples.
    #[arg(long, value_name = "N", default_value_t = 1, hide_short_help = true)]
    seed: u64,
    /// The calibration to write; its sheet goes beside it, as HTML.
    ///
    /// One that does not pass is called NAME.failed.toml instead, and takes the place of none.
    #[arg(long, value_name = "FILE", default_value = "calibration.toml")]
    out: PathBuf,
    /// Replace files that are there already.
    #[arg(long)]
    replace: bool,
    /// Print what was found, or what went wrong, as JSON.
    #[arg(long)]
    pub(super) json: bool,
}

/// Finds the cameras, writes calibration and sheet, and says how good they are.
///
/// # Errors
/// [`NodeError::Refused`] where the input cannot carry a calibration, [`NodeError::Failed`] where the disk is in the way.
pub(super) fn from_people(args: &PeopleArgs) -> Result<Judged, NodeError> {
    let request = request(args).map_err(NodeError::Refused)?;
    for path in [&args.out, &args.out.with_extension("html")] {
        refuse_existing(path, args.replace)?;
    }
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
    };
    hand_over(&found, &asked, &args.out, args.json)
}

fn request(args: &PeopleArgs) -> anyhow::Result<PeopleRequest> {
    let timing = args.clocks.timing();
    ensure!(
        timing == Timing::Clocks || args.offset_s.is_empty(),
        "--offset-s: offsets are for --clocks given"
    );
    let lenses = lenses(&args.lens)?;
    let mut seen = BTreeMap::new();
    for path in &args.seen {
        let name = path
            .file_stem()
            .and_then(|it| it.to_str())
            .unwrap_or_default();
        let frames = parse(&read(path)?.text, path, COCO17.len())?;
        if seen.insert(name.to_owned(), frames).is_some() {
            bail!("{}: two files are of camera `{name}`", path.display());
        }
    }
    let known: Vec<&str> = seen.keys().map(String::as_str).collect();
    let rates = args.rate_hz.iter().filter_map(|(name, _)| name.as_ref());
    let offsets = args.offset_s.iter().map(|(name, _)| name);
    for name in rates.chain(offsets).chain(args.known.cameras()) {
        ensure!(
            known.contains(&name.as_str()),
            "unknown camera `{name}`, expected one of {}",
            known.join(", ")
        );
    }
    let of_all = args.rate_hz.iter().find(|(of, _)| of.is_none());
    let own_rate = |name: &str| {
        let own = args
            .rate_hz
            .iter()
            .find(|(of, _)| of.as_deref() == Some(name));
        own.or(of_all).map(|(_, hz)| *hz)
    };
    let mut cameras = Vec::new();
    for (name, frames) in seen {
        let Some(lens) = lenses.get(&name) else {
            let has: Vec<&str> = lenses.keys().map(String::as_str).collect();
            bail!(
                "no lens of camera `{name}`: found those of {}; give it by --lens {name}=FILE",
                has.join(", ")
            );
        };
        let Some(rate_hz) = own_rate(&name) else {
            bail!("no rate of camera `{name}`: give it by --rate-hz {name}=HZ");
        };
        let offset_s = args.offset_s.iter().find(|(of, _)| *of == name);
        cameras.push(PeopleCamera {
            size_px: lens.size_px,
            intrinsics: lens.intrinsics,
            distortion: lens.distortion,
            rate_hz: Some(rate_hz),
            offset_s: offset_s.map(|(_, s)| *s),
            frames,
            name,
        });
    }
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
        stature_m: args.stature_m,
        seed: args.seed,
        anchors: args.known.anchors()?,
        ..PeopleRequest::new(cameras, rate_hz)
    })
}
