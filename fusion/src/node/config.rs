//! What fusion is started with. Nothing is opened here but the files that describe the venue.

use std::ops::Range;
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use farfield_proto::endpoint::is_endpoint;
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::tick::{Tick, parse_range};
use farfield_proto::venue::Venue;

use super::given::{check_given_keypoints, check_given_ticks};
use super::link::NODE;
use super::process::{Managed, NodeError};
use super::progress::Detail;

/// Where fusion listens when nobody says where: reachable from this machine only.
const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";

/// Arguments of the fusion node.
#[derive(Debug, Clone, clap::Args)]
pub struct FusionArgs {
    /// The venue file.
    pub venue: PathBuf,
    /// Where to listen for edges, for example `tcp/0.0.0.0:7447`; the venue file's, if left out.
    #[arg(long, value_name = "ENDPOINT")]
    pub listen: Vec<String>,
    /// Work on these ticks only (half-open).
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub ticks: Option<Range<Tick>>,
    /// Folder for the results; must be empty or not there.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Report as JSON lines on standard output, and end when standard input closes.
    #[arg(long, hide = true)]
    pub managed: bool,
    /// With `--managed`: report where the persons are at every tick.
    #[arg(long, hide = true, requires = "managed")]
    pub report_bodies: bool,
}

/// The validated start of a fusion node.
#[derive(Debug)]
pub(super) struct Config {
    pub(super) venue: Venue,
    /// The venue file, to be named where it is refused.
    pub(super) venue_path: PathBuf,
    /// The network's card, when the venue has one.
    pub(super) card: Option<HeatmapCard>,
    pub(super) listen: Vec<String>,
    pub(super) ticks: Option<Range<Tick>>,
    /// Where to write; claimed already by a parent.
    pub(super) out: Option<PathBuf>,
    pub(super) managed: Managed,
    pub(super) detail: Detail,
}

impl Config {
    /// Reads the venue, its calibration and its network's card.
    pub(super) fn load(args: FusionArgs) -> Result<Self, NodeError> {
        let venue = Venue::load(&args.venue).map_err(NodeError::refused)?;
        check_names(&venue).map_err(NodeError::refused)?;
        let card = load_card(&venue).map_err(NodeError::refused)?;
        check_given_keypoints(&venue, &args.venue, card.as_ref()).map_err(NodeError::refused)?;
        if let Some(ticks) = &args.ticks {
            check_given_ticks(&venue, &args.venue, ticks).map_err(NodeError::refused)?;
        }
        if let Some(wrong) = args.listen.iter().find(|text| !is_endpoint(text)) {
            return Err(NodeError::refused(anyhow!(
                "`--listen`: found `{wrong}`, expected for example tcp/0.0.0.0:7447"
            )));
        }
        let listen = [
            args.listen,
            venue.endpoints.listen.clone(),
            vec![DEFAULT_ENDPOINT.to_owned()],
        ];
        let listen = listen
            .into_iter()
            .find(|endpoints| !endpoints.is_empty())
            .unwrap_or_default();
        let managed = if args.managed {
            Managed::Yes
        } else {
            Managed::No
        };
        Ok(Self {
            venue,
            venue_path: args.venue,
            card,
            listen,
            ticks: args.ticks,
            out: args.out,
            managed,
            detail: if args.report_bodies {
                Detail::Bodies
            } else {
                Detail::Counts
            },
        })
    }
}

/// Refuses a viewpoint whose name is taken by fusion itself.
///
/// # Errors
/// Names the viewpoint.
pub fn check_names(venue: &Venue) -> anyhow::Result<()> {
    anyhow::ensure!(
        venue.viewpoint_named(NODE).is_none(),
        "a viewpoint must not be named {NODE:?}: that is the name of the fusion node"
    );
    Ok(())
}

/// Reads the card of the venue's keypoint network; `None` without a network.
///
/// # Errors
/// When the card cannot be read, or says what no card may.
pub fn load_card(venue: &Venue) -> anyhow::Result<Option<HeatmapCard>> {
    let Some(path) = &venue.network else {
        return Ok(None);
    };
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("reading the network's card {}", path.display()))?;
    Ok(Some(HeatmapCard::parse(&text, path)?))
}
