//! Execution providers of the running ONNX Runtime: the supported ones, and the configuration of a
//! session for one.

use std::path::{Path, PathBuf};

use farfield_proto::venue::Provider;
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::builder::SessionBuilder;

/// Defines types for providers by name, and the function that checks each.
macro_rules! providers {
    ($($provider:ident $name:literal)*) => {
        $(
            struct $provider;

            impl ExecutionProvider for $provider {
                const NAME: &'static str = $name;

                fn register(&self, _: &mut SessionBuilder) -> ort::Result<()> {
                    // It is only checked for, never used.
                    Ok(())
                }
            }
        )*

        /// The names of the library's providers. Call it after the backend was started.
        pub(super) fn built_in() -> Vec<&'static str> {
            let all = [$(($provider::NAME, $provider::is_available())),*];
            all.into_iter().filter(|(_, is_there)| matches!(is_there, Ok(true))).map(|(name, _)| name).collect()
        }
    };
}

/// ONNX Runtime's name of `provider`.
pub(super) fn runtime_name(provider: Provider) -> &'static str {
    match provider {
        Provider::TensorRt => TensorRt::NAME,
        Provider::Cuda => Cuda::NAME,
        Provider::OpenVino => OpenVino::NAME,
        Provider::CoreMl => CoreMl::NAME,
        Provider::Qnn => Qnn::NAME,
        Provider::Cpu => Cpu::NAME,
    }
}

/// Whether `provider` caches compiled networks.
pub(super) fn compiles(provider: Provider) -> bool {
    matches!(provider, Provider::TensorRt | Provider::OpenVino)
}

/// The registration of a session on `provider`, with the cache folder `compiled`; `None` for the
/// CPU.
pub(super) fn registration(
    provider: Provider,
    compiled: &Path,
) -> Option<ExecutionProviderDispatch> {
    let compiled = compiled.to_string_lossy();
    let dispatch = match provider {
        Provider::TensorRt => ep::TensorRT::default()
            .with_engine_cache(true)
            .with_engine_cache_path(&compiled)
            .with_timing_cache(true)
            .with_timing_cache_path(&compiled)
            .build(),
        Provider::Cuda => ep::CUDA::default().build(),
        Provider::OpenVino => ep::OpenVINO::default().with_cache_dir(&compiled).build(),
        Provider::CoreMl => ep::CoreML::default().build(),
        Provider::Qnn => ep::QNN::default().build(),
        Provider::Cpu => return None,
    };
    // Otherwise the CPU would run the network without a message.
    Some(dispatch.error_on_failure())
}

/// The cache folder of compiled networks, for the file with this fingerprint and this library.
pub(super) fn compiled_folder(model_hash: &str, library: &str) -> PathBuf {
    let base = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from);
    let home = || Some(PathBuf::from(std::env::var_os("HOME")?).join(".cache"));
    let base = base.or_else(home).unwrap_or_else(std::env::temp_dir);
    let library = blake3::hash(library.as_bytes()).to_hex();
    base.join("farfield/compiled")
        .join(format!("{model_hash}-{}", &library[..16]))
}

providers! {
    Cpu "CPUExecutionProvider"
    Cuda "CUDAExecutionProvider"
    TensorRt "TensorrtExecutionProvider"
    MiGraphX "MIGraphXExecutionProvider"
    OpenVino "OpenVINOExecutionProvider"
    CoreMl "CoreMLExecutionProvider"
    Qnn "QNNExecutionProvider"
    OneDnn "DnnlExecutionProvider"
}
