//! `farfield view RECORDING`: shows a recording on the page.

use std::fs::File;
use std::io::BufReader;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::Context as _;
use clap::Args;
use farfield_fusion::pipeline::Pipeline;
use farfield_fusion::recording::messages::MessagesInTime;
use farfield_fusion_node::{open_recording, recorded_venue};
use farfield_node::log::start_log;
use farfield_node::process::{Ending, NodeError, exit_code, say};
use farfield_page::{PageActions, PageOptions, PageState, RecordedMessages};
use farfield_proto::id::SessionId;
use farfield_proto::tick::Micros;

use super::names::GivenNames;
use super::page::{PageServer, page_skeleton};
use super::page_access::{check_own_machine, page_address};
use super::sheet;
use crate::signals::Signals;

/// The option for the address of the page.
const AT: &str = "--at ";

/// Arguments of `farfield view`.
#[derive(Debug, Args)]
pub(crate) struct ViewArgs {
    /// The recording, an MCAP file.
    recording: PathBuf,
    /// Address of the page, on this machine only.
    ///
    /// A loopback address and a port; default: 127.0.0.1:7460.
    #[arg(long, value_name = "ADDRESS", value_parser = page_address)]
    at: Option<SocketAddr>,
    /// The sheet of the recording's calibration, written by `farfield calibrate`.
    ///
    /// Default: calibration.html next to the recording or in the folder `venue` next to it, if it belongs to that
    /// calibration.
    #[arg(long, value_name = "FILE")]
    sheet: Option<PathBuf>,
}

/// Serves the page of a recording until Ctrl-C.
pub(crate) fn main(args: &ViewArgs) -> ExitCode {
    start_log();
    exit_code(view(args))
}

fn view(args: &ViewArgs) -> Result<Ending, NodeError> {
    if let Some(at) = args.at {
        check_own_machine(AT, at, "a recording").map_err(NodeError::Refused)?;
    }
    let path = &args.recording;
    let state = state(path, args.sheet.as_deref()).map_err(NodeError::Refused)?;
    farfield_node::runtime::block_on(2, async {
        let mut signals = Signals::catch()
            .context("catching signals")
            .map_err(NodeError::Failed)?;
        let server = PageServer::start(state, AT, args.at, &[], (None, None)).await?;
        for line in &server.lines {
            say(format_args!("{line}"));
        }
        say(format_args!("press Ctrl-C to stop"));
        signals.next().await;
        server.stop().await;
        Ok(Ending::Done)
    })
}

/// The state of the page of the recording at `path`.
fn state(path: &Path, given_sheet: Option<&Path>) -> anyhow::Result<Arc<PageState>> {
    let shown = path.display();
    let file = open_recording(path)?;
    let messages = MessagesInTime::open(BufReader::new(file));
    let messages = messages.with_context(|| format!("reading {shown}"))?;
    let span_us = messages
        .span_us()
        .with_context(|| format!("{shown}: found no messages, expected a recording of a run"))?;
    let (venue, card) = recorded_venue(path, messages.attached())?;
    let pipeline = Pipeline::new(&venue, card.as_ref(), SessionId(0));
    let skeleton = page_skeleton(&venue, pipeline.keypoints());
    let recorded = Recorded {
        messages,
        span_us,
        path: path.to_owned(),
    };
    let names = GivenNames::of_recording(path)?;
    let calibration = match given_sheet {
        Some(given) => sheet::given(given, &venue)?,
        None => sheet::of_venue(&venue),
    };
    let options = PageOptions {
        calibration,
        actions: Some(Arc::clone(&names) as Arc<dyn PageActions>),
        ..PageOptions::default()
    };
    let state = PageState::recording(venue, skeleton, Box::new(recorded), options);
    let state = state.context("starting the page's thread")?;
    names.attach_page(&state);
    Ok(state)
}

/// A recording in the form for the page.
struct Recorded {
    messages: MessagesInTime<BufReader<File>>,
    span_us: [Micros; 2],
    path: PathBuf,
}

impl RecordedMessages for Recorded {
    fn span_us(&self) -> [Micros; 2] {
        self.span_us
    }

    fn read(
        &mut self,
        from_us: Micros,
        to_us: Micros,
        visit: &mut dyn FnMut(&str, &[u8], Micros),
    ) -> Result<(), String> {
        let read = self.messages.read(from_us..to_us, visit);
        read.map_err(|error| format!("{}: {error}", self.path.display()))
    }
}
