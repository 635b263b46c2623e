//! Marks clicked in images, as by a browser: by HTTP to the command, to the file, and to a calibration.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::time::Duration;

use farfield_proto::calibration::Calibration;
use farfield_proto::camera::CameraModel;
use farfield_proto::frames::Point;
use image::RgbImage;
use nalgebra::Point3;
use serde_json::{Value, json};

use super::calibration::{SeenHall, calibration, carried_light};
use crate::farfield::{command, farfield};

/// Far above what a loaded machine takes to answer.
const PATIENCE: Duration = Duration::from_mins(1);
/// Clicked places, metres: marks of the court in the middle of the room, and measured places.
const MARKS: [(&str, [f64; 3]); 6] = [
    ("centre", [0.0, 0.0, 0.0]),
    ("centre_circle_north", [0.0, 3.0, 0.0]),
    ("centre_circle_south", [0.0, -3.0, 0.0]),
    ("post east", [2.0, 0.5, 1.4]),
    ("scratch west", [-2.0, -0.5, 0.0]),
    ("scratch south", [1.5, -2.0, 0.0]),
];

/// Distorted pixel of a place in `camera`; `None` outside its image.
fn seen_px(camera: &CameraModel, at_m: [f64; 3]) -> Option<[f64; 2]> {
    let pixel = camera.project(Point::new(Point3::from(at_m)))?;
    let pixel = Some(pixel).filter(|pixel| camera.sees(*pixel))?;
    let drawn = camera.distort(pixel)?;
    Some([drawn.x(), drawn.y()])
}

/// The running command and the address of its page.
struct Clicking {
    child: Child,
    stderr: BufReader<ChildStderr>,
    authority: String,
    token: String,
}

impl Drop for Clicking {
    fn drop(&mut self) {
        // The process may have ended already.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

impl Clicking {
    fn start(words: &[&str]) -> Self {
        let mut command = command();
        command
            .args(["calibrate", "marks", "--at", "127.0.0.1:0"])
            .args(words);
        let mut child = command
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let mut all = String::new();
        while !all.contains("#token=") {
            assert!(
                stderr.read_line(&mut all).unwrap() > 0,
                "it ended with:\n{all}"
            );
        }
        println!("{all}");
        let address = all
            .split_whitespace()
            .find_map(|word| word.strip_prefix("http://"));
        let (authority, token) = address.unwrap().split_once("/#token=").unwrap();
        Self {
            child,
            stderr,
            authority: authority.to_owned(),
            token: token.to_owned(),
        }
    }

    /// Sends a request with more head lines. Returns status and body of the answer.
    fn request(&self, first: &str, head: &str, body: &str) -> (u16, String) {
        let mut socket = TcpStream::connect(&self.authority).unwrap();
        socket.set_read_timeout(Some(PATIENCE)).unwrap();
        let host = if head.contains("Host:") {
            String::new()
        } else {
            format!("Host: {}\r\n", self.authority)
        };
        let length = body.len();
        let request = format!(
            "{first} HTTP/1.1\r\n{host}{head}Content-Length: {length}\r\nConnection: close\r\n\r\n{body}"
        );
        socket.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        socket.read_to_end(&mut answer).unwrap();
        let answer = String::from_utf8_lossy(&answer).into_owned();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head[9..12].parse().unwrap(), body.to_owned())
    }

    fn with_token(&self) -> String {
        format!("Authorization: Bearer {}\r\n", self.token)
    }

    fn document(&self) -> Value {
        let (status, body) = self.request("GET /api/marks", &self.with_token(), "");
        assert_eq!(status, 200, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    fn put(&self, revision: &Value, clicked: &Value) -> (u16, String) {
        let change = json!({ "revision": revision, "clicked": clicked });
        self.request("PUT /api/marks", &self.with_token(), &change.to_string())
    }

    /// Puts clicks that must be accepted; returns the new state.
    fn put_accepted(&self, revision: &Value, clicked: &Value) -> Value {
        let (status, body) = self.put(revision, clicked);
        assert_eq!(status, 200, "{body}");
        serde_json::from_str(&body).unwrap()
    }

    /// Interrupts the command as Ctrl-C does; returns the rest of its output.
    fn stop(mut self) -> String {
        let pid = self.child.id().to_string();
        assert!(
            Command::new("kill")
                .args(["-INT", &pid])
                .status()
                .unwrap()
                .success()
        );
        let mut rest = String::new();
        self.stderr.read_to_string(&mut rest).unwrap();
        assert_eq!(self.child.wait().unwrap().code(), Some(0), "{rest}");
        rest
    }
}

/// A grey image of each camera.
fn pictures(folder: &Path, cameras: &Calibration) -> PathBuf {
    let pictures = folder.join("pictures");
    fs::create_dir(&pictures).unwrap();
    for camera in cameras.cameras.values() {
        let [w, h] = camera.size_px();
        let picture = RgbImage::from_pixel(w, h, image::Rgb([90, 100, 110]));
        picture
            .save(pictures.join(format!("{}.png", camera.name())))
            .unwrap();
    }
    pictures
}

fn fit_of<'a>(state: &'a Value, camera: &str) -> &'a Value {
    let fits = state["fits"].as_array().unwrap();
    fits.iter().find(|fit| fit["camera"] == camera).unwrap()
}

/// Clients without the token get the empty page only.
fn check_strangers(clicking: &Clicking) {
    assert_eq!(clicking.request("GET /", "", "").0, 200);
    for path in ["GET /api/marks", "GET /api/picture/0", "PUT /api/marks"] {
        assert_eq!(clicking.request(path, "", "").0, 401, "{path}");
    }
    let foreign = format!(
        "{}Origin: http://stranger.example\r\n",
        clicking.with_token()
    );
    assert_eq!(clicking.request("PUT /api/marks", &foreign, "{}").0, 403);
    let host = format!("{}Host: stranger.example\r\n", clicking.with_token());
    assert_eq!(clicking.request("GET /api/marks", &host, "").0, 421);
}

/// An outdated page does not overwrite newer clicks, and invalid clicks are refused.
fn check_invalid_clicks(clicking: &Clicking, state: &Value, clicked: &Value, camera: &str) {
    let (status, _) = clicking.put(&json!(0), clicked);
    assert_eq!(status, 409);
    let mut outside = clicked.clone();
    outside["camera"][camera]["centre"] = json!([[99_999.0, 3.0]]);
    let (status, why) = clicking.put(&state["revision"], &outside);
    assert_eq!(status, 400);
    assert!(why.contains("expected a position in"), "{why}");
    assert_eq!(
        clicking.put(&state["revision"], &json!({"court": 3})).0,
        400
    );
}

/// A calibration from the carried light, aligned by the clicks, is close to the truth.
fn check_calibration(light: &SeenHall, clicked: &Path) {
    let done = light.calibrate("points", &["--marks", clicked.to_str().unwrap()]);
    assert_eq!(done.code, 0, "{}\n{}", done.stdout, done.stderr);
    let found = calibration(&light.folder.path("found.toml"));
    for (name, camera) in &light.truth.cameras {
        let at_m = found.cameras[name].center().coordinates_m();
        let apart_m = (at_m - camera.center().coordinates_m()).norm();
        println!("{name}: {:.1} mm from the truth", 1000.0 * apart_m);
        assert!(apart_m < 0.02, "{name}: {apart_m} m");
    }
}

#[test]
fn clicked_marks_align_a_calibration() {
    let light = carried_light();
    let out = light.folder.path("clicked.toml");
    let lens = light.folder.path("calibration.toml");
    let pictures = pictures(light.folder.folder(), &light.truth);
    let words = [
        pictures.to_str().unwrap(),
        "--court",
        "futsal",
        "--lens",
        lens.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    let clicking = Clicking::start(&words);

    check_strangers(&clicking);
    let document = clicking.document();
    assert_eq!(document["court"]["name"], "futsal");
    assert_eq!(
        document["cameras"].as_array().unwrap().len(),
        light.truth.cameras.len()
    );
    assert!(!out.exists(), "nothing is clicked yet");

    // One click at a time, like an operator. Then one click is moved far off, and corrected.
    let mut clicked = document["state"]["clicked"].clone();
    for (name, at_m) in &MARKS[3..] {
        clicked["places"][*name] = json!(at_m);
    }
    let mut state = document["state"].clone();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for (camera, model) in &light.truth.cameras {
        for (name, at_m) in MARKS {
            let Some([x, y]) = seen_px(model, at_m) else {
                continue;
            };
            clicked["camera"][camera][name] = json!([[x, y]]);
            state = clicking.put_accepted(&state["revision"], &clicked);
            *counts.entry(camera).or_default() += 1;
        }
    }
    let (first, seen) = counts.iter().max_by_key(|(_, seen)| **seen).unwrap();
    assert!(*seen >= 6, "{counts:?}");
    let fit = fit_of(&state, first);
    assert_eq!(fit["state"], "fits", "{fit}");
    assert!(
        !fit["lines"].as_array().unwrap().is_empty(),
        "the court is drawn over the image"
    );
    let right = clicked["camera"][*first]["centre"].clone();
    clicked["camera"][*first]["centre"][0][0] = json!(right[0][0].as_f64().unwrap() + 45.0);
    state = clicking.put_accepted(&state["revision"], &clicked);
    let fit = fit_of(&state, first);
    println!("{}", fit["text"].as_str().unwrap());
    let residuals = fit["residuals"].as_array().unwrap().iter();
    let outliers: Vec<&Value> = residuals.filter(|it| it["is_outlier"] == true).collect();
    assert_eq!(outliers.len(), 1, "{fit}");
    assert_eq!(outliers[0]["name"], "centre", "{fit}");
    let written = fs::read_to_string(&out).unwrap();
    assert!(
        written.contains("\"post east\" = [2.0, 0.5, 1.4]"),
        "every click is in the file at once: {written}"
    );
    clicked["camera"][*first]["centre"] = right;

    check_invalid_clicks(&clicking, &state, &clicked, first);
    assert_eq!(fs::read_to_string(&out).unwrap(), written);
    state = clicking.put_accepted(&state["revision"], &clicked);
    assert!(state["problem"].is_null(), "{}", state["problem"]);
    let rest = clicking.stop();
    assert!(rest.contains("--marks"), "{rest}");

    // Existing clicks are read again.
    let again = Clicking::start(&words);
    assert_eq!(again.document()["state"]["clicked"], state["clicked"]);
    again.stop();

    check_calibration(&light, &out);
}

#[test]
fn wrong_images_and_marks_are_refused() {
    let light = carried_light();
    let lens = light.folder.path("calibration.toml");
    let pictures = pictures(light.folder.folder(), &light.truth);
    let refused = |words: &[&str], message: &str| {
        let done = farfield(&[&["calibrate", "marks"], words].concat());
        assert_eq!(done.code, 2, "{message}\n{}\n{}", done.stdout, done.stderr);
        assert!(done.stderr.contains(message), "{message}: {}", done.stderr);
        println!("{}", done.stderr.lines().last().unwrap());
    };
    let text = lens.to_str().unwrap();
    refused(&[text], "expected a JPEG or PNG image, or a video");
    let name = light.truth.cameras.keys().next().unwrap();
    let small = light.folder.path(&format!("{name}.jpg"));
    RgbImage::new(64, 48).save(&small).unwrap();
    refused(
        &[small.to_str().unwrap(), "--lens", text],
        "found an image of 64x48",
    );
    let all = pictures.to_str().unwrap();
    refused(&[all, "--court", "fustal"], "did you mean `futsal`?");
    refused(
        &[all, "--court", "futsal", "--size-m", "200x20"],
        "--size-m: found a futsal court of 200 x 20 m",
    );
    refused(
        &[all, "--at", "0.0.0.0:7462"],
        "expected a loopback address",
    );
    let broken = light.folder.path("broken.toml");
    fs::write(
        &broken,
        "court = \"futsal\"\n[camera.north]\ncorner_nort_west = [1, 2]\n",
    )
    .unwrap();
    refused(&[all, "--out", broken.to_str().unwrap()], "broken.toml:3");
    fs::write(
        &broken,
        format!("court = \"futsal\"\n[camera.{name}]\ncentre = [99999, 2]\n"),
    )
    .unwrap();
    refused(
        &[all, "--out", broken.to_str().unwrap()],
        "expected a position in",
    );
    refused(
        &[
            all,
            "--court",
            "handball",
            "--out",
            broken.to_str().unwrap(),
        ],
        "found the court `futsal`",
    );
}
