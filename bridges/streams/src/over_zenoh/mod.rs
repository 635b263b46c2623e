//! Streams over Zenoh: poses as JSON on a key, and ROS 2's messages as `rmw_zenoh` expects them.
//!
//! Each has a session of its own, which has nothing to do with that of the venue's nodes: neither
//! its keys nor its links. The stream of JSON is a peer that subscribers connect to; that of ROS 2
//! is a client of the router that ROS 2's nodes connect to, and waits for it. Nothing is scouted
//! for.
//!
//! Zenoh's calls may wait, and do not work on the runtime of the streams: they have a thread. Where
//! it is slow, frames are skipped.

mod json;
mod ros2;

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use farfield_proto::transport::without_places;
use tokio::sync::mpsc::error::TryRecvError;
use tokio::sync::{mpsc, oneshot};
use zenoh::{Config, Session, Wait as _};

use crate::frame::Frame;
use crate::shell::Shell;
use crate::slot::{Counters, Feed};

/// How long to wait for a router before asking again.
const AGAIN: Duration = Duration::from_secs(2);
/// In so many steps, each of which hears the word to stop.
const STEPS: u32 = 20;

/// What is published on a session.
trait Publish {
    /// Publishes a frame.
    fn publish(&mut self, frame: &Frame) -> zenoh::Result<()>;

    /// Takes back what would stay after the last frame.
    fn end(&mut self) -> zenoh::Result<()> {
        Ok(())
    }
}

/// Serves poses as JSON to who connects to `address`.
pub(crate) async fn serve_json(
    address: SocketAddr,
    venue: &str,
    shell: &Shell,
) -> io::Result<SocketAddr> {
    let config = config("peer", "listen", address).map_err(as_io)?;
    let (opened, is_open) = oneshot::channel();
    let venue = venue.to_owned();
    run(shell, move |frames, counters| {
        let session = match zenoh::open(config).wait() {
            Ok(session) => session,
            Err(error) => {
                drop(opened.send(Err(as_io(error))));
                return;
            }
        };
        // Who asked is gone where streams end as they begin.
        drop(opened.send(Ok(())));
        let publisher = json::Publisher::new(&session, &venue);
        publish(&session, publisher, frames, counters);
    })?;
    is_open.await.map_err(io::Error::other)??;
    Ok(address)
}

/// Sends ROS 2's messages to the router at `address`, as soon as it is there.
pub(crate) fn send_ros2(address: SocketAddr, shell: &Shell) -> io::Result<SocketAddr> {
    let config = config("client", "connect", address).map_err(as_io)?;
    run(shell, move |mut frames, counters| {
        let mut was_said = false;
        let session = loop {
            match zenoh::open(config.clone()).wait() {
                Ok(session) => break session,
                Err(error) if !was_said => {
                    was_said = true;
                    counters.failed(format!("no router at {address} yet: {}", as_io(error)));
                }
                Err(_) => {}
            }
            for _ in 0..STEPS {
                // Frames that nobody can get; and the word to stop.
                if matches!(frames.try_recv(), Err(TryRecvError::Disconnected)) {
                    return;
                }
                std::thread::sleep(AGAIN / STEPS);
            }
        };
        let publisher = ros2::Publisher::new(&session);
        publish(&session, publisher, frames, counters);
    })?;
    Ok(address)
}

/// Runs `work` on a thread of its own, which gets the newest frame whenever it can take one, and none when streams stop.
fn run(
    shell: &Shell,
    work: impl FnOnce(mpsc::Receiver<Arc<Frame>>, &Counters) + Send + 'static,
) -> io::Result<()> {
    let (sender, frames) = mpsc::channel(1);
    let (done, is_done) = oneshot::channel::<()>();
    let counters = Arc::clone(&shell.counters);
    let thread = std::thread::Builder::new().name("stream-zenoh".to_owned());
    thread.spawn(move || {
        work(frames, &counters);
        drop(done);
    })?;
    let (feed, stop) = (shell.feed.fresh(), shell.stop.clone());
    shell.spawn_to_its_end(async move {
        stop.run_until_cancelled(feed_thread(feed, sender)).await;
        // It says goodbye to others; who does not wait for that leaves it behind.
        drop(is_done.await);
    });
    Ok(())
}

async fn feed_thread(mut feed: Feed, sender: mpsc::Sender<Arc<Frame>>) {
    // Room first: the frame is then the newest.
    while let Ok(room) = sender.reserve().await {
        let Some(frame) = feed.next().await else {
            return;
        };
        room.send(frame);
    }
}

fn publish(
    session: &Session,
    publisher: zenoh::Result<impl Publish>,
    mut frames: mpsc::Receiver<Arc<Frame>>,
    counters: &Counters,
) {
    match publisher {
        Ok(mut publisher) => {
            while let Some(frame) = frames.blocking_recv() {
                match publisher.publish(&frame) {
                    Ok(()) => counters.sent(),
                    Err(error) => counters.failed(as_io(error).to_string()),
                }
            }
            if let Err(error) = publisher.end() {
                counters.failed(as_io(error).to_string());
            }
        }
        Err(error) => counters.failed(as_io(error).to_string()),
    }
    if let Err(error) = session.close().wait() {
        counters.failed(as_io(error).to_string());
    }
}

/// Those who connect say what they listen to, and get what we publish: nobody's poses are passed on but ours.
const ONLY_LISTENERS: &str = r#"{
    enabled: true,
    default_permission: "deny",
    rules: [
        { id: "in", permission: "allow", flows: ["ingress"], messages: ["declare_subscriber"], key_exprs: ["**"] },
        { id: "out", permission: "allow", flows: ["egress"], messages: ["put", "delete"], key_exprs: ["farfield/**"] },
    ],
    subjects: [{ id: "all" }],
    policies: [{ rules: ["in", "out"], subjects: ["all"] }],
}"#;

/// A session that does nothing but `listen` at, or `connect` to, one address.
fn config(mode: &str, way: &str, address: SocketAddr) -> zenoh::Result<Config> {
    let mut config = Config::default();
    let endpoints = format!("[\"tcp/{address}\"]");
    for (key, value) in [
        ("mode", format!("\"{mode}\"").as_str()),
        (&format!("{way}/endpoints"), &endpoints),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        // Whoever listens has nothing to say but what he wants.
        ("transport/link/rx/max_message_size", "65536"),
        ("transport/unicast/max_sessions", "16"),
        ("transport/unicast/accept_pending", "16"),
    ] {
        config.insert_json5(key, value)?;
    }
    if way == "connect" {
        config.insert_json5("listen/endpoints", "[]")?;
    } else {
        config.insert_json5("access_control", ONLY_LISTENERS)?;
    }
    Ok(config)
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
fn as_io(error: zenoh::Error) -> io::Error {
    io::Error::other(without_places(&error.to_string()))
}
