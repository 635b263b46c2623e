//! Routes of the server, and the access check and headers of all responses.

use std::sync::Arc;

use axum::body::Bytes;
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

use super::access::{Access, Refusal, Rights, SUBPROTOCOL};
use super::client::{Client, Form};
use super::{Serving, assets, series};
use crate::calibration;
use crate::protocol::request::MAX_REQUEST_BYTES;

/// A sheet comes from a file of unknown origin: any style is allowed, and nothing active.
const SHEET_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; \
    frame-ancestors 'none'; sandbox";
/// Maximum number of unsent bytes before sending to a slow client waits: a tick of a crowd.
const MAX_UNSENT_BYTES: usize = 1 << 20;

pub(super) fn router(serving: Serving) -> Router {
    // Compress in the background, not while the first page waits.
    serving
        .tasks
        .spawn_blocking(|| assets::prepare(&assets::LIVE));
    Router::new()
        .route("/api/venue", get(venue))
        .route("/api/status", get(status))
        .route("/api/series", get(one_series))
        .route("/api/thumbnail/{camera}", get(thumbnail))
        .route("/api/calibration", get(shown_calibration))
        .route("/calibration/{key}", get(calibration_sheet))
        .route("/ws", get(binary_socket))
        .route("/ws/json", get(json_socket))
        .fallback(get(asset))
        .layer(middleware::from_fn_with_state(
            Arc::clone(&serving.access),
            check,
        ))
        .with_state(serving)
}

/// Checks the right to read.
fn may_read(rights: Rights) -> Result<(), Refusal> {
    if rights.may_read {
        Ok(())
    } else {
        Err(Refusal::NoToken)
    }
}

async fn asset(uri: Uri, headers: HeaderMap) -> Response {
    let found = assets::answer(&assets::LIVE, uri.path(), &headers);
    found.unwrap_or_else(|| plain(StatusCode::NOT_FOUND, "not found: the page is at /"))
}

async fn venue(State(serving): State<Serving>, Extension(rights): Extension<Rights>) -> Response {
    match may_read(rights) {
        Ok(()) => json(
            StatusCode::OK,
            serving.state.shared().venue_document.clone(),
        ),
        Err(refusal) => refused(refusal),
    }
}

async fn status(State(serving): State<Serving>, Extension(rights): Extension<Rights>) -> Response {
    if let Err(refusal) = may_read(rights) {
        return refused(refusal);
    }
    let newest = serving.state.shared().status.borrow().to_string();
    if newest.is_empty() {
        plain(StatusCode::SERVICE_UNAVAILABLE, "there is no status yet")
    } else {
        json(StatusCode::OK, newest)
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
            "too many requests for past angles: wait a second",
        );
    }
    match series::parse(uri.query().unwrap_or_default()) {
        Ok(query) => json(
            StatusCode::OK,
            series::answer(serving.state.shared(), &query),
        ),
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
    if !thumbnails.has(CameraIndex(camera)) {
        return plain(StatusCode::NOT_FOUND, "the venue has no such camera");
    }
    let Some(newest) = thumbnails.newest(CameraIndex(camera), Instant::now()) else {
        // Not an error status: browsers log those to their consoles, once per second and camera.
        return (StatusCode::NO_CONTENT, [(CACHE_CONTROL, "no-store")]).into_response();
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

async fn shown_calibration(
    State(serving): State<Serving>,
    Extension(rights): Extension<Rights>,
) -> Response {
    if let Err(refusal) = may_read(rights) {
        return refused(refusal);
    }
    let shown = &serving.state.shared().calibration;
    json(
        StatusCode::OK,
        calibration::document(shown, serving.sheet_key.text()),
    )
}

/// The sheet, for clients that know its key.
async fn calibration_sheet(State(serving): State<Serving>, Path(key): Path<String>) -> Response {
    let sheet = serving.state.shared().calibration.sheet.as_ref();
    let Some(sheet) = sheet.filter(|_| serving.sheet_key.is(&key)) else {
        return plain(
            StatusCode::NOT_FOUND,
            "not found: open the sheet from the page at /",
        );
    };
    let about = [
        (CONTENT_TYPE, "text/html; charset=utf-8"),
        (CACHE_CONTROL, "no-store"),
        (CONTENT_SECURITY_POLICY, SHEET_POLICY),
    ];
    (about, Bytes::from_owner(Arc::clone(&sheet.html))).into_response()
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
    // From here on, the server waits for this client when it stops.
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

/// Allows only our own scripts, styles and connections.
const POLICY: &str = "default-src 'self'; img-src 'self' data: blob:; style-src 'self'; connect-src 'self'; \
    object-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Rejects requests without rights before anything else, and adds security headers.
pub(super) async fn check(
    State(access): State<Arc<Access>>,
    mut request: Request,
    next: Next,
) -> Response {
    let mut response = match access.rights(request.headers()) {
        Ok(rights) => {
            request.extensions_mut().insert(rights);
            next.run(request).await
        }
        Err(refusal) => refused(refusal),
    };
    let headers = response.headers_mut();
    // Some documents set their own policy.
    headers
        .entry(CONTENT_SECURITY_POLICY)
        .or_insert(HeaderValue::from_static(POLICY));
    for (name, value) in [
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

pub(super) fn refused(refusal: Refusal) -> Response {
    plain(refusal.status(), refusal.to_string())
}

/// A plain text response.
pub(super) fn plain(status: StatusCode, text: impl Into<String>) -> Response {
    let mut text = text.into();
    text.push('\n');
    (status, text).into_response()
}

/// A JSON response.
pub(super) fn json(status: StatusCode, text: String) -> Response {
    let headers = [
        (CONTENT_TYPE, "application/json"),
        (CACHE_CONTROL, "no-store"),
    ];
    (status, headers, text).into_response()
}
