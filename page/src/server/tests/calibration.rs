//! The sheet of the calibration: who gets it, and what it may do.

use serde_json::json;

use super::*;
use crate::calibration::{CalibrationSheet, ShownCalibration};

const HTML: &str = "<!doctype html><title>Calibration</title><script>alert(1)</script>";

async fn with_sheet() -> Running {
    let sheet = CalibrationSheet {
        file: "calibration.html".to_owned(),
        fingerprint: Some("ab".repeat(8)),
        is_of_this: Some(false),
        html: HTML.as_bytes().into(),
    };
    let options = PageOptions {
        calibration: ShownCalibration {
            file: "calibration.toml".to_owned(),
            fingerprint: "cd".repeat(8),
            text: "of ANOTHER calibration".to_owned(),
            sheet: Some(sheet),
        },
        ..PageOptions::default()
    };
    Running::serve(PageState::live(venue::venue(), venue::skeleton(), options).unwrap()).await
}

fn body(answer: &str) -> &str {
    answer.split_once("\r\n\r\n").map_or("", |(_, body)| body)
}

#[tokio::test]
async fn the_sheet_is_told_and_opened_by_its_key_and_does_nothing() {
    let running = with_sheet().await;
    let told: Value =
        serde_json::from_str(body(&running.get("/api/calibration", "").await)).unwrap();
    assert_eq!(told["sheet"]["is_of_this"], json!(false));
    assert_eq!(told["text"], "of ANOTHER calibration");
    let path = told["sheet"]["path"].as_str().unwrap();
    assert!(!path.contains(&running.token), "the key is not the token");
    let sheet = running.get(path, "").await;
    assert_eq!(code(&sheet), "200");
    assert_eq!(body(&sheet), HTML);
    let head = sheet.to_ascii_lowercase();
    assert!(head.contains("content-type: text/html"), "{head}");
    assert!(
        head.contains("default-src 'none'") && head.contains("; sandbox"),
        "{head}"
    );
    assert_eq!(head.matches("content-security-policy").count(), 1, "{head}");
    running.end().await;
}

#[tokio::test]
async fn who_was_not_told_the_key_finds_no_sheet() {
    let running = with_sheet().await;
    let told: Value =
        serde_json::from_str(body(&running.get("/api/calibration", "").await)).unwrap();
    let path = told["sheet"]["path"].as_str().unwrap().to_owned();
    let wrong = "0".repeat(32);
    for path in [
        format!("/calibration/{wrong}"),
        "/calibration/".to_owned(),
        format!("/calibration/{}", running.token),
    ] {
        assert_eq!(code(&running.get(&path, "").await), "404", "{path}");
    }
    for path in ["/api/calibration", &path] {
        let stranger = running.get(path, "Host: stranger.example\r\n").await;
        assert_eq!(code(&stranger), "421", "{path}");
        let foreign = running
            .get(path, "Origin: http://stranger.example\r\n")
            .await;
        assert_eq!(code(&foreign), "403", "{path}");
    }
    running.end().await;
}

#[tokio::test]
async fn a_run_without_a_sheet_says_so() {
    let running = Running::live().await;
    let told: Value =
        serde_json::from_str(body(&running.get("/api/calibration", "").await)).unwrap();
    assert!(told["sheet"].is_null(), "{told}");
    assert_eq!(code(&running.get("/calibration/x", "").await), "404");
    running.end().await;
}
