//! The page of a synthetic venue, for work on the page and for its tests: no fusion, camera or
//! network.
//!
//! `cargo run -p farfield-page --example synthetic_page -- [--people 8] [--port 7460] [--seconds N]
//! [--recording MINUTES | --replay]`

mod messages;
mod people;
mod venue;

use std::io::Write as _;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use farfield_page::protocol::status::RecordingState;
use farfield_page::{
    Action, ActionKind, CalibrationSheet, PageActions, PageOptions, PageState, Server,
    ServerOptions, ShownCalibration, qr,
};
use farfield_proto::key::Keys;
use farfield_proto::order_statistics::percentile;
use farfield_proto::tick::Tick;
use messages::{Synthetic, SyntheticRecording};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

type Failure = Box<dyn std::error::Error>;

/// Command line arguments.
struct Arguments {
    people: u32,
    port: u16,
    seconds: Option<u64>,
    recording_minutes: Option<u32>,
    /// Only the messages of a replay: people and events.
    is_replay: bool,
}

fn arguments() -> Result<Arguments, Failure> {
    let mut found = Arguments {
        people: 8,
        port: 7460,
        seconds: None,
        recording_minutes: None,
        is_replay: false,
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        if word == "--replay" {
            found.is_replay = true;
            continue;
        }
        let value = words
            .next()
            .ok_or_else(|| format!("{word} needs a number"))?;
        match word.as_str() {
            "--people" => found.people = value.parse()?,
            "--port" => found.port = value.parse()?,
            "--seconds" => found.seconds = Some(value.parse()?),
            "--recording" => found.recording_minutes = Some(value.parse()?),
            _ => {
                return Err(format!(
                    "{word}: expected --people, --port, --seconds, --recording or --replay"
                )
                .into());
            }
        }
    }
    Ok(found)
}

/// Accepts all actions and reports success.
#[derive(Default)]
struct FakeActions(OnceLock<Weak<PageState>>);

impl PageActions for FakeActions {
    fn kinds(&self) -> Vec<ActionKind> {
        vec![ActionKind::NamePerson, ActionKind::Record]
    }

    fn act(&self, action: &Action) -> Result<(), String> {
        let state = self
            .0
            .get()
            .and_then(Weak::upgrade)
            .ok_or("the page has gone")?;
        let (running, text) = match action {
            Action::NamePerson { .. } => return Ok(()),
            Action::StartRecording => (true, "synthetic_2026-03-01_18-30-05.mcap"),
            Action::StopRecording => (false, "synthetic_2026-03-01_18-30-05.mcap is whole"),
        };
        let since_us = SystemTime::now().duration_since(UNIX_EPOCH);
        let since_us = since_us.map(|at| at.as_micros()).map(i64::try_from);
        state.set_recording(Some(RecordingState {
            running,
            text: text.to_owned(),
            since_us: since_us.ok().and_then(Result::ok),
            bytes: Some(1 << 20),
        }));
        Ok(())
    }
}

/// A synthetic calibration sheet.
fn calibration() -> ShownCalibration {
    let html: &[u8] = include_bytes!("sheet.html");
    ShownCalibration {
        file: "calibration.toml".to_owned(),
        fingerprint: "0123456789abcdef".to_owned(),
        text: "The sheet belongs to the calibration in use.".to_owned(),
        sheet: Some(CalibrationSheet {
            file: "calibration.html".to_owned(),
            fingerprint: Some("0123456789abcdef".to_owned()),
            is_of_this: Some(true),
            html: html.into(),
        }),
    }
}

/// Feeds every tick at its time with the messages that `is_sent` accepts; records how long each
/// call takes.
async fn feed(
    state: Arc<PageState>,
    synthetic: Synthetic,
    is_sent: impl Fn(&str) -> bool,
    call_ns: &Mutex<Vec<u64>>,
) {
    let began = Instant::now();
    for tick in 1.. {
        let tick = Tick(tick);
        sleep_until(began + Duration::from_secs_f64(tick.seconds(venue::RATE_HZ))).await;
        let messages = synthetic.messages(tick).into_iter();
        for (key, bytes, at_us) in messages.filter(|(key, ..)| is_sent(key)) {
            let before = Instant::now();
            state.message(&key, &bytes, at_us);
            let took = u64::try_from(before.elapsed().as_nanos()).unwrap_or(u64::MAX);
            call_ns
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push(took);
        }
    }
}

/// Prints the durations of the calls to standard error.
fn print_durations(state: &PageState, call_ns: &Mutex<Vec<u64>>) {
    let mut took = std::mem::take(&mut *call_ns.lock().unwrap_or_else(PoisonError::into_inner));
    took.sort_unstable();
    let us = |share| percentile(&took, share).unwrap_or_default() as f64 / 1e3;
    eprintln!(
        "{} messages, each took {:.1} us (P50), {:.1} (P99), {:.1} (P99.9); {} dropped",
        took.len(),
        us(0.5),
        us(0.99),
        us(0.999),
        state.dropped()
    );
}

#[tokio::main]
async fn main() -> Result<(), Failure> {
    tracing_subscriber::fmt()
        .with_writer(std::io::stderr)
        .init();
    let arguments = arguments()?;
    let (mut venue, skeleton) = (venue::venue(), venue::skeleton());
    // The synthetic cameras have no images; the page must handle that without errors.
    venue.security.pictures = true;
    let keys = Keys::new(&venue.name);
    let epoch_us = i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH)?.as_micros())?;
    let synthetic = Synthetic::new(venue.clone(), arguments.people, epoch_us);
    let actions = Arc::new(FakeActions::default());
    let options = PageOptions {
        actions: Some(Arc::clone(&actions) as Arc<dyn PageActions>),
        calibration: calibration(),
        ..PageOptions::default()
    };
    let call_ns = Mutex::new(Vec::new());
    let mut feeding = None;
    let state = if let Some(minutes) = arguments.recording_minutes {
        let recording = SyntheticRecording::new(synthetic, i64::from(minutes) * 3600);
        PageState::recording(venue, skeleton, Box::new(recording), options)?
    } else {
        let state = if arguments.is_replay {
            PageState::replay(venue, skeleton, options)?
        } else {
            PageState::live(venue, skeleton, options)?
        };
        let of_replay = [keys.pose(), keys.event()];
        let is_sent =
            move |key: &str| !arguments.is_replay || of_replay.iter().any(|known| known == key);
        feeding = Some(feed(Arc::clone(&state), synthetic, is_sent, &call_ns));
        state
    };
    actions.0.get_or_init(|| Arc::downgrade(&state));
    let options = ServerOptions {
        address: SocketAddr::from(([127, 0, 0, 1], arguments.port)),
        ..ServerOptions::default()
    };
    let server = Server::bind(Arc::clone(&state), options).await?;
    let mut out = std::io::stdout();
    if let Some(code) = qr::terminal_code(&server.url()) {
        writeln!(out, "{code}")?;
    }
    writeln!(out, "{}", server.url())?;
    out.flush()?;
    let stop = CancellationToken::new();
    let serving = server.serve(stop.clone());
    let ending = async {
        match arguments.seconds {
            Some(s) => tokio::time::sleep(Duration::from_secs(s)).await,
            None => tokio::signal::ctrl_c().await.unwrap_or_default(),
        }
        stop.cancel();
    };
    let feeding = async {
        match feeding {
            Some(feeding) => feeding.await,
            None => std::future::pending().await,
        }
    };
    tokio::select! {
        () = async { tokio::join!(serving, ending); } => {}
        () = feeding => {}
    }
    print_durations(&state, &call_ns);
    Ok(())
}
