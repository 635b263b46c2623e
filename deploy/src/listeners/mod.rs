//! Who listens to fusion beside its recording: the live page, and streams in the protocols of other programs.
//!
//! Fusion knows neither; `farfield fusion` hands in what opens them. `farfield run` and `farfield demo` hand the same words on to
//! the fusion that they start.

pub(crate) mod address;
mod drawn;
mod names;
mod names_tap;
mod page;
pub(crate) mod page_token;
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
use farfield_fusion::node::{
    FusionArgs, Listeners, OpenListeners, Opening, ReplayArgs, RunAtItsStart, Wiretap,
};
use farfield_node::process::{NodeError, exit_code, say};
use farfield_page::PageState;
use farfield_page::server::{HasKeys, Token};
use farfield_proto::transport::Identity;
use farfield_streams::StreamSpec;

use self::address::page_address;
use self::names::GivenNames;
use self::names_tap::NamesTap;
use self::page::PageServer;
use self::replayed::ReplayListeners;
use self::streams::RunningStreams;
use self::thread::ServingThread;
use crate::overlay::TickList;

/// Who shall listen.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct ListenerArgs {
    /// Serve the live page.
    ///
    /// At <http://127.0.0.1:7460>, or at ADDRESS: an IP address and a port. Beyond this machine it is served with fusion's
    /// certificate, and who opens it needs the token of the address that is printed.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, require_equals = true, value_parser = page_address)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with an address: how clap says it"
    )]
    pub(crate) page: Option<Option<SocketAddr>>,
    /// A name by which browsers call this machine, for the live page.
    #[arg(long, value_name = "NAME", requires = "page", hide_short_help = true)]
    pub(crate) page_name: Vec<String>,
    /// The token of the page of a node that is started; `None`: the node makes one.
    #[arg(skip)]
    pub(crate) page_token: Option<Token>,
    /// Stream poses: qtm, vmc, websocket, lsl, ...
    ///
    /// qtm, vmc, websocket, foxglove, zenoh, ros2, psn or lsl: by the protocol of that name, to this machine or to ADDRESS: an IP
    /// address, with or without a port. Beyond this machine everybody who can reach it sees where people are: none of these
    /// protocols is given keys. Streams of that NAME in the venue file (`[[stream]]`) are left out then. See `docs/streams.md`.
    ///
    /// As NAME, or NAME=ADDRESS.
    #[arg(long, value_name = "NAME")]
    pub(crate) stream: Vec<StreamSpec>,
}

impl ListenerArgs {
    /// Refuses a page that cannot be served where it is asked for, before anything listens.
    ///
    /// # Errors
    /// Names the option.
    pub(crate) fn check_page(&self, keys: HasKeys) -> Result<(), NodeError> {
        match self.page {
            Some(address) => page::check_reach(address, &self.page_name, keys),
            None => Ok(()),
        }
    }

    /// The words of a command line that say the same.
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
    /// Draw skeletons over the pictures of these ticks.
    ///
    /// Numbers with commas between; without one, of the middle one. One picture per camera; a plain one where a camera's
    /// recording is not there: a recording of ours holds no pictures, `--venue` says where they are.
    #[arg(long, value_name = "TICKS", num_args = 0..=1, require_equals = true)]
    #[expect(
        clippy::option_option,
        reason = "absent, without and with ticks: how clap says it"
    )]
    overlay: Option<Option<TickList>>,
    #[command(flatten)]
    listeners: ListenerArgs,
}

/// Solves a recording again, heard by its listeners.
pub(crate) fn replay(args: ReplayCommandArgs) -> ExitCode {
    let (later, begun) = (Arc::new(OnceLock::new()), Arc::new(OnceLock::new()));
    let listeners = Box::new(ReplayListeners {
        listeners: args.listeners,
        later: Arc::clone(&later),
        begun: Arc::clone(&begun),
        drawn: args.overlay.clone().flatten(),
    });
    let code = farfield_fusion::node::replay(&args.replay, listeners, crate::output::print);
    if let Some(out) = later.get()
        && code == ExitCode::SUCCESS
        && let Err(error) = replayed::carry(&args.replay.file, out)
    {
        say(format_args!(
            "names and edits of the recording are not carried: {error:#}"
        ));
    }
    if let (Some(asked), Some(solved)) = (args.overlay, begun.get())
        && code == ExitCode::SUCCESS
        && let Err(error) = drawn::draw(asked, solved)
    {
        return exit_code(Err(error));
    }
    code
}

/// Runs a fusion node with its listeners.
pub(crate) fn fusion(args: FusionCommandArgs) -> ExitCode {
    farfield_fusion::node::main_with(args.fusion, Box::new(args.listeners))
}

impl OpenListeners for ListenerArgs {
    fn check(&self, identity: Option<&Identity>) -> Result<(), NodeError> {
        self.check_page(HasKeys::of(identity))
    }

    fn open(self: Box<Self>, run: RunAtItsStart<'_>) -> Opening<'_> {
        Box::pin(async move {
            let asked = wanted::streams(run.venue, &self.stream).map_err(NodeError::refused)?;
            // Those of the file are for what happens now.
            let specs = if run.is_live { asked } else { self.stream };
            wanted::check_ros2(&specs, run.listens_at).map_err(NodeError::Refused)?;
            if self.page.is_none() && specs.is_empty() {
                return names_alone(&run);
            }
            let is_looked_at = self.page.is_some();
            let given = GivenNames::of_run(run.out, run.restarts.map(Path::to_owned));
            let page = self
                .page
                .map(|address| page::PageOfRun::of(&run, address, &given));
            let page = page.transpose()?;
            let (names, token) = (self.page_name, page_token::of_this_node()?);
            let facts = streams::facts(&run);
            let open = move || async move {
                let (mut said, mut served) = (Vec::new(), Served::default());
                if let Some(page) = page {
                    let (state, server) = page.serve(&names, token).await?;
                    said.extend(server.said.iter().cloned());
                    served.page = Some(state);
                    served.server = Some(server);
                }
                if !specs.is_empty() {
                    served.streams = Some(streams::start(&specs, facts, &mut said).await?);
                }
                let streams = served.streams.as_ref().map(|it| Arc::clone(&it.streams));
                let taps = (served.page.clone(), streams);
                Ok(((said, taps), served))
            };
            let (opened, thread) = ServingThread::start(open, Served::close).await?;
            let (said, (page, streams)) = opened;
            if let Some(streams) = &streams {
                given.tell_streams(streams);
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
                notices: said,
                has_viewers: is_looked_at,
                is_real_time: true,
            })
        })
    }
}

/// Nobody listens, but names that an earlier fusion has left still go on, or are forgotten, with the ids; and people are called
/// as the venue's subjects.
fn names_alone(run: &RunAtItsStart<'_>) -> Result<Listeners, NodeError> {
    let has_subjects = !run.venue.subjects.is_empty();
    let kept = run.restarts.filter(|kept| has_subjects || kept.exists());
    let given = (has_subjects || kept.is_some())
        .then(|| GivenNames::of_run(run.out, kept.map(Path::to_owned)));
    let tap = given.map(|given| NamesTap::start(run.venue, given));
    let tap = tap
        .transpose()?
        .map(|tap| Arc::new(tap) as Arc<dyn Wiretap>);
    Ok(Listeners {
        wiretaps: tap.into_iter().collect(),
        ..Listeners::default()
    })
}

/// What the serving thread keeps until the run is over.
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
    fn what_a_run_hands_on_says_the_same() {
        for words in [
            &[][..],
            &["--page"],
            &["--page=10.0.0.1:7460", "--page-name=hall.local"],
            &["--stream=qtm", "--stream=vmc=10.0.0.9:39539"],
        ] {
            let asked = parsed(words).unwrap();
            let handed = asked.words();
            let handed: Vec<&str> = handed.iter().map(String::as_str).collect();
            let again = parsed(&handed).unwrap();
            assert_eq!(again.page, asked.page);
            assert_eq!(again.page_name, asked.page_name);
            assert_eq!(again.stream, asked.stream);
        }
    }

    #[test]
    fn a_stream_that_is_none_is_refused_by_name() {
        let refused = parsed(&["--stream=natnet"]).unwrap_err();
        assert_eq!(refused.exit_code(), 2);
        assert!(refused.to_string().contains("natnet"), "{refused}");
    }
}
