//! The clicked marks while the page is open: each change is checked, written and answered with the resulting fits.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Error, bail};
use farfield_calibration::alignment::{ClickedChange, ClickedFile, Marks};
use farfield_node::process::NodeError;
use farfield_page::{Clicking, Taken};
use farfield_proto::court::{Court, PlacedCourt};
use serde::Serialize;

use super::fits::{FitDocument, fit};
use super::pictures::MarkedPicture;
use crate::calibrate::{read, write};

/// How far outside its image a click may be: at the very edge of its pixels.
const EDGE_PX: f64 = 0.5;
/// Limit for backup files; more edits by hand are unlikely.
const MOST_BACKUPS: usize = 1000;

/// The state at the start.
#[derive(Default)]
pub(super) struct Found {
    /// The clicked marks.
    pub(super) clicked: ClickedFile,
    /// The text of the file, if it existed.
    pub(super) text: Option<String>,
    /// Its court.
    pub(super) court: Option<Court>,
}

/// Images with their clicked marks.
pub(super) struct Desk {
    out: PathBuf,
    court: Option<Court>,
    cameras: Vec<MarkedPicture>,
    pngs: Vec<Arc<[u8]>>,
    state: Mutex<DeskState>,
}

/// Clicked marks with their fits.
type Fitted = (ClickedFile, Vec<(Marks, FitDocument)>);

struct DeskState {
    revision: u64,
    clicked: ClickedFile,
    /// The text of the file when it was last read or written.
    on_disk: Option<String>,
    /// The file has content that is lost when it is written, such as comments: a backup is needed first.
    is_foreign: bool,
    /// The fitted marks of each camera, and the fit.
    fits: Vec<(Marks, FitDocument)>,
}

#[derive(Serialize)]
struct DocumentLine<'a> {
    file: String,
    court: Option<CourtDocument<'a>>,
    cameras: Vec<CameraDocument<'a>>,
    state: StateDocument<'a>,
}

#[derive(Serialize)]
struct CourtDocument<'a> {
    name: &'a str,
    rules: &'a str,
    size_m: [f64; 2],
    marks: Vec<MarkDocument<'a>>,
    lines: Vec<LineDocument<'a>>,
}

#[derive(Serialize)]
struct MarkDocument<'a> {
    name: &'a str,
    position_m: [f64; 3],
}

#[derive(Serialize)]
struct LineDocument<'a> {
    name: &'a str,
    points_m: Vec<[f64; 2]>,
}

#[derive(Serialize)]
struct CameraDocument<'a> {
    name: &'a str,
    picture: &'a str,
    size_px: [u32; 2],
    has_lens: bool,
}

#[derive(Serialize)]
struct StateDocument<'a> {
    revision: u64,
    clicked: &'a ClickedFile,
    problem: Option<String>,
    fits: Vec<&'a FitDocument>,
}

impl Desk {
    /// A desk with the images of `cameras`, which writes clicks to `out`.
    ///
    /// # Errors
    /// When earlier clicks are outside these images.
    pub(super) fn new(
        out: PathBuf,
        found: Found,
        mut cameras: Vec<MarkedPicture>,
    ) -> anyhow::Result<Self> {
        let pngs = cameras.iter_mut().map(|it| std::mem::take(&mut it.png));
        let pngs = pngs.map(Arc::from).collect();
        let text = found.text.as_deref();
        let is_foreign = text.is_some_and(|text| is_foreign(text, &out));
        let mut desk = Self {
            court: found.court,
            pngs,
            cameras,
            state: Mutex::new(DeskState {
                revision: 0,
                clicked: ClickedFile::default(),
                on_disk: found.text,
                is_foreign,
                fits: Vec::new(),
            }),
            out,
        };
        // In the form in which it will be written, with the decimals that a page receives.
        let clicked = found.clicked.checked(&desk.out).map_err(Error::msg)?;
        if let Err(problem) = desk.check_pixels(&clicked) {
            bail!("{}: {problem}", desk.out.display());
        }
        let fits = desk.fits(&clicked, &[]).map_err(Error::msg)?;
        let state = desk.state.get_mut().unwrap_or_else(PoisonError::into_inner);
        state.fits = fits;
        state.clicked = clicked;
        Ok(desk)
    }

    fn lock(&self) -> MutexGuard<'_, DeskState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The lines printed at the end.
    pub(super) fn summary(&self) -> Vec<String> {
        let state = self.lock();
        let out = self.out.display();
        let mut lines = Vec::new();
        for (camera, clicked) in &state.clicked.camera {
            let clicks: usize = clicked.values().map(Vec::len).sum();
            lines.push(format!("camera {camera}: {clicks} clicks"));
        }
        lines.push(match state.clicked.problem(&self.out) {
            _ if lines.is_empty() => "nothing was clicked".to_owned(),
            None => format!("{out} is ready for `farfield calibrate points ... --marks {out}`"),
            Some(problem) => format!("not yet ready for --marks: {problem}"),
        });
        lines
    }

    /// Refuses clicks outside the images.
    fn check_pixels(&self, clicked: &ClickedFile) -> Result<(), String> {
        for camera in &self.cameras {
            let [w, h] = camera.size_px.map(f64::from);
            let own = clicked.camera.get(&camera.name).into_iter().flatten();
            for (name, [x, y]) in own.flat_map(|(name, all)| all.iter().map(move |px| (name, *px)))
            {
                let is_inside =
                    (-EDGE_PX..=w - EDGE_PX).contains(&x) && (-EDGE_PX..=h - EDGE_PX).contains(&y);
                if !is_inside {
                    return Err(format!(
                        "`camera.{}.{name}`: found ({x}, {y}), expected a position in {} of {w}x{h}",
                        camera.name, camera.file
                    ));
                }
            }
        }
        Ok(())
    }

    /// The clicked marks after a change. A page may change clicks in its images, and names. It must not change the
    /// court, and its data on cameras that it does not show may be outdated.
    fn changed(&self, before: &ClickedFile, clicked: &ClickedFile) -> Result<ClickedFile, String> {
        let is_shown = |name: &str| self.cameras.iter().any(|it| it.name == name);
        let clicked = clicked.in_place_of(before, is_shown).checked(&self.out)?;
        if (&clicked.court, clicked.size_m) != (&before.court, before.size_m) {
            return Err(
                "the court can only be set when the command is started: --court, --size-m"
                    .to_owned(),
            );
        }
        self.check_pixels(&clicked)?;
        Ok(clicked)
    }

    /// The fits of all cameras; those with unchanged marks are taken from `before`.
    fn fits(
        &self,
        clicked: &ClickedFile,
        before: &[(Marks, FitDocument)],
    ) -> Result<Vec<(Marks, FitDocument)>, String> {
        let each = self.cameras.iter().enumerate().map(|(index, camera)| {
            let marks = clicked.marks_of(&camera.name, &self.out)?;
            let known = before.get(index).filter(|(known, _)| *known == marks);
            let document = known.map(|(_, document)| document.clone());
            let document = document.unwrap_or_else(|| fit(camera, &marks, self.court.as_ref()));
            Ok((marks, document))
        });
        each.collect()
    }

    fn document_of<'a>(&self, state: &'a DeskState) -> StateDocument<'a> {
        StateDocument {
            revision: state.revision,
            clicked: &state.clicked,
            problem: state.clicked.problem(&self.out),
            fits: state.fits.iter().map(|(_, document)| document).collect(),
        }
    }

    /// Loads the file if another program has changed it since it was read or written. Returns whether it did.
    ///
    /// # Errors
    /// A message if it cannot be read; then it is not overwritten.
    fn reload(&self, state: &mut DeskState) -> Result<bool, String> {
        if !self.out.exists() {
            return Ok(false);
        }
        let text = read(&self.out).map_err(|error| format!("{error:#}"))?.text;
        if state.on_disk.as_ref() == Some(&text) {
            return Ok(false);
        }
        let shown = self.out.display();
        let problem = |problem: String| {
            format!(
                "{shown} was changed by another program; nothing is written until it is corrected or removed: {problem}"
            )
        };
        let found = ClickedFile::parse(&text, &self.out);
        let clicked = found.map_err(|error| problem(error.to_string()))?;
        let mut clicked = clicked.checked(&self.out).map_err(problem)?;
        // As at the start, if the court is given by --court and not in the file.
        if clicked.court.is_none() {
            clicked.court.clone_from(&state.clicked.court);
            clicked.size_m = state.clicked.size_m;
        }
        if (&clicked.court, clicked.size_m) != (&state.clicked.court, state.clicked.size_m) {
            return Err(problem("found another court than at the start".to_owned()));
        }
        self.check_pixels(&clicked).map_err(problem)?;
        state.fits = self.fits(&clicked, &state.fits).map_err(problem)?;
        state.clicked = clicked;
        state.revision += 1;
        state.is_foreign = is_foreign(&text, &self.out);
        state.on_disk = Some(text);
        Ok(true)
    }

    /// The result of a change with its fits; else the answer for the page.
    fn fitted(&self, state: &mut DeskState, change: &ClickedChange) -> Result<Fitted, Taken> {
        self.refuse_outdated(state)?;
        if change.revision != state.revision {
            return Err(Taken::Behind(json(&self.document_of(state))));
        }
        let clicked = self.changed(&state.clicked, &change.clicked);
        let clicked = clicked.map_err(Taken::Refused)?;
        let fits = self.fits(&clicked, &state.fits).map_err(Taken::Refused)?;
        Ok((clicked, fits))
    }

    /// Writes the change to the file; else the answer for the page. The file is checked again before, as another
    /// program may have changed it during the fit.
    fn store(
        &self,
        state: &mut DeskState,
        clicked: ClickedFile,
        fits: Vec<(Marks, FitDocument)>,
    ) -> Result<Taken, Taken> {
        self.refuse_outdated(state)?;
        self.write(state, &clicked).map_err(Taken::Failed)?;
        state.revision += 1;
        state.clicked = clicked;
        state.fits = fits;
        Ok(Taken::Written(json(&self.document_of(state))))
    }

    /// Loads the file if another program has changed it; then the page must be updated first.
    fn refuse_outdated(&self, state: &mut DeskState) -> Result<(), Taken> {
        match self.reload(state) {
            Ok(false) => Ok(()),
            Ok(true) => Err(Taken::Behind(json(&self.document_of(state)))),
            Err(problem) => Err(Taken::Failed(problem)),
        }
    }

    /// Writes the clicked marks. A file that another program wrote is backed up, since its comments are lost.
    fn write(&self, state: &mut DeskState, clicked: &ClickedFile) -> Result<(), String> {
        let failed = |error| match error {
            NodeError::Refused(error) | NodeError::Failed(error) => format!("{error:#}"),
        };
        if let Some(before) = state.on_disk.as_ref().filter(|_| state.is_foreign) {
            write(&free_name(&self.out)?, before).map_err(failed)?;
            state.is_foreign = false;
        }
        let text = clicked.text();
        write(&self.out, &text).map_err(failed)?;
        state.on_disk = Some(text);
        Ok(())
    }
}

/// Whether a file has content that would be lost when it is written.
fn is_foreign(text: &str, path: &Path) -> bool {
    !ClickedFile::parse(text, path).is_ok_and(|clicked| clicked.text() == text)
}

/// A free name for a backup: `clicked.before.toml`, `clicked.before.2.toml` and so on.
fn free_name(out: &Path) -> Result<PathBuf, String> {
    let mut names = (1..=MOST_BACKUPS).map(|number| match number {
        1 => out.with_extension("before.toml"),
        _ => out.with_extension(format!("before.{number}.toml")),
    });
    let free = names.find(|path| !path.exists());
    free.ok_or_else(|| {
        format!(
            "found {MOST_BACKUPS} backups of {}: remove some",
            out.display()
        )
    })
}

fn json(document: &impl Serialize) -> String {
    // Maps of strings and finite numbers can always be serialised.
    serde_json::to_string(document).unwrap_or_default()
}

impl Clicking for Desk {
    fn document(&self) -> String {
        let state = self.lock();
        let court = self.court.as_ref().map(|court| {
            let placed = PlacedCourt {
                court: court.clone(),
                centre_m: [0.0, 0.0],
                turn_rad: 0.0,
            };
            CourtDocument {
                name: court.name,
                rules: court.rules,
                size_m: court.size_m,
                marks: court
                    .marks
                    .iter()
                    .map(|it| MarkDocument {
                        name: &it.name,
                        position_m: it.position_m,
                    })
                    .collect(),
                lines: court
                    .lines
                    .iter()
                    .map(|it| LineDocument {
                        name: &it.name,
                        points_m: placed.points_m(&it.shape),
                    })
                    .collect(),
            }
        });
        let cameras = self.cameras.iter().map(|it| CameraDocument {
            name: &it.name,
            picture: &it.file,
            size_px: it.size_px,
            has_lens: it.lens.is_some(),
        });
        json(&DocumentLine {
            file: self.out.display().to_string(),
            court,
            cameras: cameras.collect(),
            state: self.document_of(&state),
        })
    }

    fn picture(&self, number: usize) -> Option<Arc<[u8]>> {
        self.pngs.get(number).cloned()
    }

    fn take(&self, change: &[u8]) -> Taken {
        let change = match ClickedChange::parse(change) {
            Ok(change) => change,
            Err(problem) => return Taken::Refused(problem),
        };
        let mut state = self.lock();
        let written = self.fitted(&mut state, &change);
        let written = written.and_then(|(clicked, fits)| self.store(&mut state, clicked, fits));
        written.unwrap_or_else(|otherwise| otherwise)
    }
}

#[cfg(test)]
mod tests;
