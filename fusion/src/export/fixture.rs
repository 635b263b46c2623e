//! A small person for the tests of this folder: two joints, one keypoint, three angles.

use std::cell::RefCell;
use std::io;
use std::path::Path;

use farfield_proto::id::{PersonId, SessionId};
use farfield_proto::message::{PersonPose, PersonState, PoseSet};
use farfield_proto::tick::Tick;

use super::{AngleColumn, KeypointColumn, Layout};

/// Its columns.
pub fn layout() -> Layout {
    let knee = AngleColumn {
        range_rad: Some([0.0, 2.268_928]),
        ..AngleColumn::named("knee_angle_l")
    };
    Layout {
        joints: vec!["pelvis".to_owned(), "left_knee".to_owned()],
        is_marker: vec![true; 2],
        keypoints: vec![KeypointColumn {
            index: 0,
            name: "left_knee".to_owned(),
        }],
        angles: vec![
            AngleColumn::named("pelvis_tilt"),
            AngleColumn::named("pelvis_tx"),
            knee,
        ],
    }
}

/// Its pose at any tick.
pub fn pose(person: u32, state: PersonState) -> PersonPose {
    PersonPose {
        person: PersonId(person),
        state,
        joints_m: vec![[1.0, 2.0, 0.9], [1.25, -2.000_004, 0.5]],
        keypoints_m: vec![[1.26, -2.0, 0.5]],
        sigma_m: vec![0.012, 0.023_46],
        angles: vec![std::f32::consts::FRAC_PI_6, 2.5, 0.41],
        unobserved: 0b100,
        views: 4,
    }
}

/// Several of them at a tick.
pub fn poses(tick: i64, persons: &[(u32, PersonState)]) -> PoseSet {
    PoseSet {
        session: SessionId(1),
        tick: Tick(tick),
        persons: persons.iter().map(|&(id, state)| pose(id, state)).collect(),
    }
}

/// The work that fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Work {
    /// Writing bytes.
    Write,
    /// Bringing bytes to the disk.
    Sync,
    /// Joining two files.
    Join,
}

/// The system's "Input/output error".
const EIO: i32 = 5;

thread_local! {
    static FAILING: RefCell<Option<(&'static str, Work, u32)>> = const { RefCell::new(None) };
}

/// Makes the next `times` of `work` on files whose name begins with `name` fail.
pub fn fail(name: &'static str, work: Work, times: u32) {
    FAILING.set(Some((name, work, times)));
}

/// Fails if requested.
///
/// # Errors
/// The error that [`fail`] has asked for.
pub fn check(path: &Path, work: Work) -> io::Result<()> {
    FAILING.with_borrow_mut(|failing| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        match failing {
            Some((begins, fails, times))
                if *times > 0 && *fails == work && name.starts_with(*begins) =>
            {
                *times -= 1;
                Err(io::Error::from_raw_os_error(EIO))
            }
            _ => Ok(()),
        }
    })
}
