//! Execution providers of the running ONNX Runtime: which it was built with, and what a session needs to run on one.

use std::path::{Path, PathBuf};

use farfield_proto::venue::Provider;
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::builder::SessionBuilder;

/// Types that stand for providers by their names, and the function that asks for each.
macro_rules! providers {
    ($($provider:ident $name:literal)*) => {
        $(
            struct $provider;

            impl ExecutionProvider for $provider {
                const NAME: &'static str = $name;

                fn register(&self, _: &mut SessionBuilder) -> ort::Result<()> {
                    // It is asked for, and never used.
                    Ok(())
                }
            }
        )*

        /// The names of those that the library has. To be called when a backend has been started.
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

/// Whether `provider` keeps what it has compiled.
pub(super) fn compiles(provider: Provider) -> bool {
    matches!(provider, Provider::TensorRt | Provider::OpenVino)
}

/// What puts a session on `provider`, which keeps what it compiles in the folder `compiled`; `None`: the processor needs nothing.
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
    // Else the processor would run the network, and nobody would know.
    Some(dispatch.error_on_failure())
}

/// Where compiled networks are kept between starts: of the file with that fingerprint, for this library.
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
