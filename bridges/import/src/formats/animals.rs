//! CSV tables of animal trackers: `DeepLabCut` and SLEAP.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::Content;
use super::table::{Row, column, rows};
use crate::folder::{self, MAX_FRAME};
use crate::keypoints::MAX_KEYPOINTS;
use crate::person::{CameraKey, Candidate};

/// Column indices of one keypoint.
#[derive(Debug, Clone, Copy, Default)]
struct Columns {
    x: Option<usize>,
    y: Option<usize>,
    likelihood: Option<usize>,
}

/// One animal: its keypoint names in the order of the file.
#[derive(Debug, Default)]
struct Individual {
    names: Vec<String>,
    columns: Vec<Columns>,
}

/// Reads `DeepLabCut`'s CSV: three heading rows (scorer, bodyparts, coords), or four with individuals
/// after the scorer, then one row per frame. Columns are x, y and likelihood; manual labels have no
/// likelihood. The first columns give the frame: a whole number, or the name of an image.
pub(super) fn read_deeplabcut(
    text: &str,
    path: &Path,
    content: &mut Content,
) -> Result<(), FileError> {
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
    let animals = animals(individuals.as_ref(), &bodyparts, &coords)
        .map_err(|problem| bodyparts.error(path, problem))?;
    for individual in animals.values() {
        content
            .keypoints
            .by_names(&individual.names)
            .map_err(|problem| bodyparts.error(path, problem))?;
        if individual.columns.iter().any(|it| it.likelihood.is_none()) {
            content.note("keypoints without likelihood were given the score 1");
        }
    }
    // Manual labels may have the image's name in three columns.
    let n_index = 1 + (1..3).take_while(|i| coords.cell(*i).is_empty()).count();
    for row in rows {
        let row = row?;
        let frame = frame(&row, n_index).map_err(|problem| row.error(path, problem))?;
        content
            .detections
            .new_frame(&CameraKey::OfFile, frame)
            .map_err(|problem| row.error(path, problem))?;
        for individual in animals.values() {
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
        Candidate::from_numbers(number(columns.x)?, number(columns.y)?, score)
    })?;
    content.detections.add(&CameraKey::OfFile, frame, &person)
}

/// All individuals by name; one without a name if the file has no names.
fn animals(
    individuals: Option<&Row>,
    bodyparts: &Row,
    coords: &Row,
) -> Result<BTreeMap<String, Individual>, String> {
    let mut animals: BTreeMap<String, Individual> = BTreeMap::new();
    for (column, what) in coords.cells().enumerate().skip(1) {
        let name = bodyparts.cell(column);
        if what.is_empty() && name.is_empty() {
            continue;
        }
        let whose = individuals.map_or("", |row| row.cell(column));
        // Points that belong to no individual, such as corners of an arena.
        if whose == "single" {
            continue;
        }
        let individual = animals.entry(whose.to_owned()).or_default();
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
    if animals.is_empty() {
        return Err("found no bodyparts".to_owned());
    }
    Ok(animals)
}

/// Frame number from the first columns: a number, possibly written as `12.0`, or the name of an
/// image.
fn frame(row: &Row, n_index: usize) -> Result<i64, String> {
    let filled = (0..n_index).rev().find(|i| !row.cell(*i).is_empty());
    let column = filled.unwrap_or(0);
    let cell = row.cell(column);
    let frame = match row.number(column) {
        // Not an image name: its last digits would make `12.0` frame 0.
        Ok(Some(_)) => row.whole(column, MAX_FRAME).ok(),
        _ => folder::frame_of_name(cell),
    };
    frame.ok_or_else(|| {
        format!("found `{cell}`, expected a frame (a whole number) or the name of its picture")
    })
}

/// Reads SLEAP's analysis CSV: `track,frame_idx,instance.score,nose.x,nose.y,nose.score,...`, one row
/// per animal and frame.
pub(super) fn read_sleap(text: &str, path: &Path, content: &mut Content) -> Result<(), FileError> {
    let mut rows = rows(text, path);
    let header = rows
        .next()
        .unwrap_or_else(|| Err(FileError::new(path, "found no heading")))?;
    let frame_column = column(&header, &["frame_idx"])
        .ok_or_else(|| header.error(path, "found no column `frame_idx`"))?;
    let names: Vec<String> = header
        .cells()
        .filter_map(|cell| cell.strip_suffix(".x"))
        .take(MAX_KEYPOINTS)
        .map(str::to_owned)
        .collect();
    let column_of = |name: &str, what: &str| column(&header, &[&format!("{name}.{what}")]);
    let columns: Vec<[Option<usize>; 3]> = names
        .iter()
        .map(|name| {
            [
                column_of(name, "x"),
                column_of(name, "y"),
                column_of(name, "score"),
            ]
        })
        .collect();
    if columns.iter().any(|[_, _, score]| score.is_none()) {
        content.note("keypoints without scores were given the score 1");
    }
    for row in rows {
        let row = row?;
        let wrong = |problem: String| row.error(path, problem);
        let frame = row.whole(frame_column, MAX_FRAME).map_err(wrong)?;
        let noted = content.detections.frame(&CameraKey::OfFile, frame);
        noted.map_err(wrong)?;
        let mapping = content.keypoints.by_names(&names).map_err(wrong)?;
        let person = mapping.person(|place| {
            let [x, y, score] = columns.get(place).copied().unwrap_or_default();
            let number = |column: Option<usize>| column.map_or(Ok(None), |it| row.number(it));
            let score = match score {
                Some(score) => row.number(score)?,
                None => Some(1.0),
            };
            Candidate::from_numbers(number(x)?, number(y)?, score)
        });
        let person = person.map_err(wrong)?;
        let added = content.detections.add(&CameraKey::OfFile, frame, &person);
        added.map_err(wrong)?;
    }
    Ok(())
}
