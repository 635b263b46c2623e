//! `farfield calibrate marks`: people click corners, posts and lines in one image of each camera, in a browser. The
//! result is the file for `--marks`; every click is written at once.

mod desk;
mod fits;
mod pictures;

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use farfield_calibration::alignment::ClickedFile;
use farfield_node::log::start_log;
use farfield_node::process::{NodeError, say};
use farfield_page::server::ServerError;
use farfield_page::{Clicking, ClickingServer, ServerOptions};
use farfield_proto::court::Court;
use farfield_proto::toml_file::unknown_name;
use tokio_util::sync::CancellationToken;

use self::desk::{Desk, Found};
use self::pictures::MarkedPicture;
use super::lenses::{LensFile, lenses};
use super::read;
use crate::listeners::page_access::page_address;
use crate::signals::Signals;

/// Default port of the page, next to that of the live page.
const USUAL_PORT: u16 = 7462;

/// Arguments of `farfield calibrate marks`.
#[derive(Debug, Args)]
pub(super) struct MarksArgs {
    /// An image of each camera, such as north.png; or videos; or folders.
    ///
    /// JPEG or PNG with the name of the camera, as captured: in the size of the camera, not cut and not undistorted. Of
    /// a video the sharpest image within a second is used.
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// The court whose marks and lines are in the images: futsal, handball, ...
    #[arg(long, value_name = "NAME")]
    court: Option<String>,
    /// Length and width of the court, metres, if they are not the usual ones.
    #[arg(long, value_name = "LENGTHxWIDTH", value_parser = size_m, requires = "court", hide_short_help = true)]
    size_m: Option<[f64; 2]>,
    /// Output file for the clicks; an existing one is continued.
    #[arg(long, value_name = "FILE", default_value = "clicked.toml")]
    out: PathBuf,
    /// Lenses, in a calibration of any format: to draw the court over the images.
    ///
    /// FILE for the cameras in it, NAME=FILE for a camera of another name; can be repeated.
    #[arg(long, value_name = "[NAME=]FILE", visible_alias = "calibration")]
    lens: Vec<LensFile>,
    /// Second of a video from which to take the image.
    #[arg(
        long,
        value_name = "SECONDS",
        default_value_t = 0.0,
        hide_short_help = true
    )]
    from_s: f64,
    /// Address of the page, on this machine only.
    ///
    /// A loopback address and a port; default: 127.0.0.1:7462.
    #[arg(long, value_name = "ADDRESS", value_parser = page_address)]
    at: Option<SocketAddr>,
}

fn size_m(word: &str) -> Result<[f64; 2], String> {
    let found = word.split_once('x').and_then(|(length, width)| {
        let size = [length.trim().parse().ok()?, width.trim().parse().ok()?];
        size.iter().all(|m: &f64| m.is_finite()).then_some(size)
    });
    found.ok_or_else(|| {
        format!("found `{word}`, expected length and width in metres, for example 38x20")
    })
}

/// Serves the page until Ctrl-C.
///
/// # Errors
/// [`NodeError::Refused`] for invalid input, [`NodeError::Failed`] for errors of port or disk.
pub(super) fn click_marks(args: &MarksArgs) -> Result<(), NodeError> {
    start_log();
    let usual = SocketAddr::from(([127, 0, 0, 1], USUAL_PORT));
    let address = args.at.unwrap_or(usual);
    if !address.ip().is_loopback() {
        let problem = anyhow!(
            "--at: found {address}, expected a loopback address: images of the venue are served without keys; from another machine use \
             `ssh -L {USUAL_PORT}:127.0.0.1:{USUAL_PORT} HOST`"
        );
        return Err(NodeError::Refused(problem));
    }
    let desk = Arc::new(desk(args).map_err(NodeError::Refused)?);
    farfield_node::runtime::block_on(2, async {
        let mut signals = Signals::catch()
            .context("catching signals")
            .map_err(NodeError::Failed)?;
        let options = ServerOptions {
            address,
            ..ServerOptions::default()
        };
        let clicking = Arc::clone(&desk) as Arc<dyn Clicking>;
        let server = ClickingServer::bind(clicking, options).await;
        let server = server.map_err(|error| match error {
            ServerError::Listen { address, .. } => NodeError::Failed(anyhow!(
                "{error}: end the program that listens there, or use another address (--at 127.0.0.1:{})",
                address.port().wrapping_add(1)
            )),
            error => NodeError::refused(error),
        })?;
        say(format_args!("click the marks at: {}", server.url()));
        say(format_args!(
            "press Ctrl-C to stop; every click is written to {} at once",
            args.out.display()
        ));
        let stop = CancellationToken::new();
        let until = stop.clone();
        tokio::join!(server.serve(stop), async move {
            signals.next().await;
            until.cancel();
        });
        Ok(())
    })?;
    for line in desk.summary() {
        say(format_args!("{line}"));
    }
    Ok(())
}

fn desk(args: &MarksArgs) -> anyhow::Result<Desk> {
    let found = found(args)?;
    let pictures = pictures::read_all(&args.pictures, args.from_s)?;
    let lenses = lenses(&args.lens)?;
    let mut cameras = Vec::new();
    for picture in pictures {
        let lens = lenses.get(&picture.name);
        if lens.is_none() && !lenses.is_empty() {
            let has: Vec<&str> = lenses.keys().map(String::as_str).collect();
            say(format_args!(
                "camera {}: no lens (found those of {}), so nothing is drawn over its image; set it with --lens {}=FILE",
                picture.name,
                has.join(", "),
                picture.name
            ));
        }
        cameras.push(MarkedPicture::new(picture, lens)?);
    }
    if args.lens.is_empty() {
        say(format_args!(
            "without --lens nothing is drawn over the images, so wrong clicks are not visible"
        ));
    }
    Desk::new(args.out.clone(), found, cameras)
}

/// The earlier clicks, and the court.
fn found(args: &MarksArgs) -> anyhow::Result<Found> {
    if let Some(name) = &args.court
        && !Court::names().contains(&name.as_str())
    {
        bail!("--court: {}", unknown_name("court", name, &Court::names()));
    }
    let mut found = existing(&args.out)?;
    let clicked = &mut found.clicked;
    match (&args.court, &clicked.court) {
        (Some(requested), Some(has)) if requested != has => bail!(
            "{}: found the court `{has}`, expected `{requested}` as in --court: set another --out, or remove --court",
            args.out.display()
        ),
        (Some(_), Some(_)) if args.size_m.is_some() && args.size_m != clicked.size_m => bail!(
            "{}: found {}, expected the size of --size-m: set another --out, or remove --size-m",
            args.out.display(),
            clicked
                .size_m
                .map_or("a court of the usual size".to_owned(), |[l, w]| format!(
                    "a court of {l} x {w} m"
                ))
        ),
        (Some(requested), None) => {
            clicked.court = Some(requested.clone());
            clicked.size_m = args.size_m;
        }
        _ => {}
    }
    let problem = |problem: String| anyhow!("--size-m: {problem}");
    found.court = found.clicked.court().map_err(problem)?;
    if found.court.is_none() {
        say(format_args!(
            "without --court there are no named marks and lines: choose one of {}",
            Court::names().join(", ")
        ));
    }
    Ok(found)
}

fn existing(path: &Path) -> anyhow::Result<Found> {
    if !path.exists() {
        return Ok(Found::default());
    }
    let text = read(path)?.text;
    let clicked = ClickedFile::parse(&text, path)?;
    let clicks: usize = clicked
        .camera
        .values()
        .flat_map(|own| own.values().map(Vec::len))
        .sum();
    say(format_args!(
        "{}: found {clicks} earlier clicks",
        path.display()
    ));
    Ok(Found {
        clicked,
        text: Some(text),
        court: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_parsed_or_refused() {
        assert_eq!(size_m("38x20.5"), Ok([38.0, 20.5]));
        for wrong in ["38", "38x", "axb", "infx20"] {
            let error = size_m(wrong).unwrap_err();
            assert!(error.contains("38x20"), "{error}");
        }
    }
}
