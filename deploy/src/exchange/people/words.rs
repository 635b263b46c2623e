//! People and edits as they are printed.

use std::fmt::Write as _;

use farfield_export::edits::Change;
use farfield_export::run::TableRow;
use serde::Serialize;

use super::Known;

/// What is printed as JSON.
#[derive(Serialize)]
struct Document<'a> {
    edits_file: String,
    rate_hz: f64,
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
    seconds: f64,
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
        seconds: row.roll.ticks as f64 / known.rate_hz,
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

/// What was done by the edit of that number.
pub(super) fn done(known: &Known, number: usize) -> String {
    let edits = known.edits();
    let text = edits.iter().find(|edit| edit.number == number);
    let text = text.map_or("", |edit| &edit.text);
    let path = known.edits.path().display();
    format!("edit {number}: {text}; in {path}\n")
}

/// Everybody, and all edits.
pub(super) fn table(known: &Known) -> String {
    let rows = known.rows();
    let width = |row: &TableRow| {
        known
            .name(row.person)
            .map_or(0, |name| name.chars().count())
    };
    let width = rows.iter().map(width).max().unwrap_or(0).max("name".len());
    let mut text = if rows.is_empty() {
        "nobody is there\n".to_owned()
    } else {
        format!(
            "{:>5}  {:<width$}  {:>9}  {:>9}  {:>9}  {:>5}  {:>9}\n",
            "id", "name", "from tick", "to tick", "seconds", "gaps", "sigma"
        )
    };
    for row in &rows {
        let name = known.name(row.person).unwrap_or("");
        // Blanks by hand: what is not ASCII may have another width.
        let blanks = " ".repeat(width - name.chars().count().min(width));
        let sigma = row.sigma_m.map_or_else(
            || "unknown".to_owned(),
            |sigma_m| format!("{:.1} mm", 1000.0 * sigma_m),
        );
        let [first, last] = row.roll.span;
        let seconds = row.roll.ticks as f64 / known.rate_hz;
        // Writing to a string does not fail.
        writeln!(
            text,
            "{:>5}  {name}{blanks}  {first:>9}  {last:>9}  {seconds:>9.2}  {:>5}  {sigma:>9}",
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
