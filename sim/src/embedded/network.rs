//! The embedded networks for simulated venues; they are trained on rendered pictures.

use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::write;

/// Name of the network's card.
const CARD_NAME: &str = "farfield_hrnet.toml";
/// Name of the network's file in its card.
const ONNX_NAME: &str = "farfield_hrnet.onnx";
const CARD: &str = include_str!("../../network/farfield_hrnet.toml");
const ONNX: &[u8] = include_bytes!("../../network/farfield_hrnet.onnx");

/// Name of the detector's card.
const DETECTOR_CARD_NAME: &str = "farfield_detector.toml";
/// Name of the detector's file in its card.
const DETECTOR_ONNX_NAME: &str = "farfield_detector.onnx";
const DETECTOR_CARD: &str = include_str!("../../network/detector/farfield_detector.toml");
const DETECTOR_ONNX: &[u8] = include_bytes!("../../network/detector/farfield_detector.onnx");

/// Writes the network and its card into `folder`; returns the file name of the card.
///
/// # Errors
/// [`FileError`] for a folder or file that cannot be written.
pub fn write_network(folder: &Path) -> Result<&'static str, FileError> {
    write(&folder.join(ONNX_NAME), ONNX)?;
    write(&folder.join(CARD_NAME), CARD.as_bytes())?;
    Ok(CARD_NAME)
}

/// Writes the detector and its card into `folder`; returns the file name of the card.
///
/// # Errors
/// [`FileError`] for a folder or file that cannot be written.
pub fn write_detector(folder: &Path) -> Result<&'static str, FileError> {
    write(&folder.join(DETECTOR_ONNX_NAME), DETECTOR_ONNX)?;
    write(&folder.join(DETECTOR_CARD_NAME), DETECTOR_CARD.as_bytes())?;
    Ok(DETECTOR_CARD_NAME)
}

#[cfg(test)]
mod tests {
    use farfield_proto::model_card::{DetectorCard, HeatmapCard};

    use super::*;

    /// Largest size of a network in the repository, bytes.
    const MOST_BYTES: usize = 4 << 20;

    #[test]
    fn the_card_is_valid_and_names_the_network_file() {
        let card = HeatmapCard::parse(CARD, Path::new(CARD_NAME)).unwrap();
        assert_eq!(card.file, Path::new(ONNX_NAME));
        assert!(ONNX.len() <= MOST_BYTES, "{} bytes", ONNX.len());
        let folder = tempfile::tempdir().unwrap();
        let card = write_network(&folder.path().join("models")).unwrap();
        assert!(folder.path().join("models").join(card).is_file());
        assert!(folder.path().join("models").join(ONNX_NAME).is_file());
    }

    /// Largest size of the detector in the repository, bytes.
    const MOST_DETECTOR_BYTES: usize = 1 << 20;

    #[test]
    fn the_detectors_card_names_the_detector_file() {
        let card = DetectorCard::parse(DETECTOR_CARD, Path::new(DETECTOR_CARD_NAME)).unwrap();
        assert_eq!(card.file, Path::new(DETECTOR_ONNX_NAME));
        assert!(DETECTOR_ONNX.len() <= MOST_DETECTOR_BYTES);
        let folder = tempfile::tempdir().unwrap();
        let card = write_detector(folder.path()).unwrap();
        assert!(folder.path().join(card).is_file());
        assert!(folder.path().join(DETECTOR_ONNX_NAME).is_file());
    }
}
