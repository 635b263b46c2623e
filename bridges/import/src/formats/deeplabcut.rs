//! `DeepLabCut`'s CSV: three rows of heading (scorer, bodyparts, coords), or four with individuals after the scorer, then a
//! row per frame. Columns are x, y and, but in labels made by hand, likelihood. The first columns say the frame: a whole
//! number, or the name of a picture.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::Content;
use super::table::{Row, rows};
use crate::frame_number::{self, MAX_FRAME};
use crate::keypoints::MAX_KEYPOINTS;
use crate::person::{CameraKey, Candidate};

/// Where the numbers of one keypoint stand.
#[derive(Debug, Clone, Copy, Default)]
struct Columns {
    x: Option<usize>,
    y: Option<usize>,
    likelihood: Option<usize>,
}

/// One animal: its keypoints by name, in the order of the file.
#[derive(Debug, Default)]
struct Individual {
    names: Vec<String>,
    columns: Vec<Columns>,
}

pub(super) fn read(text: &str, path: &Path, content: &mut Content) -> Result<(), FileError> {
    let mut rows = rows(text, path);
    let mut heading = |name: &str| -> Result<Row, FileError> {
        let row = rows.next().unwrap_or_else(|| {
            Err(FileError::new(
                path,
                format!("found no row `{name}`, expected a heading"),
            ))
        })?;
        Ok(row)
    };
    let scorer = heading("scorer")?;
    let mut bodyparts = heading("bodyparts")?;
    let mut individuals = None;
    if bodyparts.cell(0) == "individuals" {
        individuals = Some(bodyparts);
        bodyparts = heading("bodyparts")?;
    }
    let coords = heading("coords")?;
    for (row, name) in [
        (&scorer, "scorer"),
        (&bodyparts, "bodyparts"),
        (&coords, "coords"),
    ] {
        if row.cell(0) != name {
            return Err(row.error(
                path,
                format!("found `{}`, expected the heading `{name}`", row.cell(0)),
            ));
        }
    }
    let everybody = everybody(individuals.as_ref(), &bodyparts, &coords)
        .map_err(|problem| bodyparts.error(path, problem))?;
    for individual in everybody.values() {
        content
            .keypoints
            .by_names(&individual.names)
            .map_err(|problem| bodyparts.error(path, problem))?;
        if individual.columns.iter().any(|it| it.likelihood.is_none()) {
            content.note("keypoints without likelihood were taken for certain (score 1)");
        }
    }
    // Labels made by hand may have the picture's name in three columns.
    let n_index = 1 + (1..3).take_while(|i| coords.cell(*i).is_empty()).count();
    for row in rows {
        let row = row?;
        let frame = frame(&row, n_index).map_err(|problem| row.error(path, problem))?;
        content
            .detections
            .new_frame(&CameraKey::OfFile, frame)
            .map_err(|problem| row.error(path, problem))?;
        for individual in everybody.values() {
            person(&row, individual, frame, content).map_err(|problem| row.error(path, problem))?;
        }
    }
    Ok(())
}

fn person(
    row: &Row,
    individual: &Individual,
    frame: i64,
    content: &mut Content,
) -> Result<(), String> {
    let mapping = content.keypoints.by_names(&individual.names)?;
    let person = mapping.person(|place| {
        let columns = individual.columns.get(place).copied().unwrap_or_default();
        let number = |column: Option<usize>| column.map_or(Ok(None), |it| row.number(it));
        let score = match columns.likelihood {
            Some(column) => row.number(column)?,
            None => Some(1.0),
        };
        Candidate::of(number(columns.x)?, number(columns.y)?, score)
    })?;
    content.detections.add(&CameraKey::OfFile, frame, &person)
}

/// Everybody by name; where the file has no names, one without.
fn everybody(
    individuals: Option<&Row>,
    bodyparts: &Row,
    coords: &Row,
) -> Result<BTreeMap<String, Individual>, String> {
    let mut everybody: BTreeMap<String, Individual> = BTreeMap::new();
    for (column, what) in coords.cells().enumerate().skip(1) {
        let name = bodyparts.cell(column);
        if what.is_empty() && name.is_empty() {
            continue;
        }
        let whose = individuals.map_or("", |row| row.cell(column));
        // What belongs to nobody, such as corners of an arena.
        if whose == "single" {
            continue;
        }
        let individual = everybody.entry(whose.to_owned()).or_default();
        let known = individual.names.last().is_some_and(|last| last == name);
        if !known {
            if individual.names.len() >= MAX_KEYPOINTS {
                return Err(format!("found more than {MAX_KEYPOINTS} bodyparts"));
            }
            individual.names.push(name.to_owned());
            individual.columns.push(Columns::default());
        }
        let Some(columns) = individual.columns.last_mut() else {
            continue;
        };
        match what {
            "x" => columns.x = Some(column),
            "y" => columns.y = Some(column),
            "likelihood" => columns.likelihood = Some(column),
            other => {
                return Err(format!(
                    "found the column `{other}` of `{name}`, expected x, y or likelihood"
                ));
            }
        }
    }
    if everybody.is_empty() {
        return Err("found no bodyparts".to_owned());
    }
    Ok(everybody)
}

/// By the number, which may be written as `12.0`, or the name of a picture, in the first columns.
fn frame(row: &Row, n_index: usize) -> Result<i64, String> {
    let filled = (0..n_index).rev().find(|i| !row.cell(*i).is_empty());
    let column = filled.unwrap_or(0);
    let cell = row.cell(column);
    let frame = match row.number(column) {
        // No picture is called so: by its last digits `12.0` would be picture 0.
        Ok(Some(_)) => row.whole(column, MAX_FRAME).ok(),
        _ => frame_number::of_name(cell),
    };
    frame.ok_or_else(|| {
        format!("found `{cell}`, expected a frame (a whole number) or the name of its picture")
    })
}
