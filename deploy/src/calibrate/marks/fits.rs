//! The fit of one camera to its clicked marks, for the page.

use farfield_calibration::alignment::{
    HalfTurn, LEAST_MARKS, MarkResidual, Marks, OneCameraError, OneCameraFit, drawn_lines,
    drawn_marks, fit_one_camera,
};
use farfield_proto::court::Court;
use farfield_proto::printed::fixed;
use serde::Serialize;

use super::pictures::MarkedPicture;

/// Largest reported residual, pixels and metres; also for marks that are drawn nowhere.
const FARTHEST: f64 = 1e5;

/// One camera's fit.
#[derive(Debug, Clone, Serialize)]
pub(super) struct FitDocument {
    camera: String,
    state: FitState,
    text: String,
    warnings: Vec<String>,
    center_m: Option<[f64; 3]>,
    residuals: Vec<ResidualDocument>,
    lines: Vec<LineDocument>,
    marks: Vec<MarkDocument>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
enum FitState {
    Fits,
    Contradicts,
    TooFew,
    NoLens,
    Fails,
}

#[derive(Debug, Clone, Serialize)]
struct ResidualDocument {
    name: String,
    /// Index among the clicks of its name.
    index: usize,
    px: f64,
    m: f64,
    is_outlier: bool,
}

#[derive(Debug, Clone, Serialize)]
struct LineDocument {
    name: String,
    pieces: Vec<Vec<[f64; 2]>>,
}

#[derive(Debug, Clone, Serialize)]
struct MarkDocument {
    name: String,
    px: [f64; 2],
}

/// Fits the pose of the camera of `picture` to `marks`.
pub(super) fn fit(picture: &MarkedPicture, marks: &Marks, court: Option<&Court>) -> FitDocument {
    let Some(lens) = &picture.lens else {
        let text = format!(
            "The lens of {} is unknown, so nothing is drawn over its image: restart with --lens FILE.",
            picture.name
        );
        return without(picture, FitState::NoLens, text);
    };
    let fitted = match fit_one_camera(marks, &picture.name, lens) {
        Ok(fitted) => fitted,
        Err(OneCameraError::TooFew { found }) => {
            let more = LEAST_MARKS - found;
            let word = if more == 1 { "mark" } else { "marks" };
            let until = match court {
                Some(_) => "the court is drawn over the image",
                None => "the pose of the camera is known",
            };
            let text = format!("{more} more {word} until {until}.");
            return without(picture, FitState::TooFew, text);
        }
        Err(OneCameraError::OnALine) => {
            let text = "All marks are on one line: click one off this line.".to_owned();
            return without(picture, FitState::TooFew, text);
        }
        Err(error @ OneCameraError::None(_)) => {
            let text =
                format!("These marks fit no camera pose: {error}. Check for exchanged names.");
            return without(picture, FitState::Fails, text);
        }
    };
    let round = |px: [f64; 2]| px.map(|v| (100.0 * v).round() / 100.0);
    let lines = court.map(|court| drawn_lines(court, &fitted.state, picture.size_px));
    let drawn = court.map(|court| drawn_marks(court, &fitted.state, picture.size_px));
    FitDocument {
        camera: picture.name.clone(),
        state: if fitted.contradiction.is_some() {
            FitState::Contradicts
        } else {
            FitState::Fits
        },
        text: in_words(&fitted, court),
        warnings: warnings(&fitted),
        center_m: Some(fitted.state.center_w.into()),
        residuals: residuals(&fitted.residuals),
        lines: lines
            .unwrap_or_default()
            .into_iter()
            .map(|(name, pieces)| LineDocument {
                name,
                pieces: pieces
                    .into_iter()
                    .map(|piece| piece.into_iter().map(round).collect())
                    .collect(),
            })
            .collect(),
        marks: drawn
            .unwrap_or_default()
            .into_iter()
            .map(|(name, px)| MarkDocument {
                name,
                px: round(px),
            })
            .collect(),
    }
}

fn without(picture: &MarkedPicture, state: FitState, text: String) -> FitDocument {
    FitDocument {
        camera: picture.name.clone(),
        state,
        text,
        warnings: Vec::new(),
        center_m: None,
        residuals: Vec::new(),
        lines: Vec::new(),
        marks: Vec::new(),
    }
}

fn residuals(all: &[MarkResidual]) -> Vec<ResidualDocument> {
    let bounded = |v: f64| {
        if v.is_finite() {
            v.min(FARTHEST)
        } else {
            FARTHEST
        }
    };
    let each = all.iter().enumerate().map(|(at, it)| {
        let before = all.iter().take(at);
        ResidualDocument {
            name: it.name.clone(),
            index: before.filter(|other| other.name == it.name).count(),
            px: bounded(it.px.unwrap_or_default()),
            m: bounded(it.m),
            is_outlier: it.is_outlier,
        }
    });
    each.collect()
}

/// A name with spaces.
fn spaced(name: &str) -> String {
    name.replace('_', " ")
}

fn in_words(fitted: &OneCameraFit, court: Option<&Court>) -> String {
    if fitted.contradiction.is_some() {
        let worst = fitted.residuals.iter().max_by(|a, b| {
            let px = |it: &MarkResidual| it.px.unwrap_or_default();
            px(a).total_cmp(&px(b))
        });
        let worst = worst.map_or_else(String::new, |it| spaced(&it.name));
        let drawn = match court {
            Some(_) => "compare the drawn lines with the painted ones, and check for",
            None => "check for",
        };
        return format!(
            "The marks contradict each other; {worst} has the largest error: {drawn} exchanged names."
        );
    }
    let off: Vec<String> = fitted
        .residuals
        .iter()
        .filter(|it| it.is_outlier)
        .map(|it| {
            format!(
                "{} ({:.1} px)",
                spaced(&it.name),
                it.px.unwrap_or_default().min(FARTHEST)
            )
        })
        .collect();
    let [x, y, z]: [f64; 3] = fitted.state.center_w.into();
    let [x, y, z] = [x, y, z].map(|v| fixed(v, 1));
    let fits = fitted.residuals.len() - off.len();
    let place = format!(
        "{fits} clicks fit to {:.1} px; the camera is at ({x}, {y}, {z}) m",
        fitted.rms_px
    );
    match off.as_slice() {
        [] => place,
        [one] => format!("{one} does not fit the others: correct it, or its name. {place}"),
        several => format!(
            "{} do not fit the others: correct them, or their names. {place}",
            several.join(", ")
        ),
    }
}

fn warnings(fitted: &OneCameraFit) -> Vec<String> {
    let mut all = Vec::new();
    if fitted.is_under_floor {
        all.push(
            "This puts the camera below the floor: the court is clicked mirrored (north and south, or west and east, exchanged), or the \
             image is mirrored."
                .to_owned(),
        );
    }
    if fitted.is_ambiguous {
        all.push(
            "A second pose of the camera fits nearly as well: click marks farther apart, or one above the floor, such as a corner of the \
             crossbar."
                .to_owned(),
        );
    }
    if fitted.half_turn == HalfTurn::FitsAsWell {
        all.push(
            "The court turned by half would fit as well: it looks the same from both ends. You can choose which end is west; use the same in \
             all images."
                .to_owned(),
        );
    }
    all
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_calibration::adjustment::CameraState;
    use farfield_calibration::alignment::ClickedFile;
    use farfield_proto::camera::{Intrinsics, LensModel};

    use super::*;

    #[test]
    fn the_hint_for_more_marks_depends_on_the_court() {
        let lens = Intrinsics {
            fx_px: 30.0,
            fy_px: 30.0,
            cx_px: 20.0,
            cy_px: 15.0,
        };
        let picture = MarkedPicture {
            name: "north".to_owned(),
            file: "north.png".to_owned(),
            size_px: [40, 30],
            png: Vec::new(),
            lens: Some(CameraState::at_origin(lens, LensModel::ideal())),
        };
        let marks = ClickedFile::default().marks_of("north", Path::new("clicked.toml"));
        let marks = marks.unwrap();
        let court = Court::of("futsal", None).unwrap();
        let with = fit(&picture, &marks, Some(&court)).text;
        assert!(
            with.starts_with("4 more ") && with.contains("court"),
            "{with}"
        );
        let without = fit(&picture, &marks, None).text;
        assert!(without.starts_with("4 more ") && !without.contains("court"));
    }
}
