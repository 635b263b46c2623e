//! The inference backend of this process: ONNX Runtime if found, else `ort-tract`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;

use farfield_proto::venue::Provider;
use ort::environment::Environment;
use tracing::{info, warn};

use super::library::{Places, VARIABLE};
use super::{providers, trial};
use crate::inference::NetworkError;

/// The backend to start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BackendChoice {
    /// ONNX Runtime if found, else `ort-tract`.
    #[default]
    Best,
    /// `ort-tract`, even if ONNX Runtime is found.
    Tract,
}

/// The running backend. There is one per process, because its library is global.
#[derive(Debug)]
pub struct InferenceBackend {
    environment: Environment,
    description: String,
    is_tract: bool,
    /// Whether a library was found but not usable.
    has_refused: bool,
}

static BACKEND: OnceLock<Result<InferenceBackend, String>> = OnceLock::new();

impl InferenceBackend {
    /// Starts the backend, or returns the running one, and logs which one it is.
    ///
    /// ONNX Runtime is searched in `$ORT_DYLIB_PATH`, in the folder of the binary, in the system's
    /// library folders and in installed `onnxruntime` Python packages, in that order. Each library
    /// is first tried in a separate process. An unusable library is reported with its path, and the
    /// next one is tried.
    ///
    /// # Errors
    /// [`NetworkError::Backend`] if `$ORT_DYLIB_PATH` is set but is no usable library, or if
    /// [`BackendChoice::Tract`] is requested after ONNX Runtime was started.
    pub fn start(choice: BackendChoice) -> Result<&'static Self, NetworkError> {
        let started = BACKEND.get_or_init(|| {
            let backend = match choice {
                BackendChoice::Best => Self::best(&Places::of_process()),
                BackendChoice::Tract => Self::tract("asked for"),
            };
            if let Ok(backend) = &backend {
                if backend.is_tract || backend.has_refused {
                    warn!("{}", backend.description);
                } else {
                    info!("{}", backend.description);
                }
            }
            backend
        });
        match started {
            Err(problem) => Err(NetworkError::Backend {
                problem: problem.clone(),
            }),
            Ok(backend) if choice == BackendChoice::Tract && !backend.is_tract => {
                Err(NetworkError::Backend {
                    problem: format!("already running: {}", backend.description),
                })
            }
            Ok(backend) => Ok(backend),
        }
    }

    /// One line for the operator: the backend, its path, and its consequences.
    pub fn describe(&self) -> &str {
        &self.description
    }

    /// Whether the slow fall-back runs.
    pub fn is_tract(&self) -> bool {
        self.is_tract
    }

    /// Whether an unusable library was found; [`Self::describe`] names it and the reason.
    pub fn has_refused(&self) -> bool {
        self.has_refused
    }

    /// The execution providers of the library, by ONNX Runtime's names.
    pub fn providers(&self) -> Vec<&'static str> {
        if self.is_tract {
            Vec::new()
        } else {
            providers::built_in()
        }
    }

    /// Whether the backend supports `provider`.
    pub fn has(&self, provider: Provider) -> bool {
        provider == Provider::Cpu
            || self
                .providers()
                .contains(&providers::runtime_name(provider))
    }

    pub(super) fn environment(&self) -> &Environment {
        &self.environment
    }

    fn best(places: &Places) -> Result<Self, String> {
        if let Some(path) = &places.variable {
            let named = |problem| format!("${VARIABLE} names `{}`: {problem}", path.display());
            let backend = trial::accepts(path).and_then(|()| Self::onnx_runtime(path));
            return backend.map_err(named);
        }
        let mut refused = Vec::new();
        if let Some(path) = first_accepted(places, &mut refused) {
            // `ort` loads only one library per process, even if that fails.
            match Self::onnx_runtime(&path) {
                Ok(mut backend) => {
                    backend.description += &refused.concat();
                    backend.has_refused = !refused.is_empty();
                    return Ok(backend);
                }
                Err(problem) => refused.push(refusal(&path, &problem)),
            }
        }
        let found = if refused.is_empty() {
            "no ONNX Runtime library was found".to_owned()
        } else {
            format!(
                "no usable ONNX Runtime library was found{}",
                refused.concat()
            )
        };
        let mut backend = Self::tract(&found)?;
        backend.has_refused = !refused.is_empty();
        Ok(backend)
    }

    fn onnx_runtime(path: &Path) -> Result<Self, String> {
        if !path.is_file() {
            let problem = if path.is_dir() {
                "it is a folder, expected the library in it"
            } else {
                "there is no such file"
            };
            return Err(problem.to_owned());
        }
        let library = ort::init_from(path).map_err(|e| e.to_string())?;
        let environment = library
            .with_telemetry(false)
            .build()
            .map_err(|e| e.to_string())?;
        // Messages below a warning would be created and discarded.
        environment.set_log_level(ort::logging::LogLevel::Warning);
        let description = format!("inference by ONNX Runtime (`{}`)", path.display());
        Ok(Self {
            environment,
            description,
            is_tract: false,
            has_refused: false,
        })
    }

    fn tract(reason: &str) -> Result<Self, String> {
        ort::set_api(ort_tract::api());
        let environment = ort::init()
            .with_telemetry(false)
            .build()
            .map_err(|e| e.to_string())?;
        let description = format!(
            "inference by ort-tract ({reason}): 5 to 20 times slower than ONNX Runtime; \
             `pip install onnxruntime`, or set ${VARIABLE} to the library"
        );
        Ok(Self {
            environment,
            description,
            is_tract: true,
            has_refused: false,
        })
    }
}

/// In a process started for a trial: tries the library and returns the exit code. Otherwise `None`.
///
/// A `main` calls it before it reads its arguments.
pub fn answer_trial() -> Option<ExitCode> {
    trial::answer(|path| InferenceBackend::onnx_runtime(path).map(|_| ()))
}

/// The first library that a separate process can load. Errors of the others are added to `refused`.
fn first_accepted(places: &Places, refused: &mut Vec<String>) -> Option<PathBuf> {
    // Python packages are searched only if no installed library is usable.
    for find in [Places::installed, Places::of_python_packages] {
        for path in find(places) {
            match trial::accepts(&path) {
                Ok(()) => return Some(path),
                Err(problem) => refused.push(refusal(&path, &problem)),
            }
        }
    }
    None
}

/// The part of a message about an unusable library.
fn refusal(path: &Path, problem: &str) -> String {
    format!("; `{}` cannot be used: {problem}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refusal(variable: PathBuf) -> String {
        let places = Places {
            variable: Some(variable),
            ..Places::default()
        };
        InferenceBackend::best(&places).err().unwrap()
    }

    #[test]
    fn a_variable_without_a_library_is_an_error_with_its_path() {
        let problem = refusal("/nowhere/libonnxruntime.so".into());
        assert!(
            problem.contains("$ORT_DYLIB_PATH") && problem.contains("/nowhere/libonnxruntime.so")
        );
        let folder = tempfile::tempdir().unwrap();
        let text = folder.path().join("libonnxruntime.so");
        std::fs::write(&text, "no library").unwrap();
        assert!(refusal(text).contains("$ORT_DYLIB_PATH"));
    }
}
