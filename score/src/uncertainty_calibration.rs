//! Calibration of the reported uncertainty: errors per axis by the `sigma_m` of their lines.
//!
//! Each joint and tick has three errors, one per world axis, and one sigma. They are collected by class (the state of the
//! pose) in histograms over sigma, so that the memory does not grow with time, and scenes can be added. The goal (`58..78` %
//! within one sigma; normal errors have 68 %) applies to each fifth of the sigmas and to each state.
//!
//! A coasting pose is compared with its last matched person at any distance: a new matching would leave out the errors that
//! matter.

use std::collections::BTreeMap;
use std::fmt;

use farfield_proto::message::PersonState;
use nalgebra::Vector3;
use serde::ser::{Serialize, SerializeMap as _, Serializer};

use super::points::{JointDetail, LIMB_POINTS, ScoredBody, Sureness};
use farfield_fusion::body::skeleton::Joint;

/// Bins per decade of sigma: 1.2 % wide, finer than the decimals of a small sigma.
const BINS_PER_DECADE: f64 = 200.0;
/// Metres at which the bins begin; smaller values are in the first.
const FIRST_M: f64 = 1e-5;
/// Views from which a tracked pose counts as `tracked`, not `two_views`.
const MANY_VIEWS: u16 = 3;

/// Classes of poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    Tracked,
    TwoViews,
    Coasting,
}

impl Class {
    const ALL: [Self; 3] = [Self::Tracked, Self::TwoViews, Self::Coasting];

    /// `None` for tentative poses: they are not confirmed yet.
    fn from_sureness(sureness: &Sureness) -> Option<Self> {
        match sureness.state {
            PersonState::Tentative => None,
            PersonState::Tracked if sureness.views >= MANY_VIEWS => Some(Self::Tracked),
            PersonState::Tracked => Some(Self::TwoViews),
            PersonState::Coasting => Some(Self::Coasting),
        }
    }

    const fn name(self) -> &'static str {
        match self {
            Self::Tracked => "tracked",
            Self::TwoViews => "two_views",
            Self::Coasting => "coasting",
        }
    }
}

/// Sums over joints and ticks with about the same sigma.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Bin {
    n: u64,
    sigma_sum_m: f64,
    square_sum_m2: f64,
    within: [u64; 2],
}

impl Bin {
    fn add(&mut self, other: &Self) {
        self.n += other.n;
        self.sigma_sum_m += other.sigma_sum_m;
        self.square_sum_m2 += other.square_sum_m2;
        for (count, more) in self.within.iter_mut().zip(other.within) {
            *count += more;
        }
    }

    fn row(&self) -> Option<CalibrationRow> {
        let axes = 3.0 * self.n as f64;
        (self.n > 0).then(|| CalibrationRow {
            n: self.n,
            sigma_mm: 1000.0 * self.sigma_sum_m / self.n as f64,
            rms_mm: 1000.0 * (self.square_sum_m2 / axes).sqrt(),
            inside_1: 100.0 * self.within[0] as f64 / axes,
            inside_2: 100.0 * self.within[1] as f64 / axes,
        })
    }
}

/// Errors of a group of joints and their sigmas.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct CalibrationRow {
    /// Number of joints times ticks; each has three errors.
    pub n: u64,
    /// Mean sigma, millimetres.
    pub sigma_mm: f64,
    /// Root mean square of the errors per axis, millimetres.
    pub rms_mm: f64,
    /// Share of the errors within one sigma, percent.
    pub inside_1: f64,
    /// Share within two sigmas, percent.
    pub inside_2: f64,
}

/// Bins by class and index of the bin.
type SigmaHistogram = BTreeMap<(Class, i32), Bin>;

/// The rows for one choice of joints.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct CalibrationRows {
    /// Groups of equal size by rising sigma; fewer than five for few sigmas.
    pub fifths: Vec<CalibrationRow>,
    /// By state: `tracked` (three views and more), `two_views` (and fewer), `coasting`; only those that occur.
    pub states: BTreeMap<&'static str, CalibrationRow>,
}

impl CalibrationRows {
    fn from_histogram(histogram: &SigmaHistogram) -> Self {
        let mut by_sigma: BTreeMap<i32, Bin> = BTreeMap::new();
        let mut states = BTreeMap::new();
        for class in Class::ALL {
            let mut sum = Bin::default();
            for ((_, sigma), bin) in histogram.iter().filter(|((c, _), _)| *c == class) {
                sum.add(bin);
                by_sigma.entry(*sigma).or_default().add(bin);
            }
            states.extend(sum.row().map(|row| (class.name(), row)));
        }
        let total: u64 = by_sigma.values().map(|bin| bin.n).sum();
        let (mut fifths, mut before) = ([Bin::default(); 5], 0);
        for bin in by_sigma.values() {
            // A bin belongs to the fifth that contains its middle.
            let middle = before + bin.n / 2;
            fifths[(5 * middle / total.max(1)).min(4) as usize].add(bin);
            before += bin.n;
        }
        Self {
            fifths: fifths.iter().filter_map(Bin::row).collect(),
            states,
        }
    }
}

/// The errors of all poses with a reported uncertainty.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct UncertaintyCalibration {
    limbs: SigmaHistogram,
    all: SigmaHistogram,
}

impl UncertaintyCalibration {
    /// Whether no pose reported an uncertainty.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Adds the errors of another run.
    pub fn add(&mut self, other: &Self) {
        let both = [(&mut self.limbs, &other.limbs), (&mut self.all, &other.all)];
        for (mine, theirs) in both {
            for (key, bin) in theirs {
                mine.entry(*key).or_default().add(bin);
            }
        }
    }

    /// The rows of the 12 scored limb joints.
    pub fn limb_rows(&self) -> CalibrationRows {
        CalibrationRows::from_histogram(&self.limbs)
    }

    /// The rows of all 29 joints.
    pub fn all_rows(&self) -> CalibrationRows {
        CalibrationRows::from_histogram(&self.all)
    }

    fn add_pose(&mut self, truth: &JointDetail, pose: &JointDetail) {
        let Some(sureness) = &pose.sureness else {
            return;
        };
        let Some(class) = Class::from_sureness(sureness) else {
            return;
        };
        for (i, joint) in Joint::ALL.into_iter().enumerate() {
            let sigma_m = f64::from(sureness.sigma_m[i]);
            let [a, b] = [pose, truth].map(|d| Vector3::from(d.joints_m[i].map(f64::from)));
            let off_m = a - b;
            if !sigma_m.is_finite() || !off_m.iter().all(|v| v.is_finite()) {
                continue;
            }
            let within = |sigmas: f64| {
                off_m
                    .iter()
                    .filter(|off_m| off_m.abs() <= sigmas * sigma_m)
                    .count() as u64
            };
            let bin = Bin {
                n: 1,
                sigma_sum_m: sigma_m,
                square_sum_m2: off_m.norm_squared(),
                within: [within(1.0), within(2.0)],
            };
            let at = ((sigma_m.max(FIRST_M) / FIRST_M).log10() * BINS_PER_DECADE) as i32;
            self.all.entry((class, at)).or_default().add(&bin);
            if LIMB_POINTS.contains(&joint.name()) {
                self.limbs.entry((class, at)).or_default().add(&bin);
            }
        }
    }
}

impl Serialize for UncertaintyCalibration {
    /// The rows of the limbs as `fifths` and `states`, and those of all joints under `all_joints`.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let limbs = self.limb_rows();
        let mut map = serializer.serialize_map(Some(3))?;
        map.serialize_entry("fifths", &limbs.fifths)?;
        map.serialize_entry("states", &limbs.states)?;
        map.serialize_entry("all_joints", &self.all_rows())?;
        map.end()
    }
}

impl fmt::Display for UncertaintyCalibration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let head = format!(
            "{:>8} {:>8} {:>7} {:>6} {:>6}",
            "n", "sigma mm", "RMS mm", "in 1s", "in 2s"
        );
        let (limbs, all) = (self.limb_rows(), self.all_rows());
        write!(
            f,
            "{:<12}{:>40}   {:>40}\n{:<12}{head}   {head}",
            "calibration", "12 limb joints, per axis", "all 29 joints, per axis", ""
        )?;
        let mut row = |name: &str, rows: [Option<&CalibrationRow>; 2]| {
            write!(f, "\n{name:>11}")?;
            rows.iter().try_for_each(|row| match row {
                Some(row) => write!(
                    f,
                    " {:>8} {:>8.1} {:>7.1} {:>6.1} {:>6.1}  ",
                    row.n, row.sigma_mm, row.rms_mm, row.inside_1, row.inside_2
                ),
                None => write!(f, " {:>40}  ", "-"),
            })
        };
        for i in 0..all.fifths.len().max(limbs.fifths.len()) {
            let name = format!("fifth {}", i + 1);
            row(&name, [limbs.fifths.get(i), all.fifths.get(i)])?;
        }
        for (name, all) in &all.states {
            row(name, [limbs.states.get(name), Some(all)])?;
        }
        Ok(())
    }
}

/// Collects the errors tick by tick.
#[derive(Debug, Clone, Default)]
pub(super) struct UncertaintyTally {
    /// Per id, the actor of its last match.
    last: BTreeMap<u32, u32>,
    calibration: UncertaintyCalibration,
}

impl UncertaintyTally {
    /// Adds one tick; `matched` are pairs of an actor and the id of its pose.
    pub(super) fn add(
        &mut self,
        truths: &BTreeMap<u32, ScoredBody>,
        poses: &BTreeMap<u32, ScoredBody>,
        matched: impl Iterator<Item = (u32, u32)>,
    ) {
        let is_coasting = |pose: &ScoredBody| {
            let sureness = pose.detail.as_ref().and_then(|d| d.sureness.as_ref());
            sureness.is_some_and(|s| s.state == PersonState::Coasting)
        };
        let now: BTreeMap<u32, u32> = matched.map(|(actor, id)| (id, actor)).collect();
        for (id, pose) in poses {
            if !is_coasting(pose) {
                match now.get(id) {
                    Some(actor) => self.last.insert(*id, *actor),
                    None => self.last.remove(id),
                };
            }
            let truth = self.last.get(id).and_then(|actor| truths.get(actor));
            let details =
                truth.and_then(|truth| Some((truth.detail.as_ref()?, pose.detail.as_ref()?)));
            if let Some((truth, pose)) = details {
                self.calibration.add_pose(truth, pose);
            }
        }
    }

    /// `None` if no pose reported an uncertainty.
    pub(super) fn finish(self) -> Option<UncertaintyCalibration> {
        (!self.calibration.is_empty()).then_some(self.calibration)
    }
}

#[cfg(test)]
mod tests {
    use farfield_fusion::body::skeleton::N_JOINTS;

    use super::*;

    /// A body whose joints all lie at `x_m`, `y_m`, 1.
    fn body(x_m: f64, y_m: f64, sureness: Option<Sureness>) -> ScoredBody {
        let at = move |_: &str| Some(Vector3::new(x_m, y_m, 1.0));
        ScoredBody {
            detail: Some(Box::new(JointDetail::gather(at, sureness))),
            ..ScoredBody::default()
        }
    }

    fn sure(state: PersonState, views: u16, sigma_m: f32) -> Sureness {
        Sureness {
            state,
            views,
            sigma_m: [sigma_m; N_JOINTS],
        }
    }

    fn one<T>(value: T) -> BTreeMap<u32, T> {
        BTreeMap::from([(1, value)])
    }

    fn check(actual: f64, expected: f64) {
        // The joints are f32.
        assert!(
            (actual - expected).abs() < 1e-3,
            "{actual} is not {expected}"
        );
    }

    #[test]
    fn errors_are_counted_per_axis() {
        let mut tally = UncertaintyTally::default();
        let pose = body(0.03, 0.015, Some(sure(PersonState::Tracked, 4, 0.02)));
        tally.add(&one(body(0.0, 0.0, None)), &one(pose), [(1, 1)].into_iter());
        let calibration = tally.finish().unwrap();
        let (limbs, all) = (calibration.limb_rows(), calibration.all_rows());
        assert_eq!(
            (limbs.states["tracked"].n, all.states["tracked"].n),
            (12, 29)
        );
        let row = &limbs.states["tracked"];
        check(row.sigma_mm, 20.0);
        check(row.rms_mm, 1000.0 * ((0.0009f64 + 0.000_225) / 3.0).sqrt());
        check(row.inside_1, 200.0 / 3.0);
        check(row.inside_2, 100.0);
    }

    #[test]
    fn tentative_poses_do_not_count_and_states_have_rows() {
        let mut tally = UncertaintyTally::default();
        for (state, views) in [
            (PersonState::Tentative, 4),
            (PersonState::Tracked, 3),
            (PersonState::Tracked, 2),
            (PersonState::Coasting, 0),
        ] {
            let pose = body(0.0, 0.0, Some(sure(state, views, 0.02)));
            tally.add(&one(body(0.0, 0.0, None)), &one(pose), [(1, 1)].into_iter());
        }
        let rows = tally.finish().unwrap().all_rows();
        let counts: Vec<_> = rows
            .states
            .iter()
            .map(|(name, row)| (*name, row.n))
            .collect();
        assert_eq!(
            counts,
            [("coasting", 29), ("tracked", 29), ("two_views", 29)]
        );
    }

    #[test]
    fn a_coasting_pose_is_compared_with_its_last_person_at_any_distance() {
        let mut tally = UncertaintyTally::default();
        let truths = BTreeMap::from([(1, body(0.0, 0.0, None)), (2, body(9.0, 0.0, None))]);
        let tracked = body(0.0, 0.0, Some(sure(PersonState::Tracked, 4, 0.02)));
        tally.add(&truths, &one(tracked), [(1, 1)].into_iter());
        let drifted = body(9.0, 0.0, Some(sure(PersonState::Coasting, 0, 0.5)));
        tally.add(&truths, &one(drifted), [(2, 1)].into_iter());
        let row = tally.finish().unwrap().all_rows().states["coasting"];
        check(row.inside_1, 200.0 / 3.0);
        assert!(row.rms_mm > 5000.0, "{}", row.rms_mm);
    }

    #[test]
    fn fifths_have_equal_size_and_rising_sigmas() {
        let mut tally = UncertaintyTally::default();
        for step in 1..=50u16 {
            let pose = body(
                0.0,
                0.0,
                Some(sure(PersonState::Tracked, 4, 0.01 * f32::from(step))),
            );
            tally.add(&one(body(0.0, 0.0, None)), &one(pose), [(1, 1)].into_iter());
        }
        let fifths = tally.finish().unwrap().all_rows().fifths;
        assert!(fifths.iter().all(|row| row.n == 10 * 29), "{fifths:?}");
        assert!(fifths.is_sorted_by(|a, b| a.sigma_mm < b.sigma_mm));
    }

    #[test]
    fn runs_add_up_and_poses_without_sigmas_do_not_count() {
        let mut tally = UncertaintyTally::default();
        let truth = one(body(0.0, 0.0, None));
        tally.add(&truth, &one(body(0.0, 0.0, None)), [(1, 1)].into_iter());
        assert_eq!(tally.clone().finish(), None);
        let pose = one(body(0.0, 0.0, Some(sure(PersonState::Tracked, 4, 0.01))));
        tally.add(&truth, &pose, [(1, 1)].into_iter());
        let one = tally.finish().unwrap();
        let mut two = one.clone();
        two.add(&one);
        assert_eq!(two.all_rows().states["tracked"].n, 58);
        let json = serde_json::to_value(&two).unwrap();
        assert_eq!(json["states"]["tracked"]["n"], 24);
        assert_eq!(json["all_joints"]["fifths"][0]["n"], 58);
        assert!(two.to_string().contains("tracked"));
    }
}
