//! Caliscope's `xy_*.csv`: a row per point and camera, `sync_index,cam_id,point_id,img_loc_x,img_loc_y`. Older ones say `port`
//! for `cam_id`, newer ones `keypoint_id` for `point_id` and have an `object_id`. There are no scores.
//!
//! Its trackers number `MediaPipe`'s 33 body landmarks from 0, hands and face from 100 on.

use std::collections::BTreeMap;
use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::Content;
use super::table::{Row, column, rows};
use crate::frame_number::MAX_FRAME;
use crate::keypoints::Model;
use crate::person::{CameraKey, Candidate};

/// Ids from here on are of hands and faces.
const FIRST_OF_HANDS: i64 = 100;
/// Most cameras and people that are numbered.
const MAX_ID: i64 = 100_000;

/// Where the columns are.
struct Columns {
    frame: usize,
    camera: usize,
    object: Option<usize>,
    point: usize,
    x: usize,
    y: usize,
    /// Where a point is on a board: points of people are on none.
    on_board: Option<usize>,
}

/// One body in one picture.
type Body = BTreeMap<i64, (f64, f64)>;

pub(super) fn read(text: &str, path: &Path, content: &mut Content) -> Result<(), FileError> {
    let mut rows = rows(text, path);
    let header = rows
        .next()
        .unwrap_or_else(|| Err(FileError::new(path, "found no heading")))?;
    let columns = columns(&header).map_err(|problem| header.error(path, problem))?;
    let mut bodies: BTreeMap<(i64, i64, i64), Body> = BTreeMap::new();
    for row in rows {
        let row = row?;
        let wrong = |problem: String| row.error(path, problem);
        point(&row, &columns, &mut bodies).map_err(wrong)?;
    }
    let largest = bodies.values().filter_map(|body| body.keys().next_back());
    let Some(largest) = largest.max() else {
        return Ok(());
    };
    let count = match largest {
        0..=16 => Model::Coco17,
        17..=25 => Model::Halpe26,
        _ => Model::BlazePose,
    }
    .count();
    let whole = |problem: String| FileError::new(path, problem);
    for ((camera, frame, _), body) in &bodies {
        let mapping = content.keypoints.by_count(count).map_err(whole)?;
        let person = mapping.person(|place| match body.get(&(place.cast_signed() as i64)) {
            Some((x, y)) => Candidate::of(Some(*x), Some(*y), Some(1.0)),
            None => Ok(None),
        });
        let person = person.map_err(whole)?;
        let camera = CameraKey::Named(format!("cam_{camera}"));
        let added = content.detections.add(&camera, *frame, &person);
        added.map_err(whole)?;
    }
    content.note("the file has no scores: keypoints were taken for certain (score 1)");
    Ok(())
}

fn columns(header: &Row) -> Result<Columns, String> {
    let need = |names: &[&str]| {
        column(header, names).ok_or_else(|| format!("found no column `{}`", names.join("` or `")))
    };
    Ok(Columns {
        frame: need(&["sync_index"])?,
        camera: need(&["cam_id", "port"])?,
        object: column(header, &["object_id"]),
        point: need(&["point_id", "keypoint_id"])?,
        x: need(&["img_loc_x"])?,
        y: need(&["img_loc_y"])?,
        on_board: column(header, &["obj_loc_x", "board_loc_x"]),
    })
}

/// Adds the point of a row to its body.
fn point(
    row: &Row,
    columns: &Columns,
    bodies: &mut BTreeMap<(i64, i64, i64), Body>,
) -> Result<(), String> {
    if let Some(column) = columns.on_board
        && row.number(column)?.is_some()
    {
        return Err(
            "found a point of a calibration board, expected points of people: take the xy file of a tracker of bodies"
                .to_owned(),
        );
    }
    let id = row.whole(columns.point, MAX_FRAME)?;
    let frame = row.whole(columns.frame, MAX_FRAME)?;
    let camera = row.whole(columns.camera, MAX_ID)?;
    let object = columns
        .object
        .map_or(Ok(0), |it| row.whole(it, MAX_FRAME))?;
    let body = bodies.entry((camera, frame, object)).or_default();
    if !(0..FIRST_OF_HANDS).contains(&id) {
        return Ok(());
    }
    if let (Some(x), Some(y)) = (row.number(columns.x)?, row.number(columns.y)?)
        && body.insert(id, (x, y)).is_some()
    {
        return Err(format!(
            "found point {id} of camera {camera} at {frame} twice"
        ));
    }
    Ok(())
}
