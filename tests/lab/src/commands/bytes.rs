//! `lab bytes`: bytes per person, view and tick against errors.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::bytes::codec::Codec;
use crate::bytes::run::{Curve, svg};
use crate::suite::scenes::{NamedScene, choose};
use anyhow::{Context as _, anyhow};
use farfield_node::process::NodeError;
use farfield_sim::simulated::in_memory::Input;
use farfield_sim::simulated::without_map_faults;

use super::recordings_folder;
use farfield::output;
use farfield_sim::embedded::{write_detector, write_network};

/// The name of the recording on the command line.
const SHELF: &str = "shelf";
/// Default: the suite of the paper, the scene in which single peaks are not enough, and the Shelf.
const USUAL: [&str; 3] = ["paper", "legs", SHELF];

/// Arguments of `lab bytes`.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct BytesArgs {
    /// Suites (paper, identity, own), scene files, embedded scenes, or `shelf`, the recording below `$FARFIELD_DATA`, else
    /// ../shared. Default: paper, legs and shelf.
    #[arg(value_name = "SCENE")]
    scenes: Vec<String>,
    /// Use only the first seconds of each scene.
    #[arg(long, value_name = "S", default_value_t = 5.0)]
    seconds: f64,
    /// Render images and read them with the embedded networks, instead of making maps from the truth.
    #[arg(long)]
    pixels: bool,
    /// Write `bytes.json` and a plot of each scene to this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
}

/// Runs the scenes and recordings of `args` with every codec, and prints each table when it is ready.
///
/// # Errors
/// A scene is missing or wrong, a run fails, or the result cannot be written.
pub(super) fn study(args: &BytesArgs) -> Result<(), NodeError> {
    let root = recordings_folder();
    let requested: Vec<String> = if args.scenes.is_empty() {
        USUAL.map(str::to_owned).into()
    } else {
        args.scenes.clone()
    };
    let (shelf, scenes): (Vec<String>, Vec<String>) =
        requested.into_iter().partition(|n| n == SHELF);
    let mut chosen = choose(&scenes, &root).map_err(NodeError::Refused)?;
    if args.pixels {
        chosen.leave_out_mirrors();
    }
    let recording = root.join("data/shelf");
    let shelf = !shelf.is_empty() && !args.pixels;
    if shelf && !recording.join("venue.toml").exists() && !args.scenes.is_empty() {
        let path = recording.display();
        return Err(NodeError::Refused(anyhow!("{path} is not there")));
    }
    if let Some(folder) = &args.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("creating {}", folder.display()))
            .map_err(NodeError::Refused)?;
    }
    if let (Some(note), false) = (&chosen.note, args.json) {
        output::print(&format!("NOTE: {note}\n\n")).map_err(NodeError::Failed)?;
    }
    let shelf = (shelf && recording.join("venue.toml").exists()).then_some(recording);
    run(args, chosen.scenes, shelf.as_deref()).map_err(NodeError::Failed)
}

fn run(args: &BytesArgs, scenes: Vec<NamedScene>, shelf: Option<&Path>) -> anyhow::Result<()> {
    let folder = tempfile::tempdir().context("making a folder for the embedded networks")?;
    let input = if args.pixels {
        Input::Pixels {
            network: folder.path().join(write_network(folder.path())?),
            detector: Some(folder.path().join(write_detector(folder.path())?)),
        }
    } else {
        Input::Maps
    };
    let codecs = Codec::all();
    let mut curves = Vec::new();
    for NamedScene { name, scene, .. } in scenes {
        let mut scene = scene.shortened(args.seconds);
        if args.pixels {
            scene = without_map_faults(scene);
        }
        let curve = Curve::of_scene(&name, &Arc::new(scene), &input, &codecs)
            .with_context(|| format!("running scene {name}"))?;
        show(args, &curve)?;
        curves.push(curve);
    }
    if let Some(folder) = shelf {
        let (venue, truth) = (folder.join("venue.toml"), folder.join("truth.jsonl"));
        let curve = Curve::of_recording(SHELF, &venue, &truth, &codecs)?;
        show(args, &curve)?;
        curves.push(curve);
    }
    let mean = Curve::mean_of(&curves);
    if curves.len() > 1
        && let Some(mean) = &mean
    {
        show(args, mean)?;
    }
    let json = serde_json::to_string_pretty(&curves).context("writing JSON")?;
    if let Some(folder) = &args.out {
        let path = folder.join("bytes.json");
        std::fs::write(&path, &json).with_context(|| format!("writing {}", path.display()))?;
    }
    if args.json {
        output::print(&format!("{json}\n"))?;
    }
    Ok(())
}

/// Prints a curve, and plots it if a folder is given.
fn show(args: &BytesArgs, curve: &Curve) -> anyhow::Result<()> {
    if let Some(folder) = &args.out {
        let name = format!("{}-{}.svg", curve.place, curve.input).replace(' ', "-");
        let path = folder.join(name);
        std::fs::write(&path, svg(curve)).with_context(|| format!("writing {}", path.display()))?;
    }
    if args.json {
        return Ok(());
    }
    output::print(&format!("{curve}\n\n"))
}
