//! The live page of a run, and the page of a recording.

use std::f64::consts::TAU;
use std::net::SocketAddr;
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use farfield_fusion::body::skeleton::angles::{FIRST_JOINT_ANGLE, is_translation};
use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint, RangeOfMotion};
use farfield_fusion_node::{CopiedMessage, CopiedStep, RecordingsOnDemand, RunAtItsStart, Wiretap};
use farfield_node::process::NodeError;
use farfield_page::qr::terminal_code;
use farfield_page::server::{self, HasKeys, Keys, ServerError, Token};
use farfield_page::{
    Angle, AngleUnit, PageActions, PageOptions, PageState, Server, ServerOptions, Skeleton,
};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::transport::{FUSION, Identity};
use farfield_proto::venue::Venue;
use tokio_util::sync::{CancellationToken, DropGuard};
use tokio_util::task::TaskTracker;

use super::names::GivenNames;
use super::record_button::{self, Operator};
use super::sheet;
use super::thread::ServingThread;

/// A range of motion of at least this width is no limit, radians.
const FULL_CIRCLE_RAD: f64 = TAU - 1e-3;

/// The option for the address of a run's page.
pub(super) const PAGE: &str = "--page=";

/// Refuses an address of a run's page (`None`: the default) at which it cannot be served, before anything listens.
/// `names` are the host names that browsers use for this machine.
///
/// # Errors
/// Names the option.
pub(super) fn check_reach(
    address: Option<SocketAddr>,
    names: &[String],
    keys: HasKeys,
) -> Result<(), NodeError> {
    let address = address.unwrap_or_else(|| ServerOptions::default().address);
    server::check_reach(address, names, keys).map_err(|error| with_option(error, PAGE))
}

/// The error with the command line option that sets the address.
fn with_option(error: ServerError, option: &str) -> NodeError {
    match error {
        // The port may become free later; a service is restarted.
        ServerError::Listen { address, .. } => NodeError::Failed(anyhow!(
            "{error}: end the program that listens there, or use another address ({option}127.0.0.1:{})",
            address.port().wrapping_add(1)
        )),
        ServerError::NoKeys { address } => {
            NodeError::Refused(anyhow!("{option}{address}: {error}"))
        }
        ServerError::NoName { address } => {
            NodeError::Refused(anyhow!("{option}{address}: {error} (`--page-name NAME`)"))
        }
        error => NodeError::refused(error),
    }
}

/// A page that is served until this value is dropped.
pub(super) struct PageServer {
    /// Lines to print for the operator.
    pub(super) lines: Vec<String>,
    tasks: TaskTracker,
    stop: DropGuard,
}

impl PageServer {
    /// Serves `state` at `address` (`None`: the default), to browsers that use one of `names` for this machine.
    /// `option` is the command line option of the address. Without a token it creates one.
    ///
    /// # Errors
    /// Missing or wrong keys, an address that cannot be used.
    pub(super) async fn start(
        state: Arc<PageState>,
        option: &str,
        address: Option<SocketAddr>,
        names: &[String],
        (keys, token): (Option<Keys>, Option<Token>),
    ) -> Result<Self, NodeError> {
        let usual = ServerOptions::default();
        let address = address.unwrap_or(usual.address);
        let is_local = address.ip().is_loopback();
        let options = ServerOptions {
            address,
            names: names.to_vec(),
            keys: keys.filter(|_| !is_local),
            token,
        };
        let server = Server::bind(state, options).await;
        let server = server.map_err(|error| with_option(error, option))?;
        let url = server.url();
        let mut lines = vec![format!("the live page: {url}")];
        if !is_local && let Some(code) = terminal_code(&url) {
            lines.extend(code.lines().map(str::to_owned));
        }
        let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
        tasks.spawn(server.serve(stop.clone()));
        Ok(Self {
            lines,
            tasks,
            stop: stop.drop_guard(),
        })
    }

    /// Ends all connections and waits until they are closed.
    pub(super) async fn stop(self) {
        drop(self.stop);
        self.tasks.close();
        self.tasks.wait().await;
    }
}

/// The page of a run, before it is served.
pub(super) struct PageOfRun {
    state: Arc<PageState>,
    address: Option<SocketAddr>,
    keys: Option<Keys>,
    recordings: Option<Arc<RecordingsOnDemand>>,
}

impl PageOfRun {
    /// Reads the keys and starts the state of the page.
    pub(super) fn of(
        run: &RunAtItsStart<'_>,
        address: Option<SocketAddr>,
        names: &Arc<GivenNames>,
    ) -> Result<Self, NodeError> {
        let skeleton = page_skeleton(run.venue, run.keypoints);
        let mut actions = Arc::clone(names) as Arc<dyn PageActions>;
        if let Some(recordings) = run.recordings {
            actions = Arc::new(Operator {
                names: actions,
                recordings: Arc::clone(recordings),
            });
        }
        let options = PageOptions {
            actions: Some(actions),
            calibration: sheet::of_venue(run.venue),
            ..PageOptions::default()
        };
        let mut venue = run.venue.clone();
        // Edges send images only in live runs.
        venue.security.pictures &= run.is_live;
        let state = if run.replays.is_some() {
            PageState::replay(venue, skeleton, options)
        } else {
            PageState::live(venue, skeleton, options)
        };
        let state = state
            .context("starting the page's thread")
            .map_err(NodeError::Failed)?;
        names.attach_page(&state);
        let keys = run.identity.map(keys).transpose();
        Ok(Self {
            state,
            address,
            keys: keys.map_err(NodeError::Refused)?,
            recordings: run.recordings.cloned(),
        })
    }

    /// Serves the page to browsers that use one of `names` for this machine. Without a token it creates one.
    pub(super) async fn serve(
        self,
        names: &[String],
        token: Option<Token>,
    ) -> Result<(Arc<PageState>, PageServer), NodeError> {
        let state = Arc::clone(&self.state);
        let secrets = (self.keys, token);
        let server = PageServer::start(self.state, PAGE, self.address, names, secrets).await?;
        if let Some(recordings) = self.recordings {
            let report = record_button::report_state(recordings, Arc::downgrade(&state));
            let until = server.stop.token().clone();
            server.tasks.spawn(until.run_until_cancelled_owned(report));
        }
        Ok((state, server))
    }
}

/// Passes messages of fusion to the page.
pub(super) struct PageTap {
    state: Arc<PageState>,
    /// The key of fusion's own status.
    own_status: String,
    _thread: Arc<ServingThread>,
}

impl PageTap {
    pub(super) fn new(venue: &Venue, state: Arc<PageState>, thread: Arc<ServingThread>) -> Self {
        Self {
            state,
            own_status: farfield_proto::key::Keys::new(&venue.name).status(FUSION),
            _thread: thread,
        }
    }
}

impl Wiretap for PageTap {
    fn received(&self, message: CopiedMessage<'_>) {
        // Fusion's own status was shown when it was published, and is received again.
        if message.key != self.own_status {
            self.published(message);
        }
    }

    fn published(&self, message: CopiedMessage<'_>) {
        self.state
            .message(message.key, message.bytes, message.at_us);
    }

    fn decided(&self, _: CopiedStep<'_>) {}

    fn wants_thumbnails(&self) -> bool {
        true
    }

    fn thumbnail(&self, message: CopiedMessage<'_>) {
        self.state.thumbnail(message.bytes);
    }
}

/// The skeleton for the page: names of joints, keypoints and angles, and the tree of joints.
pub(super) fn page_skeleton(venue: &Venue, keypoints: &KeypointSet) -> Skeleton {
    let joints = Joint::ALL.map(|joint| {
        let parent = joint.parent().map(Joint::index);
        (joint.name().to_owned(), parent)
    });
    let parameters = &venue.parameters.range_of_motion;
    let ranges = parameters
        .enabled
        .then(|| RangeOfMotion::new(parameters.factor));
    let angles = ANGLE_NAMES.iter().enumerate().map(|(index, name)| {
        let range = ranges.as_ref().map(|ranges| ranges.reported_range(index));
        // Ranges of the root, and full circles, are only where a number wraps around.
        let is_joint = index >= FIRST_JOINT_ANGLE;
        let range = range.filter(|(lo, hi)| is_joint && hi - lo < FULL_CIRCLE_RAD);
        Angle {
            name: (*name).to_owned(),
            unit: if is_translation(index) {
                AngleUnit::Metres
            } else {
                AngleUnit::Radians
            },
            range: range.map(|(lo, hi)| [lo as f32, hi as f32]),
        }
    });
    Skeleton::of_tree(joints, keypoints.names().to_vec(), angles.collect())
}

/// Fusion's certificate and key, in the form for the page.
fn keys(identity: &Identity) -> anyhow::Result<Keys> {
    let read = |path: &std::path::Path| {
        std::fs::read(path).with_context(|| format!("reading {}", path.display()))
    };
    Ok(Keys {
        certificate_pem: read(&identity.certificate)?,
        key_pem: read(&identity.key)?,
    })
}
