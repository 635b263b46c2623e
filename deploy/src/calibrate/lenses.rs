//! Known lenses of the cameras: calibrations in any supported format, of one camera or of all.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_calibration::formats::{CameraRecord, Format, ImportOptions, export, import};
use farfield_node::process::say;
use farfield_proto::camera::{Intrinsics, LensModel};
use nalgebra::Isometry3;

use super::read_calibration;

/// `[NAME=]FILE` of the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct LensFile {
    /// The camera; `None`: the cameras in the file.
    camera: Option<String>,
    path: PathBuf,
}

impl std::str::FromStr for LensFile {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        Ok(match word.split_once('=') {
            Some((name, path)) if !name.is_empty() && !path.is_empty() => Self {
                camera: Some(name.to_owned()),
                path: path.into(),
            },
            Some(_) => return Err(format!("found `{word}`, expected NAME=FILE or FILE")),
            None => Self {
                camera: None,
                path: word.into(),
            },
        })
    }
}

impl LensFile {
    /// The file at `path` with the lens of `camera`.
    pub(super) fn for_camera(camera: &str, path: &Path) -> Self {
        Self {
            camera: Some(camera.to_owned()),
            path: path.to_owned(),
        }
    }

    /// The camera, if given.
    pub(super) fn camera(&self) -> Option<&str> {
        self.camera.as_deref()
    }
}

/// A camera's lens.
#[derive(Debug, Clone)]
pub(super) struct Lens {
    pub(super) size_px: [u32; 2],
    pub(super) intrinsics: Intrinsics,
    pub(super) model: LensModel,
}

impl Lens {
    /// Placeholder for an unknown lens where none is used.
    pub(super) fn placeholder() -> Self {
        Self::with_size([1, 1])
    }

    /// Placeholder where only the image size is used.
    pub(super) fn with_size(size_px: [u32; 2]) -> Self {
        let [width, height] = size_px.map(f64::from);
        Self {
            size_px,
            intrinsics: Intrinsics {
                fx_px: width.max(height),
                fy_px: width.max(height),
                cx_px: 0.5 * (width - 1.0),
                cy_px: 0.5 * (height - 1.0),
            },
            model: LensModel::ideal(),
        }
    }

    /// The lens as the calibration of a camera at the origin.
    ///
    /// # Errors
    /// A lens that no calibration can hold.
    pub(super) fn calibration(&self, name: &str) -> anyhow::Result<String> {
        self.calibration_at(name, Isometry3::identity())
    }

    /// The same for a camera with this pose.
    ///
    /// # Errors
    /// A lens that no calibration can hold.
    pub(super) fn calibration_at(
        &self,
        name: &str,
        camera_from_world: Isometry3<f64>,
    ) -> anyhow::Result<String> {
        let record = CameraRecord {
            name: name.to_owned(),
            size_px: self.size_px,
            intrinsics: self.intrinsics,
            lens: self.model,
            camera_from_world: Some(camera_from_world),
        };
        let files = export(&[record], Format::Farfield)?;
        let file = files.into_iter().next();
        Ok(file.context("a calibration without a file")?.text)
    }
}

/// The lens of the camera `name`.
///
/// # Errors
/// Lists the cameras with lenses.
pub(super) fn lens_of<'a>(
    lenses: &'a BTreeMap<String, Lens>,
    name: &str,
) -> anyhow::Result<&'a Lens> {
    lenses.get(name).ok_or_else(|| {
        let has: Vec<&str> = lenses.keys().map(String::as_str).collect();
        anyhow!(
            "no lens of camera `{name}`: found those of {}; set it with --lens {name}=FILE",
            has.join(", ")
        )
    })
}

/// The lenses of all files by camera. The file of one camera may be used for a camera of another name.
///
/// # Errors
/// A file that cannot be read.
pub(super) fn lenses(files: &[LensFile]) -> anyhow::Result<BTreeMap<String, Lens>> {
    let options = ImportOptions {
        only_lenses: true,
        ..ImportOptions::default()
    };
    let mut all = BTreeMap::new();
    for file in files {
        let imported = import(&[read_calibration(&file.path)?], &options)?;
        for remark in &imported.remarks {
            say(format_args!(
                "{}: {}: {remark}",
                file.path.display(),
                remark.kind.name()
            ));
        }
        for record in imported.cameras.iter().filter(|_| file.camera.is_none()) {
            insert(&mut all, &record.name, lens(record))?;
        }
        if let Some(camera) = &file.camera {
            let same = imported.cameras.iter().find(|it| it.name == *camera);
            let record = match (same, imported.cameras.as_slice()) {
                (Some(record), _) | (None, [record]) => record,
                (None, several) => bail!(
                    "{}: found {} cameras, but none with the name `{camera}`",
                    file.path.display(),
                    several.len()
                ),
            };
            insert(&mut all, camera, lens(record))?;
        }
    }
    Ok(all)
}

fn insert(all: &mut BTreeMap<String, Lens>, camera: &str, lens: Lens) -> anyhow::Result<()> {
    ensure!(
        all.insert(camera.to_owned(), lens).is_none(),
        "--lens: found two files for camera `{camera}`"
    );
    Ok(())
}

fn lens(record: &CameraRecord) -> Lens {
    Lens {
        size_px: record.size_px,
        intrinsics: record.intrinsics,
        model: record.lens,
    }
}
