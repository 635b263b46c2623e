//! Whether a camera is late, and by how much: by what crops show tick by tick, else by sightings and where people were.

use farfield_proto::tick::Tick;

use super::{Judge, rounded};
use crate::camera_agreement::report::{Disagreement, DisagreementCause};
use crate::camera_agreement::samples::LEAST_BURSTS_S;
use crate::camera_agreement::time_shift::jumps::Jump;
use crate::camera_agreement::time_shift::{LATE_TICKS, Shift, is_same};

/// The same by sightings alone, which say nothing of when within a tick they were taken; and seconds, as poses are kept now
/// and then.
const POSE_LATE_TICKS: f64 = 1.2;
const POSE_LATE_S: f64 = 0.05;
/// What it must leave of the cost; and where fewer seconds are known, as networks err to one side for a while: in a right second of a
/// scene 0.8 ticks left 0.958.
const LATE_EXPLAINS: f64 = 0.96;
const SHORT_S: f64 = 1.5;
const SHORT_EXPLAINS: f64 = 0.9;
/// Shifts from so many ticks on are looked for among so many that one of them explains something by chance.
const FAR_TICKS: f64 = 8.0;
/// What they must leave.
const FAR_EXPLAINS: f64 = 0.7;
/// By which factor sightings must cost more beside where people were by such a shift than beside where they are to speak against it:
/// of who moves on the spot both cost alike.
const ELSEWHERE_THEN: f64 = 1.2;

impl Judge<'_> {
    /// By how many ticks `camera` is late, when that is sure and worth a word.
    pub(super) fn late(&self, camera: usize) -> Option<f64> {
        self.lateness(camera).map(|(ticks, _)| ticks)
    }

    /// The same with what it leaves of the cost: by what crops show, else by sightings and poses.
    pub(in crate::camera_agreement) fn lateness(&self, camera: usize) -> Option<(f64, f64)> {
        let of_crops = || {
            let shift = self.shifts[camera]?;
            let ratio = shift.cost_after / shift.cost_before;
            let is_sure = explains(shift.late_ticks, ratio, self.few_ticks_explain(camera));
            let is_told = shift.late_ticks.abs() >= LATE_TICKS && is_sure;
            let ticks = self.known_late(camera).filter(|_| is_told)?;
            Some((ticks, ratio))
        };
        let of_poses = || {
            let shift = self.pose_shifts[camera]?;
            let ticks = rounded(shift.late_ticks);
            let least = POSE_LATE_TICKS.max(POSE_LATE_S * self.rate_hz);
            // Of few ticks crops know better, where they know.
            let is_known = ticks.abs() < FAR_TICKS && self.known_late(camera).is_some();
            let is_sure = shift.is_steady && explains(ticks, shift.ratio, LATE_EXPLAINS);
            let is_told = ticks.abs() >= least && !is_known && is_sure;
            is_told.then_some((ticks, shift.ratio))
        };
        of_crops()
            .or_else(|| self.late_with_others(camera))
            .or_else(of_poses)
    }

    /// Whether the crops of `camera` may only seem late: its sightings show people where they are, by poses that follow the cameras
    /// which are on time, as these are most; or they tell nothing, and as they are taken its crops fit better than a little earlier or
    /// later.
    fn is_another_step(&self, camera: usize) -> bool {
        let is_far = |shift: &&Shift| shift.late_ticks.abs() >= FAR_TICKS;
        let known = self.shifts.iter().flatten();
        let (far, near): (Vec<&Shift>, Vec<&Shift>) = known.partition(is_far);
        let Some(shift) = self.shifts[camera].as_ref().filter(is_far) else {
            return false;
        };
        let seems = self.fits[camera].late_by_crops;
        let seems = seems.map_or(shift.fits_now, |factor| factor > ELSEWHERE_THEN);
        seems && near.len() > far.len()
    }

    /// What a shift of a few ticks must leave of the cost, by how much is known.
    fn few_ticks_explain(&self, camera: usize) -> f64 {
        if self.shown_s(camera) < SHORT_S {
            SHORT_EXPLAINS
        } else {
            LATE_EXPLAINS
        }
    }

    /// For how many seconds crops of `camera` show somebody.
    fn shown_s(&self, camera: usize) -> f64 {
        let ticks = self.bursts.iter().map(|burst| burst.n_shown(camera));
        ticks.sum::<usize>() as f64 / self.rate_hz
    }

    /// The same of one of several that are late by one time, by what all of them show.
    fn late_with_others(&self, camera: usize) -> Option<(f64, f64)> {
        let group = self.late_group.as_ref()?;
        let ticks = rounded(group.late_ticks);
        group
            .cameras
            .contains(&camera)
            .then_some((ticks, group.ratio))
    }

    /// Cameras that are late in a part of the time. Where several are late by one time all the time, poses follow now these and now
    /// the others, and say nothing of it.
    pub(super) fn find_jumps(
        &self,
        jumps: &[Option<Jump>],
        all: &mut Vec<Disagreement>,
        told: &mut [bool],
    ) {
        let is_known = |jump: &&Jump| self.late_group.is_none() || !jump.is_of_poses;
        for (camera, jump) in jumps.iter().enumerate() {
            let jump = jump.as_ref().filter(is_known);
            if let (false, Some(jump)) = (told[camera], jump) {
                told[camera] = true;
                let [before_ticks, after_ticks] = jump.late_ticks.map(rounded);
                all.push(if let Some(until) = jump.until {
                    let ticks = after_ticks;
                    let late = self.disagreement(&[camera], DisagreementCause::Late { ticks });
                    late.between([jump.at, until], self.rate_hz)
                } else {
                    let cause = DisagreementCause::LateInPart {
                        before_ticks,
                        after_ticks,
                        since_tick: jump.at.0,
                    };
                    self.disagreement(&[camera], cause)
                });
            }
        }
    }

    /// Cameras that are late for some passes beside others that are not. Who is late all the time is so, too, where poses follow
    /// now these cameras and now those.
    pub(super) fn find_apart(&self, all: &mut Vec<Disagreement>, told: &mut [bool]) {
        let is_in_part = |d: &Disagreement| {
            let is_late = matches!(d.cause, DisagreementCause::Late { .. });
            let is_jump = matches!(d.cause, DisagreementCause::LateInPart { .. });
            is_jump || is_late && d.part_ticks.is_some()
        };
        if all.iter().all(is_in_part) {
            self.find_jumps(&self.apart, all, told);
        }
    }

    /// Whether `camera` is late, and that explains most of what it is off.
    pub(in crate::camera_agreement) fn is_clearly_late(&self, camera: usize) -> bool {
        self.lateness(camera)
            .is_some_and(|(_, ratio)| ratio < FAR_EXPLAINS)
    }

    /// Whether `camera` may be late, so that it says nothing of where anybody is.
    pub(in crate::camera_agreement) fn may_be_late(&self, camera: usize) -> bool {
        self.is_clearly_late(camera) || self.drifts[camera].is_some()
    }

    /// By how many ticks `camera` is late, to a hundredth; `None` where nothing moved enough to tell, or the halves of the
    /// keypoints tell otherwise.
    pub(super) fn known_late(&self, camera: usize) -> Option<f64> {
        let shift = self.shifts[camera].filter(|shift| shift.is_sharp)?;
        if self.is_another_step(camera) || self.shown_s(camera) < LEAST_BURSTS_S {
            return None;
        }
        let halves = [&self.halves[0], &self.halves[1]].map(|half| half[camera]);
        let halves = [halves[0]?.late_ticks, halves[1]?.late_ticks];
        is_told_by(halves, shift.late_ticks).then_some((100.0 * shift.late_ticks).round() / 100.0)
    }
}

impl Disagreement {
    /// The same of a camera that is late between these ticks alone.
    fn between(self, [from, to]: [Tick; 2], rate_hz: f64) -> Self {
        let at = |tick: Tick| format!("{} ({:.1} s)", tick.0, tick.0 as f64 / rate_hz);
        Self {
            part_ticks: Some([from.0, to.0]),
            found: format!(
                "between about ticks {} and {}, and not before or after, {}",
                at(from),
                at(to),
                self.found
            ),
            remedy: "recordings lost frames, or hold some twice, at moments of their own, this one at either of these: write them with \
                     their time stamps (`ffmpeg -fps_mode cfr`) or record anew without gaps; live: look at the load of the boxes"
                .to_owned(),
            ..self
        }
    }
}

/// Whether both halves of the keypoints tell the shift that all together do: where few people move little, a few keypoints that
/// are off decide where the least cost of all is.
fn is_told_by([first, second]: [f64; 2], all: f64) -> bool {
    is_same(first, second) && is_same(all, 0.5 * (first + second))
}

/// Whether a shift in time that leaves `ratio` of the cost is no chance, where one of few ticks must leave less than `few`.
fn explains(ticks: f64, ratio: f64, few: f64) -> bool {
    let most = if ticks.abs() < FAR_TICKS {
        few
    } else {
        FAR_EXPLAINS
    };
    ratio < most
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_agreement::fixture::Hall;
    use crate::camera_agreement::judge::before::JudgedBefore;
    use crate::camera_agreement::time_shift::groups::LateGroup;

    #[test]
    fn of_a_jump_that_only_poses_tell_nothing_is_said_where_several_are_late_by_one_time() {
        let samples = Hall::default().samples();
        let mut before = JudgedBefore::default();
        let mut judge = Judge::new(&samples.cameras, &samples.samples, &mut before);
        let jump = |is_of_poses| Jump {
            late_ticks: [-12.0, 0.0],
            at: Tick(16),
            until: None,
            is_of_poses,
        };
        let n_told = |judge: &Judge<'_>, is_of_poses| {
            let jumps = [Some(jump(is_of_poses)), None, None, None];
            let (mut all, mut told) = (Vec::new(), vec![false; 4]);
            judge.find_jumps(&jumps, &mut all, &mut told);
            all.len()
        };
        assert_eq!(n_told(&judge, true), 1);
        judge.late_group = Some(LateGroup {
            cameras: vec![2, 3],
            late_ticks: -15.0,
            ratio: 0.5,
        });
        assert_eq!(n_told(&judge, true), 0);
        assert_eq!(n_told(&judge, false), 1);
    }

    #[test]
    fn of_a_camera_that_shows_somebody_for_a_second_a_shift_of_a_tick_must_explain_more_and_less_tells_nothing()
     {
        let samples = Hall::default().samples();
        let mut before = JudgedBefore::default();
        let mut judge = Judge::new(&samples.cameras, &samples.samples, &mut before);
        assert!(explains(0.8, 0.95, judge.few_ticks_explain(1)));
        assert!(judge.known_late(1).is_some());
        judge.bursts.truncate(1);
        let shown = judge.bursts[0].n_shown(1) as f64;
        judge.rate_hz = shown / 1.4;
        assert!(!explains(0.8, 0.95, judge.few_ticks_explain(1)));
        assert!(explains(3.0, 0.6, judge.few_ticks_explain(1)));
        assert!(judge.known_late(1).is_some());
        judge.rate_hz = shown / 0.7;
        assert_eq!(judge.known_late(1), None);
    }

    #[test]
    fn a_camera_whose_sightings_are_where_people_are_is_not_two_steps_late() {
        let samples = Hall::default().samples();
        let mut before = JudgedBefore::default();
        let mut judge = Judge::new(&samples.cameras, &samples.samples, &mut before);
        let late = |ticks: f64| {
            Some(Shift {
                late_ticks: ticks,
                cost_before: 0.17,
                cost_after: 0.11,
                is_sharp: true,
                fits_now: true,
            })
        };
        let set = |judge: &mut Judge<'_>, camera: usize, ticks: f64| {
            judge.shifts[camera] = late(ticks);
            for half in &mut judge.halves {
                half[camera] = late(ticks);
            }
        };
        set(&mut judge, 2, 51.0);
        for (fits_now, by_sightings, expected) in [
            (true, Some(0.9), Some(51.0)),
            (true, Some(1.5), None),
            (true, None, None),
            (false, None, Some(51.0)),
        ] {
            judge.shifts[2].as_mut().unwrap().fits_now = fits_now;
            judge.fits[2].late_by_crops = by_sightings;
            let told = (judge.late(2), judge.known_late(2));
            assert_eq!(told, (expected, expected), "{by_sightings:?}");
        }
        // Where as many are late, poses may follow these.
        set(&mut judge, 3, 51.0);
        assert_eq!(judge.late(2), Some(51.0));
    }

    #[test]
    fn a_shift_that_neither_half_of_the_keypoints_tells_is_none() {
        assert!(is_told_by([3.1, 3.4], 3.3));
        assert!(!is_told_by([-0.5, -0.8], -3.3));
        assert!(!is_told_by([0.0, -3.3], -3.3));
    }
}
