//! The text of a venue file, short and commented like the sample.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use farfield_node::networks::is_installed_name;
use toml::Value;

use super::recordings::Recording;
use super::viewpoints::{ViewpointArg, key_chunk};

/// Heights of the field, metres: the defaults of a venue.
const HEIGHTS_M: [f64; 2] = [-0.3, 2.6];

/// The content of a venue file.
pub(super) struct VenueDraft<'a> {
    /// Path of the file.
    pub(super) out: &'a Path,
    pub(super) name: String,
    pub(super) rate_hz: f64,
    pub(super) calibration: &'a Path,
    /// A card, or the name of an installed network.
    pub(super) network: Option<&'a Path>,
    pub(super) detector: Option<&'a Path>,
    /// Smallest x and y, largest x and y, metres.
    pub(super) field: Option<[f64; 4]>,
    pub(super) viewpoints: &'a [ViewpointArg],
    /// The recording of each camera.
    pub(super) matched: &'a BTreeMap<&'a str, &'a Recording>,
}

/// The name of a venue, from its folder.
pub(super) fn name_of(folder: &Path) -> String {
    let full = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    key_chunk(&full.file_name().unwrap_or_default().to_string_lossy())
}

impl VenueDraft<'_> {
    /// As TOML.
    pub(super) fn to_toml(&self) -> String {
        let mut text = String::from(
            "# A venue, written by `farfield init`. All fields: deploy/venue.sample.toml, `farfield parameters`.\n",
        );
        let mut line = |left: String, comment: &str| {
            let (gap, left) = left
                .strip_prefix('\n')
                .map_or(("", left.as_str()), |left| ("\n", left));
            // Writing to a string does not fail.
            writeln!(text, "{gap}{left:<48} # {comment}").ok();
        };
        line(
            format!("name = {}", quoted(&self.name)),
            "first part of every Zenoh key",
        );
        line(
            format!("rate_hz = {:?}", self.rate_hz),
            "ticks per second, the same for all cameras",
        );
        line(
            format!("calibration = {}", self.path(self.calibration)),
            "camera poses: metres, z up",
        );
        if let Some(network) = self.network {
            line(
                format!("network = {}", self.card(network)),
                "keypoint network: installed, or a model card",
            );
        }
        if let Some(detector) = self.detector {
            line(
                format!("detector = {}", self.card(detector)),
                "person detector: installed, or a model card",
            );
        }
        if let Some([x0, y0, x1, y1]) = self.field {
            let [low, high] = HEIGHTS_M;
            line("\n[field]".to_owned(), "people are tracked inside, metres");
            line(
                format!("min_m = [{x0:?}, {y0:?}, {low:?}]"),
                "x, y, z; the floor is at 0",
            );
            line(
                format!("max_m = [{x1:?}, {y1:?}, {high:?}]"),
                "people outside are ignored",
            );
        }
        for viewpoint in self.viewpoints {
            line(
                "\n[[viewpoint]]".to_owned(),
                "one place with one edge and its cameras",
            );
            line(format!("name = {}", quoted(&viewpoint.name)), "");
            for camera in &viewpoint.cameras {
                let Some(recording) = self.matched.get(camera.as_str()) else {
                    continue;
                };
                line("[[viewpoint.camera]]".to_owned(), "");
                line(
                    format!("name = {}", quoted(camera)),
                    "its name in the calibration",
                );
                let (kind, path) = (recording.kind_name(), self.path(&recording.path));
                line(
                    format!("source = {{ kind = \"{kind}\", path = {path} }}"),
                    "",
                );
            }
        }
        // Removes a `#` without a comment.
        text.lines()
            .map(|line| line.trim_end_matches([' ', '#']).to_owned() + "\n")
            .collect()
    }

    /// An installed network stays a name.
    fn card(&self, card: &Path) -> String {
        let name = card.to_str().filter(|name| is_installed_name(name));
        name.map_or_else(|| self.path(card), quoted)
    }

    /// A path in the venue file: relative if it is inside the file's folder, else absolute.
    fn path(&self, path: &Path) -> String {
        let folder = self
            .out
            .parent()
            .filter(|it| !it.as_os_str().is_empty())
            .unwrap_or(Path::new("."));
        let full = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let (folder, path) = (full(folder), full(path));
        let shown = path.strip_prefix(&folder).unwrap_or(&path);
        quoted(&shown.display().to_string())
    }
}

/// A text as a TOML string.
fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}
