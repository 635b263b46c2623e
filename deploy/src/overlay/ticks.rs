//! Of which ticks pictures are drawn.

use std::ops::Range;
use std::str::FromStr;

use anyhow::bail;
use farfield_proto::tick::Tick;

/// Ticks as the command line names them: numbers with commas between.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TickList(pub(crate) Vec<Tick>);

impl FromStr for TickList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let tick = |part: &str| {
            let number = part.trim().parse().map(Tick);
            number.map_err(|_| format!("`{part}` is not a tick, expected a number"))
        };
        text.split(',')
            .map(tick)
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

/// The ticks that are asked for, in order; without any the middle of those that there are.
///
/// # Errors
/// Names one that is not among them.
pub(crate) fn overlay_ticks(
    asked: Option<TickList>,
    ticks: &Range<Tick>,
) -> anyhow::Result<Vec<Tick>> {
    let middle = ticks.start + (ticks.end - ticks.start) / 2;
    let mut drawn = asked.map_or_else(|| vec![middle], |list| list.0);
    drawn.sort_unstable();
    drawn.dedup();
    let outside = drawn.iter().find(|tick| !ticks.contains(tick));
    if let Some(tick) = outside {
        bail!(
            "`--overlay` {tick} is outside the ticks of the run, {}..{}",
            ticks.start,
            ticks.end
        );
    }
    Ok(drawn)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_tick_is_drawn_unless_others_of_the_run_are_named() {
        let ticks = Tick(0)..Tick(120);
        let named = |named: &[i64]| TickList(named.iter().copied().map(Tick).collect());
        assert_eq!(overlay_ticks(None, &ticks).unwrap(), [Tick(60)]);
        assert_eq!(
            overlay_ticks(Some(named(&[119, 3, 3])), &ticks).unwrap(),
            [Tick(3), Tick(119)]
        );
        let error = overlay_ticks(Some(named(&[3, 120])), &ticks).unwrap_err();
        assert!(error.to_string().contains("120"), "{error}");
    }
}
