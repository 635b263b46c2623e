//! Thumbnails of cameras: on the page if the venue allows them, and never in a recording.

use std::fmt::Write as _;
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use farfield_node::clock;
use farfield_sim::embedded;
use image::{Rgb, RgbImage};

use crate::farfield::{command, finish};

const RATE_HZ: u32 = 10;
const SECONDS: u32 = 12;
const CAMERAS: [&str; 2] = ["a", "b"];
/// A person given by the venue, since the images are noise.
const PERSON: &str = "[[person]]\ntick = 0\nkeypoints_m = { left_shoulder = [0.1, 0.2, 1.4], right_shoulder = [-0.2, 0.2, 1.4], left_hip = [0.05, 0.2, 0.95], right_hip = [-0.15, 0.2, 0.95], nose = [-0.05, 0.3, 1.65] }\n";
/// Far above what a loaded machine takes for a run of this length.
const PATIENCE: Duration = Duration::from_mins(3);

/// Writes a venue of two cameras that show noise; `more` is added to its head.
fn venue(folder: &Path, more: &str) {
    let (mut calibration, mut viewpoints) = (String::new(), String::new());
    for (name, x) in CAMERAS.into_iter().zip([-2.0, 2.0]) {
        let pictures = folder.join(name);
        std::fs::create_dir(&pictures).unwrap();
        for tick in 0..RATE_HZ * SECONDS {
            let bright = |x, y| (tick * 31 + x * y + u32::from(name.as_bytes()[0])) as u8;
            let picture = RgbImage::from_fn(160, 120, |x, y| Rgb([bright(x, y), x as u8, 90]));
            picture
                .save(pictures.join(format!("{tick:06}.png")))
                .unwrap();
        }
        write!(
            calibration,
            "[{name}]\nname = \"{name}\"\nsize = [160, 120]\nmatrix = [[150.0, 0.0, 79.5], [0.0, 150.0, 59.5], [0.0, 0.0, 1.0]]\n\
             distortions = [0.0, 0.0, 0.0, 0.0, 0.0]\nrotation = [1.5707963, 0.0, 0.0]\ntranslation = [{x}, 1.0, 5.0]\n"
        )
        .unwrap();
        write!(
            viewpoints,
            "[[viewpoint]]\nname = \"{name}\"\n[[viewpoint.camera]]\nname = \"{name}\"\n\
             source = {{ kind = \"images\", path = \"{name}/%06d.png\" }}\n"
        )
        .unwrap();
    }
    let card = embedded::write_network(&folder.join("models")).unwrap();
    std::fs::write(folder.join("calibration.toml"), calibration).unwrap();
    let text = format!(
        "name = \"hall\"\nrate_hz = {RATE_HZ}.0\ncalibration = \"calibration.toml\"\nnetwork = \"models/{card}\"\n{more}\
         [field]\nmin_m = [-5.0, -5.0, -0.3]\nmax_m = [5.0, 5.0, 2.6]\n{viewpoints}{PERSON}"
    );
    std::fs::write(folder.join("venue.toml"), text).unwrap();
}

/// The body of an answer with status 200; `None` otherwise.
fn get(page: SocketAddr, path: &str) -> Option<Vec<u8>> {
    let mut stream = TcpStream::connect(page).ok()?;
    let request = format!("GET {path} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).ok()?;
    let body = answer.windows(4).position(|end| end == b"\r\n\r\n")? + 4;
    answer
        .starts_with(b"HTTP/1.1 200")
        .then(|| answer.split_off(body))
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

/// Results of a live run with a page and a recording.
struct PageRun {
    /// All thumbnails of all cameras.
    pictures: Vec<Vec<u8>>,
    /// The page's answer about the venue.
    venue: String,
    recording: Vec<u8>,
}

fn run_with_page(more: &str) -> PageRun {
    let folder = tempfile::tempdir().unwrap();
    venue(folder.path(), more);
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let page = free.local_addr().unwrap();
    drop(free);
    let out = folder.path().join("out");
    let mut run = command();
    run.arg("run").arg(folder.path().join("venue.toml"));
    run.args(["--live", "--record", &format!("--page={page}"), "--out"])
        .arg(&out);
    let mut child = run
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut pictures, mut venue) = (Vec::new(), String::new());
    let begun = clock::now();
    while child.try_wait().unwrap().is_none() {
        assert!(begun.elapsed() < PATIENCE, "the run does not end");
        for camera in 0..CAMERAS.len() {
            pictures.extend(get(page, &format!("/api/thumbnail/{camera}")));
        }
        if let Some(answer) = get(page, "/api/venue") {
            venue = String::from_utf8(answer).unwrap();
        }
        std::thread::sleep(Duration::from_millis(300));
    }
    let finished = finish(&child.wait_with_output().unwrap());
    assert_eq!(finished.code, 0, "{}", finished.stderr);
    PageRun {
        pictures,
        venue,
        recording: std::fs::read(out.join("recording.mcap")).unwrap(),
    }
}

#[test]
fn allowed_thumbnails_are_on_the_page_and_in_no_recording() {
    let page = run_with_page("[security]\npictures = true\n");
    assert!(page.venue.contains("\"pictures\":true"), "{}", page.venue);
    let first = page.pictures.first().expect("no thumbnail on the page");
    let shown = image::load_from_memory(first).unwrap();
    // Noise takes many bytes, and an unmeasured link may have little bandwidth.
    assert!([112, 160].contains(&shown.width()) && 3 * shown.width() == 4 * shown.height());
    assert!(
        page.pictures.iter().any(|other| other != first),
        "always the same"
    );
    assert!(contains(&page.recording, b"hall/patch/a"));
    assert!(!contains(&page.recording, b"hall/thumbnail"));
    for picture in &page.pictures {
        let scan = &picture[picture.len() - 200..];
        assert!(!contains(&page.recording, scan), "a picture is recorded");
    }
}

#[test]
fn the_page_has_no_thumbnails_by_default() {
    let page = run_with_page("");
    assert!(page.venue.contains("\"pictures\":false"), "{}", page.venue);
    assert!(page.pictures.is_empty());
    assert!(contains(&page.recording, b"hall/patch/a"));
}
