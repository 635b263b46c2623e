//! How long everything takes, from the capture of pictures to the poses made of them, in the room of a few
//! histograms.

use farfield_node::histogram::Histogram;
use farfield_proto::message::StageTime;
use farfield_proto::venue::Venue;

use crate::live::Micros;
use crate::live::edge::Trip;

/// From the capture of a tick's pictures to its poses' sending.
pub(super) const CAPTURE_TO_POSE: &str = "capture_to_pose";
/// From the arrival of the last of a tick's messages to its poses' sending.
const POSE_OUT: &str = "pose_out";
/// From the capture of pictures to the sending of the patches made of them.
const PATCH_SENT: &str = "patch_sent";
/// From the sending of patches to their arrival.
const PATCH_ARRIVED: &str = "patch_arrived";
/// From the sending of boxes to the sending of the patches made with them.
const BOX_USED: &str = "box_used";

/// The paths of one edge's messages.
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
    /// The same, since it was last asked for.
    recent: Histogram,
    pose_out: Histogram,
    edges: Vec<Paths>,
}

/// The delay of the last second's poses, microseconds.
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

    /// A patch set has come from the viewpoint of this index.
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

    /// Poses go out at `now_us`: of pictures captured at `captured_us`, from messages of which the last came
    /// at `arrived_us`.
    pub(super) fn pose(&mut self, captured_us: Micros, arrived_us: Option<Micros>, now_us: Micros) {
        let span = |from_us: Micros| u32::try_from((now_us - from_us).max(0)).unwrap_or(u32::MAX);
        self.capture_to_pose.record(span(captured_us));
        self.recent.record(span(captured_us));
        if let Some(us) = arrived_us {
            self.pose_out.record(span(us));
        }
    }

    /// The delay of the poses since the last call.
    pub(super) fn take_recent(&mut self) -> Option<Recent> {
        let recent = Recent {
            p50_us: self.recent.quantile(0.5)?,
            p99_us: self.recent.quantile(0.99)?,
        };
        self.recent.clear();
        Some(recent)
    }

    /// Fusion's own.
    pub(super) fn own(&self) -> Vec<StageTime> {
        let own = [
            self.capture_to_pose.stage_time(CAPTURE_TO_POSE),
            self.pose_out.stage_time(POSE_OUT),
        ];
        own.into_iter().flatten().collect()
    }

    /// Those of all edges together, which a status has room for.
    pub(super) fn of_all_edges(&self) -> Vec<StageTime> {
        let all = |stage: &str, of: fn(&Paths) -> &Histogram| {
            let mut sum = Histogram::default();
            self.edges.iter().for_each(|paths| sum.merge(of(paths)));
            sum.stage_time(stage)
        };
        let all = [
            all(PATCH_SENT, |paths| &paths.patch_sent),
            all(PATCH_ARRIVED, |paths| &paths.patch_arrived),
            all(BOX_USED, |paths| &paths.box_used),
        ];
        all.into_iter().flatten().collect()
    }

    /// Of poses that are late, where the time goes, in words: the edge whose patches come last, and the core.
    pub(super) fn what_takes_longest(&self) -> String {
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
                    "of viewpoint {name} patches take {:.0} ms to make and {:.0} ms to travel, fusion takes {core:.0} ms",
                    ms(made),
                    ms(travelled)
                )
            },
        )
    }

    /// Those of every edge, by the viewpoint's name.
    pub(super) fn of_edges(&self) -> impl Iterator<Item = (&str, StageTime)> {
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
