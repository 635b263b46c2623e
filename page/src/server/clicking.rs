//! The page on which marks are clicked in pictures: served while an operator clicks, to nobody without the token, since it shows
//! pictures and writes a file. What is clicked, and what it comes to, is another's: [`Clicking`].

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

use super::access::{Refusal, Rights};
use super::answers::{check, json, plain, refused};
use super::assets;
use super::listening::Listening;
use super::token::Token;
use super::{ServerError, ServerOptions};

/// Largest text of what was clicked, bytes: ten thousand clicks have less.
const MAX_CLICKED_BYTES: usize = 1 << 20;
/// Requests that are worked on at once.
const AT_ONCE: usize = 2;

/// What becomes of what a page sends; each with a JSON document or a sentence for the operator.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Taken {
    /// It is in the file; what it comes to.
    Written(String),
    /// Somebody else has changed it since: what there is now.
    Behind(String),
    /// It is wrong; why.
    Refused(String),
    /// It could not be written; why.
    Failed(String),
}

/// What marks are clicked in, and where they go. Called on threads that may wait.
pub trait Clicking: Send + Sync {
    /// All that the page shows, as JSON.
    fn document(&self) -> String;

    /// The picture with this number, as PNG.
    fn picture(&self, number: usize) -> Option<Arc<[u8]>>;

    /// Takes all that was clicked so far, as JSON, in the place of what was before.
    fn take(&self, clicked: &[u8]) -> Taken;
}

/// A server that listens, and serves when it is asked to.
pub struct ClickingServer {
    clicking: Arc<dyn Clicking>,
    listening: Listening,
}

impl ClickingServer {
    /// Listens, and makes a token.
    ///
    /// # Errors
    /// [`ServerError`], as of [`super::Server::bind`].
    pub async fn bind(
        clicking: Arc<dyn Clicking>,
        options: ServerOptions,
    ) -> Result<Self, ServerError> {
        Ok(Self {
            clicking,
            listening: Listening::bind(options).await?,
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

    /// Serves until `stop`. What is being written then is written whole.
    pub async fn serve(self, stop: CancellationToken) {
        let tasks = TaskTracker::new();
        let serving = Serving {
            clicking: self.clicking,
            at_once: Arc::new(Semaphore::new(AT_ONCE)),
        };
        tasks.spawn_blocking(|| assets::prepare(&assets::MARKS));
        let of_token = Router::new()
            .route("/api/marks", get(document).put(take))
            .route("/api/picture/{number}", get(picture))
            .layer(DefaultBodyLimit::max(MAX_CLICKED_BYTES))
            .layer(middleware::from_fn(needs_token));
        let access = Arc::clone(self.listening.access());
        let router = of_token
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
    /// Does something that may wait.
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
    found.unwrap_or_else(|| {
        plain(
            StatusCode::NOT_FOUND,
            "there is nothing here: the page is at /",
        )
    })
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
        Ok(None) => plain(StatusCode::NOT_FOUND, "there is no picture of this number"),
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
