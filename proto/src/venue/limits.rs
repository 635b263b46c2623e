//! Limits of ticks and coordinates in venue files.

use crate::tick::Tick;
use crate::toml_file::{FileError, Place, TomlFile};

/// Largest coordinate, world, metres.
pub(super) const MAX_COORDINATE_M: f64 = 1e4;
/// Ticks farther from zero have no exact time in seconds.
const MAX_TICK: i64 = 1 << 53;

/// The `tick` at `place`.
///
/// # Errors
/// [`FileError`] when it is too far from zero.
pub(super) fn tick(file: &TomlFile<'_>, place: &Place, tick: i64) -> Result<Tick, FileError> {
    if (-MAX_TICK..=MAX_TICK).contains(&tick) {
        return Ok(Tick(tick));
    }
    let problem = format!(
        "found {tick}, expected a tick from {} to {MAX_TICK}",
        -MAX_TICK
    );
    Err(file.error(place, problem))
}
