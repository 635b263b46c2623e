//! The maps of a venue's or a scene's patches, before any codec, in one file: what the codec's
//! contexts are measured on.
//!
//! ```text
//! cargo run --release -p farfield-lab --example write_maps -- OUT VENUE.toml [TICKS]
//! cargo run --release -p farfield-lab --example write_maps -- OUT SCENE SECONDS [CARD.toml]
//! ```
//!
//! SCENE is a scene file or an embedded scene's name; with a network's card its pictures are read by
//! that network. OUT gets, patch after patch, width, height and number of maps as one byte each, then
//! the cells.

use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::{Arc, Mutex};

use anyhow::Context as _;
use farfield_edge::pipeline::StandIn;
use farfield_lab::in_process::InProcess;
use farfield_lab::suite::run::{Plan, SceneRun};
use farfield_lab::suite::venue::Input;
use farfield_proto::patch::Maps;
use farfield_sim::embedded;
use farfield_sim::scene::Scene;
use farfield_sim::simulated::without_map_faults;

/// Writes down what passes.
struct Tap(Arc<Mutex<BufWriter<File>>>);

impl StandIn for Tap {
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

fn main() -> anyhow::Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [out, what, rest @ ..] = &args[..] else {
        anyhow::bail!("OUT and a venue or scene are missing");
    };
    let file = Arc::new(Mutex::new(BufWriter::new(File::create(out)?)));
    let tap = {
        let file = Arc::clone(&file);
        move || Box::new(Tap(Arc::clone(&file))) as Box<dyn StandIn>
    };
    if what.ends_with("venue.toml") {
        let ticks: usize = rest.first().map_or(Ok(usize::MAX), |n| n.parse())?;
        let mut nodes = InProcess::open(Path::new(what), None)?;
        nodes.set_stand_in(&tap);
        for _ in 0..ticks {
            if nodes.step()?.is_none() {
                break;
            }
        }
    } else {
        let seconds = rest.first().context("SECONDS is missing")?.parse()?;
        let mut scene = if Path::new(what).exists() {
            Scene::load(Path::new(what))?
        } else {
            embedded::scene(what)?
        };
        scene = scene.shortened(seconds);
        let input = match rest.get(1) {
            Some(card) => {
                scene = without_map_faults(scene);
                Input::Pixels {
                    network: card.into(),
                    detector: None,
                }
            }
            None => Input::Maps,
        };
        let plan = Plan {
            stand_in: Some(Arc::new(tap)),
            ..Plan::default()
        };
        SceneRun::make(&Arc::new(scene), &input, plan)?;
    }
    file.lock()
        .map_err(|_| anyhow::anyhow!("an edge panicked"))?
        .flush()?;
    Ok(())
}
