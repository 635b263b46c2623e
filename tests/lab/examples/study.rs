//! One scene with changed parameters: a line of figures, and where the error comes from.
//!
//! ```text
//! cargo run -p farfield-lab --example study -- SCENE [SECONDS] [--set [tuning.]TABLE.FIELD=VALUE]...
//!     [--faults none] [--rate HZ] [--no-dlt] [--actors] [--two-passes] [--sureness]
//!     [--ahead TICKS] [--loss SHARE] [--seed N]
//! ```
//!
//! `--ahead` and `--loss` put links between edges and fusion over which boxes are used that many ticks after
//! the one that made them, and that lose that share of the messages each way.
//! SCENE is a scene file or the name of an embedded scene; VALUE is TOML. Columns of the budget:
//! `predict` prediction to site, `p99.9` half width of the lattice that would hold 99.9 % of the
//! prediction errors, `lost%` without support, `lattice` to site, `IK1`, `filter`, `IK2` to joint,
//! `IK2site` to site, `const` the part of IK2 that is constant in the axes of the pelvis, `along*`
//! signed error along the motion (minus is behind), `DLT` to site without a filter, `def` joint to
//! site.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, bail};
use farfield_lab::conditions::FarLinks;
use farfield_lab::suite::budget::Budget;
use farfield_lab::suite::overrides::parameters;
use farfield_lab::suite::report::Baseline;
use farfield_lab::suite::run::{Plan, SceneRun};
use farfield_lab::suite::venue::Input;
use farfield_score::table;
use farfield_sim::embedded;
use farfield_sim::faults::FaultProfile;
use farfield_sim::scene::Scene;

#[expect(clippy::struct_excessive_bools, reason = "the flags of a command line")]
struct Args {
    scene: String,
    seconds: Option<f64>,
    overrides: String,
    faultless: bool,
    rate_hz: Option<f64>,
    dlt: bool,
    actors: bool,
    two_passes: bool,
    sureness: bool,
    links: FarLinks,
}

fn args() -> anyhow::Result<Args> {
    let mut given = std::env::args().skip(1);
    let mut args = Args {
        scene: given.next().context("SCENE is missing")?,
        seconds: None,
        overrides: String::new(),
        faultless: false,
        rate_hz: None,
        dlt: true,
        actors: false,
        two_passes: false,
        sureness: false,
        links: FarLinks::default(),
    };
    while let Some(arg) = given.next() {
        let mut value = || given.next().with_context(|| format!("{arg} needs a value"));
        match arg.as_str() {
            "--set" => {
                args.overrides.push_str(&value()?);
                args.overrides.push('\n');
            }
            "--faults" if value()? == "none" => args.faultless = true,
            "--rate" => args.rate_hz = Some(value()?.parse()?),
            "--no-dlt" => args.dlt = false,
            "--two-passes" => args.two_passes = true,
            "--sureness" => args.sureness = true,
            "--ahead" => args.links.ahead = value()?.parse()?,
            "--loss" => args.links.loss = value()?.parse()?,
            "--seed" => args.links.seed = value()?.parse()?,
            "--actors" => args.actors = true,
            seconds => match seconds.parse() {
                Ok(seconds) => args.seconds = Some(seconds),
                Err(_) => bail!("`{seconds}` is not known"),
            },
        }
    }
    Ok(args)
}

fn main() -> anyhow::Result<()> {
    let args = args()?;
    let mut scene = if Path::new(&args.scene).exists() {
        Scene::load(Path::new(&args.scene))?
    } else {
        embedded::scene(&args.scene)?
    };
    if let Some(seconds) = args.seconds {
        scene = scene.shortened(seconds);
    }
    if let Some(rate_hz) = args.rate_hz {
        scene = scene.with_rate(rate_hz);
    }
    if args.faultless {
        scene = scene.with_faults(FaultProfile::none());
    }
    let plan = Plan {
        parameters: parameters(&args.overrides)?,
        keep_peaks: args.dlt,
        keep_stages: true,
        cuts: None,
        links: args.links,
        two_passes: args.two_passes,
        stand_in: None,
    };
    let run = SceneRun::make(&Arc::new(scene), &Input::Maps, plan)?;
    let found = run.found();
    let scores = run.score(&run.causal, &found);
    let mut sureness = vec![("ours", scores.calibration.clone())];
    println!("{}", table::head(10));
    if args.actors {
        for (actor, score) in &scores.actors {
            println!("{}", table::line(10, &actor.to_string(), &score.row()));
        }
    }
    println!("{}", table::line(10, "ours", &scores.mean.row()));
    if run.smoothed.ticks().next().is_some() {
        let smoothed = run.score(&run.smoothed, &found);
        println!("{}", table::line(10, "smoothed", &smoothed.mean.row()));
        sureness.push(("smoothed", smoothed.calibration));
    }
    if args.dlt {
        let baseline = Baseline::best(&run, &found);
        let name = format!("DLT {} Hz", baseline.cutoff_hz);
        println!("{}", table::line(10, &name, &baseline.scores.mean.row()));
    }
    println!("{}", scores.identity_line());
    for (name, calibration) in sureness {
        if let Some(calibration) = calibration.filter(|_| args.sureness) {
            println!("{name}: {calibration}");
        }
    }
    println!("{}", Budget::of(&run));
    Ok(())
}
