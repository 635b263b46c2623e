//! The network that the project carries: trained on rendered crops, for simulated venues.

use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::write;

/// Name of the card.
const CARD_NAME: &str = "farfield_hrnet.toml";
/// Name of the network, as the card says it.
const ONNX_NAME: &str = "farfield_hrnet.onnx";
const CARD: &str = include_str!("../../network/farfield_hrnet.toml");
const ONNX: &[u8] = include_bytes!("../../network/farfield_hrnet.onnx");

/// Writes the network and its card into `folder`, and returns the card's file name.
///
/// # Errors
/// [`FileError`] for a folder or file that cannot be written.
pub fn write_network(folder: &Path) -> Result<&'static str, FileError> {
    write(&folder.join(ONNX_NAME), ONNX)?;
    write(&folder.join(CARD_NAME), CARD.as_bytes())?;
    Ok(CARD_NAME)
}

#[cfg(test)]
mod tests {
    use farfield_proto::model_card::HeatmapCard;

    use super::*;

    /// What a network may take of a repository, bytes.
    const MOST_BYTES: usize = 4 << 20;

    #[test]
    fn the_card_is_one_and_names_the_network_beside_it() {
        let card = HeatmapCard::parse(CARD, Path::new(CARD_NAME)).unwrap();
        assert_eq!(card.file, Path::new(ONNX_NAME));
        assert!(ONNX.len() <= MOST_BYTES, "{} bytes", ONNX.len());
        let folder = tempfile::tempdir().unwrap();
        let card = write_network(&folder.path().join("models")).unwrap();
        assert!(folder.path().join("models").join(card).is_file());
        assert!(folder.path().join("models").join(ONNX_NAME).is_file());
    }
}
