//! `lab render`: images of a scene as PNG files, and the durations.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use farfield::output;
use farfield_edge::crop::{CropGeometry, CropShape};
use farfield_node::process::NodeError;
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::frames::Point;
use farfield_proto::tick::Tick;
use farfield_sim::render::{RenderSettings, Renderer};
use farfield_sim::scene::Scene;

use super::scenes::SceneArgument;

/// Arguments of `lab render`.
#[derive(Debug, clap::Args)]
pub(super) struct RenderArgs {
    /// A scene file, or the name of an embedded scene.
    scene: SceneArgument,
    /// Index of the scene's camera, from 0.
    camera: usize,
    /// The ticks to render.
    #[arg(value_name = "TICK", required = true, allow_negative_numbers = true)]
    ticks: Vec<i64>,
    /// The folder for the images.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Renders the ticks, and the crop of each person.
///
/// # Errors
/// The scene is missing or wrong or has no such camera, or an image cannot be written.
pub(super) fn render(args: &RenderArgs) -> Result<(), NodeError> {
    let scene = Arc::new(args.scene.load()?);
    let started = now();
    let renderer = Renderer::new(Arc::clone(&scene), args.camera, RenderSettings::default())
        .ok_or_else(|| NodeError::Refused(anyhow!("the scene has no camera {}", args.camera)))?;
    print_duration("backdrop", started).map_err(NodeError::Failed)?;
    render_all(args, &scene, &renderer).map_err(NodeError::Failed)
}

fn render_all(args: &RenderArgs, scene: &Scene, renderer: &Renderer) -> anyhow::Result<()> {
    std::fs::create_dir_all(&args.out).with_context(|| format!("making {}", args.out.display()))?;
    for tick in args.ticks.iter().copied().map(Tick) {
        let started = now();
        let picture = renderer.render(scene.time_s(tick));
        print_duration(&format!("tick {}", tick.0), started)?;
        write_crops(renderer, scene, args.camera, tick, &args.out)?;
        picture.save(
            args.out
                .join(format!("camera{}_{}.png", args.camera, tick.0)),
        )?;
    }
    Ok(())
}

/// Prints the time since `started`.
fn print_duration(what: &str, started: std::time::Instant) -> anyhow::Result<()> {
    output::print(&format!(
        "{what}: {:.1} ms\n",
        started.elapsed().as_secs_f64() * 1e3
    ))
}

/// Writes the crop of each person, with an upright box of the joints.
fn write_crops(
    renderer: &Renderer,
    scene: &Scene,
    camera: usize,
    tick: Tick,
    dir: &Path,
) -> anyhow::Result<()> {
    let time_s = scene.time_s(tick);
    for person in 0..scene.people().len() {
        let Some(truth) = scene.person_at(person, time_s) else {
            continue;
        };
        let model = &scene.cameras()[camera];
        let seen: Option<Vec<_>> = truth
            .joints_m
            .iter()
            .map(|&p| Some(model.project(Point::new(p.into()))?.vector_px()))
            .collect();
        let Some(seen) = seen else {
            continue;
        };
        let low = seen.iter().fold(seen[0], |a, p| a.inf(p));
        let high = seen.iter().fold(seen[0], |a, p| a.sup(p));
        let box_of_joints = BoundingBox {
            center_px: ((low + high) / 2.0).map(|v| v as f32).into(),
            size_px: ((high - low) * 1.25).map(|v| v as f32).into(),
            rotation_rad: 0.0,
        };
        let Some(geometry) = CropGeometry::new(&box_of_joints, CropShape::without_maps([192, 256]))
        else {
            continue;
        };
        let started = now();
        let crop = renderer.render_crop(time_s, &geometry);
        print_duration("  crop", started)?;
        if let Some(crop) = crop {
            crop.save(dir.join(format!("camera{camera}_{}_crop{person}.png", tick.0)))?;
        }
    }
    Ok(())
}

#[expect(
    clippy::disallowed_methods,
    reason = "a measurement for people, outside every core"
)]
fn now() -> std::time::Instant {
    std::time::Instant::now()
}
