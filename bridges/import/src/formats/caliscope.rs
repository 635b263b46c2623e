//! Caliscope's `xy_*.csv`: one row per point and camera,
//! `sync_index,cam_id,point_id,img_loc_x,img_loc_y`. Older files have `port` instead of `cam_id`;
//! newer ones have `keypoint_id` instead of `point_id`, and an `object_id`. There are no scores.
//!
//! Its trackers number `MediaPipe`'s 33 body landmarks from 0, and hands and face from 100.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use farfield_proto::toml_file::FileError;

use super::Content;
use super::table::{Row, column, rows};
use crate::folder::MAX_FRAME;
use crate::keypoints::Model;
use crate::person::{CameraKey, Candidate};

/// First id of hands and faces.
const FIRST_OF_HANDS: i64 = 100;
/// Maximum id of cameras and people.
const MAX_ID: i64 = 100_000;

/// Indices of the columns.
struct Columns {
    frame: usize,
    camera: usize,
    object: Option<usize>,
    point: usize,
    x: usize,
    y: usize,
    /// Position on a calibration board; empty for points of people.
    on_board: Option<usize>,
}

/// One body in one image.
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
    let whole = |problem: String| FileError::new(path, problem);
    let ids: BTreeSet<i64> = bodies.values().flat_map(BTreeMap::keys).copied().collect();
    let Some(model) = model(&ids, content).map_err(whole)? else {
        return Ok(());
    };
    let count = model.count();
    for ((camera, frame, _), body) in &bodies {
        let mapping = content.keypoints.by_count(count).map_err(whole)?;
        let person = mapping.person(|place| match body.get(&(place.cast_signed() as i64)) {
            Some((x, y)) => Candidate::from_numbers(Some(*x), Some(*y), Some(1.0)),
            None => Ok(None),
        });
        let person = person.map_err(whole)?;
        let camera = CameraKey::Named(format!("cam_{camera}"));
        let added = content.detections.add(&camera, *frame, &person);
        added.map_err(whole)?;
    }
    content.note("the file has no scores: all keypoints were given the score 1");
    Ok(())
}

/// Determines the keypoint model from point ids; `None` without ids. A guess is reported as a
/// warning.
///
/// Undetected points have no row, so ids that stop below 32 may be `MediaPipe`'s of a person
/// sitting at a table. A smaller model is chosen only if exactly all of its ids are present.
fn model(ids: &BTreeSet<i64>, content: &mut Content) -> Result<Option<Model>, String> {
    let Some(&largest) = ids.last() else {
        return Ok(None);
    };
    if let Some(given) = content.keypoints.given_model(largest) {
        return Ok(Some(given));
    }
    let last_of = |model: Model| model.count().cast_signed() as i64 - 1;
    if largest > last_of(Model::BlazePose) {
        return Err(format!(
            "found point {largest}, which MediaPipe's body lacks, expected ids up to {}: give the keypoint model with \
             `--keypoints MODEL`",
            last_of(Model::BlazePose)
        ));
    }
    let is_whole = |model: &Model| largest == last_of(*model) && ids.len() == model.count();
    let smaller = [Model::Coco17, Model::Halpe26].into_iter().find(is_whole);
    let model = smaller.unwrap_or(Model::BlazePose);
    if largest == last_of(Model::BlazePose) {
        content.note(
            "the file does not name its points: BLAZEPOSE was assumed, whose ids also end at 32",
        );
    } else {
        content.warnings.insert(format!(
            "the file does not name its points, of which {largest} is the last: {} was assumed; if that is wrong, give \
             `--keypoints MODEL`",
            model.name()
        ));
    }
    Ok(Some(model))
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
            "found a point of a calibration board, expected points of people: import the xy file of a body tracker"
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::{Format, ParseOptions, Parsed, parse};

    /// One body with these points, each at x = twice its id.
    fn read(ids: impl IntoIterator<Item = i64>, options: ParseOptions) -> Result<Parsed, String> {
        let rows = ids.into_iter().map(|id| format!("0,1,{id},{},5\n", 2 * id));
        let text: String = rows.collect();
        let text = format!("sync_index,cam_id,point_id,img_loc_x,img_loc_y\n{text}");
        let options = ParseOptions {
            format: Some(Format::Caliscope),
            ..options
        };
        parse(text.as_bytes(), Path::new("xy.csv"), options).map_err(|error| error.to_string())
    }

    fn model_of(parsed: &Parsed) -> &str {
        parsed.mapping.as_ref().map_or("", |it| it.name.as_str())
    }

    #[test]
    fn a_guess_from_incomplete_ids_gives_a_warning() {
        let guess = |ids: Vec<i64>| read(ids, ParseOptions::default()).unwrap();
        let upper_body = guess((0..23).collect());
        assert_eq!(model_of(&upper_body), "BLAZEPOSE");
        assert!(
            upper_body
                .warnings
                .iter()
                .any(|it| it.contains("22 is the last"))
        );
        // The last id of COCO without all ids before it.
        assert_eq!(model_of(&guess((11..17).collect())), "BLAZEPOSE");
        for (last, name) in [(16, "COCO_17"), (25, "HALPE_26")] {
            let whole = guess((0..=last).collect());
            assert_eq!(model_of(&whole), name);
            assert!(whole.warnings.iter().any(|it| it.contains(name)));
        }
        let whole = guess((0..33).collect());
        assert_eq!((model_of(&whole), whole.warnings.len()), ("BLAZEPOSE", 0));
    }

    #[test]
    fn a_given_model_overrides_the_ids() {
        let requested = |model| ParseOptions {
            model: Some(model),
            ..ParseOptions::default()
        };
        let parsed = read(0..17, requested(Model::Halpe26)).unwrap();
        assert_eq!((model_of(&parsed), parsed.warnings.len()), ("HALPE_26", 0));
        let parsed = read(0..17, requested(Model::BlazePose)).unwrap();
        assert_eq!(model_of(&parsed), "BLAZEPOSE");
        let hinted = ParseOptions {
            model_hint: Some(Model::Halpe26),
            ..ParseOptions::default()
        };
        assert_eq!(model_of(&read(0..12, hinted).unwrap()), "HALPE_26");
        // Settings of another recording do not override the file.
        assert_eq!(model_of(&read(0..33, hinted).unwrap()), "BLAZEPOSE");
    }

    #[test]
    fn unknown_ids_need_an_explicit_model() {
        let refused = read(0..60, ParseOptions::default()).unwrap_err();
        assert!(
            refused.contains("found point 59") && refused.contains("--keypoints MODEL"),
            "{refused}"
        );
        let requested = ParseOptions {
            model: Some(Model::Halpe68),
            ..ParseOptions::default()
        };
        assert_eq!(model_of(&read(0..60, requested).unwrap()), "HALPE_68");
    }
}
