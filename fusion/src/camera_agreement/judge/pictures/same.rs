//! Two cameras that show the same picture: one recording that was given for both.

use super::super::super::report::DisagreementCause;
use super::super::super::samples::SeenBody;
use super::super::{Findings, Judge, MIN_KEYPOINTS};

/// Pixels by which the keypoints of two cameras differ at most that show the same picture: their crops are not the same.
const SAME_PX: f32 = 6.0;

impl Judge<'_> {
    /// Two cameras whose keypoints stand in the same pixels at every pass.
    pub(in super::super) fn find_same_pictures(&self, findings: &mut Findings) {
        let all: Vec<usize> = (0..self.cameras.len()).collect();
        // Of people who stand in a ring opposite cameras show the same; but their lines of sight meet those of the others.
        let right = self.taken_for_right(&all);
        let are_right = |a, b| right.len() > 2 && right.contains(&a) && right.contains(&b);
        // Two cameras on one pole may look the same way.
        for (a, b) in self.pairs_of(&all) {
            if !are_right(a, b) && self.show_the_same(a, b) {
                findings.add(self, &[a, b], DisagreementCause::SamePictures);
            }
        }
    }

    fn show_the_same(&self, a: usize, b: usize) -> bool {
        let (mut n, mut same) = (0, 0);
        for pass in &self.passes {
            for one in pass.surest(a) {
                let others = pass.of_camera[b].iter();
                let others = others.map(|other| same_pixels(one, other));
                let (own, common) = others.max().unwrap_or_default();
                same += own;
                n += common;
            }
        }
        n >= MIN_KEYPOINTS && same * 10 >= n * 7
    }
}

/// How many keypoints of two sightings are in the same pixels, and how many both have.
fn same_pixels(one: &SeenBody, other: &SeenBody) -> (usize, usize) {
    let pairs = one
        .iter()
        .zip(other)
        .filter_map(|(p, q)| Some((p.as_ref()?, q.as_ref()?)));
    let near = |p: f32, q: f32| (p - q).abs() <= SAME_PX;
    pairs.fold((0, 0), |(same, n), (p, q)| {
        let is_same = near(p.pixel[0], q.pixel[0]) && near(p.pixel[1], q.pixel[1]);
        (same + usize::from(is_same), n + 1)
    })
}
