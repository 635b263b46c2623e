//! Moments of CMU Panoptic as venues: one picture per camera.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Deserialize;

/// Metres in a unit of the dataset's translations.
const METRES_PER_UNIT: f64 = 0.01;

/// From our world (z up) to that of the dataset (y down).
const DATASET_FROM_WORLD: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 1.0, 0.0);

#[derive(Deserialize)]
struct CalibrationFile {
    cameras: Vec<CalibratedCamera>,
}

/// A camera in the dataset's form, with names of the dataset.
#[derive(Deserialize)]
struct CalibratedCamera {
    name: String,
    #[serde(rename = "K")]
    matrix: [[f64; 3]; 3],
    #[serde(rename = "distCoef")]
    distortions: [f64; 5],
    #[serde(rename = "R")]
    rotation: [[f64; 3]; 3],
    #[serde(rename = "t")]
    translation: [[f64; 1]; 3],
}

/// The folders of moments in `folder`, by name.
///
/// # Errors
/// The folder cannot be read.
pub(super) fn moments_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut moments = Vec::new();
    for entry in entries {
        let path = entry?.path();
        if path.is_dir() {
            moments.push(path);
        }
    }
    moments.sort();
    Ok(moments)
}

/// Writes a venue with one viewpoint per camera of `moment` into `folder`, and returns its path. `models` has the networks.
///
/// # Errors
/// The calibration cannot be read, or a file cannot be written.
pub(super) fn write_venue(moment: &Path, models: &Path, folder: &Path) -> anyhow::Result<PathBuf> {
    let calibration = moment.with_file_name("calibration.json");
    let text = fs::read_to_string(&calibration).context(calibration.display().to_string())?;
    let file: CalibrationFile = serde_json::from_str(&text)?;
    let network = models.join("tinypose_256x192.toml").canonicalize()?;
    let detector = models.join("rtmdet_nano_person.toml").canonicalize()?;
    let mut cameras = String::new();
    let mut venue = format!(
        "name = \"panoptic\"\nrate_hz = 30.0\ncalibration = \"calibration.toml\"\nnetwork = \"{}\"\ndetector = \"{}\"\n",
        network.display(),
        detector.display()
    );
    for camera in &file.cameras {
        let name = &camera.name;
        camera.write(&mut cameras)?;
        let own = folder.join(name);
        fs::create_dir_all(&own)?;
        fs::copy(moment.join(format!("{name}.jpg")), own.join("000000.jpg"))?;
        write!(
            venue,
            "\n[[viewpoint]]\nname = \"v{name}\"\n[[viewpoint.camera]]\nname = \"c{name}\"\nsource = {{ kind = \"images\", path = \"{name}/%06d.jpg\" }}\n"
        )?;
    }
    fs::write(folder.join("calibration.toml"), cameras)?;
    let path = folder.join("venue.toml");
    fs::write(&path, venue)?;
    Ok(path)
}

impl CalibratedCamera {
    /// Appends the camera in the form of a calibration file.
    fn write(&self, text: &mut String) -> std::fmt::Result {
        let rotation = Matrix3::from_fn(|row, column| self.rotation[row][column]);
        let rotation = Rotation3::from_matrix(&(rotation * DATASET_FROM_WORLD));
        let translation_m = Vector3::from(self.translation.map(|[value]| value)) * METRES_PER_UNIT;
        let [name, matrix, distortions] = [
            format!("c{}", self.name),
            format!("{:?}", self.matrix),
            format!("{:?}", self.distortions),
        ];
        let rotation: [f64; 3] = rotation.scaled_axis().into();
        let translation: [f64; 3] = translation_m.into();
        write!(
            text,
            "[{name}]\nname = \"{name}\"\nsize = [1920, 1080]\nmatrix = {matrix}\ndistortions = {distortions}\nrotation = {rotation:?}\ntranslation = {translation:?}\nfisheye = false\n\n"
        )
    }
}
