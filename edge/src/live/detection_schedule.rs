//! When the detector runs, so that its result is ready at the detection pass.
//!
//! A run of the detector takes several ticks, and a different number on each edge. Fusion can only
//! combine sightings of one tick. Each edge therefore starts the detector before the pass, early
//! enough to finish in time. At the tick of the pass it only crops the detected people, so a pass
//! costs these crops, however slow the detector is.

use farfield_proto::id::CameraIndex;
use farfield_proto::tick::Tick;

use super::Micros;
use crate::inference::CameraDetections;

/// Safety margin for the duration of the next run, as a share.
const MARGIN: f64 = 0.25;
/// Share by which the duration of a long run decays with each later run.
const FORGOTTEN: f64 = 0.1;

/// The newest detections of each camera, and the time of the next run.
#[derive(Debug)]
pub struct DetectionSchedule {
    period_us: Micros,
    /// Duration of a run, microseconds: the longest of the recent ones.
    takes_us: f64,
    /// Detections with the tick of their pass.
    newest: Vec<(Tick, CameraDetections)>,
}

impl DetectionSchedule {
    /// A schedule without detections, for ticks `period_us` apart.
    pub fn new(period_us: Micros) -> Self {
        Self {
            period_us,
            takes_us: 0.0,
            newest: Vec::new(),
        }
    }

    /// Stores the detections for the pass at tick `pass`, of a run that took `took_us`.
    pub fn add(&mut self, pass: Tick, detections: Vec<CameraDetections>, took_us: Micros) {
        self.takes_us = (took_us as f64).max(self.takes_us * (1.0 - FORGOTTEN));
        for of_camera in detections {
            self.newest
                .retain(|(_, old)| old.camera != of_camera.camera);
            self.newest.push((pass, of_camera));
        }
    }

    /// Ticks between the pictures of a run and its end.
    fn lead_ticks(&self) -> i64 {
        let takes_us = self.takes_us * (1.0 + MARGIN);
        (takes_us / self.period_us as f64).ceil() as i64 + 1
    }

    /// Whether the detector must run on the pictures of `tick` for the next pass, at tick `pass`:
    /// there was no run for this pass, and a run on the next pictures would end too late. The edge
    /// processes every `nth` tick.
    pub fn is_due(&self, tick: Tick, pass: Tick, nth: i64) -> bool {
        let mut newest = self.newest.iter();
        let is_done =
            newest.any(|(of, detections)| *of == pass && self.is_recent(detections, pass));
        // The first run measures the duration.
        let is_late = self.newest.is_empty() || pass - tick < self.lead_ticks() + nth;
        is_late && !is_done
    }

    /// Whether detections are recent enough for `tick`. Within two durations the next run has
    /// ended.
    fn is_recent(&self, detections: &CameraDetections, tick: Tick) -> bool {
        tick - detections.tick <= 2 * self.lead_ticks()
    }

    /// The detections of `cameras` for the pass at `tick`; `None` if a camera has no recent ones.
    pub fn for_pass(&self, tick: Tick, cameras: &[CameraIndex]) -> Option<Vec<CameraDetections>> {
        let of_camera = |camera: &CameraIndex| {
            let mut newest = self.newest.iter().map(|(_, detections)| detections);
            newest
                .find(|it| it.camera == *camera && self.is_recent(it, tick))
                .cloned()
        };
        cameras.iter().map(of_camera).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_US: Micros = 10_000;

    fn add(schedule: &mut DetectionSchedule, tick: i64, cameras: &[u16], took_ticks: i64) {
        let no_people = |&camera: &u16| CameraDetections {
            camera: CameraIndex(camera),
            tick: Tick(tick),
            people: Vec::new(),
        };
        let found = cameras.iter().map(no_people).collect();
        schedule.add(next_pass(Tick(tick)), found, took_ticks * PERIOD_US);
    }

    fn next_pass(tick: Tick) -> Tick {
        Tick(tick.0.div_euclid(100) * 100 + 100)
    }

    /// The age in ticks of the detections used at every hundredth tick. A run takes `took_ticks`;
    /// the edge processes every `nth` tick.
    fn ages(took_ticks: i64, nth: i64) -> Vec<Option<i64>> {
        let mut schedule = DetectionSchedule::new(PERIOD_US);
        let mut busy: Option<Tick> = None;
        let mut ages = Vec::new();
        for tick in (0..2_000).map(|n| Tick(n * nth)) {
            if let Some(begun) = busy.filter(|begun| tick - *begun >= took_ticks) {
                add(&mut schedule, begun.0, &[0], took_ticks);
                busy = None;
            }
            if tick.0 % 100 == 0 {
                let recent = schedule.for_pass(tick, &[CameraIndex(0)]);
                ages.push(recent.map(|detections| tick - detections[0].tick));
            }
            if busy.is_none() && schedule.is_due(tick, next_pass(tick), nth) {
                busy = Some(tick);
            }
        }
        ages
    }

    #[test]
    fn a_run_of_the_detector_ends_just_before_its_pass() {
        for (took_ticks, nth, oldest) in
            [(1, 1, 3), (6, 1, 9), (60, 1, 76), (6, 4, 12), (60, 4, 80)]
        {
            let ages = ages(took_ticks, nth);
            let late = ages
                .iter()
                .skip(2)
                .filter(|age| age.is_none_or(|age| age > oldest));
            assert_eq!(late.count(), 0, "{took_ticks} of every {nth}: {ages:?}");
        }
    }

    #[test]
    fn a_detector_slower_than_the_passes_runs_all_the_time() {
        let ages = ages(150, 1);
        assert!(ages.iter().skip(4).all(Option::is_some), "{ages:?}");
    }

    #[test]
    fn a_pass_needs_recent_detections_of_each_of_its_cameras() {
        let mut schedule = DetectionSchedule::new(PERIOD_US);
        let both = [0, 1].map(CameraIndex);
        assert_eq!(schedule.for_pass(Tick(0), &both[..1]), None, "none yet");
        add(&mut schedule, 10, &[0, 1], 4);
        assert!(schedule.for_pass(Tick(16), &both).is_some());
        assert_eq!(schedule.for_pass(Tick(40), &both), None, "too old");
        add(&mut schedule, 38, &[1], 4);
        assert_eq!(
            schedule.for_pass(Tick(40), &both),
            None,
            "of one camera only"
        );
        assert!(schedule.for_pass(Tick(40), &both[1..]).is_some());
    }
}
