//! What a delay is worth: live, smoothed with 50, 100 and 200 ms, and in two passes, over the same maps.
//!
//! ```text
//! cargo run --release -p farfield-lab --example delays -- [SECONDS] [--cuts EVERY_S LASTS_S [--late TICKS]]
//!     SCENE...
//! ```
//!
//! SCENE is the name of an embedded scene. With `--cuts` fusion hears nothing for `LASTS_S` in every
//! `EVERY_S`, and with `--late` so many ticks later after all; `in cuts` and `worst` are mean and largest error of a person at those ticks.

use std::sync::Arc;

use anyhow::Context as _;
use farfield_lab::conditions::Cuts;
use farfield_lab::suite::overrides::parameters;
use farfield_lab::suite::run::{Plan, SceneRun};
use farfield_lab::suite::smoothed::{HEAD, Worth};
use farfield_lab::suite::venue::Input;
use farfield_score::lines::Recording;
use farfield_sim::embedded;

/// What is compared, the live output first.
const OUTPUTS: [&str; 5] = ["live", "50 ms", "100 ms", "200 ms", "two passes"];

struct Args {
    seconds: f64,
    cuts_s: Option<[f64; 2]>,
    late: Option<i64>,
    scenes: Vec<String>,
}

fn args() -> anyhow::Result<Args> {
    let mut given = std::env::args().skip(1);
    let mut args = Args {
        seconds: 5.0,
        cuts_s: None,
        late: None,
        scenes: Vec::new(),
    };
    while let Some(arg) = given.next() {
        if arg == "--cuts" {
            let mut number = || -> anyhow::Result<f64> {
                Ok(given.next().context("--cuts needs two numbers")?.parse()?)
            };
            args.cuts_s = Some([number()?, number()?]);
        } else if arg == "--late" {
            args.late = Some(given.next().context("--late needs ticks")?.parse()?);
        } else if let Ok(seconds) = arg.parse() {
            args.seconds = seconds;
        } else {
            args.scenes.push(arg);
        }
    }
    Ok(args)
}

fn plans(cuts: Option<Cuts>) -> anyhow::Result<[Plan; 4]> {
    let plan = |delay_ms: u32| -> anyhow::Result<Plan> {
        let parameters = parameters(&format!("smoothing.delay_ms = {delay_ms}.0"))?;
        Ok(Plan {
            cuts,
            ..Plan::with(parameters)
        })
    };
    let two_passes = Plan {
        two_passes: true,
        ..plan(0)?
    };
    Ok([plan(50)?, plan(100)?, plan(200)?, two_passes])
}

fn main() -> anyhow::Result<()> {
    let args = args()?;
    for head in HEAD {
        println!("{:27} {head}", "");
    }
    let mut sums = [[0.0; 2]; OUTPUTS.len()];
    for name in &args.scenes {
        let scene = Arc::new(embedded::scene(name)?.shortened(args.seconds));
        let cuts = args.cuts_s.map(|seconds| {
            let [every, lasts] = seconds.map(|s| (s * scene.rate_hz()).round() as i64);
            let late = args.late;
            Cuts { every, lasts, late }
        });
        let runs = SceneRun::make_all(&scene, &Input::Maps, plans(cuts)?)?;
        let live = std::iter::once((&runs[0], &runs[0].causal));
        let outputs = live.chain(runs.iter().map(|run| (run, &run.smoothed)));
        let named: Vec<(&str, (&SceneRun, &Recording))> =
            OUTPUTS.into_iter().zip(outputs).collect();
        for ((output, (run, poses)), sum) in named.into_iter().zip(&mut sums) {
            let worth = Worth::of(run, poses, cuts);
            sum[0] += worth.mean.mpjpe_mm.unwrap_or(f64::NAN);
            sum[1] += worth.mean.jitter_m_s3.unwrap_or(f64::NAN);
            println!("{name:>16} {output:>10} {worth}");
        }
    }
    let n = args.scenes.len() as f64;
    for (output, [mpjpe_mm, jitter]) in OUTPUTS.iter().zip(sums.map(|sum| sum.map(|s| s / n))) {
        let name = "mean";
        println!(
            "{name:>16} {output:>10} {mpjpe_mm:7.2} {:7} {jitter:7.0}",
            ""
        );
    }
    Ok(())
}
