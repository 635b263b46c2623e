//! Writes pictures of a scene as PNG files, and says how long they took:
//! `cargo run --release -p farfield-lab --example render_frame -- SCENE CAMERA TICK [TICK...] DIR`.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context as _;
use farfield_edge::crop::{CropGeometry, CropShape};
use farfield_proto::bounding_box::BoundingBox;
use farfield_proto::frames::Point;
use farfield_proto::tick::Tick;
use farfield_sim::render::{RenderSettings, Renderer};
use farfield_sim::scene::Scene;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, camera, ticks @ .., dir] = arguments.as_slice() else {
        anyhow::bail!("usage: render_frame SCENE CAMERA TICK [TICK...] DIR");
    };
    let scene = Arc::new(Scene::load(Path::new(scene))?);
    let camera: usize = camera.parse().context("CAMERA is a number from 0")?;
    let started = now();
    let renderer = Renderer::new(Arc::clone(&scene), camera, RenderSettings::default())
        .context("the scene has no such camera")?;
    println!("backdrop: {:.0} ms", started.elapsed().as_secs_f64() * 1e3);
    let dir = PathBuf::from(dir);
    std::fs::create_dir_all(&dir)?;
    for tick in ticks {
        let tick = Tick(tick.parse().context("TICK is a number")?);
        let started = now();
        let picture = renderer.render(scene.time_s(tick));
        println!(
            "tick {}: {:.1} ms",
            tick.0,
            started.elapsed().as_secs_f64() * 1e3
        );
        write_crops(&renderer, &scene, camera, tick, &dir)?;
        picture.save(dir.join(format!("camera{camera}_{}.png", tick.0)))?;
    }
    Ok(())
}

/// Writes what the network would see of each person, upright boxes of the joints.
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
        println!("  crop: {:.1} ms", started.elapsed().as_secs_f64() * 1e3);
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
