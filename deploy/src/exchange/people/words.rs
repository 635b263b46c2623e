//! People and edits as text and JSON.

use std::fmt::Write as _;

use farfield_export::edits::Change;
use farfield_export::run::TableRow;
use serde::Serialize;

use super::Known;

/// The JSON output.
#[derive(Serialize)]
struct Document<'a> {
    edits_file: String,
    rate_hz: Option<f64>,
    people: Vec<PersonFields<'a>>,
    edits: Vec<EditFields<'a>>,
}

#[derive(Serialize)]
struct PersonFields<'a> {
    person: u32,
    name: Option<&'a str>,
    first_tick: i64,
    last_tick: i64,
    ticks: u64,
    seconds: Option<f64>,
    gaps: usize,
    sigma_m: Option<f64>,
}

#[derive(Serialize)]
struct EditFields<'a> {
    number: usize,
    at: &'a str,
    text: String,
    in_force: bool,
}

impl Known {
    fn rows(&self) -> Vec<TableRow> {
        self.table.rows(&self.identities)
    }

    fn name(&self, person: u32) -> Option<&str> {
        self.identities.names().get(&person).map(String::as_str)
    }

    /// Seconds with a pose, if the rate is known.
    fn seconds(&self, row: &TableRow) -> Option<f64> {
        self.rate_hz.map(|rate_hz| row.roll.ticks as f64 / rate_hz)
    }

    fn edits(&self) -> Vec<EditFields<'_>> {
        let in_force: Vec<usize> = self.list.in_force().iter().map(|(n, _)| *n).collect();
        let edits = self.list.all();
        let fields = edits.map(|(number, edit)| EditFields {
            number,
            at: &edit.at,
            text: edit.change.to_string(),
            in_force: in_force.contains(&number) || matches!(edit.change, Change::Undo { .. }),
        });
        fields.collect()
    }
}

pub(super) fn json(known: &Known) -> serde_json::Result<String> {
    let person = |row: TableRow| PersonFields {
        person: row.person,
        name: known.name(row.person),
        first_tick: row.roll.span[0],
        last_tick: row.roll.span[1],
        ticks: row.roll.ticks,
        seconds: known.seconds(&row),
        gaps: row.roll.gaps,
        sigma_m: row.sigma_m.map(|sigma_m| (sigma_m * 1e4).round() / 1e4),
    };
    let document = Document {
        edits_file: known.edits.path().display().to_string(),
        rate_hz: known.rate_hz,
        people: known.rows().into_iter().map(person).collect(),
        edits: known.edits(),
    };
    Ok(serde_json::to_string_pretty(&document)? + "\n")
}

/// The line on an added edit.
pub(super) fn done(known: &Known, number: usize) -> String {
    let edits = known.edits();
    let text = edits.iter().find(|edit| edit.number == number);
    let text = text.map_or("", |edit| &edit.text);
    let path = known.edits.path().display();
    format!("edit {number}: {text}; in {path}\n")
}

/// All people and edits.
pub(super) fn table(known: &Known) -> String {
    let rows = known.rows();
    let width = |row: &TableRow| {
        known
            .name(row.person)
            .map_or(0, |name| name.chars().count())
    };
    let width = rows.iter().map(width).max().unwrap_or(0).max("name".len());
    let mut text = if rows.is_empty() {
        "no people\n".to_owned()
    } else {
        let time = if known.rate_hz.is_some() {
            "seconds"
        } else {
            "ticks"
        };
        format!(
            "{:>5}  {:<width$}  {:>9}  {:>9}  {time:>9}  {:>5}  {:>9}\n",
            "id", "name", "from tick", "to tick", "gaps", "sigma"
        )
    };
    for row in &rows {
        let name = known.name(row.person).unwrap_or("");
        // Padded by hand: text that is not ASCII may have another width.
        let blanks = " ".repeat(width - name.chars().count().min(width));
        let sigma = row.sigma_m.map_or_else(
            || "unknown".to_owned(),
            |sigma_m| format!("{:.1} mm", 1000.0 * sigma_m),
        );
        let [first, last] = row.roll.span;
        let seconds = known.seconds(row).map(|seconds| format!("{seconds:.2}"));
        let time = seconds.unwrap_or_else(|| row.roll.ticks.to_string());
        // Writing to a string does not fail.
        writeln!(
            text,
            "{:>5}  {name}{blanks}  {first:>9}  {last:>9}  {time:>9}  {:>5}  {sigma:>9}",
            row.person, row.roll.gaps
        )
        .ok();
    }
    let edits = known.edits();
    if !edits.is_empty() {
        writeln!(text, "\nedits in {}", known.edits.path().display()).ok();
    }
    for edit in edits {
        let undone = if edit.in_force { "" } else { " (undone)" };
        let (number, at, what) = (edit.number, edit.at, edit.text);
        writeln!(text, "{number:>5}  {at}  {what}{undone}").ok();
    }
    text
}

#[cfg(test)]
mod tests {
    use farfield_export::EditsFile;
    use farfield_export::edits::{EditList, Identities};
    use farfield_export::run::PeopleTable;

    use super::*;

    #[test]
    fn without_a_rate_ticks_are_shown_instead_of_seconds() {
        let mut known = Known {
            edits: EditsFile::at("edits.jsonl".into()),
            list: EditList::default(),
            identities: Identities::default(),
            table: PeopleTable::default(),
            rate_hz: Some(30.0),
        };
        for tick in 0..60 {
            known.table.roll.add(tick, 3);
        }
        let words = |known: &Known| {
            let text = table(known);
            let words = text.split_whitespace().map(str::to_owned);
            words.collect::<Vec<_>>().join(" ")
        };
        assert_eq!(
            words(&known),
            "id name from tick to tick seconds gaps sigma 3 0 59 2.00 0 unknown"
        );
        known.rate_hz = None;
        assert_eq!(
            words(&known),
            "id name from tick to tick ticks gaps sigma 3 0 59 60 0 unknown"
        );
    }
}
