//! Passes at which some cameras show one time, and others another: where every recording lost frames at a moment of its own.
//!
//! Poses follow most of the cameras. Those that fit the poses of another shift, several of them the same, are apart for as long as
//! as many others fit those of no shift: who is followed badly is so for all.

use farfield_proto::tick::Tick;

use super::jump::{EXPLAINS, FITS, PassCosts, PoseJump};

/// Fewest cameras that are apart at a pass, and keypoints of each. With these nothing is told of 91 windows of right recordings (the
/// sample, the Shelf and 13 simulated scenes), most of them of 90 or 120 ticks.
const MIN_CAMERAS: usize = 2;
const MIN_COMPARED: usize = 25;
/// Passes at which a camera that is apart at others shows the time of the poses.
const MIN_ON_TIME: usize = 2;

/// What a camera shows at a pass.
struct Moment<'a> {
    camera: usize,
    /// The shift that fits best, kept poses; `None` where none fits much better than none does.
    shift: Option<isize>,
    costs: &'a [(f64, usize)],
}

impl<'a> Moment<'a> {
    fn of(camera: usize, costs: &'a [(f64, usize)]) -> Self {
        let mut moment = Self {
            camera,
            shift: None,
            costs,
        };
        let reach = moment.reach();
        let known = (-reach..=reach).filter_map(|shift| Some((shift, moment.cost(shift)?)));
        let best = known.min_by(|a, b| a.1.total_cmp(&b.1));
        let fits = |(shift, cost): &(isize, f64)| {
            let now = moment.cost(0);
            let is_now = shift.abs() <= 1;
            *cost < FITS && (is_now || now.is_some_and(|now| *cost < EXPLAINS * now))
        };
        moment.shift = best.filter(fits).map(|(shift, _)| shift);
        moment
    }

    fn reach(&self) -> isize {
        (self.costs.len() / 2).cast_signed()
    }

    fn cost(&self, shift: isize) -> Option<f64> {
        let at = usize::try_from(shift + self.reach()).ok()?;
        let (sum, n) = *self.costs.get(at)?;
        (n >= MIN_COMPARED).then(|| sum / n as f64)
    }

    fn is_on_time(&self) -> bool {
        self.shift.is_some_and(|shift| shift.abs() <= 1)
    }

    /// Whether it shows the time of the poses, and not that of others.
    fn is_on_time_beside(&self, other: isize) -> bool {
        let costs = self.cost(0).zip(self.cost(other));
        self.is_on_time() && costs.is_some_and(|(now, there)| now < EXPLAINS * there)
    }
}

/// Per camera from and until when it is apart with others; `every` tick so many has its poses kept.
pub(in crate::camera_agreement::time_shift) fn jumps_apart(
    costs: &[PassCosts],
    every: i64,
) -> Vec<Option<PoseJump>> {
    let of = |camera: usize| {
        let own: Vec<(Tick, Option<isize>)> = costs[camera]
            .iter()
            .map(|(tick, _)| (*tick, apart(costs, camera, *tick)))
            .collect();
        let from = own.iter().position(|(_, shift)| shift.is_some())?;
        let shift = own[from].1?;
        let inside = own[from..].iter().take_while(|it| it.1.is_some());
        let to = from + inside.count();
        let outside = costs[camera][..from].iter().chain(&costs[camera][to..]);
        let on_time = outside.filter(|(_, costs)| Moment::of(camera, costs).is_on_time());
        let between = |at: usize| Some([own.get(at.checked_sub(1)?)?.0, own.get(at)?.0]);
        let is_alone = own[to..].iter().all(|it| it.1.is_none());
        (is_alone && on_time.count() >= MIN_ON_TIME).then_some(PoseJump {
            between: between(from)?,
            until: Some(between(to)?),
            late_ticks: [0.0, (shift as i64 * every) as f64],
        })
    };
    (0..costs.len()).map(of).collect()
}

/// The shift of a camera at a pass, kept poses, where others have the same then, and as many others have none.
fn apart(costs: &[PassCosts], camera: usize, tick: Tick) -> Option<isize> {
    let at = |(camera, passes): (usize, &'_ PassCosts)| {
        let index = passes.iter().position(|(of, _)| *of == tick)?;
        Some((camera, index))
    };
    let found: Vec<(usize, usize)> = costs.iter().enumerate().filter_map(at).collect();
    let moments = found
        .iter()
        .map(|&(camera, index)| Moment::of(camera, &costs[camera][index].1));
    let moments: Vec<Moment<'_>> = moments.collect();
    let own = moments.iter().find(|moment| moment.camera == camera)?;
    let shift = own.shift.filter(|_| !own.is_on_time())?;
    let is_same = |other: &&Moment<'_>| other.shift.is_some_and(|of| (of - shift).abs() <= 1);
    let same = moments.iter().filter(is_same).count();
    let on_time = moments
        .iter()
        .filter(|other| other.is_on_time_beside(shift));
    (same >= MIN_CAMERAS && on_time.count() >= same).then_some(shift)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twelve kept poses to either side, of which one fits.
    fn costs(shift: isize) -> Vec<(f64, usize)> {
        let cost = |at: isize| if at == shift { 0.2 } else { 0.8 };
        (-12..=12).map(|at| (40.0 * cost(at), 40)).collect()
    }

    /// Passes half a second apart at which cameras fit these shifts.
    fn shown(shifts: &[&[isize]]) -> Vec<PassCosts> {
        let passes = |shifts: &&[isize]| {
            let ticks = (0..).map(|pass| Tick(30 * pass));
            ticks
                .zip(shifts.iter().map(|&shift| costs(shift)))
                .collect()
        };
        shifts.iter().map(passes).collect()
    }

    #[test]
    fn cameras_that_lost_frames_before_others_are_apart_until_these_did() {
        let lost_first: &[isize] = &[0, -6, 0, 0];
        let lost_later: &[isize] = &[0, 0, 0, 0];
        let found = jumps_apart(&shown(&[lost_first, lost_later, lost_first, lost_later]), 2);
        let jump = PoseJump {
            between: [Tick(0), Tick(30)],
            until: Some([Tick(30), Tick(60)]),
            late_ticks: [0.0, -12.0],
        };
        assert_eq!(found, [Some(jump), None, Some(jump), None]);
    }

    #[test]
    fn what_one_camera_shows_or_most_do_is_of_the_poses() {
        let apart: &[isize] = &[0, -6, 0, 0];
        let on_time: &[isize] = &[0, 0, 0, 0];
        for cameras in [
            &[apart, on_time, on_time, on_time],
            &[apart, apart, apart, on_time],
        ] {
            assert_eq!(jumps_apart(&shown(cameras), 2), [None; 4]);
        }
    }
}
