//! Streams people who walk in circles, to try receivers without cameras:
//!
//! ```text
//! cargo run -p farfield-streams --example synthetic -- [--people 8] [--seconds 20] [--truth FILE] qtm vmc=127.0.0.1:39539
//! ```
//!
//! `--truth` writes the poses of all people at every tick of the motion's period, and the time of
//! tick 0, for `tests/readers/streams.py`.

use std::error::Error;
use std::fs;
use std::path::PathBuf;
use std::time::{Duration, SystemTime};

use farfield_fusion::body::skeleton::{ANGLE_NAMES, Joint};
use farfield_streams::{StreamSpec, Streams, synthetic};
use tokio::time::{Instant, sleep_until};

/// Time between the start and tick 0, so that the truth is written first.
const LEAD: Duration = Duration::from_millis(500);

struct Arguments {
    people: u32,
    seconds: f64,
    truth: Option<PathBuf>,
    specs: Vec<StreamSpec>,
}

fn arguments() -> Result<Arguments, Box<dyn Error>> {
    let mut read = Arguments {
        people: 8,
        seconds: f64::INFINITY,
        truth: None,
        specs: Vec::new(),
    };
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        let mut value = || words.next().ok_or(format!("`{word}` without a value"));
        match word.as_str() {
            "--people" => read.people = value()?.parse()?,
            "--seconds" => read.seconds = value()?.parse()?,
            "--truth" => read.truth = Some(value()?.into()),
            _ => read.specs.push(word.parse()?),
        }
    }
    Ok(read)
}

/// The poses of all people in one period, and its start (seconds since 1970).
fn truth(people: u32, start_s: f64) -> serde_json::Value {
    let tick = |tick: i64| {
        let persons = synthetic::poses_at(people, tick).persons.into_iter();
        persons
            .map(|person| serde_json::json!({ "joints_m": person.joints_m, "angles": person.angles }))
            .collect::<Vec<_>>()
    };
    let names: Vec<&str> = Joint::ALL.iter().map(|joint| joint.name()).collect();
    let ticks: Vec<_> = (0..synthetic::PERIOD).map(tick).collect();
    serde_json::json!({
        "start_s": start_s, "rate_hz": synthetic::RATE_HZ, "joints": names, "angles": ANGLE_NAMES.as_slice(), "ticks": ticks,
        "cameras": synthetic::CAMERAS.as_slice(),
    })
}

#[tokio::main]
async fn main() -> Result<(), Box<dyn Error>> {
    let given = arguments()?;
    let streams = Streams::start(&given.specs, synthetic::facts()).await?;
    let start = Instant::now() + LEAD;
    let start_s = (SystemTime::now() + LEAD).duration_since(SystemTime::UNIX_EPOCH)?;
    if let Some(path) = &given.truth {
        let whole = path.with_extension("tmp");
        fs::write(
            &whole,
            truth(given.people, start_s.as_secs_f64()).to_string(),
        )?;
        fs::rename(whole, path)?;
    }
    // Time 0 of the streams is that of their first frame, which must not be replaced.
    streams.poses(synthetic::poses_at(given.people, 0));
    let mut tick = 0;
    while (tick as f64) < given.seconds * synthetic::RATE_HZ {
        let poses = synthetic::poses_at(given.people, tick);
        sleep_until(start + Duration::from_secs_f64(tick as f64 / synthetic::RATE_HZ)).await;
        streams.poses(poses);
        tick += 1;
    }
    for stream in streams.report() {
        println!("{stream:?}");
    }
    streams.stop().await;
    Ok(())
}
