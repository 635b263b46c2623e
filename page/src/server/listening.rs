//! A listener with its limits: connections, time limits, shutdown. A router answers the requests.

use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, PrivateKeyDer};
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
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use tracing::{debug, warn};

use super::access::{Access, Token};
use super::{HasKeys, ServerError, ServerOptions, check_reach};

/// Maximum number of connections; a browser opens six for one page.
const MAX_CONNECTIONS: usize = 128;
/// Maximum time for a request's head or a TLS handshake.
const HEAD_TIME: Duration = Duration::from_secs(10);
/// Time during which a connection accepts requests; web sockets continue after it.
const CONNECTION_TIME: Duration = Duration::from_mins(1);
/// Maximum time for a response that is still being sent then, since its client may read slowly.
const ANSWER_TIME: Duration = Duration::from_secs(30);
/// Maximum size of a request's head, bytes.
const MAX_HEAD_BYTES: usize = 16 << 10;
/// Delay after the system refused a connection, for example with too many open files.
const ACCEPT_REST: Duration = Duration::from_millis(100);
/// Maximum time for clients to leave when the server stops.
const LEAVE_TIME: Duration = Duration::from_secs(2);

/// A listener with its access rules.
pub(super) struct Listening {
    listener: TcpListener,
    address: SocketAddr,
    access: Arc<Access>,
    tls: Option<TlsAcceptor>,
}

impl Listening {
    /// Binds the address, and creates a token if none is given.
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

    /// The bound address.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// The access rules.
    pub(super) fn access(&self) -> &Arc<Access> {
        &self.access
    }

    /// Serves `router` until `stop`; then gives the connections in `tasks` a moment to leave.
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
                    debug!(%error, "failed to accept a connection");
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
            warn!("some pages did not disconnect in time");
        }
    }
}

/// One connection, from its handshake to its end.
async fn connection(stream: TcpStream, tls: Option<TlsAcceptor>, router: axum::Router) {
    // Ticks are small, and late ones are worthless.
    if let Err(error) = stream.set_nodelay(true) {
        debug!(%error, "cannot disable Nagle's algorithm for a connection");
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

/// Answers requests for `ask_time`; then the last response may take `answer_time`.
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
            debug!("a response was not read in time");
            return;
        };
        served
    };
    if let Err(error) = served {
        debug!(%error, "a connection ended");
    }
}

/// A certificate chain and its private key, PEM.
pub struct Keys {
    /// The certificate, followed by its issuers.
    pub certificate_pem: Vec<u8>,
    /// The key.
    pub key_pem: Vec<u8>,
}

impl std::fmt::Debug for Keys {
    /// Hides the key.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Keys(..)")
    }
}

/// Why keys cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeysError {
    /// The certificate is invalid.
    #[error("the page's certificate cannot be read: {0}")]
    Certificate(String),
    /// There is no certificate.
    #[error("the page's certificate: expected PEM with at least one CERTIFICATE, found none")]
    NoCertificate,
    /// The key is invalid.
    #[error("the page's private key cannot be read: {0}")]
    Key(String),
    /// Certificate and key do not match.
    #[error("the page's certificate and key cannot be used: {0}")]
    Refused(String),
}

impl Keys {
    /// A TLS acceptor with these keys.
    fn acceptor(&self) -> Result<TlsAcceptor, KeysError> {
        let chain: Result<Vec<_>, _> =
            CertificateDer::pem_slice_iter(&self.certificate_pem).collect();
        let chain = chain.map_err(|error| KeysError::Certificate(error.to_string()))?;
        if chain.is_empty() {
            return Err(KeysError::NoCertificate);
        }
        let key = PrivateKeyDer::from_pem_slice(&self.key_pem)
            .map_err(|error| KeysError::Key(error.to_string()))?;
        let refused = |error: tokio_rustls::rustls::Error| KeysError::Refused(error.to_string());
        let mut config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
            .with_safe_default_protocol_versions()
            .map_err(refused)?
            .with_no_client_auth()
            .with_single_cert(chain, key)
            .map_err(refused)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(TlsAcceptor::from(Arc::new(config)))
    }
}
