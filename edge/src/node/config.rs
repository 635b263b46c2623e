//! Arguments and configuration of an edge. Only the files that describe the venue are opened here.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::anyhow;
#[cfg(feature = "study")]
use farfield_node::clock::ClockFault;
use farfield_node::clock::VenueClock;
use farfield_node::endpoints::{LinkEnd, LinkRequest, Reach};
use farfield_node::files::load_venue;
use farfield_node::process::{Managed, NodeError, say};
use farfield_proto::id::ViewpointIndex;
use farfield_proto::key::is_key_chunk;
use farfield_proto::tick::{Tick, parse_range};
use farfield_proto::transport::EdgeTransport;
use farfield_proto::venue::{Venue, VenueCamera, Viewpoint};

use crate::source::Sources;

/// Default folder of rings.
const RINGS: &str = "farfield-ring";

/// Arguments of an edge node.
#[derive(Debug, Clone, clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub struct EdgeArgs {
    /// The venue file.
    pub venue: PathBuf,
    /// Name of the viewpoint whose cameras this node has.
    #[arg(long, value_name = "NAME", value_parser = name)]
    pub viewpoint: String,
    /// Where fusion listens; the venue file's, if left out.
    ///
    /// For example `quic/10.0.0.1:7447`.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Talk to other machines without TLS.
    ///
    /// Any program in the network can then read and send messages.
    #[arg(long)]
    pub allow_plaintext: bool,
    /// First fetch the venue's files from fusion.
    ///
    /// The venue file, its calibration and its networks, signed. Files that are equal are not fetched.
    #[arg(long)]
    pub from_fusion: bool,
    /// With `--from-fusion`: the venue's name.
    ///
    /// Needed while there is no venue file.
    #[arg(long, value_name = "NAME", value_parser = name, requires = "from_fusion")]
    pub venue_name: Option<String>,
    /// With `--from-fusion`: accept older files.
    ///
    /// Files that fusion has since replaced.
    #[arg(long, requires = "from_fusion")]
    pub accept_older: bool,
    /// Folder of this node's keys; default: the venue's.
    #[arg(long, value_name = "DIR")]
    pub certificates: Option<PathBuf>,
    /// Refuse recordings without all of these ticks.
    ///
    /// Half-open: B is excluded.
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub ticks: Option<Range<Tick>>,
    /// Folder for stored patches, in live mode.
    ///
    /// See `[recording] ring_mib`. Default: `farfield-ring/VENUE/VIEWPOINT`.
    #[arg(long, value_name = "DIR")]
    pub ring: Option<PathBuf>,
    /// End when standard input closes.
    #[arg(long, hide = true)]
    pub managed: bool,
    /// Write messages on standard error as JSON lines.
    #[arg(long, hide = true)]
    pub lines_for_parent: bool,
    /// A simulated clock error.
    #[cfg(feature = "study")]
    #[command(flatten)]
    pub clock_fault: ClockFaultArgs,
}

/// Parses a venue or viewpoint name. With an invalid name the node would wait for messages that
/// cannot exist.
fn name(text: &str) -> Result<String, String> {
    if is_key_chunk(text) {
        return Ok(text.to_owned());
    }
    Err(format!(
        "found {text:?}, expected 1 to 64 ASCII letters, digits, `-`, `_` or `.`, as in the venue file"
    ))
}

/// A simulated clock error of this edge, for studies.
#[cfg(feature = "study")]
#[derive(Debug, Clone, Default, clap::Args)]
pub struct ClockFaultArgs {
    /// The clock is ahead by this many milliseconds.
    #[arg(
        long = "clock-shift-ms",
        hide = true,
        value_name = "N",
        default_value_t = 0,
        allow_hyphen_values = true
    )]
    pub shift_ms: i64,
    /// This many seconds after the start ...
    #[arg(
        long = "clock-set-after-s",
        hide = true,
        value_name = "S",
        requires = "set_by_ms"
    )]
    pub set_after_s: Option<u32>,
    /// ... the clock is set forward by this many milliseconds.
    #[arg(
        long = "clock-set-by-ms",
        hide = true,
        value_name = "N",
        allow_hyphen_values = true
    )]
    pub set_by_ms: Option<i64>,
    /// The system reports that NTP synchronises the clock.
    #[arg(long = "clock-synchronised", hide = true)]
    pub is_synchronised: bool,
}

#[cfg(feature = "study")]
impl From<ClockFaultArgs> for ClockFault {
    fn from(args: ClockFaultArgs) -> Self {
        let by_us = args.set_by_ms.map(|ms| ms.saturating_mul(1000));
        Self {
            shift_us: args.shift_ms.saturating_mul(1000),
            set: args.set_after_s.zip(by_us),
            synchronised: args.is_synchronised.then_some(true),
        }
    }
}

/// The validated configuration of an edge node.
#[derive(Debug)]
pub(super) struct EdgeConfig {
    pub(super) venue: Venue,
    /// Opens the sources of the cameras.
    pub(super) sources: Arc<dyn Sources>,
    pub(super) viewpoint: ViewpointIndex,
    pub(super) name: String,
    /// Address of fusion and identity of the edge.
    pub(super) reach: Reach,
    pub(super) ticks: Option<Range<Tick>>,
    pub(super) managed: Managed,
    /// Whether fusion may run live. Edges that a lock-step run starts have no ring.
    pub(super) may_run_live: bool,
    /// Folder of the ring, for sets that were sent or could not be sent.
    pub(super) ring: PathBuf,
    #[cfg(feature = "study")]
    clock_fault: ClockFault,
}

impl EdgeConfig {
    /// Reads the venue and its calibration.
    pub(super) fn load(args: EdgeArgs, sources: Arc<dyn Sources>) -> Result<Self, NodeError> {
        let venue = load_venue(&args.venue).map_err(NodeError::refused)?;
        let viewpoint = venue.viewpoint_named(&args.viewpoint).ok_or_else(|| {
            let known: Vec<&str> = venue.viewpoints.iter().map(|v| v.name.as_str()).collect();
            NodeError::refused(anyhow!(
                "{} has no viewpoint {:?}; it has {}",
                args.venue.display(),
                args.viewpoint,
                known.join(", ")
            ))
        })?;
        let asked = LinkRequest {
            side: LinkEnd::Connect,
            node: &args.viewpoint,
            endpoints: &args.connect,
            certificates: args.certificates.as_deref(),
            allow_plaintext: args.allow_plaintext,
        };
        let reach = asked.in_venue(&venue)?;
        let may_run_live = !args.managed || args.ring.is_some();
        let managed = if args.managed {
            Managed::Yes
        } else {
            Managed::No
        };
        let own_ring = || Path::new(RINGS).join(&venue.name).join(&args.viewpoint);
        Ok(Self {
            ring: args.ring.unwrap_or_else(own_ring),
            venue,
            sources,
            viewpoint,
            name: args.viewpoint,
            reach,
            ticks: args.ticks,
            managed,
            may_run_live,
            #[cfg(feature = "study")]
            clock_fault: args.clock_fault.into(),
        })
    }

    /// The transport to fusion.
    pub(super) fn transport(&self) -> EdgeTransport<'_> {
        EdgeTransport {
            venue: &self.venue.name,
            connect: &self.reach.endpoints,
            identity: self.reach.identity.as_ref(),
        }
    }

    /// Whether thumbnails may go to fusion: the venue allows it, and the connection is encrypted.
    pub(super) fn sends_pictures(&self) -> bool {
        let is_wanted = self.venue.security.pictures;
        if is_wanted && !self.reach.is_private() {
            say(format_args!(
                "{}: no pictures are sent, although the venue file has `pictures = true` in [security]: without keys others could see them; make keys with `farfield certs`",
                self.name
            ));
        }
        let is_so = is_wanted && self.reach.is_private();
        if is_so {
            say(format_args!(
                "{}: a small picture of each live camera goes to fusion's page about once a second, while there is one ([security] pictures)",
                self.name
            ));
        }
        is_so
    }

    /// The clock of an edge in live mode.
    #[cfg(not(feature = "study"))]
    #[expect(clippy::unused_self, reason = "a study's clock is a setting")]
    pub(super) fn start_clock(&self) -> VenueClock {
        VenueClock::start()
    }

    /// The clock of an edge in live mode, with the simulated error.
    #[cfg(feature = "study")]
    pub(super) fn start_clock(&self) -> VenueClock {
        VenueClock::start_wrong(self.clock_fault)
    }

    /// The cameras of the viewpoint, in file order.
    pub(super) fn cameras(&self) -> impl Iterator<Item = &VenueCamera> {
        let indices = self
            .venue
            .viewpoints
            .get(usize::from(self.viewpoint.0))
            .map(|v: &Viewpoint| v.cameras.as_slice());
        indices
            .unwrap_or_default()
            .iter()
            .filter_map(|&index| self.venue.camera(index))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Cli {
        #[command(flatten)]
        args: EdgeArgs,
    }

    /// Parses arguments with this viewpoint and `--venue-name`.
    fn read(viewpoint: &str, venue: &str) -> Result<EdgeArgs, String> {
        let words = ["edge", "venue.toml", "--from-fusion"];
        let names = ["--viewpoint", viewpoint, "--venue-name", venue];
        let read = Cli::try_parse_from(words.into_iter().chain(names));
        read.map(|cli| cli.args).map_err(|error| {
            assert_eq!(error.exit_code(), 2);
            error.to_string()
        })
    }

    #[test]
    fn invalid_names_of_venues_and_viewpoints_are_refused() {
        // Symptom to prevent: an edge with such a name waited forever.
        let args = read("north-east_1.a", "hall-3").unwrap();
        assert_eq!(args.viewpoint, "north-east_1.a");
        assert_eq!(args.venue_name.as_deref(), Some("hall-3"));
        for wrong in ["a b", "a/b", "*", "$x", "über"] {
            for (refused, option) in [
                (read(wrong, "hall"), "--viewpoint"),
                (read("ne", wrong), "--venue-name"),
            ] {
                let refused = refused.unwrap_err();
                let found = format!("found {wrong:?}, expected 1 to 64 ASCII letters");
                for words in [option, &found] {
                    assert!(refused.contains(words), "{words}: {refused}");
                }
            }
        }
    }
}
