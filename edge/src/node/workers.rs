//! The number of workers of the network: more are added while they increase the speed on this
//! machine.

use std::time::Duration;

use farfield_node::clock;

use crate::inference::NetworkError;
use crate::pipeline::Batch;

/// Smallest gain of one more worker; less is not worth its memory.
const GAIN: f64 = 1.15;
/// Duration of a trial per number of workers, and most crops per worker in it.
const TRIAL: Duration = Duration::from_millis(150);
const MOST_CROPS: usize = 16;

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

/// Measures `batch` with its current number of workers.
fn measured(batch: &mut Batch, workers: usize) -> Result<Workers, NetworkError> {
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
    let crops = workers * rounds.clamp(1, MOST_CROPS);
    Ok(Workers {
        workers,
        crops_per_s: crops as f64 / took_s(batch, crops)?,
    })
}

/// Time of `batch` for this number of crops, seconds.
pub(super) fn took_s(batch: &mut Batch, crops: usize) -> Result<f64, NetworkError> {
    let start = clock::now();
    batch.rehearse(crops)?;
    Ok(clock::now().duration_since(start).as_secs_f64().max(1e-6))
}
