//! `--set`: the venue with changed values, as a venue file of its own among the results.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_fusion_node::with_values;
use farfield_node::networks::installed_card;
use toml::{Table, Value};

/// The venue file at `path` with the values of `set`. Paths in it become absolute, so that the text can be saved
/// elsewhere.
///
/// # Errors
/// When the file cannot be read, or a value cannot be set.
pub(super) fn changed_venue(path: &Path, set: &[String]) -> anyhow::Result<String> {
    let shown = || path.display().to_string();
    let text = fs::read_to_string(path).with_context(shown)?;
    let mut venue: Table = with_values(&text, set)?.parse().with_context(shown)?;
    let path = std::path::absolute(path).with_context(shown)?;
    let folder = path.parent().unwrap_or(Path::new("/"));
    make_full(&mut venue, "calibration", folder);
    for name in ["network", "detector"] {
        let installed = venue.get(name).and_then(Value::as_str);
        match installed.and_then(|name| installed_card(&path, name)) {
            Some(card) => {
                let card = card.display().to_string();
                venue.insert(name.to_owned(), card.into());
            }
            None => make_full(&mut venue, name, folder),
        }
    }
    if let Some(Value::Table(security)) = venue.get_mut("security") {
        make_full(security, "certificates", folder);
    }
    for subject in tables(venue.get_mut("subject")) {
        make_full(subject, "profile", folder);
    }
    for viewpoint in tables(venue.get_mut("viewpoint")) {
        for camera in tables(viewpoint.get_mut("camera")) {
            if let Some(Value::Table(source)) = camera.get_mut("source") {
                make_full(source, "path", folder);
                make_full(source, "device", folder);
            }
        }
    }
    toml::to_string(&venue).context("writing the venue file")
}

fn tables(array: Option<&mut Value>) -> impl Iterator<Item = &mut Table> {
    let array = array.and_then(Value::as_array_mut);
    array.into_iter().flatten().filter_map(Value::as_table_mut)
}

fn make_full(table: &mut Table, name: &str, folder: &Path) {
    if let Some(Value::String(name)) = table.get_mut(name) {
        let full: PathBuf = folder.join(name.as_str());
        *name = full.display().to_string();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_venue_has_absolute_paths() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.toml");
        fs::write(
            &path,
            "name = \"hall\"\ncalibration = \"calibration.toml\"\n[[viewpoint]]\n[[viewpoint.camera]]\n\
             source = { kind = \"keypoints\", path = \"/else/a.jsonl\" }\n[[viewpoint.camera]]\n\
             source = { kind = \"video\", path = \"b.mp4\" }\n[[subject]]\nprofile = \"anna.toml\"\n[[subject]]\n\
             name = \"Bo\"\n",
        )
        .unwrap();
        let text = changed_venue(&path, &["births.coast_s=2".to_owned()]).unwrap();
        let venue: Table = text.parse().unwrap();
        let full = |name: &str| folder.path().join(name).display().to_string();
        assert_eq!(
            venue["calibration"].as_str(),
            Some(&*full("calibration.toml"))
        );
        assert_eq!(venue["births"]["coast_s"].as_integer(), Some(2));
        let subjects = venue["subject"].as_array().unwrap();
        assert_eq!(subjects[0]["profile"].as_str(), Some(&*full("anna.toml")));
        let cameras = venue["viewpoint"][0]["camera"].as_array().unwrap();
        let path_of = |i: usize| cameras[i]["source"]["path"].as_str().unwrap().to_owned();
        assert_eq!(
            (path_of(0), path_of(1)),
            ("/else/a.jsonl".to_owned(), full("b.mp4"))
        );
    }

    #[test]
    fn an_installed_network_becomes_the_path_of_its_card() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.toml");
        let card = folder.path().join("networks/net/net.toml");
        fs::create_dir_all(card.parent().unwrap()).unwrap();
        fs::write(&card, "").unwrap();
        let text = "name = \"hall\"\nnetwork = \"net\"\ndetector = \"people.toml\"\n";
        fs::write(&path, text).unwrap();
        let text = changed_venue(&path, &["births.coast_s=2".to_owned()]).unwrap();
        let venue: Table = text.parse().unwrap();
        let full = |path: PathBuf| Some(path.display().to_string());
        let stated = |name: &str| venue[name].as_str().map(str::to_owned);
        assert_eq!(stated("network"), full(card));
        assert_eq!(stated("detector"), full(folder.path().join("people.toml")));
    }

    #[test]
    fn an_unknown_parameter_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hall.toml");
        fs::write(&path, "name = \"hall\"\n").unwrap();
        let refused = changed_venue(&path, &["births.coast=2".to_owned()]).unwrap_err();
        assert!(refused.to_string().contains("births.coast_s"), "{refused}");
    }
}
