//! Which execution providers the running ONNX Runtime was built with. Inference uses the processor alone, so that every
//! machine gives the same maps; the others are told of, not used.

use ort::ep::ExecutionProvider;
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

providers! {
    Cpu "CPUExecutionProvider"
    Cuda "CUDAExecutionProvider"
    TensorRt "TensorrtExecutionProvider"
    MiGraphX "MIGraphXExecutionProvider"
    OpenVino "OpenVINOExecutionProvider"
    CoreMl "CoreMLExecutionProvider"
    OneDnn "DnnlExecutionProvider"
}
