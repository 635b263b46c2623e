//! Outputs of fusion besides its recording: the live page, and streams in the protocols of other programs.
//!
//! Fusion knows neither; `farfield fusion` passes in a function that opens them. `farfield run` and `farfield demo`
//! pass the same options on to the fusion that they start.

mod names;
mod page;
pub(crate) mod page_access;
mod record_button;
mod replayed;
mod sheet;
mod streams;
mod thread;
pub(crate) mod view;
pub(crate) mod wanted;

use std::net::SocketAddr;
use std::path::Path;
use std::process::ExitCode;
use std::sync::{Arc, OnceLock};

use clap::Args;
use farfield_fusion_node::{
    FusionArgs, Listeners, OpenListeners, Opening, ReplayArgs, RunAtItsStart, Wiretap,
};
use farfield_node::process::{NodeError, exit_code, say};
use farfield_page::PageState;
use farfield_page::server::{HasKeys, Token};
use farfield_proto::transport::Identity;
use farfield_streams::StreamSpec;

use self::names::GivenNames;
use self::names::NamesTap;
use self::page::PageServer;
use self::page_access::page_address;
use self::replayed::ReplayListeners;
use self::streams::RunningStreams;
use self::thread::ServingThread;
use crate::overlay::TickList;

/// The outputs to open.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct ListenerArgs {
    /// Serve the live page.
    ///
    /// At <http://127.0.0.1:7460>, or at ADDRESS: an IP address and a port. At an address that other machines can
    /// reach, it uses fusion's certificate, and visitors need the token in the printed address.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true, value_parser = page_address)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with an address: clap's form"
    )]
    pub(crate) page: Option<Option<SocketAddr>>,
    /// Host name that browsers use for this machine, for the live page.
    #[arg(long, value_name = "NAME", requires = "page", hide_short_help = true)]
    pub(crate) page_name: Vec<String>,
    /// The token of the page for a started node; `None`: the node creates one.
    #[arg(skip)]
    pub(crate) page_token: Option<Token>,
    /// Stream poses: qtm, vmc, websocket, lsl, ...
    ///
    /// NAME is a protocol: qtm, vmc, websocket, foxglove, zenoh, ros2, psn or lsl. NAME=ADDRESS sends to an IP address,
    /// with or without a port; the default is this machine. These protocols have no keys: everyone who can reach the
    /// stream sees where people are. It replaces streams of the same protocol in the venue file (`[[stream]]`). See
    /// `docs/streams.md`.
    #[arg(long, value_name = "NAME")]
    pub(crate) stream: Vec<StreamSpec>,
}

impl ListenerArgs {
    /// Refuses a page that cannot be served at its address, before anything listens.
    ///
    /// # Errors
    /// Names the option.
    pub(crate) fn check_page(&self, keys: HasKeys) -> Result<(), NodeError> {
        match self.page {
            Some(address) => page::check_reach(address, &self.page_name, keys),
            None => Ok(()),
        }
    }

    /// The same options as words of a command line.
    pub(crate) fn words(&self) -> Vec<String> {
        let page = self.page.iter().map(|address| match address {
            Some(address) => format!("--page={address}"),
            None => "--page".to_owned(),
        });
        let names = self
            .page_name
            .iter()
            .map(|name| format!("--page-name={name}"));
        let streams = self.stream.iter().map(|spec| format!("--stream={spec}"));
        page.chain(names).chain(streams).collect()
    }
}

/// Arguments of `farfield fusion`.
#[derive(Debug, Args)]
pub(crate) struct FusionCommandArgs {
    #[command(flatten)]
    fusion: FusionArgs,
    #[command(flatten)]
    listeners: ListenerArgs,
}

/// Arguments of `farfield replay`.
#[derive(Debug, Args)]
pub(crate) struct ReplayCommandArgs {
    #[command(flatten)]
    replay: ReplayArgs,
    /// Draw skeletons over the images of these ticks.
    ///
    /// Numbers separated by commas; without a value, the middle tick. One image per camera; a plain one if the
    /// recording of a camera is missing. A Farfield recording contains no images: `--venue` sets the paths of the
    /// camera recordings.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: clap's form"
    )]
    overlay: Option<Option<TickList>>,
    #[command(flatten)]
    listeners: ListenerArgs,
}

/// Computes a recording again, with its outputs.
pub(crate) fn replay(args: ReplayCommandArgs) -> ExitCode {
    let (later, begun) = (Arc::new(OnceLock::new()), Arc::new(OnceLock::new()));
    let listeners = Box::new(ReplayListeners {
        listeners: args.listeners,
        later: Arc::clone(&later),
        begun: Arc::clone(&begun),
        drawn: args.overlay.clone().flatten(),
    });
    let code = farfield_fusion_node::replay(&args.replay, listeners, crate::output::print);
    if let Some(out) = later.get()
        && code == ExitCode::SUCCESS
        && let Err(error) = replayed::carry(&args.replay.file, out)
    {
        say(format_args!(
            "cannot transfer names and edits of the recording: {error:#}"
        ));
    }
    if let (Some(requested), Some(solved)) = (args.overlay, begun.get())
        && code == ExitCode::SUCCESS
        && let Err(error) = replayed::draw(requested, solved)
    {
        return exit_code(Err(error));
    }
    code
}

/// Runs a fusion node with its outputs.
pub(crate) fn fusion(args: FusionCommandArgs) -> ExitCode {
    farfield_fusion_node::main_with(args.fusion, Box::new(args.listeners))
}

impl OpenListeners for ListenerArgs {
    fn check(&self, identity: Option<&Identity>) -> Result<(), NodeError> {
        self.check_page(HasKeys::of(identity))
    }

    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_> {
        Box::pin(async move {
            let requested = wanted::streams(run.venue, &self.stream).map_err(NodeError::refused)?;
            // Streams of the venue file are only for live runs.
            let specs = if run.is_live { requested } else { self.stream };
            wanted::check_ros2(&specs, run.listens_at).map_err(NodeError::Refused)?;
            if self.page.is_none() && specs.is_empty() {
                return names_only(&run);
            }
            let is_looked_at = self.page.is_some();
            let given = GivenNames::of_run(run.out, run.restarts.map(Path::to_owned));
            let page = self
                .page
                .map(|address| page::PageOfRun::of(&run, address, &given));
            let page = page.transpose()?;
            let (names, token) = (self.page_name, page_access::token_of_this_node()?);
            let facts = streams::facts(&run);
            let open = move || async move {
                let (mut lines, mut served) = (Vec::new(), Served::default());
                if let Some(page) = page {
                    let (state, server) = page.serve(&names, token).await?;
                    lines.extend(server.lines.iter().cloned());
                    served.page = Some(state);
                    served.server = Some(server);
                }
                if !specs.is_empty() {
                    served.streams = Some(streams::start(&specs, facts, &mut lines).await?);
                }
                let streams = served.streams.as_ref().map(|it| Arc::clone(&it.streams));
                let taps = (served.page.clone(), streams);
                Ok(((lines, taps), served))
            };
            let (opened, thread) = ServingThread::start(open, Served::close).await?;
            let (lines, (page, streams)) = opened;
            if let Some(streams) = &streams {
                given.attach_streams(streams);
            }
            let mut wiretaps: Vec<Arc<dyn Wiretap>> =
                vec![Arc::new(NamesTap::start(run.venue, given)?)];
            if let Some(page) = page {
                let thread = Arc::clone(&thread);
                wiretaps.push(Arc::new(page::PageTap::new(run.venue, page, thread)));
            }
            if let Some(streams) = streams {
                wiretaps.push(Arc::new(streams::StreamTap::new(
                    run.venue, streams, thread,
                )));
            }
            Ok(Listeners {
                wiretaps,
                notices: lines,
                has_viewers: is_looked_at,
                is_real_time: true,
            })
        })
    }
}

/// Without page and streams, names of an earlier fusion are still kept for people with the same ids, and people are
/// named after the venue's subjects.
fn names_only(run: &RunAtItsStart<'_>) -> Result<Listeners, NodeError> {
    let has_subjects = !run.venue.subjects.is_empty();
    let saved = run.restarts.filter(|saved| has_subjects || saved.exists());
    let given = (has_subjects || saved.is_some())
        .then(|| GivenNames::of_run(run.out, saved.map(Path::to_owned)));
    let tap = given.map(|given| NamesTap::start(run.venue, given));
    let tap = tap
        .transpose()?
        .map(|tap| Arc::new(tap) as Arc<dyn Wiretap>);
    Ok(Listeners {
        wiretaps: tap.into_iter().collect(),
        ..Listeners::default()
    })
}

/// Everything that the serving thread owns until the end of the run.
#[derive(Default)]
struct Served {
    page: Option<Arc<PageState>>,
    server: Option<PageServer>,
    streams: Option<RunningStreams>,
}

impl Served {
    async fn close(self) {
        if let Some(server) = self.server {
            server.stop().await;
        }
        if let Some(streams) = self.streams {
            streams.stop().await;
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Line {
        #[command(flatten)]
        listeners: ListenerArgs,
    }

    fn parsed(words: &[&str]) -> Result<ListenerArgs, clap::Error> {
        let words = [&["fusion"], words].concat();
        Line::try_parse_from(words).map(|line| line.listeners)
    }

    #[test]
    fn options_survive_being_passed_on() {
        for words in [
            &[][..],
            &["--page"],
            &["--page=10.0.0.1:7460", "--page-name=hall.local"],
            &["--stream=qtm", "--stream=vmc=10.0.0.9:39539"],
        ] {
            let requested = parsed(words).unwrap();
            let passed_on = requested.words();
            let passed_on: Vec<&str> = passed_on.iter().map(String::as_str).collect();
            let again = parsed(&passed_on).unwrap();
            assert_eq!(again.page, requested.page);
            assert_eq!(again.page_name, requested.page_name);
            assert_eq!(again.stream, requested.stream);
        }
    }

    #[test]
    fn an_unknown_stream_is_refused_by_name() {
        let refused = parsed(&["--stream=natnet"]).unwrap_err();
        assert_eq!(refused.exit_code(), 2);
        assert!(refused.to_string().contains("natnet"), "{refused}");
    }
}
