//! Checks before a run: every reason to refuse it, before a process starts or a file is created.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use farfield_edge::node::{Networks, load_networks, probe_sources};
use farfield_edge::source::{SourceError, SourceInfo, common_ticks};
use farfield_fusion::export::unfinished::write_whole;
use farfield_fusion_node::{
    check_calibration, check_detector, check_folder, check_given_keypoints, check_given_ticks,
    check_live_or_recorded, check_names, check_place, check_viewpoints, load_card, load_subjects,
    of_values,
};
use farfield_node::files::{load_venue, parse_venue};
use farfield_node::process::{LineKind, NodeError, say, say_as};
use farfield_page::server::HasKeys;
use farfield_proto::tick::Tick;
use farfield_proto::venue::{Source, Venue};
use farfield_sim::simulated::VenueSources;

use super::args::RunArgs;
use super::place::ListenPlace;
use super::values::changed_venue;
use crate::listeners::{ListenerArgs, wanted};
use crate::overlay::overlay_ticks;
use crate::parameters::{FAR_REMEDY, far_parameters};
use crate::recording_checks::{
    LONGER, LeapingKeypoints, held_keypoints, leaping_keypoints, odd_rates, too_short,
};
use crate::recording_checks::{camera_name, print_format};
use crate::recording_checks::{lengths_apart, starts_apart};

/// Largest allowed drift between recordings of different rates at the end of a run, ticks.
const MAX_DRIFT_TICKS: f64 = 0.5;

/// What sets the pace of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RunPace {
    /// Every node waits for the others.
    LockStep,
    /// The clock.
    Live,
}

/// A run that passed all checks.
pub(crate) struct RunPlan {
    pub(crate) venue_path: PathBuf,
    /// The changed text of the venue file, if `--set` was given.
    changed: Option<String>,
    pub(crate) venue: Venue,
    /// Opens its sources.
    pub(crate) sources: VenueSources,
    pub(crate) pace: RunPace,
    /// The ticks to process; `None`: live, until stopped.
    pub(crate) ticks: Option<Range<Tick>>,
    /// The folder for the results, if given.
    pub(crate) out: Option<PathBuf>,
    /// Whether and where to record; `Some(None)`: in the results folder.
    #[expect(clippy::option_option, reason = "as on the command line")]
    pub(crate) record: Option<Option<PathBuf>>,
    /// The ticks to draw, in order.
    pub(crate) overlay: Vec<Tick>,
    /// The outputs of fusion: page, streams.
    pub(crate) listeners: ListenerArgs,
    /// Whether the run fails if cameras disagree.
    pub(crate) strict: bool,
}

impl RunPlan {
    /// Writes the changed venue file, if any, into the results folder, where the nodes read it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn stage(&mut self, out: &Path) -> anyhow::Result<()> {
        if let Some(text) = &self.changed {
            let path = out.join("venue.toml");
            write_whole(path.clone(), text.as_bytes())
                .with_context(|| format!("writing {}", path.display()))?;
            self.venue_path = path;
        }
        Ok(())
    }

    /// Where fusion listens.
    pub(super) fn place(&self) -> ListenPlace {
        match self.pace {
            RunPace::LockStep => ListenPlace::anywhere(&self.venue),
            RunPace::Live => {
                let streams = wanted::streams(&self.venue, &self.listeners.stream);
                ListenPlace::at_venue_endpoint(&self.venue, &streams.unwrap_or_default())
            }
        }
    }
}

/// Reads the venue, probes every source and loads every network once. The edges load the networks again themselves.
pub(crate) fn check(args: RunArgs) -> Result<(RunPlan, Networks), NodeError> {
    let changed = if args.set.is_empty() {
        None
    } else {
        Some(changed_venue(&args.venue, &args.set).map_err(NodeError::Refused)?)
    };
    let venue = match &changed {
        Some(text) => {
            parse_venue(text, &args.venue).map_err(|error| of_values(error, &args.venue, &args.set))
        }
        None => load_venue(&args.venue),
    };
    let venue = venue.map_err(NodeError::refused)?;
    let sources = VenueSources::default();
    check_names(&venue).map_err(NodeError::Refused)?;
    check_own_recordings(&venue, &args.venue).map_err(NodeError::Refused)?;
    wanted::streams(&venue, &args.listeners.stream).map_err(NodeError::refused)?;
    args.listeners
        .check_page(HasKeys::of(venue.security.certificates.as_ref()))?;
    load_subjects(&venue).map_err(NodeError::refused)?;
    if let Some(out) = &args.out {
        check_folder(out).map_err(NodeError::Refused)?;
    }
    if let Some(Some(record)) = &args.record {
        check_place(record).map_err(NodeError::Refused)?;
    }
    if args.live {
        check_live_or_recorded(&venue, &args.venue).map_err(NodeError::refused)?;
    }
    check_viewpoints(&venue, &args.venue).map_err(NodeError::refused)?;
    check_calibration(&venue, &venue.calibration_path)?;
    if let Some(words) = far_parameters(&venue.parameters) {
        say_as(LineKind::FileFinding, format_args!("{words}; {FAR_REMEDY}"));
    }
    let infos = probe_sources(&sources, &venue, &venue.cameras).map_err(NodeError::refused)?;
    let pace = if args.live {
        RunPace::Live
    } else {
        RunPace::LockStep
    };
    let ticks = match common_ticks(&infos, args.ticks) {
        Err(SourceError::Endless) if pace == RunPace::Live => None,
        ticks => Some(ticks.map_err(NodeError::refused)?),
    };
    report_recordings(&venue, &infos);
    if let Some(ticks) = &ticks {
        check_rates(&venue, &infos, ticks)?;
        check_given_ticks(&venue, &args.venue, ticks).map_err(NodeError::refused)?;
    }
    let overlay = match (args.overlay, &ticks) {
        (None, _) => Vec::new(),
        (Some(requested), Some(ticks)) => {
            overlay_ticks(requested, ticks).map_err(NodeError::Refused)?
        }
        (Some(_), None) => {
            return Err(NodeError::Refused(anyhow!(
                "`--overlay` needs --ticks A..B: a camera cannot return to an earlier image"
            )));
        }
    };
    let networks = load_networks(&venue, &venue.cameras).map_err(NodeError::refused)?;
    let card = load_card(&venue).map_err(NodeError::Refused)?;
    check_given_keypoints(&venue, &args.venue, card.as_ref()).map_err(NodeError::refused)?;
    // After the files: an error in an existing file is reported before a missing one.
    check_detector(&venue, &args.venue).map_err(NodeError::refused)?;
    let plan = RunPlan {
        venue_path: args.venue,
        changed,
        venue,
        sources,
        pace,
        ticks,
        out: args.out,
        record: args.record,
        overlay,
        listeners: args.listeners,
        strict: args.strict,
    };
    Ok((plan, networks))
}

/// Refuses one recording used for two cameras. Their rays would meet at arbitrary points without an error.
fn check_own_recordings(venue: &Venue, path: &Path) -> anyhow::Result<()> {
    let mut owners: BTreeMap<&Path, &str> = BTreeMap::new();
    for camera in &venue.cameras {
        let (Source::Video { path: recording }
        | Source::Images { path: recording }
        | Source::Keypoints {
            path: recording, ..
        }) = &camera.source
        else {
            continue;
        };
        let name = camera.model.name();
        if let Some(other) = owners.insert(recording, name) {
            bail!(
                "{}: `source`: cameras `{other}` and `{name}` use the same recording {}, expected a different one for each camera",
                path.display(),
                recording.display()
            );
        }
    }
    Ok(())
}

/// Prints notes on the format, start and length of the recordings, and on suspect keypoint files.
fn report_recordings(venue: &Venue, infos: &[(String, SourceInfo)]) {
    for (camera, info) in infos {
        print_format(&camera_name(camera), info);
    }
    let starts = [starts_apart(venue, infos), lengths_apart(venue, infos)];
    for remark in starts.into_iter().flatten() {
        say(format_args!("{remark}"));
    }
    for (camera, info) in infos {
        if let Some(warning) = info.contents.and_then(|contents| contents.doubt()) {
            let named = format!("camera `{camera}`:");
            say(format_args!("{}", warning.of(&named)));
        }
    }
}

/// Refuses recordings whose rates drift apart by more than [`MAX_DRIFT_TICKS`] by the end. Warns of suspect rates and
/// of runs that are too short.
fn check_rates(
    venue: &Venue,
    infos: &[(String, SourceInfo)],
    ticks: &Range<Tick>,
) -> Result<(), NodeError> {
    if let Some(words) = too_short(ticks.end - ticks.start, venue.rate_hz, &venue.given_persons) {
        say_as(LineKind::FileFinding, format_args!("{words}; {LONGER}"));
    }
    for rate in odd_rates(infos) {
        if rate.drift_ticks(ticks.end - ticks.start) > MAX_DRIFT_TICKS {
            let (problem, remedy) = (rate.problem(), rate.remedy());
            return Err(NodeError::Refused(anyhow!("{problem}; {remedy}")));
        }
        say_as(LineKind::FileFinding, format_args!("{}", rate.problem()));
    }
    for held in held_keypoints(infos, venue.rate_hz) {
        let (problem, remedy) = (held.problem(), held.remedy());
        say_as(LineKind::FileFinding, format_args!("{problem}; {remedy}"));
    }
    if let Some(leaping) = leaping_keypoints(infos) {
        let (problem, remedy) = (leaping.problem(), LeapingKeypoints::REMEDY);
        say_as(LineKind::FileFinding, format_args!("{problem}; {remedy}"));
    }
    Ok(())
}
