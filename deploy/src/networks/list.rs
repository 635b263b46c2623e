//! `farfield networks list`.

use std::fmt::Write as _;
use std::io;

use anyhow::Context as _;
use farfield_networks::known::KNOWN;
use farfield_networks::store::{Installed, Store};
use farfield_node::process::NodeError;
use serde::Serialize;

use super::task_name;
use crate::output;

/// The networks in this program.
const BUILT_IN: &str =
    "a keypoint network and a detector for simulated people, as in `farfield demo`";

#[derive(Debug, Serialize)]
struct List {
    built_in: &'static str,
    /// The folder of installed networks.
    folder: Option<String>,
    installed: Vec<InstalledRow>,
    known: Vec<KnownRow>,
}

#[derive(Debug, Serialize)]
struct InstalledRow {
    name: String,
    card: String,
    /// `None` if it cannot be used.
    task: Option<&'static str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    problem: Option<String>,
}

#[derive(Debug, Serialize)]
struct KnownRow {
    name: &'static str,
    task: &'static str,
    about: &'static str,
    licence: &'static str,
    packages: Vec<String>,
    is_installed: bool,
}

/// Prints the networks.
///
/// # Errors
/// When the folder of installed networks cannot be read, or the list cannot be printed.
pub(super) fn print(as_json: bool) -> Result<(), NodeError> {
    let store = Store::of_user();
    let installed = store.as_ref().map_or(Ok(Vec::new()), Store::installed);
    let list = List::new(store.as_ref(), installed).map_err(NodeError::Failed)?;
    let text = if as_json {
        serde_json::to_string_pretty(&list).map_err(NodeError::failed)? + "\n"
    } else {
        list.to_text()
    };
    output::print(&text).map_err(NodeError::Failed)
}

impl List {
    fn new(store: Option<&Store>, installed: io::Result<Vec<Installed>>) -> anyhow::Result<Self> {
        let folder = store.map(|store| store.folder().display().to_string());
        let installed =
            installed.with_context(|| format!("reading {}", folder.as_deref().unwrap_or("")))?;
        let known = KNOWN.iter().map(|network| KnownRow {
            name: network.name,
            task: task_name(network.task),
            about: network.about,
            licence: network.licence.id,
            packages: network
                .packages
                .iter()
                .map(|it| {
                    let client = it.client.name();
                    format!("{} {} ({client}, {} MB)", it.name, it.version, it.megabytes)
                })
                .collect(),
            is_installed: installed.iter().any(|it| it.name == network.name),
        });
        Ok(Self {
            built_in: BUILT_IN,
            known: known.collect(),
            folder,
            installed: installed.into_iter().map(InstalledRow::from).collect(),
        })
    }

    fn to_text(&self) -> String {
        let mut text = format!("built in: {}\n", self.built_in);
        // Writing to a string does not fail.
        match (&self.folder, self.installed.as_slice()) {
            (Some(folder), []) => writeln!(text, "installed in {folder}: none").ok(),
            (Some(folder), _) => writeln!(text, "installed in {folder}:").ok(),
            (None, _) => writeln!(text, "installed: none").ok(),
        };
        for row in &self.installed {
            let what = row.task.or(row.problem.as_deref()).unwrap_or_default();
            writeln!(text, "  {}: {what}", row.name).ok();
        }
        writeln!(text, "known, for `farfield networks install NAME`:").ok();
        for row in &self.known {
            let is_installed = if row.is_installed { ", installed" } else { "" };
            let packages = row.packages.join(" or ");
            writeln!(
                text,
                "  {}: {}, {}{is_installed}",
                row.name, row.task, row.about
            )
            .ok();
            writeln!(text, "    {} from {packages}", row.licence).ok();
        }
        text
    }
}

impl From<Installed> for InstalledRow {
    fn from(network: Installed) -> Self {
        Self {
            name: network.name,
            card: network.card.display().to_string(),
            task: network.task.as_ref().ok().copied().map(task_name),
            problem: network.task.err(),
        }
    }
}

#[cfg(test)]
mod tests {
    use farfield_networks::known::Task;

    use super::*;

    #[test]
    fn installed_and_known_networks_are_listed() {
        let store = Store::in_folder("/store");
        let installed = |name: &str, task| Installed {
            name: name.to_owned(),
            card: "/store/x.toml".into(),
            task,
        };
        let all = vec![
            installed("blazepose", Ok(Task::Keypoints)),
            installed("own", Err("x.onnx does not exist".to_owned())),
        ];
        let text = List::new(Some(&store), Ok(all)).unwrap().to_text();
        for line in [
            "installed in /store:\n  blazepose: keypoints\n  own: x.onnx does not exist\n",
            "  blazepose: keypoints, BlazePose full: 33 keypoints with heels and foot tips, installed\n    Apache-2.0 from @mediapipe/pose",
            "  blazepose-heavy: keypoints, BlazePose heavy: the same keypoints, slower\n",
        ] {
            assert!(text.contains(line), "{text}");
        }
    }
}
