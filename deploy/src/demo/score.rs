//! The error of the poses of one tick, at once and without a file; and the score of the whole demo.

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

use anyhow::Context as _;
use farfield_fusion::body::skeleton::{Joint, Joints};
use farfield_fusion_node::Body;
use farfield_proto::tick::Tick;
use farfield_score::lines::{LinesRole, PoseLines, TruthExtent};
use farfield_score::points::{LIMB_POINTS, PointSet};
use farfield_score::{GATE_M, score};
use nalgebra::Vector3;

/// Mean distance of the 12 limb joints, metres, over the true people that have a pose within the gate of the score.
/// Each true person is compared with the nearest pose. `None` without such a pair.
pub(super) fn mean_error_m(bodies: &[Body], truth_m: &[Joints]) -> Option<f64> {
    let limbs = limb_joints();
    let nearest = truth_m.iter().filter_map(|person_m| {
        let distances = bodies
            .iter()
            .filter_map(|body| distance_m(body, person_m, &limbs));
        distances.filter(|&d| d <= GATE_M).reduce(f64::min)
    });
    let errors: Vec<f64> = nearest.collect();
    (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64)
}

fn limb_joints() -> Vec<usize> {
    let is_limb = |joint: &Joint| LIMB_POINTS.contains(&joint.name());
    Joint::ALL
        .into_iter()
        .filter(is_limb)
        .map(Joint::index)
        .collect()
}

fn distance_m(body: &Body, person_m: &Joints, limbs: &[usize]) -> Option<f64> {
    let distances = limbs.iter().map(|&joint| {
        let at = Vector3::from(body.joints_m.get(joint)?.map(f64::from));
        Some((at - person_m[joint]).norm())
    });
    let sum: f64 = distances.sum::<Option<f64>>()?;
    Some(sum / limbs.len() as f64)
}

/// The table of joint errors.
pub(super) fn table(
    poses: &Path,
    truth: &Path,
    ticks: &Range<Tick>,
    rate_hz: f64,
) -> anyhow::Result<String> {
    let poses = read(poses, LinesRole::Poses, ticks)?;
    let truth = read(truth, LinesRole::Truth, ticks)?;
    if truth.is_empty() {
        return Ok("the truth contains no person, so there is no score\n".to_owned());
    }
    let scores = score(&poses, &truth, TruthExtent::Whole, Some(rate_hz));
    Ok(format!("{scores}\n"))
}

fn read(path: &Path, role: LinesRole, ticks: &Range<Tick>) -> anyhow::Result<PoseLines> {
    let file = File::open(path).with_context(|| format!("opening {}", path.display()))?;
    let reader = BufReader::new(file);
    Ok(PoseLines::read(
        reader,
        path,
        role,
        PointSet::Joints,
        Some(ticks),
    )?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn standing_at(x_m: f64) -> Joints {
        std::array::from_fn(|joint| Vector3::new(x_m, 0.0, joint as f64 * 0.05))
    }

    fn body(person: u32, joints_m: &Joints) -> Body {
        let joint = |m: &Vector3<f64>| [m.x as f32, m.y as f32, m.z as f32];
        Body {
            person,
            joints_m: joints_m.iter().map(joint).collect(),
        }
    }

    #[test]
    fn every_person_is_compared_with_the_nearest_pose() {
        let truth = [standing_at(0.0), standing_at(2.0)];
        let poses = [body(1, &standing_at(2.02)), body(2, &standing_at(0.04))];
        let error_m = mean_error_m(&poses, &truth).unwrap();
        assert!((error_m - 0.03).abs() < 1e-6, "{error_m}");
    }

    #[test]
    fn poses_far_from_all_people_have_no_error() {
        let truth = [standing_at(0.0)];
        assert_eq!(mean_error_m(&[body(1, &standing_at(3.0))], &truth), None);
        assert_eq!(mean_error_m(&[], &truth), None);
        let cut = Body {
            person: 1,
            joints_m: vec![[0.0; 3]; 3],
        };
        assert_eq!(mean_error_m(&[cut], &truth), None);
    }
}
