//! What is clicked, held while the page is open: each change is checked, written whole and answered with what it comes to.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::bail;
use farfield_calibration::alignment::{ClickedChange, ClickedFile, Marks};
use farfield_node::process::NodeError;
use farfield_page::{Clicking, Taken};
use farfield_proto::court::{Court, PlacedCourt};
use serde::Serialize;

use super::fits::{FitDocument, fit};
use super::pictures::MarkedPicture;
use crate::calibrate::write;

/// How far outside its picture a click may be: at the very edge of its pixels.
const EDGE_PX: f64 = 0.5;
/// What every file of ours begins with.
const HEADING: &str = "# Clicked with `farfield calibrate marks`";

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

struct Held {
    revision: u64,
    clicked: ClickedFile,
    /// A file that somebody else wrote, until it is kept under another name.
    foreign: Option<String>,
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
        let foreign = found.text.filter(|text| !text.starts_with(HEADING));
        let mut desk = Self {
            court: found.court,
            pngs,
            cameras,
            held: Mutex::new(Held {
                revision: 0,
                clicked: ClickedFile::default(),
                foreign,
                fits: Vec::new(),
            }),
            out,
        };
        let shown = desk.out.display().to_string();
        if let Err(problem) = desk.check_pixels(&found.clicked) {
            bail!("{shown}: {problem}");
        }
        let fits = desk.fits(&found.clicked, &[]);
        let fits = fits.map_err(|problem| anyhow::anyhow!("{shown}: {problem}"))?;
        let held = desk.held.get_mut().unwrap_or_else(PoisonError::into_inner);
        held.fits = fits;
        held.clicked = found.clicked;
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

    /// What a page may change: clicks in its pictures, and names. Not the court, nor what is of cameras that it does not show.
    fn check(&self, held: &Held, clicked: &ClickedFile) -> Result<ClickedFile, String> {
        let clicked = clicked.checked()?;
        let before = &held.clicked;
        if (&clicked.court, clicked.size_m) != (&before.court, before.size_m) {
            return Err(
                "the court is said when the command is started: --court, --size-m".to_owned(),
            );
        }
        for name in clicked.camera.keys() {
            let is_shown = self.cameras.iter().any(|it| it.name == *name);
            if !is_shown && clicked.camera.get(name) != before.camera.get(name) {
                return Err(format!("there is no picture of camera `{name}` here"));
            }
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
            let marks = clicked.marks_of(&camera.name)?;
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

    /// Writes what is clicked; a file that somebody else wrote is kept beside it, since its comments are lost.
    fn write(&self, held: &mut Held, clicked: &ClickedFile) -> Result<(), String> {
        let failed = |error| match error {
            NodeError::Refused(error) | NodeError::Failed(error) => format!("{error:#}"),
        };
        if let Some(text) = &held.foreign {
            write(&self.out.with_extension("before.toml"), text).map_err(failed)?;
            held.foreign = None;
        }
        write(&self.out, &clicked.text()).map_err(failed)
    }
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
        if change.revision != held.revision {
            return Taken::Behind(json(&self.state(&held)));
        }
        let clicked = match self.check(&held, &change.clicked) {
            Ok(clicked) => clicked,
            Err(problem) => return Taken::Refused(problem),
        };
        let fits = match self.fits(&clicked, &held.fits) {
            Ok(fits) => fits,
            Err(problem) => return Taken::Refused(problem),
        };
        if let Err(problem) = self.write(&mut held, &clicked) {
            return Taken::Failed(problem);
        }
        held.revision += 1;
        held.clicked = clicked;
        held.fits = fits;
        Taken::Written(json(&self.state(&held)))
    }
}
