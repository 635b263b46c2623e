//! Everything that a run can be refused for, before a process starts or a file is made.

use std::ops::Range;
use std::path::PathBuf;

use anyhow::anyhow;
use farfield_edge::node::{Networks, load_networks, probe_sources};
use farfield_edge::source::common_ticks;
use farfield_fusion::node::{
    NodeError, check_folder, check_given_keypoints, check_given_ticks, check_names, load_card,
};
use farfield_proto::tick::Tick;
use farfield_proto::venue::Venue;
use farfield_testbed::simulated::VenueSources;

use crate::cli::{RunArgs, TickList};

/// A run that nothing speaks against.
pub(crate) struct Plan {
    pub(crate) venue_path: PathBuf,
    pub(crate) venue: Venue,
    /// How its sources are opened.
    pub(crate) sources: VenueSources,
    pub(crate) ticks: Range<Tick>,
    /// Where the results shall go, if anyone said so.
    pub(crate) out: Option<PathBuf>,
    /// The ticks to draw, if any shall be drawn; in order.
    pub(crate) overlay: Vec<Tick>,
}

/// Reads the venue, probes every source and loads every network once: the edges will load them for
/// themselves.
pub(crate) fn check(args: RunArgs) -> Result<(Plan, Networks), NodeError> {
    let venue = Venue::load(&args.venue).map_err(NodeError::refused)?;
    let sources = VenueSources::default();
    check_names(&venue).map_err(NodeError::Refused)?;
    if let Some(out) = &args.out {
        check_folder(out).map_err(NodeError::Refused)?;
    }
    let infos = probe_sources(&sources, &venue, &venue.cameras).map_err(NodeError::refused)?;
    let ticks = common_ticks(&infos, args.ticks).map_err(NodeError::refused)?;
    check_given_ticks(&venue, &args.venue, &ticks).map_err(NodeError::refused)?;
    let overlay = args
        .overlay
        .map_or(Ok(Vec::new()), |asked| overlay_ticks(asked, &ticks))?;
    let networks = load_networks(&venue, &venue.cameras).map_err(NodeError::refused)?;
    let card = load_card(&venue).map_err(NodeError::Refused)?;
    check_given_keypoints(&venue, &args.venue, card.as_ref()).map_err(NodeError::refused)?;
    let plan = Plan {
        venue_path: args.venue,
        venue,
        sources,
        ticks,
        out: args.out,
        overlay,
    };
    Ok((plan, networks))
}

fn overlay_ticks(asked: Option<TickList>, ticks: &Range<Tick>) -> Result<Vec<Tick>, NodeError> {
    let middle = ticks.start + (ticks.end - ticks.start) / 2;
    let mut drawn = asked.map_or_else(|| vec![middle], |list| list.0);
    drawn.sort_unstable();
    drawn.dedup();
    if let Some(tick) = drawn.iter().find(|tick| !ticks.contains(tick)) {
        return Err(NodeError::Refused(anyhow!(
            "`--overlay` {tick} is outside the ticks of the run, {}..{}",
            ticks.start,
            ticks.end
        )));
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
