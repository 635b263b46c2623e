//! `farfield simulate`: writes a scene as the venue folder of a recording.
//!
//! Check (everything that can be refused) -> record into a temporary folder in the same place -> rename it when it is
//! whole. After an error nothing incomplete remains.

mod keypoints;
mod kind;
mod pictures;
mod summary;
mod work;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context as _, anyhow, ensure};
use farfield_fusion_node::check_folder;
use farfield_node::files::load_venue;
use farfield_node::log::start_log;
use farfield_node::process::{Ending, NodeError, exit_code, say};
use farfield_proto::camera::CameraModel;
use farfield_proto::tick::{Tick, parse_range};
use farfield_proto::venue::SimulatedContent;
use farfield_sim::faults::SceneCrowd;
use farfield_sim::maps_file::Course;
use farfield_sim::scene::Scene;
use farfield_sim::simulated::{SimulatedSource, VenueSources, VenueText, without_map_faults};

use self::kind::RecordingKind;
use self::work::Interrupt;
use crate::networks::card_path;
use crate::output;
use crate::overlay::{TickList, draw_poses, overlay, overlay_ticks};
use crate::venue_folder::{self, CALIBRATION};

/// Arguments of `farfield simulate`.
#[derive(Debug, clap::Args)]
pub(crate) struct SimulateArgs {
    /// The scene file.
    pub(crate) scene: PathBuf,
    /// Folder for the venue.
    ///
    /// It must be empty or not exist.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// What to record: videos, images, keypoints, maps.
    ///
    /// Default: videos if ffmpeg is installed, else images.
    #[arg(long = "as", value_name = "KIND", hide_possible_values = true)]
    pub(crate) kind: Option<RecordingKind>,
    /// Record only these ticks; B is excluded.
    #[arg(long, value_name = "A..B", value_parser = parse_range, allow_hyphen_values = true)]
    pub(crate) ticks: Option<Range<Tick>>,
    /// Let people walk back the same way, endlessly.
    ///
    /// Only with `--as maps`.
    #[arg(long)]
    pub(crate) there_and_back: bool,
    /// Draw the true skeletons over the images of these ticks.
    ///
    /// Numbers separated by commas; without a value, the middle tick. One image per camera.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: clap's form"
    )]
    pub(crate) overlay: Option<Option<TickList>>,
    /// Card of a detector for the people.
    ///
    /// Without one, the venue gives each person by hand at the person's first tick.
    #[arg(long, value_name = "CARD")]
    pub(crate) detector: Option<PathBuf>,
}

/// A checked recording.
struct RecordingPlan {
    scene: Arc<Scene>,
    /// The people, for all cameras.
    crowd: Arc<SceneCrowd>,
    name: String,
    /// The scene file, as given.
    from: String,
    kind: RecordingKind,
    ticks: Range<Tick>,
    /// The time course and the number of ticks of a recording of maps.
    course: (Course, u32),
    detector: Option<String>,
    /// The ticks to draw.
    overlay: Vec<Tick>,
    out: PathBuf,
}

impl RecordingPlan {
    /// The frames of a camera, with the tick numbers of the scene.
    fn frames(&self, camera: usize, content: SimulatedContent) -> anyhow::Result<SimulatedSource> {
        let ticks = self.ticks.clone();
        Ok(SimulatedSource::new(
            &self.crowd,
            camera,
            content,
            ticks,
            Tick(0),
        )?)
    }
}

/// Records a scene and prints a summary.
pub(crate) fn main(args: SimulateArgs) -> ExitCode {
    start_log();
    exit_code(simulate(args))
}

fn simulate(args: SimulateArgs) -> Result<Ending, NodeError> {
    let plan = check(args).map_err(NodeError::Refused)?;
    let interrupt = Interrupt::catch()
        .context("catching signals")
        .map_err(NodeError::Failed)?;
    // The folder is deleted with its content unless it gets its final name.
    let folder = venue_folder::temporary_sibling(&plan.out).map_err(NodeError::Refused)?;
    let recorded = record(&plan, folder.path(), &interrupt).map_err(NodeError::Failed)?;
    if recorded == Ending::Done {
        venue_folder::give_name(folder, &plan.out).map_err(NodeError::Failed)?;
        draw(&plan).map_err(NodeError::Failed)?;
        output::print(&summary::text(&plan)).map_err(NodeError::Failed)?;
    }
    Ok(recorded)
}

fn check(args: SimulateArgs) -> anyhow::Result<RecordingPlan> {
    let scene = Scene::load(&args.scene)?;
    check_folder(&args.out)?;
    let all = scene.ticks();
    let ticks = args.ticks.unwrap_or_else(|| all.clone());
    ensure!(
        ticks.start >= all.start && ticks.end <= all.end && ticks.start < ticks.end,
        "`--ticks` {}..{} is not inside the scene {}, which has {}..{}",
        ticks.start,
        ticks.end,
        args.scene.display(),
        all.start,
        all.end
    );
    let overlay = match args.overlay {
        Some(requested) => overlay_ticks(requested, &ticks)?,
        None => Vec::new(),
    };
    let kind = RecordingKind::choose(args.kind)?;
    ensure!(
        kind == RecordingKind::Maps || !args.there_and_back,
        "`--there-and-back` needs `--as maps`: other recordings are played once"
    );
    // The truth of images has no faults of maps.
    let scene = Arc::new(if kind.has_images() {
        without_map_faults(scene)
    } else {
        scene
    });
    let detector = args
        .detector
        .as_deref()
        .map(|card| detector_card(card, kind))
        .transpose()?;
    Ok(RecordingPlan {
        name: venue_name(&args.scene),
        from: args.scene.display().to_string(),
        crowd: Arc::new(SceneCrowd::new(Arc::clone(&scene))),
        course: Course::new(&scene, &ticks, args.there_and_back),
        scene,
        kind,
        ticks,
        detector,
        overlay,
        out: args.out,
    })
}

/// Draws the truth over the recording.
fn draw(plan: &RecordingPlan) -> anyhow::Result<()> {
    if plan.overlay.is_empty() {
        return Ok(());
    }
    let venue = load_venue(&plan.out.join("venue.toml"))?;
    let sources = VenueSources::default();
    let of = (&venue, &plan.overlay[..], &*plan.out.join("truth.jsonl"));
    draw_poses(of, &plan.out, |camera, tick, persons| {
        overlay(&sources, &venue, camera, tick, persons)
    })
}

/// The absolute path of the card, as the venue is in another folder.
fn detector_card(card: &Path, kind: RecordingKind) -> anyhow::Result<String> {
    ensure!(
        kind.has_images(),
        "`--detector` {}: a venue of {} has no images for it",
        card.display(),
        kind.name()
    );
    let full = std::fs::canonicalize(card_path(card))
        .with_context(|| format!("`--detector` {}", card.display()))?;
    full.into_os_string()
        .into_string()
        .map_err(|_| anyhow!("`--detector` {}: its name is not UTF-8", card.display()))
}

/// The scene's name as a valid part of Zenoh keys.
fn venue_name(scene: &Path) -> String {
    let stem = scene.file_stem().unwrap_or_default().to_string_lossy();
    let letter = |c: char| {
        if c.is_ascii_alphanumeric() || "-_.".contains(c) {
            c
        } else {
            '-'
        }
    };
    let name: String = stem.chars().take(64).map(letter).collect();
    if name.is_empty() {
        "scene".to_owned()
    } else {
        name
    }
}

/// Writes all files into `folder`.
fn record(plan: &RecordingPlan, folder: &Path, interrupt: &Interrupt) -> anyhow::Result<Ending> {
    let RecordingPlan { scene, ticks, .. } = plan;
    say(format_args!(
        "recording {} ticks of {} cameras as {}",
        ticks.end - ticks.start,
        scene.cameras().len(),
        plan.kind.name()
    ));
    venue_folder::write_calibration(scene, folder)?;
    write_truth(plan, &folder.join("truth.jsonl"))?;
    let has_images = plan.kind.has_images();
    let network = has_images.then(|| venue_folder::write_network(folder));
    let network = network.transpose()?;
    let ending = match plan.kind {
        RecordingKind::Keypoints => keypoints::write(plan, folder, interrupt)?,
        RecordingKind::Maps => keypoints::write_as_maps(plan, folder, interrupt)?,
        RecordingKind::Videos | RecordingKind::Images => pictures::write(plan, folder, interrupt)?,
    };
    let source = |camera: &CameraModel| plan.kind.source(camera.name());
    // Keypoints and maps contain sightings, and a detector finds the people.
    let is_given = has_images && plan.detector.is_none();
    let text = VenueText {
        scene,
        name: &plan.name,
        head: &format!("Simulated from {}; the truth is in truth.jsonl.", plan.from),
        calibration: CALIBRATION,
        network: network.as_deref(),
        detector: plan.detector.as_deref(),
        source: &source,
        first_tick: ticks.start,
        given: is_given.then(|| ticks.clone()),
    };
    venue_folder::write(&folder.join("venue.toml"), text.to_toml().as_bytes())?;
    Ok(ending)
}

/// The truth of every tick of the recording; of a whole period if it repeats.
fn write_truth(plan: &RecordingPlan, path: &Path) -> anyhow::Result<()> {
    let RecordingPlan { scene, ticks, .. } = plan;
    if plan.kind != RecordingKind::Maps {
        return venue_folder::write_truth(scene, ticks, path);
    }
    let (course, n) = plan.course;
    let moments = (0..i64::from(n)).map(|i| {
        let elapsed_s = Tick(i).seconds(scene.rate_hz());
        (ticks.start + i, course.time_s(elapsed_s))
    });
    venue_folder::write_truth_at(scene, moments, path)
}
