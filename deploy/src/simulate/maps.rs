//! Cameras as files of maps that were made beforehand.

use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::export::unfinished::Unfinished;
use farfield_node::process::Ending;
use farfield_sim::maps_file::write_maps;

use super::RecordingPlan;
use super::kind::RecordingKind;
use super::work::{Interrupt, each_camera};

/// Writes one file per camera into `folder`.
pub(super) fn write(
    plan: &RecordingPlan,
    folder: &Path,
    interrupt: &Interrupt,
) -> anyhow::Result<Ending> {
    let cameras = plan.scene.cameras();
    each_camera(cameras.len(), interrupt, |camera| {
        let path = folder.join(RecordingKind::Maps.path(cameras[camera].name()));
        let goes_on = || !interrupt.is_asked();
        let write = || -> anyhow::Result<Ending> {
            if let Some(parent) = path.parent() {
                std::fs::create_dir_all(parent)?;
            }
            let mut file = Unfinished::create(&path)?;
            if !write_maps(&plan.crowd, camera, plan.course, None, &mut file, &goes_on)? {
                return Ok(Ending::Interrupted);
            }
            file.flush()?;
            file.finish()?;
            Ok(Ending::Done)
        };
        write().with_context(|| format!("writing {}", path.display()))
    })
}
