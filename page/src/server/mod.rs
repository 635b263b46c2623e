//! HTTP and web sockets for pages: who may ask what, and the connections.
//!
//! Bound to the loopback it speaks plain HTTP, and everybody on the machine may read. Beyond it there is no server without
//! keys, and nothing is told without the token.

mod access;
mod assets;
mod client;
mod flow;
mod outgoing;
mod routes;
mod series;
#[cfg(test)]
mod tests;
mod tls;
mod token;

use std::io;
use std::net::SocketAddr;
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{Instant, sleep, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};

use crate::state::{PageState, lock};
use access::Access;
use flow::Allowance;
pub use tls::{Keys, KeysError};
pub use token::Token;

/// Most connections at once: a browser opens six for one page.
const MAX_CONNECTIONS: usize = 128;
/// Most web sockets at once.
pub(crate) const MAX_CLIENTS: usize = 32;
/// How long a request's head, or a TLS handshake, may take.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// How long a connection is asked for more; a web socket is no request, and goes on.
const CONNECTION_TIME: Duration = Duration::from_mins(1);
/// How long an answer may take that is under way then: its client may read slowly, or not at all.
const ANSWER_TIME: Duration = Duration::from_secs(30);
/// Longest head of a request, bytes.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// After the system had no connection to give (too many files are open), it is asked again so much later.
const ACCEPT_REST: Duration = Duration::from_millis(100);
/// How long clients may take to leave when the server stops.
const LEAVE_TIME: Duration = Duration::from_secs(2);

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
}

impl Default for ServerOptions {
    /// On the loopback, port 7460, without keys.
    fn default() -> Self {
        Self {
            address: SocketAddr::from(([127, 0, 0, 1], 7460)),
            names: Vec::new(),
            keys: None,
        }
    }
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
    listener: TcpListener,
    address: SocketAddr,
    access: Arc<Access>,
    tls: Option<TlsAcceptor>,
}

impl Server {
    /// Listens, and makes a token.
    ///
    /// # Errors
    /// [`ServerError`]: keys that are missing or wrong, an address that cannot be had.
    pub async fn bind(state: Arc<PageState>, options: ServerOptions) -> Result<Self, ServerError> {
        let address = options.address;
        let is_local = address.ip().is_loopback();
        if !is_local && options.keys.is_none() {
            return Err(ServerError::NoKeys { address });
        }
        if address.ip().is_unspecified() && options.names.is_empty() {
            return Err(ServerError::NoName { address });
        }
        let tls = options.keys.as_ref().map(Keys::acceptor).transpose()?;
        let failed = |source| ServerError::Listen { address, source };
        let listener = TcpListener::bind(address).await.map_err(failed)?;
        let bound = listener.local_addr().map_err(failed)?;
        let token = Token::random().ok_or(ServerError::NoRandomNumbers)?;
        let access = Access::new(token, bound, options.names, tls.is_some());
        Ok(Self {
            state,
            listener,
            address: bound,
            access: Arc::new(access),
            tls,
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// The address of the page, with the token: for the operator alone.
    pub fn url(&self) -> String {
        self.access.url()
    }

    /// The token.
    pub fn token(&self) -> &Token {
        self.access.token()
    }

    /// Serves until `stop`; then clients are told, and have a moment to leave.
    pub async fn serve(self, stop: CancellationToken) {
        let tasks = TaskTracker::new();
        let serving = Serving {
            state: Arc::clone(&self.state),
            access: Arc::clone(&self.access),
            sockets: Arc::new(Semaphore::new(MAX_CLIENTS)),
            series: SeriesAllowance::new(),
            tasks: tasks.clone(),
            stop: stop.clone(),
        };
        let router = routes::router(serving);
        let connections = Arc::new(Semaphore::new(MAX_CONNECTIONS));
        while let Some(accepted) = stop.run_until_cancelled(self.listener.accept()).await {
            let stream = match accepted {
                Ok((stream, _)) => stream,
                Err(error) => {
                    debug!(%error, "a connection was lost before it began");
                    sleep(ACCEPT_REST).await;
                    continue;
                }
            };
            let Ok(permit) = Arc::clone(&connections).try_acquire_owned() else {
                continue;
            };
            let (router, tls, stop) = (router.clone(), self.tls.clone(), stop.clone());
            tasks.spawn(async move {
                stop.run_until_cancelled(connection(stream, tls, router))
                    .await;
                drop(permit);
            });
        }
        tasks.close();
        if timeout(LEAVE_TIME, tasks.wait()).await.is_err() {
            warn!("some pages did not leave");
        }
    }
}

/// What every request needs.
#[derive(Clone)]
pub(crate) struct Serving {
    pub(crate) state: Arc<PageState>,
    pub(crate) access: Arc<Access>,
    pub(crate) sockets: Arc<Semaphore>,
    pub(crate) series: SeriesAllowance,
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

/// One connection, from its handshake to its end.
async fn connection(stream: TcpStream, tls: Option<TlsAcceptor>, router: axum::Router) {
    // Ticks are small and late ones are worth nothing.
    if let Err(error) = stream.set_nodelay(true) {
        debug!(%error, "a connection keeps small messages back");
    }
    let Some(tls) = tls else {
        return requests(stream, router, [CONNECTION_TIME, ANSWER_TIME]).await;
    };
    match timeout(HEAD_TIME, tls.accept(stream)).await {
        Ok(Ok(stream)) => requests(stream, router, [CONNECTION_TIME, ANSWER_TIME]).await,
        Ok(Err(error)) => debug!(%error, "a TLS handshake failed"),
        Err(_) => debug!("a TLS handshake took too long"),
    }
}

/// Answers requests for so long; then the last answer has so long to be read.
async fn requests<S>(stream: S, router: axum::Router, [ask_time, answer_time]: [Duration; 2])
where
    S: AsyncRead + AsyncWrite + Send + Unpin + 'static,
{
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(HEAD_TIME)
        .max_buf_size(MAX_HEAD_BYTES)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    let mut connection = pin!(connection);
    let served = if let Ok(served) = timeout(ask_time, connection.as_mut()).await {
        served
    } else {
        connection.as_mut().graceful_shutdown();
        let Ok(served) = timeout(answer_time, connection).await else {
            debug!("an answer was not read");
            return;
        };
        served
    };
    if let Err(error) = served {
        debug!(%error, "a connection ended");
    }
}
