//! What an edge is started with. Nothing is opened here but the files that describe the venue.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::anyhow;
use farfield_proto::endpoint::is_endpoint;
use farfield_proto::id::ViewpointIndex;
use farfield_proto::tick::{Tick, parse_range};
use farfield_proto::transport::EdgeTransport;
use farfield_proto::venue::{Venue, VenueCamera, Viewpoint};

use super::process::{Managed, NodeError};
use crate::source::Sources;

/// Where fusion is looked for when nobody says where: on this machine.
const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";

/// Arguments of an edge node.
#[derive(Debug, Clone, clap::Args)]
pub struct EdgeArgs {
    /// The venue file.
    pub venue: PathBuf,
    /// Name of the viewpoint whose cameras this node has.
    #[arg(long, value_name = "NAME")]
    pub viewpoint: String,
    /// Where fusion listens, for example `tcp/10.0.0.1:7447`; the venue file's, if left out.
    #[arg(long, value_name = "ENDPOINT")]
    pub connect: Vec<String>,
    /// Refuse to start unless the recordings hold these ticks (half-open).
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub ticks: Option<Range<Tick>>,
    /// End when standard input closes.
    #[arg(long, hide = true)]
    pub managed: bool,
}

/// The validated start of an edge node.
#[derive(Debug)]
pub(super) struct Config {
    pub(super) venue: Venue,
    /// How the sources of the cameras are opened.
    pub(super) sources: Arc<dyn Sources>,
    pub(super) viewpoint: ViewpointIndex,
    pub(super) name: String,
    pub(super) connect: Vec<String>,
    pub(super) ticks: Option<Range<Tick>>,
    pub(super) managed: Managed,
}

impl Config {
    /// Reads the venue and its calibration.
    pub(super) fn load(args: EdgeArgs, sources: Arc<dyn Sources>) -> Result<Self, NodeError> {
        let venue = Venue::load(&args.venue).map_err(NodeError::refused)?;
        let viewpoint = venue.viewpoint_named(&args.viewpoint).ok_or_else(|| {
            let known: Vec<&str> = venue.viewpoints.iter().map(|v| v.name.as_str()).collect();
            NodeError::refused(anyhow!(
                "{} has no viewpoint {:?}; it has {}",
                args.venue.display(),
                args.viewpoint,
                known.join(", ")
            ))
        })?;
        if let Some(wrong) = args.connect.iter().find(|text| !is_endpoint(text)) {
            return Err(NodeError::refused(anyhow!(
                "`--connect`: found `{wrong}`, expected for example {DEFAULT_ENDPOINT}"
            )));
        }
        let connect = [
            args.connect,
            venue.endpoints.connect.clone(),
            vec![DEFAULT_ENDPOINT.to_owned()],
        ];
        let connect = connect
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
            sources,
            viewpoint,
            name: args.viewpoint,
            connect,
            ticks: args.ticks,
            managed,
        })
    }

    /// How the edge reaches fusion.
    pub(super) fn transport(&self) -> EdgeTransport<'_> {
        EdgeTransport {
            venue: &self.venue.name,
            connect: &self.connect,
            identity: None,
        }
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
