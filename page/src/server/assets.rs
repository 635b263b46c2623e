//! The page itself: the committed bundle, so that users need no other tool. Compressed once, at the
//! first request.

use std::io::Write as _;
use std::sync::LazyLock;

use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_TYPE, ETAG, IF_NONE_MATCH, VARY,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse as _, Response};
use flate2::Compression;
use flate2::write::GzEncoder;
use ring::digest::{SHA256, digest};

/// One file of the bundle.
struct Asset {
    path: &'static str,
    kind: &'static str,
    bytes: &'static [u8],
    /// Empty if compression failed.
    gzip: Vec<u8>,
    tag: String,
}

impl Asset {
    fn new(path: &'static str, kind: &'static str, bytes: &'static [u8]) -> Self {
        let tag = digest(&SHA256, bytes);
        let mut bits = [0; 8];
        bits.copy_from_slice(&tag.as_ref()[..8]);
        let tag = u64::from_be_bytes(bits);
        Self {
            path,
            kind,
            bytes,
            gzip: gzip(bytes).unwrap_or_default(),
            tag: format!("\"{tag:016x}\""),
        }
    }
}

fn gzip(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// The files of one page.
pub(super) struct Bundle([Asset; 3]);

/// The live page.
pub(super) static LIVE: LazyLock<Bundle> = LazyLock::new(|| {
    Bundle([
        Asset::new(
            "/",
            "text/html; charset=utf-8",
            include_bytes!("../../bundle/index.html"),
        ),
        Asset::new(
            "/page.js",
            "text/javascript; charset=utf-8",
            include_bytes!("../../bundle/page.js"),
        ),
        Asset::new(
            "/page.css",
            "text/css; charset=utf-8",
            include_bytes!("../../bundle/page.css"),
        ),
    ])
});

/// The page for clicking marks.
pub(super) static MARKS: LazyLock<Bundle> = LazyLock::new(|| {
    Bundle([
        Asset::new(
            "/",
            "text/html; charset=utf-8",
            include_bytes!("../../bundle/marks.html"),
        ),
        Asset::new(
            "/marks.js",
            "text/javascript; charset=utf-8",
            include_bytes!("../../bundle/marks.js"),
        ),
        Asset::new(
            "/marks.css",
            "text/css; charset=utf-8",
            include_bytes!("../../bundle/marks.css"),
        ),
    ])
});

/// Compresses all files of a page before the first request.
pub(super) fn prepare(bundle: &LazyLock<Bundle>) {
    LazyLock::force(bundle);
}

/// The response for a file of the bundle; `None` if there is no such file.
pub(super) fn answer(bundle: &'static Bundle, path: &str, headers: &HeaderMap) -> Option<Response> {
    let asset = bundle.0.iter().find(|asset| asset.path == path)?;
    let has = |name, what: &str| {
        let mut values = headers.get_all(name).iter();
        values.any(|value: &HeaderValue| value.to_str().is_ok_and(|text| text.contains(what)))
    };
    let mut response = if has(IF_NONE_MATCH, &asset.tag) {
        StatusCode::NOT_MODIFIED.into_response()
    } else if has(ACCEPT_ENCODING, "gzip") && !asset.gzip.is_empty() {
        let mut response = asset.gzip.as_slice().into_response();
        response
            .headers_mut()
            .insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
        response
    } else {
        asset.bytes.into_response()
    };
    let into = response.headers_mut();
    into.insert(CONTENT_TYPE, HeaderValue::from_static(asset.kind));
    into.insert(CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    into.insert(VARY, HeaderValue::from_static("accept-encoding"));
    if let Ok(tag) = HeaderValue::from_str(&asset.tag) {
        into.insert(ETAG, tag);
    }
    Some(response)
}
