//! SLEAP's analysis as CSV: `track,frame_idx,instance.score,nose.x,nose.y,nose.score,...`, a row per animal and frame.

use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::Content;
use super::table::{column, rows};
use crate::frame_number::MAX_FRAME;
use crate::keypoints::MAX_KEYPOINTS;
use crate::person::{CameraKey, Candidate};

pub(super) fn read(text: &str, path: &Path, content: &mut Content) -> Result<(), FileError> {
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
    let of = |name: &str, what: &str| column(&header, &[&format!("{name}.{what}")]);
    let columns: Vec<[Option<usize>; 3]> = names
        .iter()
        .map(|name| [of(name, "x"), of(name, "y"), of(name, "score")])
        .collect();
    if columns.iter().any(|[_, _, score]| score.is_none()) {
        content.note("keypoints without scores were taken for certain (score 1)");
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
            Candidate::of(number(x)?, number(y)?, score)
        });
        let person = person.map_err(wrong)?;
        let added = content.detections.add(&CameraKey::OfFile, frame, &person);
        added.map_err(wrong)?;
    }
    Ok(())
}
