//! `farfield demo`: simulated people on a court, simulated cameras, and every node of a venue, scored against the
//! truth. Needs only the program itself.
//!
//! Check -> claim -> write the venue -> run it as `farfield run` does -> score.

mod play;
mod score;
mod ticker;
mod words;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use farfield_fusion_node::{FolderClaim, is_for_many};
use farfield_node::log::start_log;
use farfield_node::process::{Ending, NodeError, exit_code};
use farfield_page::server::Token;
use farfield_proto::tick::Tick;

use self::play::{DemoScript, Play};
use self::ticker::DemoTicker;
use self::words::ImageBackend;
use crate::listeners::ListenerArgs;
use crate::overlay::TickList;
use crate::run::{self, RunArgs, Session};
use crate::{output, venue_folder};

/// Folder of the simulated venue inside the results.
const VENUE: &str = "venue";
/// Name of the venue and of the results folders.
const NAME: &str = "demo";

/// Arguments of `farfield demo`.
#[derive(Debug, clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub(crate) struct DemoArgs {
    /// Number of ticks.
    ///
    /// Default: 300; with images and without ONNX Runtime 150, so that it takes about a minute there, too.
    #[arg(long, value_name = "N", conflicts_with_all = ["forever", "page"],
          value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) ticks: Option<u32>,
    /// Run until Ctrl-C.
    ///
    /// Every five minutes of scene time people start again, and with them the files: in `farfield-out/demo-N`, or DIR,
    /// DIR-2 and so on.
    #[arg(long)]
    pub(crate) forever: bool,
    /// No images and no network: many times faster.
    ///
    /// Maps are made from the truth, with typical faults of networks.
    #[arg(long)]
    pub(crate) maps: bool,
    /// With `--page`: use images and networks instead of maps.
    #[arg(
        long,
        requires = "page",
        conflicts_with = "maps",
        hide_short_help = true
    )]
    pub(crate) pictures: bool,
    /// Give the people by hand instead of detecting them.
    #[arg(long, conflicts_with = "maps")]
    pub(crate) given: bool,
    /// Folder for the results.
    ///
    /// It must be empty or not exist. Default: `farfield-out/demo-N`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Another scene instead of the court.
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    /// Draw skeletons over the images of these ticks.
    ///
    /// Numbers separated by commas. Default: the middle tick. One image per camera.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: clap's form"
    )]
    pub(crate) overlay: Option<Option<TickList>>,
    /// Record, for `farfield replay`.
    ///
    /// As an MCAP file. Default: `recording.mcap` in the results folder.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with a file: clap's form"
    )]
    pub(crate) record: Option<Option<PathBuf>>,
    /// Set a parameter to another value.
    ///
    /// For example `smoothing.cutoff_hz=3`; `farfield parameters` lists them.
    #[arg(long, value_name = "TABLE.FIELD=VALUE", hide_short_help = true)]
    pub(crate) set: Vec<String>,
    #[command(flatten)]
    pub(crate) listeners: ListenerArgs,
}

impl DemoArgs {
    /// Whether it has a page: then it runs live, from maps, until Ctrl-C.
    fn has_page(&self) -> bool {
        self.listeners.page.is_some()
    }

    /// Whether it runs until Ctrl-C.
    fn is_endless(&self) -> bool {
        self.forever || self.has_page()
    }

    /// Whether it uses maps instead of images and networks.
    fn uses_maps(&self) -> bool {
        self.maps || self.has_page() && !self.pictures && !self.given
    }
}

/// Runs the demo and prints its score.
pub(crate) fn main(args: &DemoArgs) -> ExitCode {
    start_log();
    exit_code(demo(args))
}

fn demo(args: &DemoArgs) -> Result<Ending, NodeError> {
    let script = DemoScript::choose(args).map_err(NodeError::Refused)?;
    let mut session = Session::open()?;
    // All rounds have the same page address: a page stays open from one to the next.
    let listeners = ListenerArgs {
        page_token: args.has_page().then(Token::random).flatten(),
        ..args.listeners.clone()
    };
    if !args.is_endless() {
        return show(args, &listeners, &script, 1, &mut session);
    }
    for round in 1.. {
        let script = script.for_round(round);
        if show(args, &listeners, &script, round, &mut session)? == Ending::Interrupted {
            break;
        }
    }
    Ok(Ending::Interrupted)
}

/// The results folder of a round, if the first has `out`.
fn out_of_round(out: &Path, round: u32) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    if round > 1 {
        name.push(format!("-{round}"));
    }
    name.into()
}

/// The recording of a round, if the first records to `file`. In a folder, recordings get different names anyway.
fn recording_of(file: &Path, round: u32) -> PathBuf {
    if is_for_many(file) {
        return file.to_owned();
    }
    let mut name =
        out_of_round(Path::new(file.file_stem().unwrap_or_default()), round).into_os_string();
    if let Some(ending) = file.extension() {
        name.push(".");
        name.push(ending);
    }
    file.with_file_name(name)
}

/// Plays `script` once as one `round` of many, and prints its score.
fn show(
    args: &DemoArgs,
    listeners: &ListenerArgs,
    script: &DemoScript,
    round: u32,
    session: &mut Session,
) -> Result<Ending, NodeError> {
    let out = args.out.as_deref().map(|out| out_of_round(out, round));
    let record = args.record.as_ref();
    let record = record.map(|it| it.as_deref().map(|file| recording_of(file, round)));
    let claim = FolderClaim::take(out.as_deref(), NAME).map_err(NodeError::Refused)?;
    let out = claim.folder();
    let (play, undo) = Play::stage(script, &out.join(VENUE)).map_err(NodeError::Failed)?;
    let (mut plan, networks) = run::check(RunArgs {
        live: args.has_page(),
        venue: play.venue.clone(),
        ticks: None,
        out: None,
        record,
        set: args.set.clone(),
        overlay: Some(args.overlay.clone().flatten()),
        listeners: listeners.clone(),
        strict: false,
        json: false,
    })?;
    undo.keep();
    plan.stage(out).map_err(NodeError::Failed)?;
    let backend = ImageBackend::measure(networks).map_err(NodeError::failed)?;
    let introduction = words::introduction(&play, &backend, out);
    output::print(&introduction).map_err(NodeError::Failed)?;
    let end = session.watch(&plan, out, &mut DemoTicker::new(&play))?;
    let done = run::done(out).map_err(NodeError::Failed)?;
    let Some(ticks) = done.filter(|ticks| !ticks.is_empty()) else {
        return run::finish(&plan, &claim, end, false);
    };
    let truth = out.join("truth.jsonl");
    venue_folder::write_truth(&play.scene, &ticks, &truth).map_err(NodeError::Failed)?;
    let ending = run::finish(&plan, &claim, end, false)?;
    if ending == Ending::Done {
        output::print(&words::images(out, &plan.overlay)).map_err(NodeError::Failed)?;
    }
    print_score(out, &truth, &ticks, play.scene.rate_hz()).map_err(NodeError::Failed)?;
    Ok(ending)
}

fn print_score(out: &Path, truth: &Path, ticks: &Range<Tick>, rate_hz: f64) -> anyhow::Result<()> {
    let text = score::table(&out.join("poses.jsonl"), truth, ticks, rate_hz)?;
    output::print(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_round_has_its_own_recording() {
        let file = Path::new("out/hall.v2.mcap");
        assert_eq!(recording_of(file, 1), file);
        assert_eq!(recording_of(file, 3), Path::new("out/hall.v2-3.mcap"));
        assert_eq!(recording_of(Path::new("hall"), 2), Path::new("hall-2"));
        let folder = recording_of(Path::new("recordings/"), 2);
        assert_eq!(folder.to_str(), Some("recordings/"));
    }

    #[test]
    fn each_round_has_its_own_folder() {
        let out = Path::new("a/b.c");
        assert_eq!(out_of_round(out, 1), Path::new("a/b.c"));
        assert_eq!(out_of_round(out, 2), Path::new("a/b.c-2"));
    }
}
