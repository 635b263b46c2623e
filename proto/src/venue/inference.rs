//! `[inference]`: the inference providers of live edges.

use serde::Deserialize;

use crate::toml_file::{FileError, Place, TomlFile, unknown_name};

/// An inference provider.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Provider {
    /// `TensorRT` of NVIDIA.
    TensorRt,
    /// CUDA of NVIDIA.
    Cuda,
    /// `OpenVINO` of Intel.
    OpenVino,
    /// Core ML of Apple.
    CoreMl,
    /// QNN of Qualcomm.
    Qnn,
    /// The processor, by ONNX Runtime itself or by `ort-tract`.
    Cpu,
}

impl Provider {
    /// All providers.
    pub const ALL: [Self; 6] = [
        Self::TensorRt,
        Self::Cuda,
        Self::OpenVino,
        Self::CoreMl,
        Self::Qnn,
        Self::Cpu,
    ];

    /// The name in the venue file.
    pub fn name(self) -> &'static str {
        match self {
            Self::TensorRt => "tensorrt",
            Self::Cuda => "cuda",
            Self::OpenVino => "openvino",
            Self::CoreMl => "coreml",
            Self::Qnn => "qnn",
            Self::Cpu => "cpu",
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct RawInference {
    providers: Vec<String>,
}

/// The providers at `place`, in the order of the attempts; empty if not set.
pub(super) fn providers(
    file: &TomlFile<'_>,
    place: &Place,
    raw: &[String],
) -> Result<Vec<Provider>, FileError> {
    let mut found = Vec::new();
    for (i, name) in raw.iter().enumerate() {
        let place = place.index(i);
        let known = Provider::ALL.into_iter().find(|it| it.name() == name);
        let provider = known.ok_or_else(|| {
            let problem = unknown_name("provider", name, &Provider::ALL.map(Provider::name));
            file.error(&place, problem)
        })?;
        if found.contains(&provider) {
            return Err(file.error(&place, format!("`{name}` is there twice")));
        }
        found.push(provider);
    }
    Ok(found)
}

impl RawInference {
    /// The default of all viewpoints without their own setting.
    pub(super) fn checked(&self, file: &TomlFile<'_>) -> Result<Vec<Provider>, FileError> {
        let place = Place::field("inference").key("providers");
        providers(file, &place, &self.providers)
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn read(text: &str) -> Result<Vec<Provider>, String> {
        let file = TomlFile::parse(text, Path::new("venue.toml")).unwrap();
        let raw: RawInference = toml::from_str(text).unwrap();
        raw.checked(&file).map_err(|error| error.problem)
    }

    #[test]
    fn providers_keep_their_order_and_unknown_ones_are_refused() {
        assert_eq!(
            read("providers = [\"cuda\", \"cpu\"]"),
            Ok(vec![Provider::Cuda, Provider::Cpu])
        );
        assert_eq!(read(""), Ok(Vec::new()));
        let unknown = read("providers = [\"cudda\"]").unwrap_err();
        assert!(
            unknown.contains("`cudda`") && unknown.contains("`cuda`"),
            "{unknown}"
        );
        assert!(read("providers = [\"cpu\", \"cpu\"]").is_err());
    }
}
