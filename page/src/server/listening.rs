//! A listener with its rules: who is let in, for how long, and what ends it. What it answers is a router's.

use std::net::SocketAddr;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::{sleep, timeout};
use tokio_rustls::TlsAcceptor;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};

use super::access::Access;
use super::token::Token;
use super::{HasKeys, Keys, ServerError, ServerOptions, check_reach};

/// Most connections at once: a browser opens six for one page.
const MAX_CONNECTIONS: usize = 128;
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

/// Listens, and knows who may come.
pub(super) struct Listening {
    listener: TcpListener,
    address: SocketAddr,
    access: Arc<Access>,
    tls: Option<TlsAcceptor>,
}

impl Listening {
    /// Listens, and makes a token where none is given.
    pub(super) async fn bind(options: ServerOptions) -> Result<Self, ServerError> {
        let address = options.address;
        let keys = HasKeys::of(options.keys.as_ref());
        check_reach(address, &options.names, keys)?;
        let tls = options.keys.as_ref().map(Keys::acceptor).transpose()?;
        let failed = |source| ServerError::Listen { address, source };
        let listener = TcpListener::bind(address).await.map_err(failed)?;
        let bound = listener.local_addr().map_err(failed)?;
        let token = options.token.or_else(Token::random);
        let token = token.ok_or(ServerError::NoRandomNumbers)?;
        let access = Access::new(token, bound, options.names, tls.is_some());
        Ok(Self {
            listener,
            address: bound,
            access: Arc::new(access),
            tls,
        })
    }

    /// Where it listens.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Its rules.
    pub(super) fn access(&self) -> &Arc<Access> {
        &self.access
    }

    /// Answers by `router` until `stop`; then `tasks`, to which connections belong, have a moment to leave.
    pub(super) async fn serve(
        self,
        router: axum::Router,
        tasks: TaskTracker,
        stop: CancellationToken,
    ) {
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
pub(super) async fn requests<S>(
    stream: S,
    router: axum::Router,
    [ask_time, answer_time]: [Duration; 2],
) where
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
