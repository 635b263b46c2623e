//! The venue that a recording is solved for: as it was, or with what the operator wants otherwise.

use std::fs;
use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail, ensure};
use farfield_node::files::load_venue;
use farfield_proto::calibration::Calibration;
use farfield_proto::model_card::HeatmapCard;
use farfield_proto::venue::Venue;
use toml::{Table, Value};

use super::super::config::load_card;
use crate::recording::reader::Recording;
use crate::recording::{CALIBRATION_FILE, CARD_FILE, VENUE_FILE};

/// What shall be otherwise than it was.
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
    /// Whether all shall be as it was.
    pub(super) fn none(&self) -> bool {
        self.venue.is_none() && self.calibration.is_none() && self.set.is_empty()
    }
}

/// The venue, and the card of its network if it has one.
///
/// # Errors
/// When a file is missing or refused, a value cannot be set, or the viewpoints and cameras are not those
/// of the recording.
pub(super) fn replay_venue<R: Read + Seek>(
    file: &Path,
    recording: &Recording<R>,
    changes: &Changes<'_>,
) -> anyhow::Result<(Venue, Option<HeatmapCard>)> {
    let recorded = recorded(file, recording)?;
    if changes.none() {
        let card = recorded_card(file, recording, &recorded.venue)?;
        return Ok((recorded.venue, card));
    }
    let text = match changes.venue {
        Some(path) => read(path)?,
        None => recorded.text.clone(),
    };
    let text = with_values(&text, changes.set)?;
    let path = changes.venue.unwrap_or(&recorded.path);
    let calibration = match (changes.calibration, changes.venue) {
        (Some(path), _) => Calibration::parse(&read(path)?, path)?,
        (None, Some(path)) => own_calibration(path)?,
        (None, None) => recorded.calibration,
    };
    let venue = Venue::parse(&text, path, calibration)?;
    check_same_cameras(&recorded.venue, &venue, path)?;
    let card = match changes.venue {
        Some(_) => load_card(&venue)?,
        None => recorded_card(file, recording, &venue)?,
    };
    Ok((venue, card))
}

/// The venue as it was.
struct Recorded {
    text: String,
    path: PathBuf,
    calibration: Calibration,
    venue: Venue,
}

fn recorded<R: Read + Seek>(file: &Path, recording: &Recording<R>) -> anyhow::Result<Recorded> {
    let attached = |name: &str| {
        let text = recording.file(name);
        text.ok_or_else(|| anyhow!("{}: there is no {name} in the recording", file.display()))
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

/// The card that `venue` names, as it was attached.
fn recorded_card<R: Read + Seek>(
    file: &Path,
    recording: &Recording<R>,
    venue: &Venue,
) -> anyhow::Result<Option<HeatmapCard>> {
    let Some(path) = &venue.network else {
        return Ok(None);
    };
    let Some(text) = recording.file(CARD_FILE) else {
        bail!(
            "{}: there is no {CARD_FILE} in the recording",
            file.display()
        );
    };
    Ok(Some(HeatmapCard::parse(text, path)?))
}

fn own_calibration(venue: &Path) -> anyhow::Result<Calibration> {
    let path = load_venue(venue)?.calibration_path;
    Ok(Calibration::parse(&read(&path)?, &path)?)
}

fn read(path: &Path) -> anyhow::Result<String> {
    fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))
}

/// The venue file `text` with other values.
fn with_values(text: &str, set: &[String]) -> anyhow::Result<String> {
    if set.is_empty() {
        return Ok(text.to_owned());
    }
    let mut file: Table = text.parse().context("reading the venue file")?;
    for assignment in set {
        let wrong =
            || anyhow!("`--set`: found `{assignment}`, expected for example smoothing.cutoff_hz=3");
        let (name, value) = assignment.split_once('=').ok_or_else(wrong)?;
        let (table, field) = name.trim().split_once('.').ok_or_else(wrong)?;
        let table = file
            .entry(table)
            .or_insert_with(|| Value::Table(Table::new()));
        let table = table.as_table_mut().ok_or_else(wrong)?;
        table.insert(field.to_owned(), value_of(value.trim()));
    }
    toml::to_string(&file).context("writing the venue file")
}

/// A TOML value; what is none is taken for a text, so that words need no quotes.
fn value_of(text: &str) -> Value {
    let parsed: Option<Table> = format!("value = {text}").parse().ok();
    let value = parsed.and_then(|mut table| table.remove("value"));
    value.unwrap_or_else(|| Value::String(text.to_owned()))
}

/// Recorded messages name viewpoints and cameras by their position.
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
    use super::*;

    #[test]
    fn values_are_set_where_they_are_and_where_they_are_not() {
        let text = "name = \"hall\"\n[smoothing]\ncutoff_hz = 1.5\n";
        let set = ["smoothing.cutoff_hz = 3.5", "prediction.predictor=paper"].map(str::to_owned);
        let changed: Table = with_values(text, &set).unwrap().parse().unwrap();
        assert_eq!(changed["smoothing"]["cutoff_hz"].as_float(), Some(3.5));
        assert_eq!(changed["prediction"]["predictor"].as_str(), Some("paper"));
        assert_eq!(changed["name"].as_str(), Some("hall"));
        for wrong in ["smoothing", "smoothing=3", "name.x=3", "cutoff_hz 3"] {
            let error = with_values(text, &[wrong.to_owned()]).unwrap_err();
            assert!(error.to_string().contains(wrong), "{error}");
        }
    }
}
