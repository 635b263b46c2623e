//! One image per camera, with the geometry of the calibration, so that people can compare the two.

use std::path::Path;

use farfield_edge::source::FrameContent;
use farfield_fusion::export::unfinished::write_whole;
use farfield_proto::plain_text::file_stem;
use farfield_proto::venue::Venue;
use image::ImageFormat;

use super::opened::OpenedSource;
use crate::overlay::{background, draw_place};
use crate::report_lines::ReportLines;

const PICTURES: &str = "pictures";

/// Writes `check_CAMERA.png` for every camera into `out`.
pub(super) fn draw(venue: &Venue, opened: &[OpenedSource], out: &Path, report: &mut ReportLines) {
    match draw_all(venue, opened, out) {
        Ok(()) => {
            let numbers = venue.cameras.iter().enumerate();
            let names: Vec<String> = numbers
                .map(|(i, camera)| format!("{} {}", i + 1, camera.model.name()))
                .collect();
            report.ok(
                PICTURES,
                format!(
                    "{}: check_CAMERA.png of every camera, with the field (yellow), the floor (grey), the axes at the origin \
                     (x red, y green, z blue), the used range of a fisheye (white), and the other cameras by number: {}",
                    out.display(),
                    names.join(", ")
                ),
            );
        }
        Err(error) => report.warn(
            PICTURES,
            format!("{error:#}"),
            "choose a writable folder: `--out DIR`",
        ),
    }
}

fn draw_all(venue: &Venue, opened: &[OpenedSource], out: &Path) -> anyhow::Result<()> {
    use anyhow::Context as _;
    std::fs::create_dir_all(out).with_context(|| format!("creating {}", out.display()))?;
    for (i, (camera, source)) in venue.cameras.iter().zip(opened).enumerate() {
        let content = match &source.first {
            Some(Ok(FrameContent::Image(image))) if image.size_px() == camera.model.size_px() => {
                Some(FrameContent::Image(image.clone()))
            }
            Some(Ok(FrameContent::Image(_)) | Err(_)) | None => None,
            Some(Ok(content)) => Some(content.clone()),
        };
        let mut image = background(content, &camera.model);
        draw_place(&mut image, venue, i);
        let path = out.join(format!("check_{}.png", file_stem(camera.model.name())));
        let mut bytes = std::io::Cursor::new(Vec::new());
        image
            .write_to(&mut bytes, ImageFormat::Png)
            .with_context(|| format!("encoding {}", path.display()))?;
        write_whole(path.clone(), &bytes.into_inner())
            .with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(())
}
