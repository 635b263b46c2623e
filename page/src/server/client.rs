//! One client: its playback position, its selection, and a loop that sends new data and handles
//! requests.
//!
//! Ticks are never queued: each is taken from the newest-value slot, or from the past, when there
//! is room to send.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use farfield_proto::id::CameraIndex;
use farfield_proto::tick::Tick;
use futures_util::{SinkExt as _, StreamExt as _};
use tokio::sync::watch;
use tokio::time::{Instant, Interval, MissedTickBehavior, interval, sleep_until, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::Serving;
use super::flow::{Allowance, Flow};
use crate::playback::Cursor;
use crate::protocol::request::{Action, Command, RequestError, parse};
use crate::protocol::text::{ActionKind, EventLine, Playback, TextMessage};
use crate::state::Shared;
use crate::state::known::frame::SharedFrame;
use crate::state::past::Lookup;

/// Number of events sent to a new client.
const FIRST_EVENTS: usize = 200;
/// Interval for checking a tick that is being loaded.
const LOADING: Duration = Duration::from_millis(50);
/// Maximum rate of ticks of the past, per second.
const MAX_PAST_HZ: f64 = 100.0;

/// Encoding of ticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// Binary messages, kinds 1 to 3.
    Binary,
    /// JSON.
    Json,
}

/// The next thing to do.
enum Next {
    Stop,
    Received(Option<Result<Message, axum::Error>>),
    Newest,
    Past,
    Status,
    Events,
    Names,
    Second,
}

/// One client.
pub(super) struct Client {
    shared: Arc<Shared>,
    tasks: TaskTracker,
    stop: CancellationToken,
    form: Form,
    may_act: bool,
    began: Instant,
    cursor: Cursor,
    camera: Option<CameraIndex>,
    persons: Vec<u32>,
    angles: Vec<u16>,
    most_hz: Option<f64>,
    /// Session and number of the last sent tick, and whether it was live.
    sent: Option<(u32, Tick, bool)>,
    /// Whether that tick must be sent again because the selection changed.
    is_due_again: bool,
    /// With [`Self::most_hz`], no tick before this one is sent.
    due_tick: f64,
    /// Time of the next lookup of a past tick.
    lookup_at: Option<Instant>,
    is_loading: bool,
    sent_status: Option<Arc<str>>,
    sent_events: u64,
    sent_playback: Option<Playback>,
    flow: Flow,
    allowance: Allowance,
    newest: watch::Receiver<Option<SharedFrame>>,
    status: watch::Receiver<Arc<str>>,
    names: watch::Receiver<Arc<BTreeMap<u32, String>>>,
    events: watch::Receiver<u64>,
}

impl Client {
    pub(super) fn new(serving: &Serving, may_act: bool, form: Form) -> Self {
        let shared = Arc::clone(serving.state.shared());
        shared.clients.fetch_add(1, Ordering::Relaxed);
        let is_fed = shared.mode.is_fed();
        Self {
            tasks: serving.tasks.clone(),
            stop: serving.stop.clone(),
            form,
            may_act,
            began: Instant::now(),
            cursor: Cursor::live(shared.context.venue.rate_hz),
            camera: None,
            persons: Vec::new(),
            angles: Vec::new(),
            most_hz: None,
            sent: None,
            is_due_again: false,
            due_tick: f64::NEG_INFINITY,
            lookup_at: (!is_fed).then(Instant::now),
            is_loading: !is_fed,
            sent_status: None,
            sent_events: 0,
            sent_playback: None,
            flow: Flow::new(Duration::ZERO),
            allowance: Allowance::new(Duration::ZERO),
            newest: shared.newest.subscribe(),
            status: shared.status.subscribe(),
            names: shared.names.subscribe(),
            events: shared.events.watch(),
            shared,
        }
    }

    /// Runs until the client leaves or the server stops.
    pub(super) async fn run(mut self, mut socket: WebSocket) {
        if self.greet(&mut socket).await.is_ok() {
            let mut second = interval(Duration::from_secs(1));
            second.set_missed_tick_behavior(MissedTickBehavior::Delay);
            while let Ok(()) = self.step(&mut socket, &mut second).await {}
        }
    }

    fn now(&self) -> Duration {
        self.began.elapsed()
    }

    async fn greet(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        let hello = TextMessage::hello(self.shared.mode, self.may_act, &self.shared.kinds);
        text(socket, hello.to_json()).await?;
        if !self.shared.mode.is_fed() {
            // Starts at the beginning, as soon as it is known.
            self.cursor.play(Tick(i64::MIN), self.now(), 1.0, None);
        }
        self.newest.mark_changed();
        self.send_names(socket).await?;
        self.send_events(socket).await?;
        let status = Arc::clone(&self.status.borrow_and_update());
        self.send_status(socket, status).await
    }

    async fn step(&mut self, socket: &mut WebSocket, second: &mut Interval) -> Result<(), Closed> {
        let is_live = self.cursor.is_live();
        let lookup_at = self.lookup_at;
        let next = tokio::select! {
            biased;
            () = self.stop.cancelled() => Next::Stop,
            received = socket.next() => Next::Received(received),
            _ = second.tick() => Next::Second,
            Ok(()) = self.names.changed() => Next::Names,
            Ok(()) = self.events.changed() => Next::Events,
            Ok(()) = self.status.changed(), if is_live => Next::Status,
            Ok(()) = self.newest.changed(), if is_live && self.flow.has_room() => Next::Newest,
            () = sleep_until(lookup_at.unwrap_or_else(Instant::now)), if lookup_at.is_some() && self.flow.has_room() => Next::Past,
        };
        match next {
            Next::Stop => close(socket, close_code::AWAY, "the server stops").await,
            Next::Received(received) => self.receive(socket, received).await,
            Next::Newest => self.send_newest(socket).await,
            Next::Past => self.send_past(socket).await,
            Next::Status => {
                let status = Arc::clone(&self.status.borrow_and_update());
                self.send_status(socket, status).await
            }
            Next::Events => self.send_events(socket).await,
            Next::Names => self.send_names(socket).await,
            Next::Second => self.each_second(socket).await,
        }
    }

    async fn each_second(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        let now = self.now();
        if self.flow.is_gone(now) {
            return Err(Closed);
        }
        if let Some(ping) = self.flow.due_ping(now) {
            send(socket, Message::Ping(ping.to_vec().into())).await?;
        }
        // Also if unchanged: a client that receives nothing cannot know that the server is alive.
        self.sent_playback = None;
        self.send_playback(socket).await
    }

    async fn receive(
        &mut self,
        socket: &mut WebSocket,
        received: Option<Result<Message, axum::Error>>,
    ) -> Result<(), Closed> {
        let text = match received {
            None | Some(Ok(Message::Close(_))) => return Err(Closed),
            Some(Err(_)) => {
                return close(socket, close_code::SIZE, "not a message of the protocol").await;
            }
            Some(Ok(Message::Pong(payload))) if self.flow.answered(&payload, self.now()) => {
                return Ok(());
            }
            // Pings, unexpected pongs and binary messages count as requests.
            Some(Ok(Message::Ping(_) | Message::Pong(_) | Message::Binary(_))) => None,
            Some(Ok(Message::Text(text))) => Some(text),
        };
        if !self.allowance.take(self.now()) {
            return close(socket, close_code::POLICY, "too many messages").await;
        }
        let Some(text) = text else {
            return Ok(());
        };
        match parse(&text) {
            Ok(request) => {
                let outcome = self.execute(request.command).await;
                if request.number.is_some() || outcome.is_err() {
                    answer(socket, request.number, outcome).await?;
                }
                self.send_playback(socket).await
            }
            Err(RequestError::TooLong { .. }) => {
                close(socket, close_code::SIZE, "the message is too long").await
            }
            Err(error) => answer(socket, None, Err(error.to_string())).await,
        }
    }

    async fn execute(&mut self, command: Command) -> Result<(), String> {
        let span = self.shared.past.span();
        let here = self
            .sent
            .map(|(_, tick, _)| tick)
            .or(span.map(|[_, last]| last));
        let nothing = "there are no ticks yet";
        let at = || here.ok_or(nothing);
        match command {
            Command::Live if self.shared.mode.is_fed() => {
                self.cursor.follow();
                self.newest.mark_changed();
                self.status.mark_changed();
            }
            Command::Live => {
                let [_, last] = span.ok_or(nothing)?;
                self.cursor.stay(last);
            }
            Command::Pause => self.cursor.stay(at()?),
            Command::Seek(tick) => {
                let [first, last] = span.ok_or(nothing)?;
                self.cursor.stay(tick.min(last).max(first));
            }
            Command::Step(ticks) => self.cursor.stay(at()? + ticks),
            Command::Play { speed, repeat } => self.cursor.play(at()?, self.now(), speed, repeat),
            Command::Camera(camera) => {
                let n = self.shared.context.venue.cameras.len();
                if let Some(camera) = camera.filter(|camera| usize::from(*camera) >= n) {
                    return Err(format!(
                        "there is no camera {camera}: the venue has {n}, counted from 0"
                    ));
                }
                self.camera = camera.map(CameraIndex);
                self.show_again();
            }
            Command::Angles { persons, angles } => {
                (self.persons, self.angles) = (persons, angles);
                self.show_again();
            }
            Command::Rate(hz) => {
                self.most_hz = hz;
                self.due_tick = f64::NEG_INFINITY;
            }
            Command::Act(action) => return self.act(action).await,
        }
        self.lookup_at = (!self.cursor.is_live()).then(Instant::now);
        Ok(())
    }

    /// The selection also applies to the current tick.
    fn show_again(&mut self) {
        self.is_due_again = !self.cursor.is_live();
    }

    async fn act(&self, action: Action) -> Result<(), String> {
        if !self.may_act {
            let what = match action.kind() {
                ActionKind::NamePerson => "naming people",
                ActionKind::Record => "recording",
            };
            return Err(format!("{what} needs the token of the page's address"));
        }
        let shared = Arc::clone(&self.shared);
        let acting = self.tasks.spawn_blocking(move || shared.act(&action));
        acting
            .await
            .map_err(|_| "the action failed unexpectedly".to_owned())?
    }

    /// Sends the newest tick if it is due.
    async fn send_newest(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        let Some(frame) = self.newest.borrow_and_update().clone() else {
            return Ok(());
        };
        let mark = (frame.session, frame.tick, true);
        if self.sent == Some(mark) {
            return Ok(());
        }
        if let Some(hz) = self.most_hz {
            let (tick, step) = (frame.tick.0 as f64, self.shared.context.venue.rate_hz / hz);
            // Starts again after a jump.
            let is_near = (self.due_tick - tick).abs() <= 2.0 * step + 1.0;
            if is_near && tick + 0.5 < self.due_tick {
                return Ok(());
            }
            self.due_tick = step + if is_near { self.due_tick } else { tick };
        }
        self.sent = Some(mark);
        let first = match self.form {
            Form::Binary => Message::Binary(frame.encoded.clone().into()),
            Form::Json => Message::Text(self.shared.live_json(&frame).to_string().into()),
        };
        self.send_tick(socket, &frame, first).await
    }

    /// Sends the past tick that is due.
    async fn send_past(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        let span = self.shared.past.span();
        let can_follow = self.shared.mode.is_fed();
        let now = self.now();
        let due = span.map(|span| (span, self.cursor.due(now, span, can_follow)));
        let Some(([first, _], due)) = due else {
            return self.wait_for_past(socket).await;
        };
        let Some(due) = due else {
            // Playback reached the newest tick.
            self.lookup_at = None;
            self.newest.mark_changed();
            self.status.mark_changed();
            return self.send_playback(socket).await;
        };
        if self.sent.is_none() && self.cursor.is_playing() && self.is_loading {
            // Playback starts when there is something to play.
            self.cursor.play(
                first.max(due),
                now,
                self.cursor.speed(),
                self.cursor.repeat(),
            );
        }
        let frame = match self.shared.past.at(due) {
            Lookup::Frame(frame) => frame,
            Lookup::Loading => return self.wait_for_past(socket).await,
            Lookup::Nothing => {
                self.lookup_at = None;
                return Ok(());
            }
        };
        self.is_loading = false;
        let least =
            Duration::from_secs_f64(1.0 / self.most_hz.unwrap_or(MAX_PAST_HZ).min(MAX_PAST_HZ));
        self.lookup_at = self
            .cursor
            .period()
            .map(|period| Instant::now() + period.max(least));
        let mark = (frame.session, frame.tick, false);
        let is_due_again = std::mem::take(&mut self.is_due_again);
        if is_due_again || self.sent != Some(mark) {
            self.sent = Some(mark);
            let first = match self.form {
                Form::Binary => Message::Binary(frame.as_history().into()),
                Form::Json => Message::Text(frame.json(false).into()),
            };
            self.send_tick(socket, &frame, first).await?;
        }
        match self.shared.past.status_at(frame.tick) {
            Some(status) => self.send_status(socket, status).await,
            None => Ok(()),
        }
    }

    async fn wait_for_past(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        self.lookup_at = Some(Instant::now() + LOADING);
        if !std::mem::replace(&mut self.is_loading, true) {
            self.send_playback(socket).await?;
        }
        Ok(())
    }

    async fn send_tick(
        &mut self,
        socket: &mut WebSocket,
        frame: &SharedFrame,
        first: Message,
    ) -> Result<(), Closed> {
        feed(socket, first).await?;
        if self.form == Form::Binary {
            let camera = self
                .camera
                .and_then(|camera| frame.camera_view(&self.shared.context, camera));
            if let Some(view) = camera {
                feed(socket, Message::Binary(view.into())).await?;
            }
            if !self.persons.is_empty() && !self.angles.is_empty() {
                let chosen = frame.chosen_angles(&self.persons, &self.angles);
                feed(socket, Message::Binary(chosen.into())).await?;
            }
        }
        if let Some(ping) = self.flow.sent_tick(self.began.elapsed()) {
            feed(socket, Message::Ping(ping.to_vec().into())).await?;
        }
        in_time(socket.flush()).await
    }

    async fn send_names(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        let names = Arc::clone(&self.names.borrow_and_update());
        text(socket, TextMessage::Names { names: &names }.to_json()).await
    }

    async fn send_events(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        self.events.borrow_and_update();
        let (lines, sent) = self.shared.events.after(self.sent_events, FIRST_EVENTS);
        self.sent_events = sent;
        if lines.is_empty() {
            return Ok(());
        }
        let events: Vec<&EventLine> = lines.iter().map(AsRef::as_ref).collect();
        text(socket, TextMessage::Events { events }.to_json()).await
    }

    async fn send_status(
        &mut self,
        socket: &mut WebSocket,
        status: Arc<str>,
    ) -> Result<(), Closed> {
        let is_sent = self
            .sent_status
            .as_ref()
            .is_some_and(|sent| Arc::ptr_eq(sent, &status));
        if is_sent || status.is_empty() {
            return Ok(());
        }
        let json = status.to_string();
        self.sent_status = Some(status);
        text(socket, json).await
    }

    /// Sends the playback position if it changed.
    async fn send_playback(&mut self, socket: &mut WebSocket) -> Result<(), Closed> {
        let span = self.shared.past.span();
        let playback = Playback {
            state: self.cursor.state(),
            tick: self.sent.map(|(_, tick, _)| tick),
            speed: self.cursor.speed(),
            repeat: self.cursor.repeat(),
            first: span.map(|[first, _]| first),
            last: span.map(|[_, last]| last),
            loading: self.is_loading || self.shared.past.is_loading(),
        };
        if self.sent_playback == Some(playback) {
            return Ok(());
        }
        self.sent_playback = Some(playback);
        text(socket, TextMessage::Playback(playback).to_json()).await
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        self.shared.clients.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Maximum time for a client to accept a message.
const SEND_TIME: Duration = Duration::from_secs(30);

/// The connection is over.
struct Closed;

/// Awaits a send operation with a time limit.
async fn in_time<T>(sending: impl Future<Output = Result<T, axum::Error>>) -> Result<T, Closed> {
    match timeout(SEND_TIME, sending).await {
        Ok(Ok(sent)) => Ok(sent),
        Ok(Err(_)) | Err(_) => Err(Closed),
    }
}

async fn send(socket: &mut WebSocket, message: Message) -> Result<(), Closed> {
    in_time(socket.send(message)).await
}

async fn feed(socket: &mut WebSocket, message: Message) -> Result<(), Closed> {
    in_time(socket.feed(message)).await
}

async fn text(socket: &mut WebSocket, text: String) -> Result<(), Closed> {
    send(socket, Message::Text(text.into())).await
}

async fn answer(
    socket: &mut WebSocket,
    request: Option<u64>,
    outcome: Result<(), String>,
) -> Result<(), Closed> {
    text(socket, TextMessage::answer(request, outcome).to_json()).await
}

async fn close(socket: &mut WebSocket, code: u16, reason: &'static str) -> Result<(), Closed> {
    let frame = CloseFrame {
        code,
        reason: reason.into(),
    };
    send(socket, Message::Close(Some(frame))).await?;
    Err(Closed)
}
