//! Streams over Zenoh: poses as JSON on keys, and ROS 2 messages as `rmw_zenoh` expects them.
//!
//! Each stream has its own session, independent of the sessions of the venue's nodes. The JSON
//! stream is a peer that subscribers connect to. The ROS 2 stream is a client of the router that
//! ROS 2 nodes use, and waits for it. Scouting is off.
//!
//! Zenoh's calls may block and do not work on the runtime of the streams, so they run on a separate
//! thread. While it is busy, frames are skipped.

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
use crate::slot::{Counters, Feed, Shell};

/// Delay before trying to connect to a router again.
const AGAIN: Duration = Duration::from_secs(2);
/// Number of steps of this delay; each checks the stop signal.
const STEPS: u32 = 20;

/// A publisher on a session.
trait Publish {
    /// Publishes a frame.
    fn publish(&mut self, frame: &Frame) -> zenoh::Result<()>;

    /// Removes what would remain after the last frame.
    fn end(&mut self) -> zenoh::Result<()> {
        Ok(())
    }
}

/// Serves poses as JSON to clients that connect to `address`.
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
        // The caller may be gone if streams stop while starting.
        drop(opened.send(Ok(())));
        let publisher = json::Publisher::new(&session, &venue);
        publish(&session, publisher, frames, counters);
    })?;
    is_open.await.map_err(io::Error::other)??;
    Ok(address)
}

/// Sends ROS 2 messages to the router at `address`, as soon as it is available.
pub(crate) fn send_ros2(address: SocketAddr, shell: &Shell) -> io::Result<SocketAddr> {
    let config = config("client", "connect", address).map_err(as_io)?;
    run(shell, move |mut frames, counters| {
        let mut was_reported = false;
        let session = loop {
            match zenoh::open(config.clone()).wait() {
                Ok(session) => break session,
                Err(error) if !was_reported => {
                    was_reported = true;
                    counters.failed(format!("no router at {address} yet: {}", as_io(error)));
                }
                Err(_) => {}
            }
            for _ in 0..STEPS {
                // Drop frames that cannot be sent, and check the stop signal.
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

/// Runs `work` on its own thread, which receives the newest frame whenever it is ready, and none
/// after the stop.
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
    shell.spawn_until_done(async move {
        stop.run_until_cancelled(feed_thread(feed, sender)).await;
        // Closing waits for the network; on stop, this task is abandoned after the grace period.
        drop(is_done.await);
    });
    Ok(())
}

async fn feed_thread(mut feed: Feed, sender: mpsc::Sender<Arc<Frame>>) {
    // Reserve first, so that the frame is the newest one.
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

/// Clients may declare subscriptions and receive our publications; nothing of other clients is
/// forwarded.
const ONLY_SUBSCRIBERS: &str = r#"{
    enabled: true,
    default_permission: "deny",
    rules: [
        { id: "in", permission: "allow", flows: ["ingress"], messages: ["declare_subscriber"], key_exprs: ["**"] },
        { id: "out", permission: "allow", flows: ["egress"], messages: ["put", "delete"], key_exprs: ["farfield/**"] },
    ],
    subjects: [{ id: "all" }],
    policies: [{ rules: ["in", "out"], subjects: ["all"] }],
}"#;

/// Configuration of a session that only listens at, or connects to, one address.
fn config(mode: &str, direction: &str, address: SocketAddr) -> zenoh::Result<Config> {
    let mut config = Config::default();
    let endpoints = format!("[\"tcp/{address}\"]");
    for (key, value) in [
        ("mode", format!("\"{mode}\"").as_str()),
        (&format!("{direction}/endpoints"), &endpoints),
        ("scouting/multicast/enabled", "false"),
        ("scouting/gossip/enabled", "false"),
        // Clients only send subscriptions, so small limits are enough.
        ("transport/link/rx/max_message_size", "65536"),
        ("transport/unicast/max_sessions", "16"),
        ("transport/unicast/accept_pending", "16"),
    ] {
        config.insert_json5(key, value)?;
    }
    if direction == "connect" {
        config.insert_json5("listen/endpoints", "[]")?;
    } else {
        config.insert_json5("access_control", ONLY_SUBSCRIBERS)?;
    }
    Ok(config)
}

#[expect(clippy::needless_pass_by_value, reason = "what `map_err` takes")]
fn as_io(error: zenoh::Error) -> io::Error {
    io::Error::other(without_places(&error.to_string()))
}
