//! HTTP and web sockets for pages: who may ask what, and the connections.
//!
//! Bound to the loopback it speaks plain HTTP, and everybody on the machine may read. Beyond it there is no server without
//! keys, and nothing is told without the token.

mod access;
mod answers;
mod assets;
mod clicking;
mod client;
mod flow;
mod listening;
mod outgoing;
mod routes;
mod series;
#[cfg(test)]
mod tests;
mod tls;
mod token;

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
pub use clicking::{Clicking, ClickingServer, Taken};
use flow::Allowance;
use listening::Listening;
pub use tls::{Keys, KeysError};
pub use token::Token;

/// Most web sockets at once.
pub(crate) const MAX_CLIENTS: usize = 32;

/// Where and for whom pages are served.
#[derive(Debug)]
pub struct ServerOptions {
    /// Where it listens; port 0: a free one.
    pub address: SocketAddr,
    /// Names and addresses, beside those of the loopback, by which browsers may call the server: `hall.local`,
    /// `192.168.1.7`, `[fd00::7]`. The first is the one in the address that is printed.
    pub names: Vec<String>,
    /// Certificate and key; needed beyond the loopback.
    pub keys: Option<Keys>,
    /// What says that somebody has the address; `None`: a token that is made anew.
    pub token: Option<Token>,
}

impl Default for ServerOptions {
    /// On the loopback, port 7460, without keys.
    fn default() -> Self {
        Self {
            address: SocketAddr::from(([127, 0, 0, 1], 7460)),
            names: Vec::new(),
            keys: None,
            token: None,
        }
    }
}

/// Whether there are keys for HTTPS.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HasKeys {
    /// There are.
    Yes,
    /// There are none.
    No,
}

impl HasKeys {
    /// Whether these are there.
    pub fn of<T>(keys: Option<&T>) -> Self {
        if keys.is_some() { Self::Yes } else { Self::No }
    }
}

/// Refuses an address at which nothing can be served, without listening there: `names` are those by which browsers may call the
/// server.
///
/// # Errors
/// [`ServerError::NoKeys`] beyond the loopback without keys, [`ServerError::NoName`] for all addresses of a machine that has no name.
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
    /// Others could read what goes over the network.
    #[error(
        "the page at {address} could be reached from other machines, and there are no keys for HTTPS: make some with \
         `farfield certs`, or serve it at 127.0.0.1"
    )]
    NoKeys {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// Nobody could open the page.
    #[error(
        "the page at {address} listens at all addresses: name at least one by which browsers call this machine"
    )]
    NoName {
        /// Where it was to listen.
        address: SocketAddr,
    },
    /// The keys are no keys.
    #[error(transparent)]
    Keys(#[from] KeysError),
    /// The address cannot be had.
    #[error("the page cannot listen at {address}: {source}")]
    Listen {
        /// Where.
        address: SocketAddr,
        /// What the system says.
        source: io::Error,
    },
    /// The system has no random numbers.
    #[error("no token can be made: the system gives no random numbers")]
    NoRandomNumbers,
}

/// A server that listens, and serves when it is asked to.
pub struct Server {
    state: Arc<PageState>,
    listening: Listening,
    sheet_key: Arc<Token>,
}

impl Server {
    /// Listens, and makes a token where none is given.
    ///
    /// # Errors
    /// [`ServerError`]: keys that are missing or wrong, an address that cannot be had.
    pub async fn bind(state: Arc<PageState>, options: ServerOptions) -> Result<Self, ServerError> {
        let listening = Listening::bind(options).await?;
        let sheet_key = Token::random().ok_or(ServerError::NoRandomNumbers)?;
        Ok(Self {
            state,
            listening,
            sheet_key: Arc::new(sheet_key),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.listening.address()
    }

    /// The address of the page, with the token: for the operator alone.
    pub fn url(&self) -> String {
        self.listening.access().url()
    }

    /// The token.
    pub fn token(&self) -> &Token {
        self.listening.access().token()
    }

    /// Serves until `stop`; then clients are told, and have a moment to leave.
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

/// What every request needs.
#[derive(Clone)]
pub(crate) struct Serving {
    pub(crate) state: Arc<PageState>,
    pub(crate) access: Arc<Access>,
    pub(crate) sockets: Arc<Semaphore>,
    pub(crate) series: SeriesAllowance,
    /// Under which key the sheet of the calibration is: told to who may read, because a browser says no token where it opens a page.
    pub(crate) sheet_key: Arc<Token>,
    pub(crate) tasks: TaskTracker,
    pub(crate) stop: CancellationToken,
}

/// How often the past of angles may be asked for, by all clients together: an answer goes through thousands of ticks.
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

    /// Takes one; `false`: there was none left.
    pub(crate) fn take(&self) -> bool {
        lock(&self.left).take(self.began.elapsed())
    }
}
