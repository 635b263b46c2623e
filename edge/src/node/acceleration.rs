//! Choice of the number of workers of the network, and of an accelerator.
//!
//! Workers are added while they increase the speed on this machine. Each accelerator is tried with
//! the real network, its maps are compared with the CPU's, and it is used if it is faster.

use std::path::Path;
use std::time::Duration;

use farfield_node::clock;
use farfield_proto::venue::Provider;

use crate::inference::{InputTensor, KeypointNetwork, NetworkError};
use crate::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use crate::pipeline::Batch;

/// Largest difference from the CPU's maps, whose peaks are about 1. At half precision networks
/// differ by some thousandths.
const MAX_DIFFERENCE: f32 = 0.02;
/// Crops per timed round, and number of rounds. A viewpoint of a team game sees about as many
/// people.
const CROPS: usize = 16;
const ROUNDS: usize = 3;

/// Result of the choice.
#[derive(Debug, Clone, PartialEq)]
pub struct Acceleration {
    /// The provider that runs the network.
    pub provider: Provider,
    /// Its speed and number of workers.
    pub workers: Workers,
    /// Largest difference of its maps from the CPU's.
    pub difference: f32,
    /// Why earlier providers are not used.
    pub refused: Vec<String>,
}

/// Finds the best number of workers for `batch`. Then replaces them by the first of `providers`
/// that can run the network of `card`, gives the CPU's maps, and is faster.
///
/// # Errors
/// If the CPU cannot run the network.
pub fn accelerate(
    batch: &mut Batch,
    card: &Path,
    providers: &[Provider],
) -> Result<Acceleration, NetworkError> {
    let found = find_workers(batch)?;
    let processor = found.last().copied().unwrap_or(Workers {
        workers: 1,
        crops_per_s: 0.0,
    });
    let mut refused = Vec::new();
    let others = providers.iter().take_while(|it| **it != Provider::Cpu);
    for &provider in others {
        match try_provider(batch, card, provider, processor) {
            Ok(Ok((crops_per_s, difference))) => {
                return Ok(Acceleration {
                    provider,
                    workers: Workers {
                        workers: 1,
                        crops_per_s,
                    },
                    difference,
                    refused,
                });
            }
            Ok(Err(why)) => refused.push(format!("{} {why}", provider.name())),
            Err(error) => refused.push(format!("{} cannot be used: {error}", provider.name())),
        }
        batch.accelerate(None);
    }
    Ok(Acceleration {
        provider: Provider::Cpu,
        workers: processor,
        difference: 0.0,
        refused,
    })
}

/// Speed of `provider`, crops per second, and difference of its maps; or why it is not used.
fn try_provider(
    batch: &mut Batch,
    card: &Path,
    provider: Provider,
    processor: Workers,
) -> Result<Result<(f64, f32), String>, NetworkError> {
    if !InferenceBackend::start(BackendChoice::Best)?.has(provider) {
        return Ok(Err(
            "cannot be used: this library was built without it".to_owned()
        ));
    }
    let mut network = OnnxKeypointNetwork::load_on(card, provider)?;
    let difference = difference(&mut network, &mut OnnxKeypointNetwork::load(card)?)?;
    // NaN fails every comparison.
    let agrees = difference <= MAX_DIFFERENCE;
    if !agrees {
        return Ok(Err(format!(
            "is not used: its maps differ from the processor's by {difference:.3}, at most {MAX_DIFFERENCE} is allowed"
        )));
    }
    batch.accelerate(Some(Box::new(network)));
    let mut least_s = f64::INFINITY;
    // The first round also compiles and allocates buffers.
    for _ in 0..=ROUNDS {
        least_s = least_s.min(took_s(batch, CROPS)?);
    }
    let crops_per_s = CROPS as f64 / least_s;
    if crops_per_s <= processor.crops_per_s {
        return Ok(Err(format!(
            "is not used: {crops_per_s:.0} crops per second, {:.0} on the processor",
            processor.crops_per_s
        )));
    }
    Ok(Ok((crops_per_s, difference)))
}

/// Largest difference of the maps of both networks for a crop with content.
fn difference(
    network: &mut OnnxKeypointNetwork,
    processor: &mut OnnxKeypointNetwork,
) -> Result<f32, NetworkError> {
    let input = &network.card().input;
    let [width, height] = [input.width as usize, input.height as usize];
    let value = |i: usize| {
        let (x, y) = ((i % width) as f32, (i / width % height) as f32);
        (0.11 * x + i as f32 / (width * height) as f32).sin() * (0.07 * y).cos()
    };
    let inputs = [InputTensor {
        values: (0..3 * width * height).map(value).collect(),
    }];
    let (found, expected) = (network.infer(&inputs)?, processor.infer(&inputs)?);
    let apart = found.iter().zip(&expected).map(|(a, b)| (a - b).abs());
    Ok(apart.fold(0.0, f32::max))
}

impl Acceleration {
    /// Reports which provider runs the network, and why others do not; empty if no other was
    /// requested.
    pub fn describe(&self) -> String {
        let mut parts = self.refused.clone();
        if self.provider != Provider::Cpu {
            parts.push(format!(
                "{} runs the network: {:.0} crops per second, maps as the processor's to {:.4}",
                self.provider.name(),
                self.workers.crops_per_s,
                self.difference
            ));
        } else if !parts.is_empty() {
            parts.push("the processor runs the network".to_owned());
        }
        parts.join("; ")
    }
}

/// Smallest gain of one more worker; less is not worth its memory.
const GAIN: f64 = 1.15;
/// Duration of a trial per number of workers, and most crops per worker in it.
const TRIAL: Duration = Duration::from_millis(150);
const MAX_CROPS: usize = 16;

/// A number of workers and its speed.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Workers {
    /// Workers that run the network in parallel.
    pub workers: usize,
    /// Their total speed, crops per second.
    pub crops_per_s: f64,
}

/// Sets `batch` to the fastest number of workers, up to one per core. Returns the speed of each
/// number up to the chosen one, which is last.
///
/// # Errors
/// If the network fails or cannot be loaded again.
pub fn find_workers(batch: &mut Batch) -> Result<Vec<Workers>, NetworkError> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut found: Vec<Workers> = Vec::new();
    for workers in 1..=cores {
        if batch.set_workers(workers)? < workers {
            break;
        }
        let more = measure(batch, workers)?;
        let is_slower = |best: &Workers| more.crops_per_s < GAIN * best.crops_per_s;
        if found.last().is_some_and(is_slower) {
            break;
        }
        found.push(more);
    }
    batch.set_workers(found.len())?;
    Ok(found)
}

/// Measures `batch` with its current number of workers.
fn measure(batch: &mut Batch, workers: usize) -> Result<Workers, NetworkError> {
    // The first run of a network also allocates buffers, which matters little for long runs.
    let first_s = took_s(batch, workers)?;
    let round_s = if first_s > TRIAL.as_secs_f64() {
        first_s
    } else {
        took_s(batch, workers)?
    };
    if round_s > TRIAL.as_secs_f64() {
        return Ok(Workers {
            workers,
            crops_per_s: workers as f64 / round_s,
        });
    }
    let rounds = (TRIAL.as_secs_f64() / round_s) as usize;
    let crops = workers * rounds.clamp(1, MAX_CROPS);
    Ok(Workers {
        workers,
        crops_per_s: crops as f64 / took_s(batch, crops)?,
    })
}

/// Time of `batch` for this number of crops, seconds.
fn took_s(batch: &mut Batch, crops: usize) -> Result<f64, NetworkError> {
    let start = clock::now();
    batch.rehearse(crops)?;
    Ok(clock::now().duration_since(start).as_secs_f64().max(1e-6))
}
