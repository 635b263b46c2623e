//! `farfield bench edge`: how many people an edge can track on this machine, and at which rate.

use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use farfield_edge::inference::KeypointNetwork as _;
use farfield_edge::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use farfield_edge::node::Workers;
use farfield_node::files::load_venue;
use farfield_node::process::NodeError;
use farfield_proto::venue::Venue;
use farfield_sim::embedded;
use serde::Serialize;

use super::other_work::OtherWork;
use crate::doctor::{measured_workers, people_at};
use crate::output;

/// Rates that are reported in addition to that of a venue, ticks per second.
const RATES_HZ: [f64; 3] = [60.0, 30.0, 15.0];

/// Arguments of `farfield bench edge`.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct BenchEdgeArgs {
    /// The venue file whose network is measured; default: the network of the demo.
    #[arg(value_name = "VENUE")]
    venue: Option<PathBuf>,
    /// Print JSON instead of a table.
    #[arg(long)]
    pub(crate) json: bool,
}

/// The results.
#[derive(Debug, Serialize)]
struct EdgeReport {
    /// The library that runs the network.
    backend: String,
    /// The network's card.
    network: String,
    workers: Vec<Workers>,
    /// With the last number of workers: people of one viewpoint, by rate.
    people: Vec<PeopleAtRate>,
    #[serde(rename = "beside")]
    other_work: OtherWork,
}

#[derive(Debug, Serialize)]
struct PeopleAtRate {
    rate_hz: f64,
    people: u32,
}

/// Measures, and prints the results.
///
/// # Errors
/// When the venue has no network, it cannot be run, or the result cannot be printed.
pub(crate) fn bench_edge(args: &BenchEdgeArgs) -> Result<(), NodeError> {
    let report = match &args.venue {
        None => measure_demo()?,
        Some(path) => measure_venue(path)?,
    };
    let text = if args.json {
        serde_json::to_string_pretty(&report).map_err(NodeError::failed)? + "\n"
    } else {
        report.to_string()
    };
    output::print(&text).map_err(NodeError::Failed)
}

fn measure_venue(path: &Path) -> Result<EdgeReport, NodeError> {
    let venue = load_venue(path).map_err(NodeError::refused)?;
    let card = venue.network.as_deref().ok_or_else(|| {
        NodeError::Refused(anyhow!(
            "{}: found no `network`, expected one: none of its sources has images",
            path.display()
        ))
    })?;
    measured(card, card.display().to_string(), Some(&venue))
}

fn measure_demo() -> Result<EdgeReport, NodeError> {
    let folder = tempfile::tempdir().context("creating a temporary folder");
    let folder = folder.map_err(NodeError::Failed)?;
    let network = embedded::write_network(folder.path()).map_err(NodeError::failed)?;
    let card = folder.path().join(network);
    measured(&card, "the network of the demo".to_owned(), None)
}

fn measured(card: &Path, network: String, venue: Option<&Venue>) -> Result<EdgeReport, NodeError> {
    let backend = InferenceBackend::start(BackendChoice::Best).map_err(NodeError::failed)?;
    let found = measured_workers(card).map_err(NodeError::failed)?;
    let read = OnnxKeypointNetwork::load(card).map_err(NodeError::failed)?;
    let other_work = OtherWork::measured(read.card(), venue).map_err(NodeError::refused)?;
    let crops_per_s = found.last().map_or(0.0, |best| best.crops_per_s);
    let own_hz = venue.map(|venue| venue.rate_hz);
    let other_hz = RATES_HZ
        .into_iter()
        .filter(|rate_hz| own_hz != Some(*rate_hz));
    let people = own_hz
        .into_iter()
        .chain(other_hz)
        .map(|rate_hz| PeopleAtRate {
            rate_hz,
            people: people_at(rate_hz, crops_per_s),
        });
    Ok(EdgeReport {
        backend: backend.describe().to_owned(),
        network,
        people: people.collect(),
        workers: found,
        other_work,
    })
}

impl fmt::Display for EdgeReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n{}", self.backend, self.network)?;
        writeln!(f, "\nworkers  crops/s")?;
        for row in &self.workers {
            writeln!(f, "{:>7}  {:>7.0}", row.workers, row.crops_per_s)?;
        }
        writeln!(f, "\n     Hz  people of one viewpoint")?;
        for row in &self.people {
            writeln!(f, "{:>7}  {:>6}", row.rate_hz, row.people)?;
        }
        write!(f, "{}", self.other_work)
    }
}
