//! The venue of a replay: as recorded, or with the operator's changes.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_fusion::recording::attached::Attached;
use farfield_fusion::recording::{CALIBRATION_FILE, CARD_FILE, VENUE_FILE};
use farfield_node::files::load_venue;
use farfield_proto::calibration::{Calibration, text_of};
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::toml_file::{FileError, unknown_name};
use farfield_proto::venue::Venue;
use farfield_proto::venue::layout;
use farfield_proto::venue::parameters::{self, PARAMETERS, TABLES};
use toml::{Table, Value};

use super::super::config::load_card;

/// Changes of the operator.
#[derive(Debug, Clone, Copy)]
pub(super) struct Changes<'a> {
    /// Another venue file.
    pub(super) venue: Option<&'a Path>,
    /// Another calibration.
    pub(super) calibration: Option<&'a Path>,
    /// Other values, `table.field=value`.
    pub(super) set: &'a [String],
}

impl Changes<'_> {
    /// Whether there are no changes.
    pub(super) fn none(&self) -> bool {
        self.venue.is_none() && self.calibration.is_none() && self.set.is_empty()
    }
}

/// The venue of the replay, and the card of its network if it has one.
///
/// # Errors
/// A file is missing or refused, a value cannot be set, or the viewpoints and cameras are not those of the recording.
pub(super) fn replay_venue(
    file: &Path,
    recording: &Attached,
    changes: &Changes<'_>,
) -> anyhow::Result<(Venue, Option<HeatmapCard>)> {
    if changes.none() {
        return recorded_venue(file, recording);
    }
    let recorded = recorded(file, recording)?;
    let text = match changes.venue {
        Some(path) => read(path)?,
        None => recorded.text,
    };
    let text = with_values(&text, changes.set)?;
    let path = changes.venue.unwrap_or(&recorded.path);
    let calibration = match (changes.calibration, changes.venue) {
        (Some(path), _) => read_calibration(path)?,
        (None, Some(path)) => own_calibration(path)?,
        (None, None) => recorded.calibration,
    };
    let venue = Venue::parse(&text, path, calibration);
    let venue = venue.map_err(|error| of_values(error, path, changes.set))?;
    check_same_cameras(&recorded.venue, &venue, path)?;
    let card = match changes.venue {
        Some(_) => load_card(&venue)?,
        None => recorded_card(file, recording, &venue)?,
    };
    Ok((venue, card))
}

/// The venue of the recording `file` as recorded, and the card of its network if it has one.
///
/// # Errors
/// An attached file is missing or refused.
pub fn recorded_venue(
    file: &Path,
    recording: &Attached,
) -> anyhow::Result<(Venue, Option<HeatmapCard>)> {
    let venue = recorded(file, recording)?.venue;
    let card = recorded_card(file, recording, &venue)?;
    Ok((venue, card))
}

/// The recorded venue.
struct Recorded {
    text: String,
    path: PathBuf,
    calibration: Calibration,
    venue: Venue,
}

fn recorded(file: &Path, recording: &Attached) -> anyhow::Result<Recorded> {
    let attached = |name: &str| {
        let text = recording.file(name);
        text.ok_or_else(|| anyhow!("{}: the recording does not contain {name}", file.display()))
    };
    let text = attached(VENUE_FILE)?;
    let path = file.join(VENUE_FILE);
    let calibration =
        Calibration::parse(attached(CALIBRATION_FILE)?, &file.join(CALIBRATION_FILE))?;
    let venue = Venue::parse(text, &path, calibration.clone())?;
    Ok(Recorded {
        text: text.to_owned(),
        path,
        calibration,
        venue,
    })
}

/// The attached card that `venue` names.
fn recorded_card(
    file: &Path,
    recording: &Attached,
    venue: &Venue,
) -> anyhow::Result<Option<HeatmapCard>> {
    let Some(path) = &venue.network else {
        return Ok(None);
    };
    let Some(text) = recording.file(CARD_FILE) else {
        bail!(
            "{}: the recording does not contain {CARD_FILE}",
            file.display()
        );
    };
    Ok(Some(HeatmapCard::parse(text, path)?))
}

fn own_calibration(venue: &Path) -> anyhow::Result<Calibration> {
    read_calibration(&load_venue(venue)?.calibration_path)
}

fn read_calibration(path: &Path) -> anyhow::Result<Calibration> {
    let bytes = fs::read(path).with_context(|| format!("reading {}", path.display()))?;
    Ok(Calibration::parse(&text_of(bytes, path)?, path)?)
}

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))
}

/// The venue file `text` with other values, `table.name=value`. The name is that of the parameter, in any table of the file.
///
/// # Errors
/// A value cannot be set, or the text is no TOML.
pub fn with_values(text: &str, set: &[String]) -> anyhow::Result<String> {
    if set.is_empty() {
        return Ok(text.to_owned());
    }
    let mut file: Table = text.parse().context("reading the venue file")?;
    for assignment in set {
        let wrong =
            || anyhow!("`--set`: found `{assignment}`, expected for example smoothing.cutoff_hz=3");
        let (name, value) = assignment.split_once('=').ok_or_else(wrong)?;
        let keys = keys(name.trim())?;
        let is_set = keys.len() > 1 && layout::set(&mut file, &keys, value_of(value.trim()));
        ensure!(is_set, wrong());
    }
    toml::to_string(&file).context("writing the venue file")
}

/// Marks an error in the venue file at `path` as one with the values of `set`, which are in no line of the file.
pub fn of_values(error: FileError, path: &Path, set: &[String]) -> FileError {
    if set.is_empty() || error.path != path {
        return error;
    }
    let changed = format!("{} with --set {}", path.display(), set.join(" --set "));
    FileError {
        path: changed.into(),
        line: None,
        ..error
    }
}

/// The tables that contain the value `name`, and its name there.
fn keys(name: &str) -> anyhow::Result<Vec<&str>> {
    if let Some(parameter) = parameters::find(name) {
        return Ok(parameter.keys());
    }
    let keys: Vec<&str> = name.split('.').collect();
    if keys.len() == 2 && TABLES.iter().any(|(table, _)| *table == keys[0]) {
        let known: Vec<String> = PARAMETERS.iter().map(ToString::to_string).collect();
        let known: Vec<&str> = known.iter().map(String::as_str).collect();
        bail!("`--set`: {}", unknown_name("parameter", name, &known));
    }
    Ok(keys)
}

/// A TOML value. Text that is no TOML is a string, so that words need no quotes.
fn value_of(text: &str) -> Value {
    let parsed: Option<Table> = format!("value = {text}").parse().ok();
    let value = parsed.and_then(|mut table| table.remove("value"));
    value.unwrap_or_else(|| Value::String(text.to_owned()))
}

/// Ensures equal viewpoints and cameras: recorded messages name them by position.
fn check_same_cameras(recorded: &Venue, venue: &Venue, path: &Path) -> anyhow::Result<()> {
    let names = |venue: &Venue| -> Vec<(String, Vec<String>)> {
        let camera = |&index| {
            let camera = venue.camera(index);
            camera.map_or_else(String::new, |camera| camera.model.name().to_owned())
        };
        let viewpoints = venue.viewpoints.iter();
        viewpoints
            .map(|v| (v.name.clone(), v.cameras.iter().map(camera).collect()))
            .collect()
    };
    let shown = path.display();
    ensure!(
        names(recorded) == names(venue),
        "{shown}: its viewpoints and cameras are not those of the recording, in the same order"
    );
    ensure!(
        recorded.rate_hz.to_bits() == venue.rate_hz.to_bits(),
        "{shown}: `rate_hz`: found {}, the recording has {}",
        venue.rate_hz,
        recorded.rate_hz
    );
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use farfield_proto::venue::Parameters;

    use super::*;
    use farfield_fusion::recording::reader::Recording;
    use farfield_fusion::recording::writer::{Head, RecordingWriter};

    #[test]
    fn values_are_set_in_existing_and_new_tables() {
        let text = "name = \"hall\"\n[births]\ncoast_s = 1.5\n";
        let set = [
            "births.coast_s = 3.5",
            "prediction.predictor=paper",
            "tuning.ik.iterations=7",
            "field.min_m=[0, 0, 0]",
        ];
        let changed = with_values(text, &set.map(str::to_owned)).unwrap();
        let changed: Table = changed.parse().unwrap();
        assert_eq!(changed["births"]["coast_s"].as_float(), Some(3.5));
        let tuning = &changed["tuning"];
        assert_eq!(tuning["prediction"]["predictor"].as_str(), Some("paper"));
        assert_eq!(tuning["ik"]["iterations"].as_integer(), Some(7));
        assert_eq!(changed["field"]["min_m"].as_array().map(Vec::len), Some(3));
        assert_eq!(changed["name"].as_str(), Some("hall"));
        for wrong in ["smoothing", "smoothing=3", "name.x=3", "cutoff_hz 3"] {
            let error = with_values(text, &[wrong.to_owned()]).unwrap_err();
            assert!(error.to_string().contains(wrong), "{error}");
        }
    }

    #[test]
    fn an_unknown_parameter_is_refused_with_the_nearest_name() {
        let set = ["smoothing.cutof_hz=3".to_owned()];
        let refused = with_values("name = \"hall\"\n", &set).unwrap_err();
        assert_eq!(
            refused.to_string(),
            "`--set`: unknown parameter `smoothing.cutof_hz`, did you mean `smoothing.cutoff_hz`?"
        );
    }

    #[test]
    fn an_error_in_a_set_value_names_the_value_and_no_line() {
        let path = Path::new("hall.toml");
        let set = ["smoothing.cutoff_hz=-3".to_owned()];
        let text = with_values("name = \"hall\"\nrate_hz = 60.0\n", &set).unwrap();
        let wrong = FileError::new(path, "found -3, expected more")
            .at_field("smoothing.cutoff_hz")
            .at_line(text.lines().count());
        assert_eq!(
            of_values(wrong.clone(), path, &set).to_string(),
            "hall.toml with --set smoothing.cutoff_hz=-3: `smoothing.cutoff_hz`: found -3, expected more"
        );
        assert_eq!(of_values(wrong.clone(), Path::new("cal.toml"), &set), wrong);
        assert_eq!(of_values(wrong.clone(), path, &[]), wrong);
    }

    /// A recording without messages and with this venue file.
    fn recording(venue: &str) -> Recording<Cursor<Vec<u8>>> {
        let calibration = "[a]\nname = \"a\"\nsize = [64, 48]\nmatrix = [[50.0, 0.0, 32.0], \
            [0.0, 50.0, 24.0], [0.0, 0.0, 1.0]]\ndistortions = [0.0, 0.0, 0.0, 0.0]\n\
            rotation = [0.0, 0.0, 0.0]\ntranslation = [0.0, 0.0, 0.0]\n";
        let facts = [("venue", "hall"), ("viewpoints", "v")];
        let facts = facts.map(|(k, v)| (k.to_owned(), v.to_owned()));
        let head = Head {
            venue: "hall".to_owned(),
            viewpoints: vec!["v".to_owned()],
            rate_hz: 50.0,
            started_ns: 5,
            files: vec![
                (VENUE_FILE.to_owned(), venue.into()),
                (CALIBRATION_FILE.to_owned(), calibration.into()),
            ],
            facts: facts.into(),
            json_poses: None,
        };
        let written = RecordingWriter::create(Vec::new(), head).unwrap().finish();
        Recording::open(Cursor::new(written.unwrap())).unwrap()
    }

    const VENUE: &str = "name = \"hall\"\nrate_hz = 50.0\ncalibration = \"calibration.toml\"\n\
        [[viewpoint]]\nname = \"v\"\n[[viewpoint.camera]]\nname = \"a\"\n\
        source = { kind = \"keypoints\", path = \"a.jsonl\" }\n";

    fn replayed(venue: &str, set: &[&str]) -> anyhow::Result<Venue> {
        let set: Vec<String> = set.iter().copied().map(str::to_owned).collect();
        let changes = Changes {
            venue: None,
            calibration: None,
            set: &set,
        };
        let recording = recording(venue);
        replay_venue(Path::new("hall.mcap"), recording.attached(), &changes).map(|(venue, _)| venue)
    }

    #[test]
    fn set_values_are_added_to_those_of_the_recording() {
        let recorded = format!("{VENUE}[tuning]\nbirths.flat_m = 0.05\nbirths.moved_m = 0.2\n");
        let set = ["births.coast_s=2", "births.moved_m=0.1"];
        let venue = replayed(&recorded, &set).unwrap();
        let mut expected = Parameters::default();
        expected.births.flat_m = 0.05;
        (expected.births.coast_s, expected.births.moved_m) = (2.0, 0.1);
        assert_eq!(venue.parameters, expected);
    }
}
