//! `farfield demo`: people on a court who do not exist, cameras that see them, and every node of a
//! venue around them, scored against the truth. Needs nothing beside the program.
//!
//! Check -> claim -> write the venue -> run it as `farfield run` does -> score.

mod live_error;
mod play;
mod score;
mod ticker;
mod words;

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use farfield_fusion::node::{FolderClaim, is_for_many};
use farfield_node::log::start_log;
use farfield_node::process::{Ending, NodeError, exit_code};
use farfield_page::server::Token;
use farfield_proto::tick::Tick;

use self::play::{DemoScript, Play};
use self::ticker::DemoTicker;
use self::words::PictureBackend;
use crate::listeners::ListenerArgs;
use crate::overlay::TickList;
use crate::run::{self, RunArgs, Session};
use crate::{output, venue_folder};

/// The folder of the simulated venue, in that of the results.
const VENUE: &str = "venue";
/// Name of the venue, and of the folders of results.
const NAME: &str = "demo";

/// Arguments of `farfield demo`.
#[derive(Debug, clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a switch of the command line"
)]
pub(crate) struct DemoArgs {
    /// How many ticks to run.
    ///
    /// Default: 300; 150 of pictures without ONNX Runtime, so that it takes about a minute there, too.
    #[arg(long, value_name = "N", conflicts_with_all = ["forever", "page"],
          value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) ticks: Option<u32>,
    /// Run until Ctrl-C.
    ///
    /// Every five minutes of the people's time they start anew, and with them the
    /// files: in `farfield-out/demo-N`, or DIR, DIR-2 and so on.
    #[arg(long)]
    pub(crate) forever: bool,
    /// No pictures and no network: many times faster.
    ///
    /// Maps are made from the truth, with the faults that networks have.
    #[arg(long)]
    pub(crate) maps: bool,
    /// With `--page`: pictures and networks in the place of maps.
    #[arg(
        long,
        requires = "page",
        conflicts_with = "maps",
        hide_short_help = true
    )]
    pub(crate) pictures: bool,
    /// Give the people by hand instead of finding them.
    #[arg(long, conflicts_with = "maps")]
    pub(crate) given: bool,
    /// Folder for the results.
    ///
    /// It must be empty or not there. Default: `farfield-out/demo-N`.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    /// Another scene than the court.
    #[arg(long, value_name = "FILE")]
    pub(crate) scene: Option<PathBuf>,
    /// Draw skeletons over the pictures of these ticks.
    ///
    /// Numbers with commas between. Without it, or without a tick, of the middle one. One picture per camera.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: how clap says it"
    )]
    pub(crate) overlay: Option<Option<TickList>>,
    /// Record, for `farfield replay`.
    ///
    /// As an MCAP file. Default: `recording.mcap` in the folder of the results.
    #[arg(long, value_name = "FILE", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with a file: how clap says it"
    )]
    pub(crate) record: Option<Option<PathBuf>>,
    /// Use another value of a parameter.
    ///
    /// See `farfield parameters`; for example `smoothing.cutoff_hz=3`.
    #[arg(long, value_name = "TABLE.FIELD=VALUE", hide_short_help = true)]
    pub(crate) set: Vec<String>,
    #[command(flatten)]
    pub(crate) listeners: ListenerArgs,
}

impl DemoArgs {
    /// Whether somebody looks on: then it runs live, from maps, until Ctrl-C.
    fn is_shown(&self) -> bool {
        self.listeners.page.is_some()
    }

    /// Whether it runs until Ctrl-C.
    fn is_endless(&self) -> bool {
        self.forever || self.is_shown()
    }

    /// Whether it does without pictures and networks.
    fn is_of_maps(&self) -> bool {
        self.maps || self.is_shown() && !self.pictures && !self.given
    }
}

/// Runs the demo and says how good it was.
pub(crate) fn main(args: &DemoArgs) -> ExitCode {
    start_log();
    exit_code(demo(args))
}

fn demo(args: &DemoArgs) -> Result<Ending, NodeError> {
    let script = DemoScript::choose(args).map_err(NodeError::Refused)?;
    let mut session = Session::open()?;
    // Who has the address of one round has that of all: a page goes on from one to the next.
    let listeners = ListenerArgs {
        page_token: args.is_shown().then(Token::random).flatten(),
        ..args.listeners.clone()
    };
    if !args.is_endless() {
        return show(args, &listeners, (&script, 1), &mut session);
    }
    for round in 1.. {
        let script = script.of_round(round);
        if show(args, &listeners, (&script, round), &mut session)? == Ending::Interrupted {
            break;
        }
    }
    Ok(Ending::Interrupted)
}

/// Where a round of many goes, when the first goes to `out`.
fn out_of(out: &Path, round: u32) -> PathBuf {
    let mut name = out.as_os_str().to_owned();
    if round > 1 {
        name.push(format!("-{round}"));
    }
    name.into()
}

/// Where a round of many records, when the first does to `file`; in a folder all have names of their own.
fn recording_of(file: &Path, round: u32) -> PathBuf {
    if is_for_many(file) {
        return file.to_owned();
    }
    let mut name = out_of(Path::new(file.file_stem().unwrap_or_default()), round).into_os_string();
    if let Some(ending) = file.extension() {
        name.push(".");
        name.push(ending);
    }
    file.with_file_name(name)
}

/// Plays `script` once, as one `round` of many, heard by `listeners`, and says how good it was.
fn show(
    args: &DemoArgs,
    listeners: &ListenerArgs,
    (script, round): (&DemoScript, u32),
    session: &mut Session,
) -> Result<Ending, NodeError> {
    let out = args.out.as_deref().map(|out| out_of(out, round));
    let record = args.record.as_ref();
    let record = record.map(|it| it.as_deref().map(|file| recording_of(file, round)));
    let claim = FolderClaim::take(out.as_deref(), NAME).map_err(NodeError::Refused)?;
    let out = claim.folder();
    let (play, undo) = Play::stage(script, &out.join(VENUE)).map_err(NodeError::Failed)?;
    let (mut plan, networks) = run::check(RunArgs {
        live: args.is_shown(),
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
    let backend = PictureBackend::of(networks).map_err(NodeError::failed)?;
    let words = words::beginning(&play, &backend, out);
    output::print(&words).map_err(NodeError::Failed)?;
    let end = session.watch(&plan, out, &mut DemoTicker::new(&play))?;
    let done = run::done(out).map_err(NodeError::Failed)?;
    let Some(ticks) = done.filter(|ticks| !ticks.is_empty()) else {
        return run::finish(&plan, &claim, end, false);
    };
    let truth = out.join("truth.jsonl");
    venue_folder::write_truth(&play.scene, &ticks, &truth).map_err(NodeError::Failed)?;
    let ending = run::finish(&plan, &claim, end, false)?;
    if ending == Ending::Done {
        output::print(&words::pictures(out, &plan.overlay)).map_err(NodeError::Failed)?;
    }
    tell_score(out, &truth, &ticks, play.scene.rate_hz()).map_err(NodeError::Failed)?;
    Ok(ending)
}

fn tell_score(out: &Path, truth: &Path, ticks: &Range<Tick>, rate_hz: f64) -> anyhow::Result<()> {
    let text = score::table(&out.join("poses.jsonl"), truth, ticks, rate_hz)?;
    output::print(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_round_records_to_a_file_of_its_own() {
        let file = Path::new("out/hall.v2.mcap");
        assert_eq!(recording_of(file, 1), file);
        assert_eq!(recording_of(file, 3), Path::new("out/hall.v2-3.mcap"));
        assert_eq!(recording_of(Path::new("hall"), 2), Path::new("hall-2"));
        let folder = recording_of(Path::new("recordings/"), 2);
        assert_eq!(folder.to_str(), Some("recordings/"));
    }

    #[test]
    fn every_round_has_a_folder_of_its_own() {
        let out = Path::new("a/b.c");
        assert_eq!(out_of(out, 1), Path::new("a/b.c"));
        assert_eq!(out_of(out, 2), Path::new("a/b.c-2"));
    }
}
