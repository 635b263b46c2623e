
use std::convert::Infallible;
use std::path::Path;
use std::str::FromStr;

use farfield_node::process::NodeError;
use farfield_sim::embedded;
use farfield_sim::scene::Scene;

/// A scene file, or the name of an embedded scene.
#[derive(Debug, Clone)]
pub(super) struct SceneArgument(String);

impl SceneArgument {
    /// The argument.
    pub(super) fn name(&self) -> &str {
        &self.0
    }

    /// Reads the scene.
    ///
    /// # Errors
    /// Contains the file and what is wrong with it, or the names of embedded scenes.
    pub(super) fn load(&self) -> Result<Scene, NodeError> {
        let path = Path::new(&self.0);
        let scene = if path.exists() {
            Scene::load(path)
        } else {
            embedded::scene(&self.0)
        };
        scene.map_err(NodeError::refused)
    }
}

impl FromStr for SceneArgument {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}
