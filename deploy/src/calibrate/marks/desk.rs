//! What is clicked, held while the page is open: each change is checked, written whole and answered with what it comes to.

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

/// How far outside its picture a click may be: at the very edge of its pixels.
const EDGE_PX: f64 = 0.5;
/// Most files of which each is kept as it was: nobody edits one more often.
const MOST_KEPT: usize = 1000;

/// What there was at the start.
#[derive(Default)]
pub(super) struct Found {
    /// What was clicked.
    pub(super) clicked: ClickedFile,
    /// The file as it was, where there was one.
    pub(super) text: Option<String>,
    /// The court that it is of.
    pub(super) court: Option<Court>,
}

/// Pictures, and what is clicked in them.
pub(super) struct Desk {
    out: PathBuf,
    court: Option<Court>,
    cameras: Vec<MarkedPicture>,
    pngs: Vec<Arc<[u8]>>,
    held: Mutex<Held>,
}

/// What is clicked, and what it comes to.
type Weighed = (ClickedFile, Vec<(Marks, FitDocument)>);

struct Held {
    revision: u64,
    clicked: ClickedFile,
    /// The text of the file when it was last read or written.
    on_disk: Option<String>,
    /// The file holds what is lost when it is written, comments above all: it has to be kept under another name before.
    is_foreign: bool,
    /// Of each camera what was fitted, and what came of it.
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
    /// A desk with the pictures of `cameras`, whose clicks go to `out`.
    ///
    /// # Errors
    /// When what was clicked before is not in these pictures.
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
            held: Mutex::new(Held {
                revision: 0,
                clicked: ClickedFile::default(),
                on_disk: found.text,
                is_foreign,
                fits: Vec::new(),
            }),
            out,
        };
        // As it will be written: to the last decimal that a page is told.
        let clicked = found.clicked.checked(&desk.out).map_err(Error::msg)?;
        if let Err(problem) = desk.check_pixels(&clicked) {
            bail!("{}: {problem}", desk.out.display());
        }
        let fits = desk.fits(&clicked, &[]).map_err(Error::msg)?;
        let held = desk.held.get_mut().unwrap_or_else(PoisonError::into_inner);
        held.fits = fits;
        held.clicked = clicked;
        Ok(desk)
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is said at the end.
    pub(super) fn summary(&self) -> Vec<String> {
        let held = self.held();
        let out = self.out.display();
        let mut lines = Vec::new();
        for (camera, clicked) in &held.clicked.camera {
            let clicks: usize = clicked.values().map(Vec::len).sum();
            lines.push(format!("camera {camera}: {clicks} clicks"));
        }
        lines.push(match held.clicked.problem(&self.out) {
            _ if lines.is_empty() => "nothing was clicked".to_owned(),
            None => format!("{out} is what `farfield calibrate points ... --marks {out}` takes"),
            Some(problem) => format!("not yet for --marks: {problem}"),
        });
        lines
    }

    /// Refuses clicks outside of the pictures, and cameras of which there is none.
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
                        "`camera.{}.{name}`: found ({x}, {y}), expected a place in {} of {w}x{h}",
                        camera.name, camera.file
                    ));
                }
            }
        }
        Ok(())
    }

    /// What is clicked after a change. Of what a page says its clicks in its pictures count, and names: it may not change the
    /// court, and what it says of cameras that it does not show may be old.
    fn changed(&self, before: &ClickedFile, clicked: &ClickedFile) -> Result<ClickedFile, String> {
        let is_shown = |name: &str| self.cameras.iter().any(|it| it.name == name);
        let clicked = clicked.in_place_of(before, is_shown).checked(&self.out)?;
        if (&clicked.court, clicked.size_m) != (&before.court, before.size_m) {
            return Err(
                "the court is said when the command is started: --court, --size-m".to_owned(),
            );
        }
        self.check_pixels(&clicked)?;
        Ok(clicked)
    }

    /// What each camera's clicks come to; taken from `before` where they are the same.
    fn fits(
        &self,
        clicked: &ClickedFile,
        before: &[(Marks, FitDocument)],
    ) -> Result<Vec<(Marks, FitDocument)>, String> {
        let each = self.cameras.iter().enumerate().map(|(index, camera)| {
            let marks = clicked.marks_of(&camera.name, &self.out)?;
            let known = before.get(index).filter(|(of, _)| *of == marks);
            let document = known.map(|(_, document)| document.clone());
            let document = document.unwrap_or_else(|| fit(camera, &marks, self.court.as_ref()));
            Ok((marks, document))
        });
        each.collect()
    }

    fn state<'a>(&self, held: &'a Held) -> StateDocument<'a> {
        StateDocument {
            revision: held.revision,
            clicked: &held.clicked,
            problem: held.clicked.problem(&self.out),
            fits: held.fits.iter().map(|(_, document)| document).collect(),
        }
    }

    /// Takes up the file where somebody else has changed it since it was read or written; whether so.
    ///
    /// # Errors
    /// In words, where it cannot be read: it is not written over.
    fn take_up(&self, held: &mut Held) -> Result<bool, String> {
        if !self.out.exists() {
            return Ok(false);
        }
        let text = read(&self.out).map_err(|error| format!("{error:#}"))?.text;
        if held.on_disk.as_ref() == Some(&text) {
            return Ok(false);
        }
        let shown = self.out.display();
        let problem = |problem: String| {
            format!(
                "{shown} was changed elsewhere, and is left as it is until it is put right or away: {problem}"
            )
        };
        let found = ClickedFile::parse(&text, &self.out);
        let clicked = found.map_err(|error| problem(error.to_string()))?;
        let mut clicked = clicked.checked(&self.out).map_err(problem)?;
        // As at the start, where --court says it and the file does not.
        if clicked.court.is_none() {
            clicked.court.clone_from(&held.clicked.court);
            clicked.size_m = held.clicked.size_m;
        }
        if (&clicked.court, clicked.size_m) != (&held.clicked.court, held.clicked.size_m) {
            return Err(problem("found another court than at the start".to_owned()));
        }
        self.check_pixels(&clicked).map_err(problem)?;
        held.fits = self.fits(&clicked, &held.fits).map_err(problem)?;
        held.clicked = clicked;
        held.revision += 1;
        held.is_foreign = is_foreign(&text, &self.out);
        held.on_disk = Some(text);
        Ok(true)
    }

    /// What a change comes to, and the fits of it; else what the page is told instead.
    fn weighed(&self, held: &mut Held, change: &ClickedChange) -> Result<Weighed, Taken> {
        self.refuse_behind(held)?;
        if change.revision != held.revision {
            return Err(Taken::Behind(json(&self.state(held))));
        }
        let clicked = self.changed(&held.clicked, &change.clicked);
        let clicked = clicked.map_err(Taken::Refused)?;
        let fits = self.fits(&clicked, &held.fits).map_err(Taken::Refused)?;
        Ok((clicked, fits))
    }

    /// Puts it into the file; else what the page is told instead. Fitting takes time, in which somebody may have written to the
    /// file: it is looked at again right before.
    fn put(
        &self,
        held: &mut Held,
        clicked: ClickedFile,
        fits: Vec<(Marks, FitDocument)>,
    ) -> Result<Taken, Taken> {
        self.refuse_behind(held)?;
        self.write(held, &clicked).map_err(Taken::Failed)?;
        held.revision += 1;
        held.clicked = clicked;
        held.fits = fits;
        Ok(Taken::Written(json(&self.state(held))))
    }

    /// Takes up the file where somebody else has changed it: then a page has to be told first.
    fn refuse_behind(&self, held: &mut Held) -> Result<(), Taken> {
        match self.take_up(held) {
            Ok(false) => Ok(()),
            Ok(true) => Err(Taken::Behind(json(&self.state(held)))),
            Err(problem) => Err(Taken::Failed(problem)),
        }
    }

    /// Writes what is clicked; a file that somebody else wrote is kept beside it, since its comments are lost.
    fn write(&self, held: &mut Held, clicked: &ClickedFile) -> Result<(), String> {
        let failed = |error| match error {
            NodeError::Refused(error) | NodeError::Failed(error) => format!("{error:#}"),
        };
        if let Some(before) = held.on_disk.as_ref().filter(|_| held.is_foreign) {
            write(&free_name(&self.out)?, before).map_err(failed)?;
            held.is_foreign = false;
        }
        let text = clicked.text();
        write(&self.out, &text).map_err(failed)?;
        held.on_disk = Some(text);
        Ok(())
    }
}

/// Whether a file says more than is written again.
fn is_foreign(text: &str, path: &Path) -> bool {
    !ClickedFile::parse(text, path).is_ok_and(|clicked| clicked.text() == text)
}

/// Where a file is kept as it was: `clicked.before.toml`, `clicked.before.2.toml` and so on.
fn free_name(out: &Path) -> Result<PathBuf, String> {
    let mut names = (1..=MOST_KEPT).map(|number| match number {
        1 => out.with_extension("before.toml"),
        _ => out.with_extension(format!("before.{number}.toml")),
    });
    let free = names.find(|path| !path.exists());
    free.ok_or_else(|| {
        format!(
            "found {MOST_KEPT} files that are kept as {} was: take some away",
            out.display()
        )
    })
}

fn json(document: &impl Serialize) -> String {
    // Maps of texts and finite numbers can always be said.
    serde_json::to_string(document).unwrap_or_default()
}

impl Clicking for Desk {
    fn document(&self) -> String {
        let held = self.held();
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
            state: self.state(&held),
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
        let mut held = self.held();
        let written = self.weighed(&mut held, &change);
        let written = written.and_then(|(clicked, fits)| self.put(&mut held, clicked, fits));
        written.unwrap_or_else(|otherwise| otherwise)
    }
}

#[cfg(test)]
mod tests;
