//! How many workers run the network: as many as gain something on this computer, as it is.

use std::time::Duration;

use farfield_node::clock;

use crate::inference::NetworkError;
use crate::pipeline::Batch;

/// How much faster one worker more must make it: less is not worth its memory.
const GAIN: f64 = 1.15;
/// For how long each number of workers is tried, and the most crops that it is tried with for each worker.
const TRIAL: Duration = Duration::from_millis(150);
const MOST_CROPS: usize = 16;

/// So many workers, and what they do.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Workers {
    /// How many run the network at the same time.
    pub workers: usize,
    /// What they do together, crops per second.
    pub crops_per_s: f64,
}

/// Gives `batch` the number of workers that is fastest, up to one for each core; what each number does up to that one, which
/// is the last.
///
/// # Errors
/// When the network fails, or cannot be loaded again.
pub fn find_workers(batch: &mut Batch) -> Result<Vec<Workers>, NetworkError> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let mut found: Vec<Workers> = Vec::new();
    for workers in 1..=cores {
        if batch.set_workers(workers)? < workers {
            break;
        }
        let more = measured(batch, workers)?;
        let is_slower = |best: &Workers| more.crops_per_s < GAIN * best.crops_per_s;
        if found.last().is_some_and(is_slower) {
            break;
        }
        found.push(more);
    }
    batch.set_workers(found.len())?;
    Ok(found)
}

/// How fast `batch` is, which has so many workers.
fn measured(batch: &mut Batch, workers: usize) -> Result<Workers, NetworkError> {
    // The first run of a network also makes its buffers, which counts for little where a run takes long.
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
    let crops = workers * rounds.clamp(1, MOST_CROPS);
    Ok(Workers {
        workers,
        crops_per_s: crops as f64 / took_s(batch, crops)?,
    })
}

/// How long `batch` takes for so many crops, seconds.
pub(super) fn took_s(batch: &mut Batch, crops: usize) -> Result<f64, NetworkError> {
    let start = clock::now();
    batch.rehearse(crops)?;
    Ok(clock::now().duration_since(start).as_secs_f64().max(1e-6))
}
