//! The calibration of the venue: the given file, or the one in the folder.
//!
//! A calibration in the form of another program, or one whose picture sizes are those of padded pictures, is written anew next
//! to the venue file.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail, ensure};
use farfield_calibration::formats::{Format, ImportOptions, Imported, Remark, RemarkKind, import};
use farfield_edge::source::{SourceError, probe};
use farfield_import::calibrations::{self, Choice, FoundCalibration};
use farfield_node::process::say;
use farfield_proto::calibration::{Calibration, text_of};
use farfield_proto::toml_file::unread;
use farfield_proto::venue::Venue;

use super::{InitArgs, answer, recordings};
use crate::calibrate::{read_calibration, remark_line, venue_calibration};

/// Encoders and cameras pad pictures to multiples of this many pixels, or cut them to less.
const BLOCK_PX: u32 = 16;

/// The calibration of a new venue.
pub(super) struct VenueCalibration {
    /// Its file, which does not exist yet if [`Self::text`] is set.
    pub(super) path: PathBuf,
    pub(super) calibration: Calibration,
    /// The content of the file to write.
    pub(super) text: Option<String>,
    /// What was read.
    imported: Imported,
}

impl VenueCalibration {
    /// The given calibration, or the only one in the folder, detected by content. `out` is the venue file.
    ///
    /// # Errors
    /// None or several are found, or the file cannot be used.
    pub(super) fn find(args: &InitArgs, out: &Path) -> anyhow::Result<Self> {
        if let Some(path) = &args.calibration {
            return Self::read(path, out);
        }
        let shown = args.folder.display();
        let what = match calibrations::among(&recordings::entries(&args.folder)?).choice() {
            Choice::One(one, others) => {
                for other in others {
                    say(format_args!("found but not used: {other}"));
                }
                let FoundCalibration { imported, .. } = &*one;
                return match one.paths().as_slice() {
                    [path] => Self::of(path, imported.clone(), out),
                    _ => Self::written_anew(imported.clone(), out),
                };
            }
            Choice::Several(all) => {
                format!("found several different calibrations in {shown}: {all}")
            }
            Choice::None(unusable) if unusable.is_empty() => {
                format!("found no calibration in {shown}")
            }
            Choice::None(unusable) => {
                let reasons = unusable.join("; ");
                format!("found no usable calibration in {shown}: {reasons}")
            }
        };
        match answer(&format!("{what}. Which file is the calibration?"))? {
            Some(path) => Self::read(Path::new(&path), out),
            None => bail!("{what}: set the calibration with `--calibration FILE`"),
        }
    }

    fn read(path: &Path, out: &Path) -> anyhow::Result<Self> {
        let imported = import(&[read_calibration(path)?], &ImportOptions::default())?;
        Self::of(path, imported, out)
    }

    /// The calibration `imported` from the file `path`.
    fn of(path: &Path, imported: Imported, out: &Path) -> anyhow::Result<Self> {
        if !matches!(imported.format, Format::Farfield | Format::Caliscope) {
            return Self::written_anew(imported, out);
        }
        let bytes = fs::read(path).map_err(|error| {
            let problem = unread(&error, "a calibration in TOML");
            anyhow!("reading {}: {problem}", path.display())
        })?;
        Ok(Self {
            path: path.to_owned(),
            calibration: Calibration::parse(&text_of(bytes, path)?, path)?,
            text: None,
            imported,
        })
    }

    /// A new file next to the venue file `out`, in metres.
    fn written_anew(imported: Imported, out: &Path) -> anyhow::Result<Self> {
        let stem = out.file_stem().unwrap_or_default().to_string_lossy();
        let path = out.with_file_name(format!("{stem}-calibration.toml"));
        ensure!(
            !path.exists(),
            "{} already exists, and is not overwritten: give it with `--calibration`, or remove it",
            path.display()
        );
        for remark in &imported.remarks {
            say(format_args!("{}", remark_line(remark)));
        }
        let (text, calibration) = venue_calibration(&imported, &path)?;
        Ok(Self {
            path,
            calibration,
            text: Some(text),
            imported,
        })
    }

    /// The same for the sizes of the pictures of `venue`, where they differ by less than a block from those of the
    /// calibration: `None` if no size does.
    ///
    /// # Errors
    /// The new file cannot be named.
    pub(super) fn of_pictures(&self, venue: &Venue, out: &Path) -> anyhow::Result<Option<Self>> {
        let mut imported = self.imported.clone();
        imported.remarks.clear();
        for camera in &venue.cameras {
            let Err(SourceError::PixelSize {
                found_px,
                expected_px,
                ..
            }) = probe(camera, venue)
            else {
                continue;
            };
            let name = camera.model.name();
            let record = imported.cameras.iter_mut().find(|it| it.name == name);
            if let (Some(record), true) = (record, is_padding(found_px, expected_px)) {
                record.size_px = found_px;
                let [[width, height], [old_width, old_height]] = [found_px, expected_px];
                let text = format!(
                    "its pictures have {width}x{height} pixels, its calibration {old_width}x{old_height}: taken as cut or \
                     padded at the right and lower edge, so that its principal point stays (`--exact-sizes` refuses this)"
                );
                let remark = Remark::of_camera(RemarkKind::Assumed, name, text);
                imported.remarks.push(remark);
            }
        }
        if imported.remarks.is_empty() {
            return Ok(None);
        }
        Self::written_anew(imported, out).map(Some)
    }
}

/// Whether two sizes differ as pictures with and without padding do: by less than a block, where one is whole blocks.
fn is_padding(found_px: [u32; 2], expected_px: [u32; 2]) -> bool {
    let sides = found_px.into_iter().zip(expected_px);
    { sides }.all(|(a, b)| {
        let padded = a.max(b);
        a == b || padded.is_multiple_of(BLOCK_PX) && padded - a.min(b) < BLOCK_PX
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_with_and_without_padding_are_of_the_same_pictures() {
        assert!(is_padding([1080, 1920], [1088, 1920]));
        assert!(is_padding([1920, 1088], [1920, 1080]));
        assert!(!is_padding([1920, 1080], [1080, 1920]), "turned");
        assert!(!is_padding([1280, 720], [1920, 1080]), "scaled");
        assert!(!is_padding([1070, 1920], [1080, 1920]), "not in blocks");
    }
}
