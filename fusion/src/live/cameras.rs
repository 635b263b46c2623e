//! What the statuses of the edges say of their cameras: what is worth a line to the operator, and what the summary says.

use std::collections::BTreeMap;

use farfield_proto::id::CameraIndex;
use farfield_proto::message::live::{CameraHealth, CameraStatus};

/// Statuses of an edge that begins, which has a camera's first picture still to come: it may say so in the first ones, of
/// which two come at once and one a second from then on.
const FIRST_PICTURE: u32 = 5;

/// One camera, as its edge has described it.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRecord {
    /// How it was last.
    pub health: CameraHealth,
    /// Why it gave no pictures when it last gave none, in the words of whatever reads them.
    pub reason: Option<String>,
    /// How often it stopped working.
    pub troubles: u32,
    /// Frames per second, as it was last.
    pub frames_per_s: f32,
    /// What the operator was told last.
    told: CameraHealth,
    /// Statuses in which it may still be without a picture.
    awaited: u32,
}

/// A change that the operator is told.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraNotice {
    /// Which camera.
    pub camera: CameraIndex,
    /// How it is now.
    pub health: CameraHealth,
    /// Why, when it gives no pictures and that is known.
    pub reason: Option<String>,
}

/// All cameras of a run.
#[derive(Debug, Clone, Default)]
pub struct Cameras {
    records: BTreeMap<CameraIndex, CameraRecord>,
}

impl Cameras {
    /// The edge of these cameras begins anew: their first pictures are still to come.
    pub fn begin(&mut self, statuses: &[CameraStatus]) {
        for status in statuses {
            if let Some(record) = self.records.get_mut(&status.camera) {
                record.awaited = FIRST_PICTURE;
            }
        }
    }

    /// Takes a status; what has changed. Two statuses in a row must say it, as pictures may be late for once, and
    /// where the first is still to come, more: a failure is certain at once.
    pub fn hear(&mut self, statuses: &[CameraStatus]) -> Vec<CameraNotice> {
        statuses
            .iter()
            .filter_map(|status| self.hear_one(status))
            .collect()
    }

    fn hear_one(&mut self, status: &CameraStatus) -> Option<CameraNotice> {
        let record = self.records.entry(status.camera).or_insert(CameraRecord {
            health: CameraHealth::Works,
            reason: None,
            troubles: 0,
            frames_per_s: 0.0,
            told: CameraHealth::Works,
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
        if !is_certain || record.told == status.health {
            return None;
        }
        if record.told == CameraHealth::Works {
            record.troubles += 1;
        }
        record.told = status.health;
        Some(CameraNotice {
            camera: status.camera,
            health: status.health,
            reason: status.reason.clone(),
        })
    }

    /// All cameras that were described, by index.
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
    fn a_failure_is_told_once_with_its_reason_and_so_is_its_end() {
        let mut cameras = Cameras::default();
        let failed = status(CameraHealth::Failed, Some("no route to host"));
        let notices = cameras.hear(&failed);
        assert_eq!(notices[0].reason.as_deref(), Some("no route to host"));
        assert_eq!(cameras.hear(&failed), []);
        let works = status(CameraHealth::Works, None);
        assert_eq!(cameras.hear(&works), [], "one picture may be a last one");
        assert_eq!(cameras.hear(&works)[0].health, CameraHealth::Works);
        let (_, record) = cameras.records().next().unwrap();
        assert_eq!(
            (record.troubles, record.reason.as_deref()),
            (1, Some("no route to host"))
        );
    }

    #[test]
    fn a_camera_whose_first_picture_is_still_to_come_is_silent_without_a_word_for_some_seconds() {
        let mut cameras = Cameras::default();
        let silent = status(CameraHealth::Silent, None);
        let works = status(CameraHealth::Works, None);
        let told =
            |cameras: &mut Cameras, n: u32| (0..n).flat_map(|_| cameras.hear(&silent)).count();
        assert_eq!(told(&mut cameras, 3), 0);
        assert_eq!(cameras.hear(&works), [], "it always worked");
        assert_eq!(told(&mut cameras, 2), 1, "it had worked, and does no more");
        // Its edge is started again.
        assert_eq!([&works, &works].map(|it| cameras.hear(it).len()), [0, 1]);
        cameras.begin(&silent);
        assert_eq!(told(&mut cameras, FIRST_PICTURE), 0);
        assert_eq!(told(&mut cameras, 3), 1, "nor does the first ever come");
        let (_, record) = cameras.records().next().unwrap();
        assert_eq!(record.troubles, 2);
    }

    #[test]
    fn a_camera_that_is_late_for_once_is_not_worth_a_line() {
        let mut cameras = Cameras::default();
        for health in [
            CameraHealth::Silent,
            CameraHealth::Works,
            CameraHealth::Black,
        ] {
            assert_eq!(cameras.hear(&status(health, None)), []);
        }
        assert_eq!(cameras.hear(&status(CameraHealth::Black, None)).len(), 1);
    }
}
