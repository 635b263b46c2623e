//! The paths of the server, and what every answer carries.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::ws::{WebSocket, WebSocketUpgrade};
use axum::extract::{Path, State};
use axum::http::header::{
    CACHE_CONTROL, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, IF_NONE_MATCH,
};
use axum::http::{HeaderMap, StatusCode, Uri};
use axum::middleware;
use axum::response::{IntoResponse as _, Response};
use axum::routing::get;
use axum::{Extension, Router};
use farfield_proto::id::CameraIndex;
use tokio::time::Instant;

use super::access::{Refusal, Rights, SUBPROTOCOL};
use super::answers::{check, json, plain, refused};
use super::client::{Client, Form};
use super::{Serving, assets, series};
use crate::calibration;
use crate::protocol::request::MAX_REQUEST_BYTES;

/// A sheet is a file that somebody wrote: it may look as it likes, and do nothing.
const SHEET_POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; \
    frame-ancestors 'none'; sandbox";
/// What a slow client may leave unsent before sending to it waits, bytes: a tick of a crowd.
const MAX_UNSENT_BYTES: usize = 1 << 20;

pub(super) fn router(serving: Serving) -> Router {
    // Not while the first page waits for it.
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

/// Whether somebody may read.
fn may_read(rights: Rights) -> Result<(), Refusal> {
    if rights.may_read {
        Ok(())
    } else {
        Err(Refusal::NoToken)
    }
}

async fn asset(uri: Uri, headers: HeaderMap) -> Response {
    let found = assets::answer(&assets::LIVE, uri.path(), &headers);
    found.unwrap_or_else(|| {
        plain(
            StatusCode::NOT_FOUND,
            "there is nothing here: the page is at /",
        )
    })
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
        plain(StatusCode::SERVICE_UNAVAILABLE, "nothing is known yet")
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
            "the past of angles is asked for too often: wait a second",
        );
    }
    match series::parse(uri.query().unwrap_or_default()) {
        Ok(asked) => json(
            StatusCode::OK,
            series::answer(serving.state.shared(), &asked),
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
        // No error: browsers write those into their consoles, once a second and camera.
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

/// The sheet, for who was told its key.
async fn calibration_sheet(State(serving): State<Serving>, Path(key): Path<String>) -> Response {
    let sheet = serving.state.shared().calibration.sheet.as_ref();
    let Some(sheet) = sheet.filter(|_| serving.sheet_key.is(&key)) else {
        return plain(
            StatusCode::NOT_FOUND,
            "there is no sheet here: open it from the page, which is at /",
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
