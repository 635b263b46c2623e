//! Arguments and configuration of the fusion node. Only the files that describe the venue are opened here.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::anyhow;
use farfield_node::clock::unix_time;
use farfield_node::endpoints::{LinkEnd, LinkRequest, Reach};
use farfield_node::files::load_venue;
use farfield_node::process::{LineKind, Managed, NodeError, say_as};
use farfield_proto::model_card::{HeatmapCard, unread_card};
use farfield_proto::plausibility;
use farfield_proto::tick::{Micros, Tick, parse_range};
use farfield_proto::transport::FUSION;
use farfield_proto::venue::Venue;

use super::handout::Handout;
use super::output::progress::Detail;
use super::recording::{RecordingPlace, check_place};
use super::session::messages::RunMode;
use super::subjects::{KnownSubjects, load_subjects};
use super::venue_checks::{
    check_detector, check_given_keypoints, check_given_ticks, check_live_or_recorded,
    check_ticks_to_come, check_viewpoints,
};

/// Arguments of the fusion node.
#[derive(Debug, Clone, clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub struct FusionArgs {
    /// The venue file.
    pub venue: PathBuf,
    /// Run live; without it, in lock-step.
    ///
    /// Live, each tick of the clock uses the data that the edges have sent by then.
    #[arg(long)]
    pub live: bool,
    /// Endpoint to listen on [default: the venue file's].
    ///
    /// For example `quic/0.0.0.0:7447`.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// With `--managed`: the fallback endpoint if that one is taken.
    #[arg(long, hide = true, value_name = "ENDPOINT", requires_all = ["managed", "listen"])]
    pub listen_else: Option<String>,
    /// Communicate with other machines without TLS.
    ///
    /// Every machine in the network can then read and send messages.
    #[arg(long)]
    pub allow_plaintext: bool,
    /// Folder of fusion's keys [default: the venue file's].
    #[arg(long, value_name = "DIR")]
    pub certificates: Option<PathBuf>,
    /// Process only these ticks, B excluded.
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub ticks: Option<Range<Tick>>,
    /// Folder for the results.
    ///
    /// It must be empty or not exist.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Record, for `farfield replay`.
    ///
    /// The recording is an MCAP file with all received and sent messages, and the messages used for each tick. FILE must not
    /// exist. If FILE is a folder, a new file is created in it; a path with a slash at its end creates the folder. Default:
    /// `recording.mcap` in the folder of the results.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    pub record: Option<Option<PathBuf>>,
    /// Report as JSON lines on standard output, and end when standard input closes.
    #[arg(long, hide = true)]
    pub managed: bool,
    /// Write messages on standard error as JSON lines.
    #[arg(long, hide = true)]
    pub lines_for_parent: bool,
    /// With `--managed`: report the positions of the persons at every tick.
    #[arg(long, hide = true, requires = "managed")]
    pub report_bodies: bool,
}

/// The validated configuration of a fusion node.
#[derive(Debug)]
pub(super) struct FusionConfig {
    pub(super) venue: Venue,
    /// The path of the venue file, for error messages.
    pub(super) venue_path: PathBuf,
    /// The network's card, if the venue has one.
    pub(super) card: Option<HeatmapCard>,
    /// The people that the venue names.
    pub(super) subjects: KnownSubjects,
    /// Endpoints and identity of fusion.
    pub(super) reach: Reach,
    /// Fallback if the endpoint is taken.
    pub(super) reach_else: Option<Reach>,
    pub(super) mode: RunMode,
    /// Files that edges may request.
    pub(super) handout: Arc<Handout>,
    pub(super) ticks: Option<Range<Tick>>,
    /// The folder of the results; under a parent, already claimed.
    pub(super) out: Option<PathBuf>,
    /// The place of the recording, if requested.
    pub(super) record: Option<RecordingPlace>,
    pub(super) managed: Managed,
    pub(super) detail: Detail,
}

impl FusionConfig {
    /// A configuration of `venue` with defaults, for tests.
    #[cfg(test)]
    pub(super) fn with_venue(venue: Venue) -> Self {
        Self {
            venue,
            venue_path: PathBuf::from("venue.toml"),
            card: None,
            subjects: KnownSubjects::default(),
            reach: Reach {
                endpoints: Vec::new(),
                identity: None,
                validity: None,
            },
            reach_else: None,
            handout: Arc::default(),
            mode: RunMode::LockStep,
            ticks: None,
            out: None,
            record: None,
            managed: Managed::No,
            detail: Detail::Counts,
        }
    }

    /// Reads the venue, its calibration and its network's card.
    pub(super) fn load(args: FusionArgs) -> Result<Self, NodeError> {
        let venue = load_venue(&args.venue).map_err(NodeError::refused)?;
        check_names(&venue).map_err(NodeError::refused)?;
        let card = load_card(&venue).map_err(NodeError::refused)?;
        let subjects = load_subjects(&venue).map_err(NodeError::refused)?;
        check_given_keypoints(&venue, &args.venue, card.as_ref()).map_err(NodeError::refused)?;
        check_viewpoints(&venue, &args.venue).map_err(NodeError::refused)?;
        check_detector(&venue, &args.venue).map_err(NodeError::refused)?;
        if let Some(ticks) = &args.ticks {
            check_given_ticks(&venue, &args.venue, ticks).map_err(NodeError::refused)?;
            let now_us = unix_time().as_micros() as Micros;
            if args.live {
                check_ticks_to_come(&venue, ticks, now_us).map_err(NodeError::Refused)?;
            }
        }
        if args.live {
            check_live_or_recorded(&venue, &args.venue).map_err(NodeError::refused)?;
        }
        if let Some(Some(record)) = &args.record {
            check_place(record).map_err(NodeError::Refused)?;
        }
        let (reach, reach_else) = reach(&args, &venue)?;
        let handout = Handout::load(&args.venue, &venue, reach.identity.as_ref());
        let handout = Arc::new(handout.map_err(NodeError::Refused)?);
        let managed = if args.managed {
            Managed::Yes
        } else {
            Managed::No
        };
        Ok(Self {
            venue,
            venue_path: args.venue,
            card,
            subjects,
            reach,
            reach_else,
            mode: if args.live {
                RunMode::Live
            } else {
                RunMode::LockStep
            },
            handout,
            ticks: args.ticks,
            out: args.out,
            record: args.record.map(RecordingPlace::from_option),
            managed,
            detail: if args.report_bodies {
                Detail::Bodies
            } else {
                Detail::Counts
            },
        })
    }

    /// Whether edges may send thumbnails: in a live run, if the venue allows it and the links are private.
    pub(super) fn allows_thumbnails(&self) -> bool {
        self.mode == RunMode::Live && self.venue.security.pictures && self.reach.is_private()
    }
}

/// The endpoints to listen on, and the fallback.
fn reach(args: &FusionArgs, venue: &Venue) -> Result<(Reach, Option<Reach>), NodeError> {
    let all: Vec<String> = args
        .listen
        .iter()
        .chain(&args.listen_else)
        .cloned()
        .collect();
    let request = LinkRequest {
        side: LinkEnd::Listen,
        node: FUSION,
        endpoints: &all,
        certificates: args.certificates.as_deref(),
        allow_plaintext: args.allow_plaintext,
    };
    let mut reach = request.in_venue(venue)?;
    let Some(fallback) = &args.listen_else else {
        return Ok((reach, None));
    };
    let reach_else = Reach {
        endpoints: vec![fallback.clone()],
        ..reach.clone()
    };
    reach.endpoints.truncate(args.listen.len());
    Ok((reach, Some(reach_else)))
}

/// Refuses a viewpoint with the name of the fusion node.
///
/// # Errors
/// There is such a viewpoint.
pub fn check_names(venue: &Venue) -> anyhow::Result<()> {
    anyhow::ensure!(
        venue.viewpoint_named(FUSION).is_none(),
        "a viewpoint must not be named {FUSION:?}: that is the name of the fusion node"
    );
    Ok(())
}

/// Refuses a calibration, read from `path`, that makes a correct run impossible, and reports its suspect values.
///
/// # Errors
/// [`NodeError::Refused`] with all faults.
pub fn check_calibration(venue: &Venue, path: &Path) -> Result<(), NodeError> {
    let path = path.display();
    let findings = plausibility::of_venue(venue);
    let wrong: Vec<String> = findings
        .iter()
        .filter(|finding| finding.is_wrong())
        .map(|finding| format!("{path}: {finding}"))
        .collect();
    if !wrong.is_empty() {
        return Err(NodeError::Refused(anyhow!(
            "{}\n`farfield check VENUE` draws what every camera should see",
            wrong.join("\n")
        )));
    }
    for finding in &findings {
        say_as(LineKind::FileFinding, format_args!("{path}: {finding}"));
    }
    Ok(())
}

/// Reads the card of the venue's keypoint network; `None` without a network.
///
/// # Errors
/// The card cannot be read or is invalid.
pub fn load_card(venue: &Venue) -> anyhow::Result<Option<HeatmapCard>> {
    let Some(path) = &venue.network else {
        return Ok(None);
    };
    let text = std::fs::read_to_string(path).map_err(|error| {
        anyhow!(
            "reading the network's card {}: {}",
            path.display(),
            unread_card(&error, path)
        )
    })?;
    Ok(Some(HeatmapCard::parse(&text, path)?))
}
