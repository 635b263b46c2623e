//! Scenes of any content: read or refused, never a panic, and never for ever.
#![no_main]

use std::hint::black_box;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use farfield_sim::embedded::CLIPS;
use farfield_sim::motion::Clip;
use farfield_sim::scene::Scene;
use libfuzzer_sys::fuzz_target;

static CLIP: LazyLock<Arc<Clip>> = LazyLock::new(|| {
    let (name, text) = CLIPS[0];
    Arc::new(Clip::parse(text, Path::new(name)).expect("an embedded clip can be read"))
});

fuzz_target!(|text: &str| {
    let scene = Scene::parse(text, Path::new("scene.toml"), &mut |_| Ok(Arc::clone(&CLIP)));
    if let Ok(scene) = scene {
        black_box(scene.person_at(0, scene.seconds() / 2.0));
    }
});
