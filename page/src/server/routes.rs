//! The paths of the server, and what every answer carries.

use std::sync::Arc;

use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::extract::{Path, Request, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, IF_NONE_MATCH, REFERRER_POLICY,
    X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use axum::{Extension, Router};
use farfield_proto::id::CameraIndex;
use tokio::time::Instant;

use super::access::{Refusal, Rights, SUBPROTOCOL};
use super::client::{Client, Form};
use super::{Serving, assets, series};
use crate::protocol::request::MAX_REQUEST_BYTES;

/// No scripts, styles or connections but our own.
const POLICY: &str = "default-src 'self'; img-src 'self' data: blob:; style-src 'self'; connect-src 'self'; \
    object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
/// What a slow client may leave unsent before sending to it waits, bytes: a tick of a crowd.
const MAX_UNSENT_BYTES: usize = 1 << 20;

pub(super) fn router(serving: Serving) -> Router {
    // Not while the first page waits for it.
    serving.tasks.spawn_blocking(assets::prepare);
    Router::new()
        .route("/api/venue", get(venue))
        .route("/api/status", get(status))
        .route("/api/series", get(one_series))
        .route("/api/thumbnail/{camera}", get(thumbnail))
        .route("/ws", get(binary_socket))
        .route("/ws/json", get(json_socket))
        .fallback(get(asset))
        .layer(middleware::from_fn_with_state(serving.clone(), check))
        .with_state(serving)
}

/// Refuses who may not ask, before anything else is looked at; adds the headers that keep a browser from harm.
async fn check(State(serving): State<Serving>, mut request: Request, next: Next) -> Response {
    let mut response = match serving.access.rights(request.headers()) {
        Ok(rights) => {
            request.extensions_mut().insert(rights);
            next.run(request).await
        }
        Err(refusal) => refused(refusal),
    };
    let headers = response.headers_mut();
    for (name, value) in [
        (CONTENT_SECURITY_POLICY, POLICY),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (
            HeaderName::from_static("cross-origin-resource-policy"),
            "same-origin",
        ),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    response
}

fn refused(refusal: Refusal) -> Response {
    plain(refusal.status(), refusal.to_string())
}

/// A line for people.
fn plain(status: StatusCode, text: impl Into<String>) -> Response {
    let mut text = text.into();
    text.push('\n');
    (status, text).into_response()
}

fn json(text: String) -> Response {
    let headers = [
        (CONTENT_TYPE, "application/json"),
        (CACHE_CONTROL, "no-store"),
    ];
    (headers, text).into_response()
}

/// Whether somebody may read.
fn may_read(rights: Rights) -> Result<(), Refusal> {
    if rights.may_read {
        Ok(())
    } else {
        Err(Refusal::NoToken)
    }
}

async fn asset(uri: Uri, headers: HeaderMap) -> Response {
    let found = assets::answer(uri.path(), &headers);
    found.unwrap_or_else(|| {
        plain(
            StatusCode::NOT_FOUND,
            "there is nothing here: the page is at /",
        )
    })
}

async fn venue(State(serving): State<Serving>, Extension(rights): Extension<Rights>) -> Response {
    match may_read(rights) {
        Ok(()) => json(serving.state.shared().venue_document.clone()),
        Err(refusal) => refused(refusal),
    }
}

async fn status(State(serving): State<Serving>, Extension(rights): Extension<Rights>) -> Response {
    if let Err(refusal) = may_read(rights) {
        return refused(refusal);
    }
    let newest = serving.state.shared().status.borrow().to_string();
    if newest.is_empty() {
        plain(StatusCode::SERVICE_UNAVAILABLE, "nothing is known yet")
    } else {
        json(newest)
    }
}

async fn one_series(
    State(serving): State<Serving>,
    Extension(rights): Extension<Rights>,
    uri: Uri,
) -> Response {
    if let Err(refusal) = may_read(rights) {
        return refused(refusal);
    }
    if !serving.series.take() {
        return plain(
            StatusCode::TOO_MANY_REQUESTS,
            "the past of angles is asked for too often: wait a second",
        );
    }
    match series::parse(uri.query().unwrap_or_default()) {
        Ok(asked) => json(series::answer(serving.state.shared(), &asked)),
        Err(error) => plain(StatusCode::BAD_REQUEST, error.to_string()),
    }
}

async fn thumbnail(
    State(serving): State<Serving>,
    Extension(rights): Extension<Rights>,
    Path(camera): Path<u16>,
    headers: HeaderMap,
) -> Response {
    if let Err(refusal) = may_read(rights) {
        return refused(refusal);
    }
    let thumbnails = &serving.state.shared().thumbnails;
    let Some(newest) = thumbnails.newest(CameraIndex(camera), Instant::now()) else {
        return plain(
            StatusCode::NOT_FOUND,
            "there is no picture of this camera now",
        );
    };
    let is_known = headers
        .get_all(IF_NONE_MATCH)
        .iter()
        .any(|tag| tag.as_bytes() == newest.tag.as_bytes());
    let about = [(CACHE_CONTROL, "no-store"), (ETAG, newest.tag.as_str())];
    if is_known {
        (StatusCode::NOT_MODIFIED, about).into_response()
    } else {
        (about, [(CONTENT_TYPE, "image/jpeg")], newest.jpeg).into_response()
    }
}

async fn binary_socket(
    state: State<Serving>,
    rights: Extension<Rights>,
    upgrade: WebSocketUpgrade,
) -> Response {
    socket(state.0, rights.0, upgrade, Form::Binary)
}

async fn json_socket(
    state: State<Serving>,
    rights: Extension<Rights>,
    upgrade: WebSocketUpgrade,
) -> Response {
    socket(state.0, rights.0, upgrade, Form::Json)
}

fn socket(serving: Serving, rights: Rights, upgrade: WebSocketUpgrade, form: Form) -> Response {
    if let Err(refusal) = may_read(rights) {
        return refused(refusal);
    }
    let Ok(permit) = Arc::clone(&serving.sockets).try_acquire_owned() else {
        return plain(
            StatusCode::SERVICE_UNAVAILABLE,
            "too many pages are open: close one",
        );
    };
    // The server waits for clients when it stops, from here on.
    let present = serving.tasks.token();
    upgrade
        .protocols([SUBPROTOCOL])
        .max_message_size(MAX_REQUEST_BYTES)
        .max_frame_size(MAX_REQUEST_BYTES)
        .write_buffer_size(0)
        .max_write_buffer_size(MAX_UNSENT_BYTES)
        .on_upgrade(move |socket: WebSocket| async move {
            Client::new(&serving, rights.may_act, form)
                .run(socket)
                .await;
            drop(permit);
            drop(present);
        })
}
