//! Delays from the capture of pictures to their poses, in a few histograms.

use farfield_node::histogram::Histogram;
use farfield_proto::message::StageTime;
use farfield_proto::venue::Venue;

use farfield_fusion::live::Micros;
use farfield_fusion::live::edge::Trip;

/// From capturing a tick's pictures to sending its poses.
pub(super) const CAPTURE_TO_POSE: &str = "capture_to_pose";
/// From receiving the last message of a tick to sending its poses.
const POSE_OUT: &str = "pose_out";
/// From capturing pictures to sending their patches.
const PATCH_SENT: &str = "patch_sent";
/// From sending patches to receiving them.
const PATCH_ARRIVED: &str = "patch_arrived";
/// From sending boxes to sending the patches made with them.
const BOX_USED: &str = "box_used";

/// Delays of one edge's messages.
#[derive(Debug, Default)]
struct Paths {
    name: String,
    patch_sent: Histogram,
    patch_arrived: Histogram,
    box_used: Histogram,
}

/// All delays of a run.
#[derive(Debug, Default)]
pub(super) struct Delays {
    capture_to_pose: Histogram,
    /// The same since the last [`Delays::take_recent`].
    recent: Histogram,
    pose_out: Histogram,
    edges: Vec<Paths>,
}

/// Delay of the poses of the last second, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Recent {
    pub(super) p50_us: u32,
    pub(super) p99_us: u32,
}

impl Delays {
    pub(super) fn new(venue: &Venue) -> Self {
        let paths = |name: &String| Paths {
            name: name.clone(),
            ..Paths::default()
        };
        Self {
            edges: venue.viewpoints.iter().map(|v| paths(&v.name)).collect(),
            ..Self::default()
        }
    }

    /// Adds the trip of a patch set from the viewpoint of this index.
    pub(super) fn trip(&mut self, index: usize, trip: Trip) {
        let Some(paths) = self.edges.get_mut(index) else {
            return;
        };
        let all = [
            (&mut paths.patch_sent, trip.sent_us),
            (&mut paths.patch_arrived, trip.arrived_us),
            (&mut paths.box_used, trip.box_used_us),
        ];
        for (histogram, us) in all {
            if let Some(us) = us {
                histogram.record(us);
            }
        }
    }

    /// Adds poses that are sent at `now_us`: captured at `captured_us`, with the last message received at `arrived_us`.
    pub(super) fn pose(&mut self, captured_us: Micros, arrived_us: Option<Micros>, now_us: Micros) {
        let span = |from_us: Micros| u32::try_from((now_us - from_us).max(0)).unwrap_or(u32::MAX);
        self.capture_to_pose.record(span(captured_us));
        self.recent.record(span(captured_us));
        if let Some(us) = arrived_us {
            self.pose_out.record(span(us));
        }
    }

    /// Delay of the poses since the last call.
    pub(super) fn take_recent(&mut self) -> Option<Recent> {
        let recent = Recent {
            p50_us: self.recent.quantile(0.5)?,
            p99_us: self.recent.quantile(0.99)?,
        };
        self.recent.clear();
        Some(recent)
    }

    /// Fusion's own delays.
    pub(super) fn own(&self) -> Vec<StageTime> {
        let own = [
            self.capture_to_pose.stage_time(CAPTURE_TO_POSE),
            self.pose_out.stage_time(POSE_OUT),
        ];
        own.into_iter().flatten().collect()
    }

    /// Delays of all edges together, few enough for a status.
    pub(super) fn all_edges(&self) -> Vec<StageTime> {
        let all = |stage: &str, histogram: fn(&Paths) -> &Histogram| {
            let mut sum = Histogram::default();
            self.edges
                .iter()
                .for_each(|paths| sum.merge(histogram(paths)));
            sum.stage_time(stage)
        };
        let all = [
            all(PATCH_SENT, |paths| &paths.patch_sent),
            all(PATCH_ARRIVED, |paths| &paths.patch_arrived),
            all(BOX_USED, |paths| &paths.box_used),
        ];
        all.into_iter().flatten().collect()
    }

    /// Describes the largest delays: those of the edge whose patches come last, and of the core.
    pub(super) fn largest_in_words(&self) -> String {
        const USUALLY: f64 = 0.98;
        let ms = |us: u32| f64::from(us) / 1e3;
        let slowest = self.edges.iter().filter_map(|paths| {
            let made = paths.patch_sent.quantile(USUALLY)?;
            let travelled = paths.patch_arrived.quantile(USUALLY).unwrap_or(0);
            Some((made.saturating_add(travelled), made, travelled, &paths.name))
        });
        let core = ms(self.pose_out.quantile(USUALLY).unwrap_or(0));
        slowest.max().map_or_else(
            || format!("fusion takes {core:.0} ms from the last patch to the poses"),
            |(_, made, travelled, name)| {
                format!(
                    "patches of viewpoint {name} take {:.0} ms to make and {:.0} ms to travel, fusion takes {core:.0} ms",
                    ms(made),
                    ms(travelled)
                )
            },
        )
    }

    /// Delays of every edge, with the viewpoint's name.
    pub(super) fn by_edge(&self) -> impl Iterator<Item = (&str, StageTime)> {
        self.edges.iter().flat_map(|paths| {
            let all = [
                paths.patch_sent.stage_time(PATCH_SENT),
                paths.patch_arrived.stage_time(PATCH_ARRIVED),
                paths.box_used.stage_time(BOX_USED),
            ];
            let name = paths.name.as_str();
            all.into_iter().flatten().map(move |time| (name, time))
        })
    }
}
