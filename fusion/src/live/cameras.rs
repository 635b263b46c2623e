//! Camera health from the statuses of the edges: messages for the operator, and data for the
//! summary.

use std::collections::BTreeMap;

use farfield_proto::id::CameraIndex;
use farfield_proto::message::live::{CameraHealth, CameraStatus};

/// Number of first statuses of an edge that may report a camera without a picture: two come at
/// once, then one a second.
const FIRST_PICTURE: u32 = 5;

/// One camera, as its edge reports it.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRecord {
    /// The last health.
    pub health: CameraHealth,
    /// Why it gave no pictures the last time, in the words of its reader.
    pub reason: Option<String>,
    /// How often it stopped working.
    pub troubles: u32,
    /// Last frames per second.
    pub frames_per_s: f32,
    /// The last health that was reported to the operator.
    reported: CameraHealth,
    /// Remaining statuses in which it may be without a picture.
    awaited: u32,
}

/// A change to report to the operator.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraNotice {
    /// Which camera.
    pub camera: CameraIndex,
    /// The new health.
    pub health: CameraHealth,
    /// Why it gives no pictures, if known.
    pub reason: Option<String>,
}

/// All cameras of a run.
#[derive(Debug, Clone, Default)]
pub struct Cameras {
    records: BTreeMap<CameraIndex, CameraRecord>,
}

impl Cameras {
    /// The edge of these cameras restarts: their first pictures are still to come.
    pub fn begin(&mut self, statuses: &[CameraStatus]) {
        for status in statuses {
            if let Some(record) = self.records.get_mut(&status.camera) {
                record.awaited = FIRST_PICTURE;
            }
        }
    }

    /// Processes a status; returns the changes. A change needs two statuses in a row, because a
    /// picture may be late once, and more before the first picture. A failure is certain at once.
    pub fn update(&mut self, statuses: &[CameraStatus]) -> Vec<CameraNotice> {
        statuses
            .iter()
            .filter_map(|status| self.update_one(status))
            .collect()
    }

    fn update_one(&mut self, status: &CameraStatus) -> Option<CameraNotice> {
        let record = self.records.entry(status.camera).or_insert(CameraRecord {
            health: CameraHealth::Works,
            reason: None,
            troubles: 0,
            frames_per_s: 0.0,
            reported: CameraHealth::Works,
            awaited: FIRST_PICTURE,
        });
        let is_silent = status.health == CameraHealth::Silent;
        let is_awaited = is_silent && record.awaited > 0;
        record.awaited = if is_silent {
            record.awaited.saturating_sub(1)
        } else {
            0
        };
        let is_certain = !is_awaited
            && (status.health == record.health || status.health == CameraHealth::Failed);
        record.health = status.health;
        record.frames_per_s = status.frames_per_s;
        if status.reason.is_some() {
            record.reason.clone_from(&status.reason);
        }
        if !is_certain || record.reported == status.health {
            return None;
        }
        if record.reported == CameraHealth::Works {
            record.troubles += 1;
        }
        record.reported = status.health;
        Some(CameraNotice {
            camera: status.camera,
            health: status.health,
            reason: status.reason.clone(),
        })
    }

    /// All reported cameras, by index.
    pub fn records(&self) -> impl Iterator<Item = (CameraIndex, &CameraRecord)> {
        self.records
            .iter()
            .map(|(camera, record)| (*camera, record))
    }
}

/// The health in words, after "camera X".
pub fn in_words(health: CameraHealth) -> &'static str {
    match health {
        CameraHealth::Works => "works",
        CameraHealth::Frozen => "gives the same picture over and over",
        CameraHealth::Black => "gives black pictures",
        CameraHealth::Silent => "gives no pictures",
        CameraHealth::Failed => "has failed, and is opened again until it works",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(health: CameraHealth, reason: Option<&str>) -> [CameraStatus; 1] {
        [CameraStatus {
            camera: CameraIndex(4),
            health,
            frames_per_s: 59.5,
            capture_offset_us: 0,
            reason: reason.map(str::to_owned),
        }]
    }

    #[test]
    fn a_failure_and_its_end_are_reported_once() {
        let mut cameras = Cameras::default();
        let failed = status(CameraHealth::Failed, Some("no route to host"));
        let notices = cameras.update(&failed);
        assert_eq!(notices[0].reason.as_deref(), Some("no route to host"));
        assert_eq!(cameras.update(&failed), []);
        let works = status(CameraHealth::Works, None);
        assert_eq!(cameras.update(&works), [], "one picture may be a last one");
        assert_eq!(cameras.update(&works)[0].health, CameraHealth::Works);
        let (_, record) = cameras.records().next().unwrap();
        assert_eq!(
            (record.troubles, record.reason.as_deref()),
            (1, Some("no route to host"))
        );
    }

    #[test]
    fn silence_before_the_first_picture_is_not_reported_at_once() {
        let mut cameras = Cameras::default();
        let silent = status(CameraHealth::Silent, None);
        let works = status(CameraHealth::Works, None);
        let notices =
            |cameras: &mut Cameras, n: u32| (0..n).flat_map(|_| cameras.update(&silent)).count();
        assert_eq!(notices(&mut cameras, 3), 0);
        assert_eq!(cameras.update(&works), [], "it always worked");
        assert_eq!(
            notices(&mut cameras, 2),
            1,
            "it had worked, and does no more"
        );
        // Its edge restarts.
        assert_eq!([&works, &works].map(|it| cameras.update(it).len()), [0, 1]);
        cameras.begin(&silent);
        assert_eq!(notices(&mut cameras, FIRST_PICTURE), 0);
        assert_eq!(notices(&mut cameras, 3), 1, "nor does the first ever come");
        let (_, record) = cameras.records().next().unwrap();
        assert_eq!(record.troubles, 2);
    }

    #[test]
    fn one_late_picture_is_not_reported() {
        let mut cameras = Cameras::default();
        for health in [
            CameraHealth::Silent,
            CameraHealth::Works,
            CameraHealth::Black,
        ] {
            assert_eq!(cameras.update(&status(health, None)), []);
        }
        assert_eq!(cameras.update(&status(CameraHealth::Black, None)).len(), 1);
    }
}
