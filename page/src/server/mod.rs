//! HTTP and web sockets for pages: access rules and connections.
//!
//! On the loopback interface the server uses plain HTTP, and everyone on the machine may read.
//! Elsewhere it requires keys, and every request needs the token.

mod access;
mod assets;
mod clicking;
mod client;
mod flow;
mod listening;
mod routes;
mod series;
#[cfg(test)]
mod tests;

use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use tokio::sync::Semaphore;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::state::{PageState, lock};
use access::Access;
pub use access::Token;
pub use clicking::{Clicking, ClickingServer, Taken};
use flow::Allowance;
use listening::Listening;
pub use listening::{Keys, KeysError};

/// Maximum number of web sockets.
pub(crate) const MAX_CLIENTS: usize = 32;

/// Options of the server.
#[derive(Debug)]
pub struct ServerOptions {
    /// Listening address; port 0 selects a free one.
    pub address: SocketAddr,
    /// Names and addresses, other than the loopback ones, that browsers may use for the server:
    /// `hall.local`, `192.168.1.7`, `[fd00::7]`. The first one appears in the printed URL.
    pub names: Vec<String>,
    /// Certificate and key; required beyond the loopback interface.
    pub keys: Option<Keys>,
    /// The token; `None` creates a new one.
    pub token: Option<Token>,
}

impl Default for ServerOptions {
    /// Loopback, port 7460, no keys.
    fn default() -> Self {
        Self {
            address: SocketAddr::from(([127, 0, 0, 1], 7460)),
            names: Vec::new(),
            keys: None,
            token: None,
        }
    }
}

/// Whether keys for HTTPS exist.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HasKeys {
    /// There are.
    Yes,
    /// There are none.
    No,
}

impl HasKeys {
    /// From an optional value.
    pub fn of<T>(keys: Option<&T>) -> Self {
        if keys.is_some() { Self::Yes } else { Self::No }
    }
}

/// Rejects an address that cannot be served, without listening. `names` are those that browsers may
/// use for the server.
///
/// # Errors
/// [`ServerError::NoKeys`] beyond the loopback without keys; [`ServerError::NoName`] for all
/// addresses of a machine without a name.
pub fn check_reach(
    address: SocketAddr,
    names: &[String],
    keys: HasKeys,
) -> Result<(), ServerError> {
    if !address.ip().is_loopback() && keys == HasKeys::No {
        return Err(ServerError::NoKeys { address });
    }
    if address.ip().is_unspecified() && names.is_empty() {
        return Err(ServerError::NoName { address });
    }
    Ok(())
}

/// Why pages cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// Others could read the traffic.
    #[error(
        "the page at {address} could be reached from other machines, and there are no keys for HTTPS: make some with \
         `farfield certs`, or serve it at 127.0.0.1"
    )]
    NoKeys {
        /// The requested address.
        address: SocketAddr,
    },
    /// Browsers could not open the page.
    #[error(
        "the page at {address} listens at all addresses: name at least one by which browsers call this machine"
    )]
    NoName {
        /// The requested address.
        address: SocketAddr,
    },
    /// The keys are invalid.
    #[error(transparent)]
    Keys(#[from] KeysError),
    /// The address is not available.
    #[error("the page cannot listen at {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The error of the operating system.
        source: io::Error,
    },
    /// The system provides no random numbers.
    #[error("no token can be made: the system gives no random numbers")]
    NoRandomNumbers,
}

/// A bound server that is not serving yet.
pub struct Server {
    state: Arc<PageState>,
    listening: Listening,
    sheet_key: Arc<Token>,
}

impl Server {
    /// Binds the address, and creates a token if none is given.
    ///
    /// # Errors
    /// [`ServerError`] if keys are missing or invalid, or the address is not available.
    pub async fn bind(state: Arc<PageState>, options: ServerOptions) -> Result<Self, ServerError> {
        let listening = Listening::bind(options).await?;
        let sheet_key = Token::random().ok_or(ServerError::NoRandomNumbers)?;
        Ok(Self {
            state,
            listening,
            sheet_key: Arc::new(sheet_key),
        })
    }

    /// The bound address.
    pub fn address(&self) -> SocketAddr {
        self.listening.address()
    }

    /// The page's URL with the token, for the operator only.
    pub fn url(&self) -> String {
        self.listening.access().url()
    }

    /// The token.
    pub fn token(&self) -> &Token {
        self.listening.access().token()
    }

    /// Serves until `stop`; then notifies clients and gives them a moment to leave.
    pub async fn serve(self, stop: CancellationToken) {
        let tasks = TaskTracker::new();
        let serving = Serving {
            state: Arc::clone(&self.state),
            access: Arc::clone(self.listening.access()),
            sockets: Arc::new(Semaphore::new(MAX_CLIENTS)),
            series: SeriesAllowance::new(),
            sheet_key: Arc::clone(&self.sheet_key),
            tasks: tasks.clone(),
            stop: stop.clone(),
        };
        self.listening
            .serve(routes::router(serving), tasks, stop)
            .await;
    }
}

/// Shared state of all requests.
#[derive(Clone)]
pub(crate) struct Serving {
    pub(crate) state: Arc<PageState>,
    pub(crate) access: Arc<Access>,
    pub(crate) sockets: Arc<Semaphore>,
    pub(crate) series: SeriesAllowance,
    /// Key in the path of the calibration's sheet. Clients that may read receive it, since a
    /// browser sends no token when it opens a page.
    pub(crate) sheet_key: Arc<Token>,
    pub(crate) tasks: TaskTracker,
    pub(crate) stop: CancellationToken,
}

/// Rate limit of past angles for all clients together; a response covers thousands of ticks.
#[derive(Clone)]
pub(crate) struct SeriesAllowance {
    began: Instant,
    left: Arc<Mutex<Allowance>>,
}

impl SeriesAllowance {
    fn new() -> Self {
        Self {
            began: Instant::now(),
            left: Arc::new(Mutex::new(Allowance::new(Duration::ZERO))),
        }
    }

    /// Takes one; returns `false` if none is left.
    pub(crate) fn take(&self) -> bool {
        lock(&self.left).take(self.began.elapsed())
    }
}
