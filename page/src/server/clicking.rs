//! Server of the page for clicking marks in images. It requires the token, since it shows images
//! and writes a file. The host program stores and evaluates the marks: [`Clicking`].

use std::net::SocketAddr;
use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Path, Request, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use axum::{Extension, Router};
use tokio::sync::Semaphore;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::access::{Refusal, Rights, Token};
use super::assets;
use super::listening::Listening;
use super::routes::{check, json, plain, refused};
use super::{ServerError, ServerOptions};

/// Maximum size of submitted marks, bytes; ten thousand clicks need less.
const MAX_CLICKED_BYTES: usize = 1 << 20;
/// Maximum number of concurrent requests.
const AT_ONCE: usize = 2;

/// Result of a submission, with a JSON document or a sentence for the operator.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Taken {
    /// Written to the file; the evaluation.
    Written(String),
    /// Changed by another page in the meantime; the current state.
    Behind(String),
    /// Invalid; the reason.
    Refused(String),
    /// Not written; the reason.
    Failed(String),
}

/// Source of images and destination of marks. Called on threads that may block.
pub trait Clicking: Send + Sync {
    /// Everything that the page shows, as JSON.
    fn document(&self) -> String;

    /// The image with this number, as PNG.
    fn picture(&self, number: usize) -> Option<Arc<[u8]>>;

    /// Replaces all marks by `clicked`, as JSON.
    fn take(&self, clicked: &[u8]) -> Taken;
}

/// A bound server that is not serving yet.
pub struct ClickingServer {
    clicking: Arc<dyn Clicking>,
    listening: Listening,
}

impl ClickingServer {
    /// Binds the address and creates a token.
    ///
    /// # Errors
    /// [`ServerError`], as for [`super::Server::bind`].
    pub async fn bind(
        clicking: Arc<dyn Clicking>,
        options: ServerOptions,
    ) -> Result<Self, ServerError> {
        Ok(Self {
            clicking,
            listening: Listening::bind(options).await?,
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

    /// Serves until `stop`. A write in progress is completed.
    pub async fn serve(self, stop: CancellationToken) {
        let tasks = TaskTracker::new();
        let serving = Serving {
            clicking: self.clicking,
            at_once: Arc::new(Semaphore::new(AT_ONCE)),
        };
        tasks.spawn_blocking(|| assets::prepare(&assets::MARKS));
        let with_token = Router::new()
            .route("/api/marks", get(document).put(take))
            .route("/api/picture/{number}", get(picture))
            .layer(DefaultBodyLimit::max(MAX_CLICKED_BYTES))
            .layer(middleware::from_fn(needs_token));
        let access = Arc::clone(self.listening.access());
        let router = with_token
            .fallback(get(asset))
            .layer(middleware::from_fn_with_state(access, check))
            .with_state(serving);
        self.listening.serve(router, tasks, stop).await;
    }
}

#[derive(Clone)]
struct Serving {
    clicking: Arc<dyn Clicking>,
    at_once: Arc<Semaphore>,
}

impl Serving {
    /// Runs an operation that may block.
    async fn work<T: Send + 'static>(
        &self,
        work: impl FnOnce(&dyn Clicking) -> T + Send + 'static,
    ) -> Result<T, Response> {
        let stopped = || plain(StatusCode::SERVICE_UNAVAILABLE, "the server is stopping");
        let permit = Arc::clone(&self.at_once).acquire_owned().await;
        let permit = permit.map_err(|_| stopped())?;
        let clicking = Arc::clone(&self.clicking);
        let work = tokio::task::spawn_blocking(move || {
            let done = work(clicking.as_ref());
            drop(permit);
            done
        });
        work.await.map_err(|_| stopped())
    }
}

async fn needs_token(
    Extension(rights): Extension<Rights>,
    request: Request,
    next: Next,
) -> Response {
    if rights.may_act {
        next.run(request).await
    } else {
        refused(Refusal::NoToken)
    }
}

async fn asset(uri: Uri, headers: HeaderMap) -> Response {
    let found = assets::answer(&assets::MARKS, uri.path(), &headers);
    found.unwrap_or_else(|| plain(StatusCode::NOT_FOUND, "not found: the page is at /"))
}

async fn document(State(serving): State<Serving>) -> Response {
    match serving.work(|clicking| clicking.document()).await {
        Ok(text) => json(StatusCode::OK, text),
        Err(response) => response,
    }
}

async fn picture(State(serving): State<Serving>, Path(number): Path<usize>) -> Response {
    let found = serving.work(move |clicking| clicking.picture(number)).await;
    match found {
        Ok(Some(png)) => {
            let headers = [(CONTENT_TYPE, "image/png"), (CACHE_CONTROL, "no-store")];
            (headers, Bytes::from_owner(png)).into_response()
        }
        Ok(None) => plain(
            StatusCode::NOT_FOUND,
            "there is no picture with this number",
        ),
        Err(response) => response,
    }
}

async fn take(State(serving): State<Serving>, clicked: Bytes) -> Response {
    match serving.work(move |clicking| clicking.take(&clicked)).await {
        Ok(Taken::Written(text)) => json(StatusCode::OK, text),
        Ok(Taken::Behind(text)) => json(StatusCode::CONFLICT, text),
        Ok(Taken::Refused(why)) => plain(StatusCode::BAD_REQUEST, why),
        Ok(Taken::Failed(why)) => plain(StatusCode::INTERNAL_SERVER_ERROR, why),
        Err(response) => response,
    }
}
