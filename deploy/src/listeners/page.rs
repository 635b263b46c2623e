//! The live page of a run, and of a recording.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, OnceLock, PoisonError, Weak};

use anyhow::Context as _;
use farfield_fusion::body::skeleton::angles::is_translation;
use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint, RangeOfMotion};
use farfield_fusion::node::{CopiedMessage, CopiedStep, Listeners, RunAtItsStart, Wiretap};
use farfield_node::process::NodeError;
use farfield_page::qr::terminal_code;
use farfield_page::server::Keys;
use farfield_page::{
    Action, ActionKind, Angle, AngleUnit, PageActions, PageOptions, PageState, Server,
    ServerOptions, Skeleton,
};
use farfield_proto::keypoints::KeypointSet;
use farfield_proto::transport::Identity;
use farfield_proto::venue::Venue;
use tokio_util::sync::{CancellationToken, DropGuard};
use tokio_util::task::TaskTracker;

/// A page that is served until this is let go of.
pub(crate) struct PageServer {
    /// What the operator is told of it, a line each.
    pub(crate) said: Vec<String>,
    tasks: TaskTracker,
    stop: DropGuard,
}

impl PageServer {
    /// Serves `state` at `address` (`None`: the usual one), to browsers that call this machine by one of `names`.
    ///
    /// # Errors
    /// Keys that are missing or wrong, an address that cannot be had.
    pub(crate) async fn start(
        state: Arc<PageState>,
        (address, names): (Option<SocketAddr>, &[String]),
        identity: Option<&Identity>,
    ) -> Result<Self, NodeError> {
        let usual = ServerOptions::default();
        let address = address.unwrap_or(usual.address);
        let is_local = address.ip().is_loopback();
        let keys = identity.filter(|_| !is_local).map(keys).transpose();
        let options = ServerOptions {
            address,
            names: names.to_vec(),
            keys: keys.map_err(NodeError::Refused)?,
        };
        let server = Server::bind(state, options).await;
        let server = server.map_err(NodeError::refused)?;
        let url = server.url();
        let mut said = vec![format!("the live page: {url}")];
        if !is_local && let Some(code) = terminal_code(&url) {
            said.extend(code.lines().map(str::to_owned));
        }
        let (tasks, stop) = (TaskTracker::new(), CancellationToken::new());
        tasks.spawn(server.serve(stop.clone()));
        Ok(Self {
            said,
            tasks,
            stop: stop.drop_guard(),
        })
    }

    /// Tells those who look that it is over, and waits until they have left.
    pub(crate) async fn stop(self) {
        drop(self.stop);
        self.tasks.close();
        self.tasks.wait().await;
    }
}

/// Serves the page of a run.
pub(super) async fn listen(
    run: &RunAtItsStart<'_>,
    place: (Option<SocketAddr>, &[String]),
    listeners: &mut Listeners,
) -> Result<(), NodeError> {
    let skeleton = page_skeleton(run.venue, run.keypoints);
    let names = Arc::new(GivenNames::default());
    let options = PageOptions {
        actions: Some(Arc::clone(&names) as Arc<dyn PageActions>),
        ..PageOptions::default()
    };
    let state = PageState::live(run.venue.clone(), skeleton, options);
    let state = state
        .context("starting the page's thread")
        .map_err(NodeError::Failed)?;
    names.page.get_or_init(|| Arc::downgrade(&state));
    let server = PageServer::start(Arc::clone(&state), place, run.identity).await?;
    listeners.said.extend(server.said.iter().cloned());
    listeners.wiretaps.push(Arc::new(PageTap {
        state,
        _server: server,
    }));
    Ok(())
}

/// What people are called, for as long as the run lasts.
#[derive(Default)]
struct GivenNames {
    by_person: Mutex<BTreeMap<u32, String>>,
    page: OnceLock<Weak<PageState>>,
}

impl PageActions for GivenNames {
    fn kinds(&self) -> Vec<ActionKind> {
        vec![ActionKind::NamePerson]
    }

    fn act(&self, action: &Action) -> Result<(), String> {
        let Action::NamePerson { person, name } = action else {
            return Err("recordings are started with the run, by `--record`".to_owned());
        };
        // What a thread that died left is whole: it is one map.
        let by_person = self.by_person.lock();
        let mut by_person = by_person.unwrap_or_else(PoisonError::into_inner);
        if name.is_empty() {
            by_person.remove(person);
        } else {
            by_person.insert(*person, name.clone());
        }
        if let Some(page) = self.page.get().and_then(Weak::upgrade) {
            page.set_names(by_person.clone());
        }
        Ok(())
    }
}

/// Gives the page what passes.
struct PageTap {
    state: Arc<PageState>,
    _server: PageServer,
}

impl Wiretap for PageTap {
    fn received(&self, message: CopiedMessage<'_>) {
        self.state
            .message(message.key, message.bytes, message.at_us);
    }

    fn published(&self, message: CopiedMessage<'_>) {
        self.received(message);
    }

    fn decided(&self, _: CopiedStep<'_>) {}
}

/// The bodies of poses, for the page: names of joints, keypoints and angles, what hangs from what.
pub(crate) fn page_skeleton(venue: &Venue, keypoints: &KeypointSet) -> Skeleton {
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
        let range = range.filter(|(lo, hi)| lo.is_finite() && hi.is_finite());
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

/// Fusion's certificate and key, as the page needs them.
fn keys(identity: &Identity) -> anyhow::Result<Keys> {
    let read = |path: &std::path::Path| {
        std::fs::read(path).with_context(|| format!("reading {}", path.display()))
    };
    Ok(Keys {
        certificate_pem: read(&identity.certificate)?,
        key_pem: read(&identity.key)?,
    })
}
