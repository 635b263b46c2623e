//! Whether something else than the processor runs the network: tried with the real network, held to the processor's maps, and
//! taken where it is faster.

use std::path::Path;

use farfield_proto::venue::Provider;

use super::workers::{Workers, find_workers, took_s};
use crate::inference::{InputTensor, KeypointNetwork, NetworkError};
use crate::network::{BackendChoice, InferenceBackend, OnnxKeypointNetwork};
use crate::pipeline::Batch;

/// How far a map may be from the processor's, of peaks of about 1: with half the digits networks are off by some thousandths.
const MOST_DIFFERENCE: f32 = 0.02;
/// Crops that it is timed with, and how many times: as many people as a viewpoint sees of a game.
const CROPS: usize = 16;
const ROUNDS: usize = 3;

/// What came of the providers of an edge.
#[derive(Debug, Clone, PartialEq)]
pub struct Acceleration {
    /// What runs the network.
    pub provider: Provider,
    /// How fast, and with how many workers.
    pub workers: Workers,
    /// By how much its maps differ from the processor's at most.
    pub difference: f32,
    /// Why those before it are not used.
    pub refused: Vec<String>,
}

/// Gives `batch` as many workers as gain something, and lets the first of `providers` run the network of `card` in their place that
/// can, gives the processor's maps, and is faster.
///
/// # Errors
/// When the processor cannot run the network.
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
        match tried(batch, card, provider, processor) {
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

/// What `provider` does, crops per second, and how far its maps are from the processor's; or why it is not used.
fn tried(
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
    let agrees = difference <= MOST_DIFFERENCE;
    if !agrees {
        return Ok(Err(format!(
            "is not used: its maps differ from the processor's by {difference:.3}, and {MOST_DIFFERENCE} is the most"
        )));
    }
    batch.accelerate(Some(Box::new(network)));
    let mut least_s = f64::INFINITY;
    // The first round also compiles and makes buffers.
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

/// By how much the maps of the two differ at most, for a crop with something in it.
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
    /// What runs the network, and why the others do not; empty where no other was asked for.
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
