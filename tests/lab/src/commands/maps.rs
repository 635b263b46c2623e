//! `lab maps`: writes the maps of a venue's or a scene's patches, before any codec, to one file. The codec's priors are
//! measured on it (`lab codec`).
//!
//! The file has for each patch width, height and number of maps as one byte each, then the cells.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use anyhow::{Context as _, anyhow};
use farfield_edge::pipeline::StandIn;
use farfield_node::process::NodeError;
use farfield_proto::patch::Maps;
use farfield_sim::simulated::without_map_faults;

use super::scenes::SceneArgument;
use crate::in_process::InProcess;
use crate::suite::run::{SceneRun, SceneRunPlan};
use farfield_sim::simulated::in_memory::Input;

/// Arguments of `lab maps`.
#[derive(Debug, clap::Args)]
pub(super) struct MapsArgs {
    /// The file to write.
    #[arg(value_name = "OUT")]
    out: PathBuf,
    /// A scene file, or the name of an embedded scene.
    #[arg(value_name = "SCENE", required_unless_present = "venue")]
    scene: Option<SceneArgument>,
    /// A venue file with recorded sources, instead of a scene.
    #[arg(long, value_name = "VENUE", conflicts_with = "scene")]
    venue: Option<PathBuf>,
    /// Use only the first ticks of the venue.
    #[arg(long, value_name = "N", requires = "venue")]
    ticks: Option<usize>,
    /// Use only the first seconds of the scene.
    #[arg(long, value_name = "S", conflicts_with = "venue")]
    seconds: Option<f64>,
    /// Render images of the scene and read them with the network of this card, instead of making maps from the truth.
    #[arg(long, value_name = "CARD", conflicts_with = "venue")]
    network: Option<PathBuf>,
}

/// Writes all maps to a file.
struct MapsTap(Arc<Mutex<BufWriter<File>>>);

impl StandIn for MapsTap {
    fn recode(&mut self, maps: &mut Maps) {
        let Ok(mut out) = self.0.lock() else { return };
        let head = [maps.width(), maps.height(), maps.keypoints()].map(|n| n as u8);
        let cells = (0..maps.keypoints()).flat_map(|k| maps.cells(k)).copied();
        let all: Vec<u8> = head.into_iter().chain(cells).collect();
        if let Err(error) = out.write_all(&all) {
            eprintln!("{error}");
        }
    }
}

/// Runs the venue or the scene, and writes the maps of all its patches.
///
/// # Errors
/// The scene or venue is missing or wrong, a run fails, or the file cannot be written.
pub(super) fn write(args: &MapsArgs) -> Result<(), NodeError> {
    let scene = args.scene.as_ref().map(SceneArgument::load).transpose()?;
    let file = File::create(&args.out)
        .with_context(|| format!("writing {}", args.out.display()))
        .map_err(NodeError::Refused)?;
    let file = Arc::new(Mutex::new(BufWriter::new(file)));
    let tap = {
        let file = Arc::clone(&file);
        move || Box::new(MapsTap(Arc::clone(&file))) as Box<dyn StandIn>
    };
    if let Some(venue) = &args.venue {
        run_venue(venue, args.ticks, &tap).map_err(NodeError::Failed)?;
    }
    if let Some(mut scene) = scene {
        if let Some(seconds) = args.seconds {
            scene = scene.shortened(seconds);
        }
        let mut input = Input::Maps;
        if let Some(card) = &args.network {
            scene = without_map_faults(scene);
            input = Input::Pixels {
                network: card.clone(),
                detector: None,
            };
        }
        let plan = SceneRunPlan {
            stand_in: Some(Arc::new(tap)),
            ..SceneRunPlan::default()
        };
        SceneRun::make(&Arc::new(scene), &input, plan).map_err(NodeError::Failed)?;
    }
    let mut file = file
        .lock()
        .map_err(|_| NodeError::Failed(anyhow!("an edge panicked")))?;
    file.flush().map_err(NodeError::failed)
}

fn run_venue(
    path: &Path,
    ticks: Option<usize>,
    tap: &dyn Fn() -> Box<dyn StandIn>,
) -> anyhow::Result<()> {
    let mut nodes = InProcess::open(path)?;
    nodes.set_stand_in(tap);
    for _ in 0..ticks.unwrap_or(usize::MAX) {
        if nodes.step()?.is_none() {
            break;
        }
    }
    Ok(())
}
